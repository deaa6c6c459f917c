"""Mass, friction and offset of a drive from its motion and its force, by one linear regression.

    F = M ẍ + b ẋ + F_c s(ẋ) + c + Σ_k a_k z_k,     s = sign ẋ, or tanh(ẋ/v_s)

It needs no simulation and no start, and holds in open and in closed loop; what it minimises is the error of the equation,
which is neither a simulation fit nor a prediction of the motion. Every column is low-passed and decimated like the force, so
that filters bias nothing but what they smear: the instants where the friction changes its sign.

References
----------
M. Gautier, "Dynamic identification of robots with power model", IEEE ICRA 1997, 1922-1927.
A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System Identification
Benchmarks 2019.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from engine.model.errors import ProcessingError
from engine.recordings.fit import Fit, compare
from engine.recordings.processing.differentiate import differentiated
from engine.recordings.processing.zero_phase import ZeroPhaseFilter, filtered
from optimizers.estimation.confidence import correlations, covariance
from optimizers.problem import ProblemError

Samples = npt.NDArray[np.float64]

NORMAL_95 = 1.959963984540054
STRONG_CORRELATION = 0.95
_SAMPLES_PER_TERM = 10
_SAME = 1e-8
"""A combination of the (scaled) columns smaller than this says nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveRecording:
    """What was measured, SI: the force (or torque) of the drive, and its position or its velocity.

    Parameters
    ----------
    force : ndarray, shape (samples,)
    position, velocity : ndarray, optional
        One of them; a velocity that was measured is not derived again.
    further : mapping of str to ndarray
        Other signals that the force is linear in: a pressure, whose coefficient is an area.
    sample_time : float
        s.
    """

    force: Samples
    sample_time: float
    position: Samples | None = None
    velocity: Samples | None = None
    further: Mapping[str, Samples] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.position is None) == (self.velocity is None):
            got = "both" if self.position is not None else "none"
            raise ProblemError(f"one of position and velocity must be recorded, got {got}", at=("position",))
        if not (self.sample_time > 0 and math.isfinite(self.sample_time)):
            raise ProblemError(f"sample_time must be > 0 s, got {self.sample_time}", at=("dataset",))
        for name, signal in self.signals.items():
            if signal.ndim != 1 or signal.size != self.force.size:
                raise ProblemError(
                    f"{name} must have {self.force.size} samples as the force has, got {signal.size}", at=(name,)
                )
            if not np.isfinite(signal).all():
                raise ProblemError(f"{name} must be finite at every sample, got NaN or infinity", at=(name,))
            if name != "force" and np.ptp(signal) == 0:
                raise ProblemError(f"{name} must vary, got a constant", at=(name,))

    @property
    def signals(self) -> dict[str, Samples]:
        """Everything that was measured, by name."""
        motion = {"position": self.position, "velocity": self.velocity}
        return {"force": self.force, **{k: v for k, v in motion.items() if v is not None}, **self.further}


@dataclass(frozen=True, slots=True, kw_only=True)
class Treatment:
    """What is done to the signals before the regression.

    Parameters
    ----------
    low_pass : float, optional
        rad/s: edge of a Butterworth filter of order ``order``, forward and backward, on the motion before it is derived.
    decimation : int
        One sample of so many is kept, behind a Chebyshev filter of order 8 on every column; 1: all.
    dropped : int
        Samples left out at the beginning, where the filters settle.
    least_velocity : float
        Slower samples are left out at last: what sticks obeys no such equation.
    transition_velocity : float
        v_s of a dry friction that turns smoothly; 0: at once. A drive that stands has the sign of its noise: where it stands
        long, this choice decides on the offset.
    """

    low_pass: float | None = None
    order: int = 4
    decimation: int = 1
    dropped: int = 0
    least_velocity: float = 0.0
    transition_velocity: float = 0.0

    def __post_init__(self) -> None:
        if not 1 <= self.decimation <= 100:
            raise ProblemError(f"decimation must be 1 to 100, got {self.decimation}", at=("decimation",))
        if self.dropped < 0:
            raise ProblemError(f"dropped must be >= 0 samples, got {self.dropped}", at=("dropped",))
        for name, value in (
            ("least_velocity", self.least_velocity),
            ("transition_velocity", self.transition_velocity),
        ):
            if not (value >= 0 and math.isfinite(value)):
                raise ProblemError(f"{name} must be >= 0, got {value:g}", at=(name,))


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """A coefficient of the equation (SI) with its 95 % interval."""

    value: float
    lower95: float
    upper95: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveFit:
    """The regression.

    Attributes
    ----------
    terms : mapping of str to Term
        ``mass``, ``viscous``, ``coulomb``, ``offset``; with friction of its own in each direction ``viscous_negative`` and
        ``coulomb_negative`` in place of ``offset``; further signals by their names.
    equation_error : Fit
        Force measured against the force of the equation, after the treatment: no simulation.
    correlations : ndarray, shape (terms, terms)
    indistinguishable : tuple of str
        Terms that this motion does not tell apart.
    samples : int
        Left for the regression.
    force, computed : ndarray, shape (samples,)
        Of the equation.
    """

    terms: Mapping[str, Term]
    equation_error: Fit
    correlations: Samples
    indistinguishable: tuple[str, ...]
    samples: int
    force: Samples
    computed: Samples


