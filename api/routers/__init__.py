"""The paths of the API: each reads its request, calls one use case, and says what comes back."""

from __future__ import annotations

from api.routers import catalog, datasets, health, jobs, results, spectra, studies, systems

ROUTERS = (
    systems.router,
    studies.router,
    spectra.router,
    jobs.router,
    datasets.router,
    results.router,
    catalog.router,
)
HEALTH = health.router
