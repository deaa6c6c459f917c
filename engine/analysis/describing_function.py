"""Limit cycles by the describing function: a law is replaced by what it makes of a sine, its gain N(A) for the fundamental.

    N(A) G(jω) = 1,   G from the law's output back to its input   (with a sign turned at the summing point: N G = -1)

N(A) is the law's own closed form where there is one, and the Fourier integral of its response to a sine else. A cycle is
stable where a growing amplitude makes the loop decay: W(s) = 1/G(s) = N(A) moves by Δs = N'(A)/W'(s) ΔA, and Re Δs < 0.

References
----------
A. Gelb, W. Vander Velde, "Multiple-Input Describing Functions and Nonlinear System Design", McGraw-Hill 1968, chapters 2
and 3 (gains; Loeb's criterion); J.-J. E. Slotine, W. Li, "Applied Nonlinear Control", Prentice Hall 1991, chapter 5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.fourier import transform
from engine.exact.laws.laws import Law, law_values
from engine.exact.laws.system import MATRICES, NonlinearSystem
from engine.exact.nonlinear.integrate import Integration
from engine.signals import make

if TYPE_CHECKING:
    from engine.elements._base import Values
    from engine.elements._nonlinear import NonlinearElement

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Gain = Callable[[Real], Complex]

_DECADES: Final = (-9, 9)
_PER_DECADE: Final = 60
_NEWTON: Final = 30
_STEP: Final = 1e-6
_SAME: Final = 1e-4
"""Two solutions closer than this, relative to themselves, are one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """A limit cycle as the describing function has it: ``amplitude`` at the law's input, ``frequency`` in rad/s."""

    amplitude: float
    frequency: float
    gain: complex
    stable: bool


def fourier_gain(element: type[NonlinearElement], values: Values, amplitude: float, frequency: float = 1.0) -> complex:
    """Return N(A) from the simulated response of a law with one input and one output to A sin ωt, its second period.

    Parameters
    ----------
    element : NonlinearElement
    values : mapping
        Real values, complete.
    amplitude : float
        > 0, unit of the input.
    frequency : float
        rad/s; of no influence unless the law has a rate of its own.

    Raises
    ------
    ValueError
        If the law has not one input and one output, or cannot be followed for two periods.
    """
    ports = element.ports(values)
    if len(ports.inputs) != 1 or len(ports.outputs) != 1:
        msg = f"a describing function must be that of one input and one output, got {element.kind}"
        raise ValueError(msg)
    shapes = dict.fromkeys(MATRICES, (1, 0, 0)) | {
        "b1": (1, 0, 1), "b3": (1, 0, 1), "c1": (1, 1, 0), "c3": (1, 1, 0), "d11": (1, 1, 1), "d12": (1, 1, 0),
        "d13": (1, 1, 1), "d21": (1, 0, 1), "d23": (1, 0, 1), "d31": (1, 1, 1), "d32": (1, 1, 0), "d33": (1, 1, 1),
        "delays": (1, 0), "x0": (1, 0),
    }  # fmt: skip
    matrices: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
    matrices["d13"][:], matrices["d31"][:] = 1.0, 1.0
    lanes, real = law_values(values)
    law = Law(
        element=element, label=element.kind, at=(), values=lanes, real=real, states=slice(0, len(element.initial(real))),
        inputs=slice(0, 1), outputs=slice(0, 1),
    )  # fmt: skip
    system = NonlinearSystem(matrices, [law], ("u",), ("y",))
    sine = make("sine", {"amplitude": amplitude, "frequency": frequency})
    period = 2 * np.pi / frequency
    outcome = Integration(system, {"u": sine}).advance(2 * period)
    if outcome.end < 2 * period * (1 - 1e-9):
        msg = f"{element.kind} must be followed for two periods of a sine, got {outcome.end:g} s: {outcome.advice}"
        raise ValueError(msg)
    line = transform(outcome.output(0).since(period), np.array([frequency])).value[0]
    # ∫ A sin ωt e^-jωt over a period is -j A/2 of its length
    return complex(line * 2j / (period * amplitude))