def drive_parameters(
    recording: DriveRecording,
    treatment: Treatment | None = None,
    *,
    asymmetric: bool = False,
    inertia: bool = True,
    viscous: bool = True,
) -> DriveFit:
    """Return the coefficients of the equation.

    Parameters
    ----------
    recording : DriveRecording
    treatment : Treatment, optional
        None by default.
    asymmetric : bool
        Whether the friction is another in each direction; it then takes the place of the offset, which is no other thing
        than half the difference of the two dry frictions.
    inertia, viscous : bool
        Whether mass and viscous friction are asked for; strokes of one constant velocity show neither.

    Raises
    ------
    ProblemError
        For a recording too short, or one that never moves in a direction that is asked for.
    """
    treatment = treatment or Treatment()
    try:
        velocity = _velocity(recording, treatment)
        columns = _columns(recording, velocity, treatment, asymmetric=asymmetric, inertia=inertia, viscous=viscous)
        moving = np.abs(_treated(velocity, recording, treatment)) >= treatment.least_velocity
        force = _treated(recording.force, recording, treatment)[moving]
        table = np.stack([_treated(column, recording, treatment)[moving] for column in columns.values()], axis=1)
    except ProcessingError as error:
        raise ProblemError(error.message, at=error.at or ("treatment",)) from error
    fewest = _SAMPLES_PER_TERM * len(columns)
    if len(force) < fewest:
        raise ProblemError(
            f"the recording must keep at least {fewest} samples for {len(columns)} terms, got {len(force)}",
            at=("dataset",),
        )
    scale = np.linalg.norm(table, axis=0)
    for name, size in zip(columns, scale, strict=True):
        if size == 0:
            raise ProblemError(f"{name} must be excited to be found, got no motion that shows it", at=("position",))
    found = np.linalg.lstsq(table / scale, force, rcond=_SAME)[0] / scale
    computed = table @ found
    cov = covariance([table], [force - computed])
    deviation = NORMAL_95 * np.sqrt(np.diag(cov))
    return DriveFit(
        terms={
            name: Term(value=float(p), lower95=float(p - d), upper95=float(p + d))
            for name, p, d in zip(columns, found, deviation, strict=True)
        },
        equation_error=compare(force, computed),
        correlations=correlations(cov),
        indistinguishable=_sentences(tuple(columns), correlations(cov)),
        samples=len(force),
        force=force,
        computed=computed,
    )


def _velocity(recording: DriveRecording, treatment: Treatment) -> Samples:
    """Return the low-passed velocity."""
    rate = 1 / recording.sample_time
    motion = recording.velocity if recording.position is None else recording.position
    assert motion is not None  # one of them is there, by DriveRecording
    if treatment.low_pass is not None:
        design = ZeroPhaseFilter(band="low_pass", frequency=treatment.low_pass, order=treatment.order)
        motion = filtered(motion, rate, design)
    return motion if recording.position is None else differentiated(motion, rate)


def _columns(
    recording: DriveRecording,
    velocity: Samples,
    treatment: Treatment,
    *,
    asymmetric: bool,
    inertia: bool,
    viscous: bool,
) -> dict[str, Samples]:
    """Return what each coefficient is multiplied by, at every sample."""
    columns = {"mass": differentiated(velocity, 1 / recording.sample_time)} if inertia else {}
    smooth = treatment.transition_velocity
    turned = np.tanh(velocity / smooth) if smooth else np.sign(velocity)
    up, down = np.maximum(turned, 0.0), np.maximum(-turned, 0.0)
    if asymmetric:
        columns |= (
            {"viscous": np.maximum(velocity, 0.0), "viscous_negative": np.minimum(velocity, 0.0)} if viscous else {}
        )
        columns |= {"coulomb": up, "coulomb_negative": -down}
    else:
        columns |= {"viscous": velocity} if viscous else {}
        columns |= {"coulomb": turned, "offset": np.ones_like(velocity)}
    return columns | dict(recording.further)


def _treated(signal: Samples, recording: DriveRecording, treatment: Treatment) -> Samples:
    """Return a column without its beginning, low-passed and decimated; the last sample is kept."""
    signal = signal[treatment.dropped :]
    if treatment.decimation == 1:
        return signal
    rate = 1 / recording.sample_time
    design = ZeroPhaseFilter(
        band="low_pass",
        frequency=0.8 * math.pi * rate / treatment.decimation,
        order=8,
        family="chebyshev1",
        ripple=0.05,
    )
    return filtered(signal, rate, design)[(signal.size - 1) % treatment.decimation :: treatment.decimation]


def _sentences(names: tuple[str, ...], matrix: Samples) -> tuple[str, ...]:
    return tuple(
        f"{names[j]} and {names[i]} are hard to tell apart (correlation {matrix[i, j]:.3f}): move so that they differ"
        for i in range(len(names))
        for j in range(i)
        if abs(matrix[i, j]) > STRONG_CORRELATION
    )
