"""The paths of the API: each reads its request, calls one use case, and says what comes back."""

from __future__ import annotations

from api.routers import (
    acquisition_templates,
    acquisitions,
    agents,
    audit,
    catalog,
    comments,
    datasets,
    frfs,
    health,
    jobs,
    keys,
    lineage,
    openid,
    processing,
    reports,
    results,
    schedules,
    sign_ins,
    spectra,
    studies,
    systems,
    validations,
    webhooks,
    workspaces,
)

ROUTERS = (
    systems.router,
    studies.router,
    spectra.router,
    frfs.router,
    validations.router,
    jobs.router,
    datasets.router,
    processing.router,
    results.router,
    reports.router,
    comments.router,
    lineage.router,
    catalog.router,
    schedules.router,
    webhooks.router,
    agents.router,
    acquisitions.router,
    acquisition_templates.router,
    keys.router,
    workspaces.router,
    sign_ins.router,
    audit.router,
)
HEALTH = health.router
SIGN_IN = openid.router
