"""How fast the system forgets: the decay rate of what decays last, negative where everything decays.

α = max over the poles of Re p;   what is left of a disturbance fades as e^{α t}
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import TOUCHES, Absent, Found, SystemMetric
from engine.model.tangent import INFINITESIMAL
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.frequency.poles import Poles
    from engine.metrics._base import Finding, SystemSubject


@final
class SpectralAbscissa(SystemMetric):
    """The decay rate of what decays last."""

    kind: ClassVar[str] = "spectral_abscissa"
    title: ClassVar[str] = "Spectral abscissa"
    unit: ClassVar[str] = "1/s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Largest real part of any pole: below 0 the rate at which what lasts longest decays; 0 for an integrator."
    )
    range: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    source: ClassVar[str] = (
        "L. N. Trefethen, M. Embree, Spectra and Pseudospectra, chapter 14; with delays W. Michiels, S.-I. Niculescu, "
        "Stability, Control, and Computation for Time-Delay Systems, 2nd ed., section 1.2"
    )
    time_power: ClassVar[float] = -1

    @classmethod
    def measure(cls, subject: SystemSubject) -> Finding:
        """Return the value or the reason why there is none."""
        poles = subject.poles
        if poles.neutral:
            return Absent(
                verdict=Verdict.UNSTABLE,
                advice="a loop of delays and direct gains echoes without end: it has no last pole",
            )
        if not len(poles.values):
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice="the system has no poles: nothing in it decays")
        first = 0  # by falling real part
        value = 0.0 if poles.at_zero[first] or poles.on_axis[first] else float(poles.values[first].real)
        motion = poles.motion[first].real
        return Found(
            value=value + 1j * INFINITESIMAL * motion if motion.any() else np.full(motion.shape, value),
            at=float(abs(poles.values[first].imag)),
            kinked=_tied(poles),
        )


def _tied(poles: Poles) -> bool:
    """Return whether another pole is as far to the right and moves otherwise: then the larger of both has a kink."""
    values, motion = poles.values, poles.motion.real
    near = np.abs(values.real - values[0].real) <= TOUCHES * abs(values[0]) + poles.uncertainty + poles.uncertainty[0]
    return bool(np.any(np.abs(motion[near] - motion[0]) > TOUCHES * np.abs(motion[0]).max(initial=0.0)))
