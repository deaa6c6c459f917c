"""The Fourier analyser."""

from __future__ import annotations

from fastapi import APIRouter, Response

from api.auth import Runner
from api.bodies import DocumentRoute
from api.calls import CreationDep, InstallationDep
from api.schemas.spectra import SpectrumReply, SpectrumRequest
from api.services import spectra

router = APIRouter(prefix="/v1", tags=["studies"], route_class=DocumentRoute)


@router.post("/spectra", response_model=SpectrumReply, summary="Spectrum")
def spectrum(request: SpectrumRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Amplitudes, densities, harmonics and band energies of a recording or of a simulated output."""
    return creation.study(caller, "spectrum", lambda: spectra.run_spectra(service, caller, request), kept=request.keep)
