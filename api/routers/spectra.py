"""The Fourier analyser."""

from __future__ import annotations

from fastapi import APIRouter, Response

from api.http.auth import Runner
from api.http.bodies import DocumentRoute
from api.http.calls import BY_A_WORKER, CreationDep, Prefer
from api.schemas.spectra import SpectrumReply, SpectrumRequest

router = APIRouter(prefix="/v1", tags=["studies"], route_class=DocumentRoute)


@router.post("/spectra", response_model=SpectrumReply, responses=BY_A_WORKER, summary="Spectrum")
async def spectrum(request: SpectrumRequest, caller: Runner, creation: CreationDep, prefer: Prefer = None) -> Response:
    """Amplitudes, densities, harmonics and band energies of a recording or of a simulated output."""
    return await creation.study(caller, "spectrum", request, kept=request.keep, prefer=prefer)