def cycles(gain: Gain, frequencies: Real, loop: Callable[[Real], Complex], scale: float) -> list[Cycle]:
    """Return every solution of N(A) G(jω) = 1 that a scan shows, in the order of its frequency.

    Parameters
    ----------
    gain : callable
        N at amplitudes (k,), complex.
    frequencies : ndarray, shape (m,)
        Rising, rad/s: close enough for G to be nearly straight between neighbours.
    loop : callable
        G at frequencies (k,).
    scale : float
        An amplitude from which nine decades are looked at in either direction.
    """
    count = (_DECADES[1] - _DECADES[0]) * _PER_DECADE + 1
    amplitudes = scale * np.logspace(*_DECADES, count)
    with np.errstate(all="ignore"):
        curve, locus = gain(amplitudes), 1.0 / loop(frequencies)
    found: list[Cycle] = []
    for i, k in _crossings(curve, locus):
        solved = _solved(gain, loop, float(amplitudes[i]), float(frequencies[k]))
        if solved is not None and not any(_alike(solved, other) for other in found):
            found.append(solved)
    return sorted(found, key=lambda cycle: (cycle.frequency, cycle.amplitude))


def _crossings(first: Complex, second: Complex) -> list[tuple[int, int]]:
    """Return which segments of two polylines in the plane cross."""
    p, r = first[:-1, None], np.diff(first)[:, None]
    q, s = second[None, :-1], np.diff(second)[None]
    with np.errstate(all="ignore"):
        area = (np.conj(r) * s).imag
        along = (np.conj(q - p) * s).imag / area
        across = (np.conj(q - p) * r).imag / area
    hit = np.isfinite(area) & (area != 0) & (along >= 0) & (along <= 1) & (across >= 0) & (across <= 1)
    return [(int(i), int(k)) for i, k in zip(*np.nonzero(hit), strict=True)]


def _solved(gain: Gain, loop: Callable[[Real], Complex], amplitude: float, frequency: float) -> Cycle | None:
    """Return the solution near a crossing, by Newton's method in ln A and ln ω; None where it leads elsewhere."""
    start = place = np.log([amplitude, frequency])
    for _ in range(_NEWTON):
        n, w, dn, dw = _slopes(gain, loop, place)
        miss = n - w
        jacobian = np.array([[dn.real, -dw.real], [dn.imag, -dw.imag]])
        if not np.isfinite(jacobian).all() or np.linalg.matrix_rank(jacobian) < 2:
            return None
        step = -np.linalg.solve(jacobian, [miss.real, miss.imag])
        place = place + np.clip(step, -0.3, 0.3)
        if np.abs(step).max() <= 1e-10:
            break
    n, w, dn, dw = _slopes(gain, loop, place)
    if abs(n - w) > 1e-6 * abs(w) or np.abs(place - start).max() > 1.0:
        return None
    size, rate = (float(value) for value in np.exp(place))
    # ln A grows by 1: N moves by dn; W'(s) = dW/dω / j, and dW/dω = dw/ω
    return Cycle(amplitude=size, frequency=rate, gain=complex(n), stable=bool((dn / (dw / (1j * rate))).real < 0))


def _slopes(gain: Gain, loop: Callable[[Real], Complex], place: Real) -> tuple[complex, complex, complex, complex]:
    """Return N, W = 1/G and their slopes by ln A and ln ω."""
    steps = np.array([-_STEP, 0.0, _STEP])
    with np.errstate(all="ignore"):
        n = gain(np.exp(place[0] + steps))
        w = 1.0 / loop(np.exp(place[1] + steps))
    return complex(n[1]), complex(w[1]), complex((n[2] - n[0]) / (2 * _STEP)), complex((w[2] - w[0]) / (2 * _STEP))


def _alike(one: Cycle, other: Cycle) -> bool:
    return (
        abs(one.frequency - other.frequency) <= _SAME * other.frequency
        and abs(one.amplitude - other.amplitude) <= _SAME * other.amplitude
    )
