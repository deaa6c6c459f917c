"""Receptance, mobility and accelerance of one structure.

displacement/force · (jω)ⁿ:   n = 0 receptance (dynamic compliance), 1 mobility, 2 accelerance
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from engine.model.errors import SpectrumError
from engine.recordings.spectra.frf import Frf

Form = Literal["receptance", "mobility", "accelerance"]

_DERIVATIVES: dict[Form, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
MOTIONS = {"m": 0, "m/s": 1, "m/s**2": 2, "rad": 0, "rad/s": 1, "rad/s**2": 2}
_UNITS = {"m": ("m", "m/s", "m/s**2"), "rad": ("rad", "rad/s", "rad/s**2")}


def in_form(frf: Frf, form: Form, *, unit: str) -> tuple[Frf, str]:
    """Return a response function of a displacement, velocity or acceleration as one of another of these.

    Parameters
    ----------
    frf : Frf
        Lines > 0 rad/s.
    form : {"receptance", "mobility", "accelerance"}
    unit : str
        SI unit of the response that was measured.

    Returns
    -------
    Frf, str
        And the SI unit of the response now.

    Raises
    ------
    SpectrumError
        For a response that is no motion.
    """
    if unit not in MOTIONS:
        msg = f"output must be a displacement, velocity or acceleration for the form {form}, got one in {unit or 'no unit'}"
        raise SpectrumError(msg, at=("form",))
    power = _DERIVATIVES[form]
    factor = (1j * frf.frequency) ** (power - MOTIONS[unit])
    target = _UNITS["rad" if unit.startswith("rad") else "m"][power]
    return replace(frf, value=frf.value * factor), target
