"""Frequency metrics of many systems of one structure at once.

    G(s) = G11 + G12 (I - Δ G22)⁻¹ Δ G21,   Δ = diag(e^{-s τ}),   G_ij(s) = C_i (s I - A)⁻¹ B_j + D_ij

A scan over frequencies brackets peaks and crossings; it uses the eigenvalues of A, which makes a frequency cost n
divisions. Where the eigenvectors are nearly dependent, it solves instead. The value at the place found is always computed
by solving, and its derivatives by the solution's tangent,  F x = r:  F ẋ = ṙ - Ḟ x.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from engine.batch.collocation.time import Readings
from engine.model.linear_system import Array

SMALLEST_LOOP_GAIN = 1e-9
"""Crossings of a loop gain below this are not counted."""
_ON_THE_AXIS = 1e-6
_FLAT = 1e-3
_ASIDE, _REACHED = 1e-4, 0.02
"""How far to the side of a peak its slope is looked at, and how far off the scan may see it, as parts of its frequency."""
_PER_DECADE = 32
_TURNS = 120
_REACH = 1e-7, 1e5
"""How far the scan goes below the lowest and above the highest corner, where only limits are left to be found."""
_WELL_CONDITIONED = 1e7
_NUDGE = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """One path of B systems: ``b`` (B, n, 1 + m), ``c`` (B, 1 + m, n), ``d`` (B, 1 + m, 1 + m); delay channels come last."""

    a: Array
    b: Array
    c: Array
    d: Array
    delays: Array

    @property
    def batch(self) -> int:
        """Number of systems."""
        return int(self.a.shape[0])


class Scan:
    """The response of a path, real parts only, wherever it is asked for.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tau = path.delays.real
        a = path.a.real
        batch, n = a.shape[:2]
        self._poles, vectors, self._modal = _eigenvectors(a)
        # Repeated poles (two integrators in a loop) have dependent eigenvectors; those of a neighbour are good enough to
        # scan with, because what is found is polished on the system itself.
        repeated = np.flatnonzero(~self._modal)
        if repeated.size:
            i, j = np.indices((n, n))
            nudge = _NUDGE * np.abs(a[repeated]).max(axis=(1, 2))[:, None, None] * np.cos(1.0 + 3.0 * i + 7.0 * j)
            self._poles[repeated], vectors[repeated], self._modal[repeated] = _eigenvectors(a[repeated] + nudge)
        safe = np.where(self._modal[:, None, None], vectors, np.eye(n))
        ports = path.d.shape[1]
        left = np.linalg.solve(safe, path.b.real.astype(complex)) if n else np.zeros((batch, 0, ports))
        right = path.c.real @ safe
        # (B, n, ports * ports): the residue of every entry at every pole
        self._residues = (np.swapaxes(right, 1, 2)[:, :, :, None] * left[:, :, None, :]).reshape(batch, n, -1)
        self.frequencies = self._grid()
        self.response = self.at(np.arange(batch), self.frequencies)

    def at(self, rows: Array, omega: Array) -> Array:
        """Return G(jω) of systems ``rows`` (k,) at their own frequencies ``omega`` (k, q)."""
        path = self._path
        k, q = omega.shape
        ports = path.d.shape[1]
        modal = self._modal[rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = 1.0 / (1j * omega[:, :, None] - self._poles[rows, None, :])
            inner = (parts @ self._residues[rows]).reshape(k, q, ports, ports) + path.d.real[rows, None]
        for index in np.flatnonzero(~modal):
            row = rows[index]
            resolvent = 1j * omega[index][:, None, None] * np.eye(path.a.shape[1]) - path.a[row].real
            inner[index] = (
                path.c[row].real @ np.linalg.solve(resolvent, path.b[row].real[None].astype(complex)) + path.d[row].real
            )
        if ports == 1:
            return np.asarray(inner[..., 0, 0])
        turn = np.exp(-1j * omega[:, :, None] * self._tau[rows, None, :])
        with np.errstate(divide="ignore", invalid="ignore"):
            if ports == 2:
                e = turn[..., 0]
                return np.asarray(
                    inner[..., 0, 0] + inner[..., 0, 1] * e * inner[..., 1, 0] / (1 - e * inner[..., 1, 1])
                )
        delayed = np.linalg.solve(
            np.eye(ports - 1) - turn[..., :, None] * inner[..., 1:, 1:], turn[..., None] * inner[..., 1:, :1]
        )
        return np.asarray(inner[..., 0, 0] + (inner[..., :1, 1:] @ delayed)[..., 0, 0])

    def _grid(self) -> Array:
        """Return rising frequencies (B, q): a logarithmic sweep, the neighbourhood of every pole, the turns of the delays."""
        size = np.abs(self._poles)
        top = size.max(axis=1, initial=0.0)
        delay = self._tau.sum(axis=1)
        inverse = 1.0 / np.where(delay > 0, delay, np.inf)
        corner = np.where(size > 1e-9 * top[:, None], size, np.inf).min(axis=1, initial=np.inf)
        low = np.minimum(corner, np.where(inverse > 0, inverse, np.inf))
        low = np.where(np.isfinite(low), low, 1.0)
        high = np.maximum(np.maximum(top, inverse), low)
        count = int(np.clip(_PER_DECADE * np.log10((100 * high / low).max()), 48, 400))
        inside = np.geomspace(0.05 * low, 10 * high, count, axis=1)
        tails = np.concatenate(
            [
                np.geomspace(_REACH[0] * low, 0.04 * low, 14, axis=1),
                np.geomspace(12 * high, _REACH[1] * high, 14, axis=1),
            ],
            axis=1,
        )
        width = np.maximum(np.abs(self._poles.real), 1e-9 * size)
        around = np.abs(self._poles.imag)[:, :, None] + width[:, :, None] * np.array([-4.0, -1.0, 0.0, 1.0, 4.0])
        pieces = [inside, tails, around.reshape(len(low), -1)]
        if self._tau.shape[1]:
            pieces.append(np.where(inverse > 0, inverse, low)[:, None] * 0.25 * np.arange(1, _TURNS + 1))
        omega = np.concatenate(pieces, axis=1)
        return np.sort(np.clip(omega, _REACH[0] * low[:, None], _REACH[1] * high[:, None]), axis=1)

    def peak(self, height: Callable[[Array, Array], Array]) -> Array:
        """Return the frequency (B,) at which ``height`` of the response and its frequency is largest."""
        rows = np.arange(self._path.batch)
        heights = height(self.response, self.frequencies)
        heights = np.where(np.isfinite(heights), heights, -np.inf)
        last = heights.shape[1] - 1
        padded = np.pad(heights, ((0, 0), (1, 1)), constant_values=-np.inf)
        summits = np.where((heights >= padded[:, :-2]) & (heights >= padded[:, 2:]), heights, -np.inf)
        best_height = np.full(len(rows), -np.inf)
        best = self.frequencies[:, 0].copy()
        for _ in range(2):
            place = summits.argmax(axis=1)
            low = self.frequencies[rows, np.maximum(place - 1, 0)]
            high = self.frequencies[rows, np.minimum(place + 1, last)]
            trial = value = np.zeros((len(rows), 9))
            middle = place
            for _ in range(4):
                trial = low[:, None] * (high / low)[:, None] ** (np.arange(9) / 8)
                value = height(self.at(rows, trial), trial)
                middle = np.where(np.isfinite(value), value, -np.inf).argmax(axis=1)
                low, high = trial[rows, np.maximum(middle - 1, 0)], trial[rows, np.minimum(middle + 1, 8)]
            # The parabola through the last three, on a logarithmic axis.
            centre = np.clip(middle, 1, 7)
            a, b, c = (value[rows, centre + shift] for shift in (-1, 0, 1))
            bend = a - 2 * b + c
            shift = np.where(bend < 0, np.clip(0.5 * (a - c) / np.where(bend < 0, bend, -1.0), -1.0, 1.0), 0.0)
            shift = np.where(centre == middle, shift, middle - centre)
            found = trial[rows, centre] * (trial[:, 1] / trial[:, 0]) ** shift
            found_height = value[rows, middle]
            higher = found_height > best_height
            best_height, best = np.where(higher, found_height, best_height), np.where(higher, found, best)
            np.put_along_axis(summits, place[:, None], -np.inf, axis=1)
        return best

    def hidden(self, size: Array) -> Array:
        """Return for whom (B,) the delays turn by more than a radian between two frequencies, |G| there being at least ``size``."""
        turns = np.diff(self.frequencies, axis=1) * self._tau.sum(axis=1)[:, None] > 1.0
        large = np.abs(self.response) >= size[:, None]
        return np.asarray((turns & (large[:, :-1] | large[:, 1:])).any(axis=1))

    def crossings(self, level: Callable[[Array, Array], Array], *, first_fall: bool = False) -> tuple[Array, Array]:
        """Return (systems, frequencies) of every sign change of ``level``, or of the first fall only.

        ``level`` gets responses (k, q) and the systems (k,) that they belong to.
        """
        values = level(self.response, np.arange(self._path.batch))
        changes = (values[:, :-1] >= 0) != (values[:, 1:] >= 0)
        changes &= np.isfinite(values[:, :-1]) & np.isfinite(values[:, 1:])
        if first_fall:
            falls = (values[:, :-1] >= 0) & (values[:, 1:] < 0)
            changes = falls & (np.cumsum(falls, axis=1) == 1)
        rows, place = np.nonzero(changes)
        low, high = self.frequencies[rows, place], self.frequencies[rows, place + 1]
        at_low, at_high = values[rows, place], values[rows, place + 1]
        for step in range(16):
            weight = (
                np.clip(at_low / np.where(at_low == at_high, 1.0, at_low - at_high), 0.01, 0.99) if step % 3 else 0.5
            )
            middle = low + (high - low) * weight
            value = level(self.at(rows, middle[:, None]), rows)[:, 0]
            same = (value >= 0) == (at_low >= 0)
            low, at_low = np.where(same, middle, low), np.where(same, value, at_low)
            high, at_high = np.where(same, high, middle), np.where(same, at_high, value)
        return rows, np.where(np.abs(at_low) < np.abs(at_high), low, high)


def _eigenvectors(a: Array) -> tuple[Array, Array, Array]:
    """Return eigenvalues (B, n), eigenvectors (B, n, n), and whose eigenvectors are independent (B,)."""
    poles, vectors = np.linalg.eig(a)
    if not a.shape[1]:
        return poles.astype(complex), vectors.astype(complex), np.ones(len(a), dtype=bool)
    singular = np.linalg.svd(vectors, compute_uv=False)
    return poles.astype(complex), vectors.astype(complex), singular[:, -1] * _WELL_CONDITIONED > singular[:, 0]


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
    f[:, :n, :n] = 1j * omega[:, None, None] * np.eye(n) - path.a[rows].real
    slope[:, :n, :n] = 1j * np.eye(n)
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
    x = np.linalg.solve(f, right.real.astype(complex))
    z = np.linalg.solve(f, np.concatenate([right.imag - tangent @ x, -slope @ x], axis=2))
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
        try:
            static, moved_static, _ = solved(path, everyone, np.zeros(batch))
        except np.linalg.LinAlgError:
            return Readings(value=np.full(batch, np.nan, dtype=complex), doubtful=np.ones(batch, dtype=bool))
    level = np.abs(static.real) * 10**-0.15
    rows, omega = scan.crossings(lambda g, systems: np.abs(g) - level[systems, None], first_fall=True)
    value = np.full(batch, np.inf, dtype=complex)
    omega = _newton(
        path, rows, omega, lambda g: np.abs(g) - level[rows], lambda g, slope: (np.conj(g) * slope).real / np.abs(g)
    )
    g, moved, slope = solved(path, rows, omega)
    size = np.abs(g)
    fall = (np.conj(g) * slope).real / size
    level_moved = np.sign(static.real) * moved_static.real * 10**-0.15
    shift = (level_moved[rows] - (np.conj(g) * moved).real / size) / fall
    value[rows] = _dual(omega, shift)
    scale = np.abs(scan.response).max(axis=1)
    value[np.abs(static.real) <= 1e-9 * scale] = np.nan
    return Readings(value=value, doubtful=np.zeros(batch, dtype=bool))


def _nearest(batch: int, rows: Array, value: Array, order: Array) -> Readings:
    """Return for each system the value whose ``order`` is smallest, infinite where there is none."""
    result = np.full(batch, np.inf, dtype=complex)
    for index in np.argsort(-order, kind="stable"):
        result[rows[index]] = value[index]
    return Readings(value=result, doubtful=np.zeros(batch, dtype=bool))


def balanced_peak(path: Path, scan: Scan) -> Readings:
    """Return 1 / max |S - 1/2|, the symmetric disk margin."""
    found = _peak(path, scan, lambda g: 0.5 * (1 - g) / (1 + g), lambda g: -1 / (1 + g) ** 2)
    return Readings(value=1 / found.value, doubtful=found.doubtful)


def _gain_margins(path: Path, scan: Scan) -> tuple[Array, Array]:
    """Return (systems, -1 / L with infinitesimals) wherever L is real and negative, both ends of the axis included."""
    rows, omega = scan.crossings(lambda g, _: g.imag)
    omega = _newton(path, rows, omega, lambda g: g.imag, lambda _, slope: slope.imag)
    value, moved, slope = solved(path, rows, omega)
    shift = -moved.imag / np.where(slope.imag == 0, np.inf, slope.imag)
    real = _dual(value.real, moved.real + slope.real * shift)
    counts = (value.real < -SMALLEST_LOOP_GAIN) & (np.abs(value.imag) < _ON_THE_AXIS * np.abs(value.real))
    everyone, (first, second) = np.arange(path.batch), scan.response[:, :2].T
    flat = (np.abs(second - first) < _FLAT * np.abs(first)) & (np.abs(first.imag) < _FLAT * np.abs(first.real))
    resting = everyone[flat & (first.real < -SMALLEST_LOOP_GAIN)]
    value, moved, _ = solved(path, resting, scan.frequencies[resting, 0])
    direct = path.d[:, 0, 0] + 0j
    passing = everyone[(direct.real < -SMALLEST_LOOP_GAIN) & (path.delays.shape[1] == 0)]
    gains = np.concatenate([real[counts], _dual(value.real, moved.real), direct[passing]])
    return np.concatenate([rows[counts], resting, passing]), -1 / gains


def gain_margin(path: Path, scan: Scan) -> Readings:
    """-1 / L where L is real and negative, nearest 1 on a logarithmic scale."""
    rows, margin = _gain_margins(path, scan)
    found = _nearest(path.batch, rows, margin, np.abs(np.log(margin.real)))
    # a crossing that the scan steps over is nearer to 1 only where |L| is
    nearest = np.minimum(np.abs(found.value.real), 1 / np.abs(found.value.real))
    return Readings(value=found.value, doubtful=scan.hidden(np.maximum(nearest, SMALLEST_LOOP_GAIN)))


def gain_margin_up(path: Path, scan: Scan) -> Readings:
    """The smallest gain margin above 1."""
    rows, margin = _gain_margins(path, scan)
    rows, margin = rows[margin.real > 1], margin[margin.real > 1]
    found = _nearest(path.batch, rows, margin, margin.real)
    return Readings(value=found.value, doubtful=scan.hidden(np.maximum(1 / found.value.real, SMALLEST_LOOP_GAIN)))


def gain_margin_down(path: Path, scan: Scan) -> Readings:
    """The largest gain margin below 1, 0 where there is none."""
    rows, margin = _gain_margins(path, scan)
    rows, margin = rows[margin.real < 1], margin[margin.real < 1]
    found = _nearest(path.batch, rows, margin, -margin.real).value
    return _unless_hidden(
        scan, Readings(value=np.where(np.isinf(found), 0.0, found), doubtful=np.zeros(path.batch, bool))
    )


def _phase_margins(path: Path, scan: Scan) -> tuple[Array, Array, Array]:
    """Return (systems, frequencies, π + arg L), both with infinitesimals, wherever |L| = 1."""
    rows, omega = scan.crossings(lambda g, _: np.abs(g) - 1)
    omega = _newton(path, rows, omega, lambda g: np.abs(g) - 1, lambda g, slope: (np.conj(g) * slope).real / np.abs(g))
    value, moved, slope = solved(path, rows, omega)
    # d ln L = (d ln|L|, d arg L)
    by_parameter, by_frequency = moved / value, slope / value
    shift = -by_parameter.real / np.where(by_frequency.real == 0, np.inf, by_frequency.real)
    angle = np.angle(-value)
    return rows, _dual(omega, shift), _dual(angle, by_parameter.imag + by_frequency.imag * shift)


def phase_margin(path: Path, scan: Scan) -> Readings:
    """π + arg L where |L| = 1, nearest 0."""
    rows, _, angle = _phase_margins(path, scan)
    return _unless_hidden(scan, _nearest(path.batch, rows, angle, np.abs(angle.real)))


def delay_margin(path: Path, scan: Scan) -> Readings:
    """The smallest of (π + arg L in [0, 2π)) / ω where |L| = 1."""
    rows, omega, angle = _phase_margins(path, scan)
    margin = np.where(angle.real < 0, angle + 2 * np.pi, angle) / omega
    return _unless_hidden(scan, _nearest(path.batch, rows, margin, margin.real))


def _unless_hidden(scan: Scan, found: Readings) -> Readings:
    """Doubt what is found at |L| = 1 where a loop gain of 1 turns round more often than is looked at: the loop may be unstable."""
    return Readings(value=found.value, doubtful=scan.hidden(np.ones(len(found.value))))


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
