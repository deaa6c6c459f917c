"""Frequency metrics of many systems of one structure at once.

A scan over frequencies brackets peaks and crossings. The value at the place found is always computed by solving, and its
derivatives by the solution's tangent,  F x = r:  F ẋ = ṙ - Ḟ x.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from engine.batch import stacks
from engine.batch.frequency.scan import Path, Readings, Scan
from engine.model.linear_system import Array

SMALLEST_LOOP_GAIN = 1e-9
"""Crossings of a loop gain below this are not counted."""
_ON_THE_AXIS = 1e-6
_FLAT = 1e-3
_ASIDE, _REACHED = 1e-4, 0.02
"""How far to the side of a peak its slope is looked at, and how far off the scan may see it, as parts of its frequency."""


def solved(path: Path, rows: Array, omega: Array) -> tuple[Array, Array, Array]:
    """Return G(jω), its tangent by the infinitesimals and its derivative by ω, each (k,), for systems ``rows``.

    The tangent is not divided by the size of the infinitesimal.
    """
    n, ports = path.a.shape[1], path.d.shape[1]
    m = ports - 1
    k = len(rows)
    tau = path.delays[rows]
    turn = np.exp(1j * omega[:, None] * tau.real)
    f = np.zeros((k, n + m, n + m), dtype=complex)
    slope = np.zeros_like(f)
    tangent = np.zeros_like(f)
    variable, moves = path.variable(omega)
    f[:, :n, :n] = variable[:, None, None] * np.eye(n) - path.a[rows].real
    slope[:, :n, :n] = moves[:, None, None] * np.eye(n)
    tangent[:, :n, :n] = -path.a[rows].imag
    if m:
        f[:, :n, n:], f[:, n:, :n] = -path.b[rows, :, 1:].real, -path.c[rows, 1:].real
        f[:, n:, n:] = turn[:, :, None] * np.eye(m) - path.d[rows, 1:, 1:].real
        slope[:, n:, n:] = (1j * tau.real * turn)[:, :, None] * np.eye(m)
        tangent[:, :n, n:], tangent[:, n:, :n] = -path.b[rows, :, 1:].imag, -path.c[rows, 1:].imag
        tangent[:, n:, n:] = (1j * omega[:, None] * tau.imag * turn)[:, :, None] * np.eye(m) - path.d[rows, 1:, 1:].imag
    right = np.concatenate([path.b[rows, :, :1], path.d[rows, 1:, :1]], axis=1)
    read = np.concatenate([path.c[rows, :1], path.d[rows, :1, 1:]], axis=2)
    direct = path.d[rows, 0, 0]
    x = stacks.solve(f, right.real.astype(complex))
    z = stacks.solve(f, np.concatenate([right.imag - tangent @ x, -slope @ x], axis=2))
    real = read.real.astype(complex)
    value = (real @ x)[:, 0, 0] + direct.real
    moved = (real @ z[:, :, :1] + read.imag @ x)[:, 0, 0] + direct.imag
    return value, moved, (real @ z[:, :, 1:])[:, 0, 0]


def _newton(
    path: Path, rows: Array, omega: Array, level: Callable[[Array], Array], slope_of: Callable[[Array, Array], Array]
) -> Array:
    """Return crossings after two Newton steps on the system itself; they were found to about 1e-6."""
    for _ in range(2):
        g, _, slope = solved(path, rows, omega)
        fall = slope_of(g, slope)
        shift = level(g) / np.where(fall == 0, np.inf, fall)
        omega = np.where(np.abs(shift) < 1e-3 * omega, omega - shift, omega)
    return omega


def _dual(value: Array, tangent: Array) -> Array:
    return value + 1j * tangent


def _peak(path: Path, scan: Scan, shape: Callable[[Array], Array], slope: Callable[[Array], Array]) -> Readings:
    """Return max |shape(G)|; ``slope`` is the derivative of the shape by G."""
    everyone = np.arange(path.batch)
    omega = _summit(path, scan.peak(lambda g, _: np.abs(shape(g))), shape, slope)
    value, tangent, _ = solved(path, everyone, omega)
    shaped = shape(value)
    size = np.abs(shaped)
    moved = (np.conj(shaped) * slope(value) * tangent).real / np.where(size > 0, size, 1.0)
    return Readings(value=_dual(size, moved), doubtful=~np.isfinite(size))


def _summit(path: Path, omega: Array, shape: Callable[[Array], Array], slope: Callable[[Array], Array]) -> Array:
    """Return peaks after a secant step on the system itself: the scan may be that of a neighbour with distinct poles."""

    def tilt(at: Array) -> Array:
        value, _, moved = solved(path, np.arange(path.batch), at)
        return (np.conj(shape(value)) * slope(value) * moved).real

    beside = omega * (1 + _ASIDE)
    first, second = tilt(omega), tilt(beside)
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = -first * (beside - omega) / (second - first)
    return np.where((second < first) & (np.abs(shift) < _REACHED * omega), omega + shift, omega)


def path_peak(path: Path, scan: Scan) -> Readings:
    """Return max |G|."""
    return _peak(path, scan, lambda g: g, np.ones_like)


def sensitivity_peak(path: Path, scan: Scan) -> Readings:
    """Return max |1 / (1 + L)|."""
    return _peak(path, scan, lambda g: 1 / (1 + g), lambda g: -1 / (1 + g) ** 2)


def complementary_peak(path: Path, scan: Scan) -> Readings:
    """Return max |L / (1 + L)|."""
    return _peak(path, scan, lambda g: g / (1 + g), lambda g: 1 / (1 + g) ** 2)


def bandwidth(path: Path, scan: Scan) -> Readings:
    """First ω at which |G| has fallen 3 dB below |G(0)|; infinite where it never does."""
    batch = path.batch
    everyone = np.arange(batch)
    with np.errstate(divide="ignore", invalid="ignore"):
        static, moved_static, _ = solved(path, everyone, np.zeros(batch))
    level = np.abs(static.real) * 10**-0.15
    rows, omega, doubtful = scan.crossings(lambda g, systems: np.abs(g) - level[systems, None], first_fall=True)
    value = np.full(batch, np.inf, dtype=complex)
    omega = _newton(
        path, rows, omega, lambda g: np.abs(g) - level[rows], lambda g, slope: (np.conj(g) * slope).real / np.abs(g)
    )
    g, moved, slope = solved(path, rows, omega)
    size = np.abs(g)
    doubtful = _unknown(doubtful | np.isnan(static.real), rows, size)
    fall = (np.conj(g) * slope).real / size
    level_moved = np.sign(static.real) * moved_static.real * 10**-0.15
    shift = (level_moved[rows] - (np.conj(g) * moved).real / size) / fall
    value[rows] = _dual(omega, shift)
    scale = np.abs(scan.response).max(axis=1)
    value[np.abs(static.real) <= 1e-9 * scale] = np.nan
    return Readings(value=value, doubtful=doubtful)


def _nearest(doubtful: Array, rows: Array, value: Array, order: Array) -> Readings:
    """Return for each system the value whose ``order`` is smallest, infinite where there is none; ``doubtful`` (B,) stay so."""
    result = np.full(len(doubtful), np.inf, dtype=complex)
    for index in np.argsort(-order, kind="stable"):
        result[rows[index]] = value[index]
    return Readings(value=result, doubtful=_unknown(doubtful, rows, value.real))


def _unknown(doubtful: Array, rows: Array, found: Array) -> Array:
    """Return who is doubtful (B,), with those of ``rows`` that lie exactly at a pole, where nothing is ``found``."""
    more = np.zeros_like(doubtful)
    more[rows[np.isnan(found)]] = True
    return np.asarray(doubtful | more)


def balanced_peak(path: Path, scan: Scan) -> Readings:
    """Return 1 / max |S - 1/2|, the symmetric disk margin."""
    found = _peak(path, scan, lambda g: 0.5 * (1 - g) / (1 + g), lambda g: -1 / (1 + g) ** 2)
    return Readings(value=1 / found.value, doubtful=found.doubtful)


def _gain_margins(path: Path, scan: Scan) -> tuple[Array, Array, Array]:
    """Return (systems, -1 / L with infinitesimals) wherever L is real and negative, both ends of the axis included, and who is doubtful."""
    rows, omega, doubtful = scan.crossings(lambda g, _: g.imag)
    omega = _newton(path, rows, omega, lambda g: g.imag, lambda _, slope: slope.imag)
    value, moved, slope = solved(path, rows, omega)
    shift = -moved.imag / np.where(slope.imag == 0, np.inf, slope.imag)
    real = _dual(value.real, moved.real + slope.real * shift)
    counts = (value.real < -SMALLEST_LOOP_GAIN) & (np.abs(value.imag) < _ON_THE_AXIS * np.abs(value.real))
    everyone, (first, second) = np.arange(path.batch), scan.response[:, :2].T
    flat = (np.abs(second - first) < _FLAT * np.abs(first)) & (np.abs(first.imag) < _FLAT * np.abs(first.real))
    resting = everyone[flat & (first.real < -SMALLEST_LOOP_GAIN)]
    value, moved, _ = solved(path, resting, scan.frequencies[resting, 0])
    direct = path.at_the_end + 0j
    passing = everyone[(direct.real < -SMALLEST_LOOP_GAIN) & (path.delays.shape[1] == 0)]
    doubtful = _unknown(doubtful | np.isnan(direct.real), rows, real.real)
    gains = np.concatenate([real[counts], _dual(value.real, moved.real), direct[passing]])
    return np.concatenate([rows[counts], resting, passing]), -1 / gains, doubtful


def gain_margin(path: Path, scan: Scan) -> Readings:
    """-1 / L where L is real and negative, nearest 1 on a logarithmic scale."""
    rows, margin, doubtful = _gain_margins(path, scan)
    found = _nearest(doubtful, rows, margin, np.abs(np.log(margin.real)))
    # a crossing that the scan steps over is nearer to 1 only where |L| is
    nearest = np.minimum(np.abs(found.value.real), 1 / np.abs(found.value.real))
    return Readings(value=found.value, doubtful=doubtful | scan.hidden(np.maximum(nearest, SMALLEST_LOOP_GAIN)))


def gain_margin_up(path: Path, scan: Scan) -> Readings:
    """The smallest gain margin above 1."""
    rows, margin, doubtful = _gain_margins(path, scan)
    rows, margin = rows[margin.real > 1], margin[margin.real > 1]
    found = _nearest(doubtful, rows, margin, margin.real)
    smallest = np.maximum(1 / found.value.real, SMALLEST_LOOP_GAIN)
    return Readings(value=found.value, doubtful=doubtful | scan.hidden(smallest))


def gain_margin_down(path: Path, scan: Scan) -> Readings:
    """The largest gain margin below 1, 0 where there is none."""
    rows, margin, doubtful = _gain_margins(path, scan)
    rows, margin = rows[margin.real < 1], margin[margin.real < 1]
    found = _nearest(doubtful, rows, margin, -margin.real).value
    return _unless_hidden(scan, Readings(value=np.where(np.isinf(found), 0.0, found), doubtful=doubtful))


def _phase_margins(path: Path, scan: Scan) -> tuple[Array, Array, Array, Array]:
    """Return (systems, frequencies, π + arg L), both with infinitesimals, wherever |L| = 1, and who is doubtful."""
    rows, omega, doubtful = scan.crossings(lambda g, _: np.abs(g) - 1)
    omega = _newton(path, rows, omega, lambda g: np.abs(g) - 1, lambda g, slope: (np.conj(g) * slope).real / np.abs(g))
    value, moved, slope = solved(path, rows, omega)
    # d ln L = (d ln|L|, d arg L)
    by_parameter, by_frequency = moved / value, slope / value
    shift = -by_parameter.real / np.where(by_frequency.real == 0, np.inf, by_frequency.real)
    angle = np.angle(-value)
    return rows, _dual(omega, shift), _dual(angle, by_parameter.imag + by_frequency.imag * shift), doubtful


def phase_margin(path: Path, scan: Scan) -> Readings:
    """π + arg L where |L| = 1, nearest 0."""
    rows, _, angle, doubtful = _phase_margins(path, scan)
    return _unless_hidden(scan, _nearest(doubtful, rows, angle, np.abs(angle.real)))


def delay_margin(path: Path, scan: Scan) -> Readings:
    """The smallest of (π + arg L in [0, 2π)) / ω where |L| = 1."""
    rows, omega, angle, doubtful = _phase_margins(path, scan)
    margin = np.where(angle.real < 0, angle + 2 * np.pi, angle) / omega
    return _unless_hidden(scan, _nearest(doubtful, rows, margin, margin.real))


def _unless_hidden(scan: Scan, found: Readings) -> Readings:
    """Doubt what is found at |L| = 1 where a loop gain of 1 turns round more often than is looked at: the loop may be unstable."""
    return Readings(value=found.value, doubtful=found.doubtful | scan.hidden(np.ones(len(found.value))))


PATH_METRICS: Mapping[str, Callable[[Path, Scan], Readings]] = MappingProxyType(
    {
        "bandwidth": bandwidth,
        "compliance_peak": path_peak,
        "control_sensitivity_peak": path_peak,
        "resonance_peak": path_peak,
    }
)
LOOP_METRICS: Mapping[str, Callable[[Path, Scan], Readings]] = MappingProxyType(
    {
        "sensitivity_peak": sensitivity_peak,
        "complementary_peak": complementary_peak,
        "disk_margin": balanced_peak,
        "gain_margin": gain_margin,
        "gain_margin_down": gain_margin_down,
        "gain_margin_up": gain_margin_up,
        "phase_margin": phase_margin,
        "delay_margin": delay_margin,
    }
)
