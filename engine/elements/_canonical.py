"""State spaces of rational transfer functions, scaled so that their matrices are balanced.

A polynomial quotient becomes the controllable canonical form, a list of zeros and poles a cascade of sections.
Scalings are powers of two taken from the real parts: they change no digit and stay analytic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import lapack

from engine.elements._base import Array, Realization, absent, matrix
from engine.model.errors import DiagramError
from engine.model.parameters import Scalar
from engine.model.traced import nominal

_OVERSIZED: Final = 1e300


def rational(numerator: Sequence[Scalar], denominator: Sequence[Scalar]) -> Realization:
    """Return the balanced controllable canonical form of numerator(s)/denominator(s), highest power first.

    Raises
    ------
    DiagramError
        If the denominator is zero, the numerator empty or the quotient improper.

    References
    ----------
    T. Kailath, Linear Systems, Prentice-Hall 1980, section 2.1.
    """
    top, bottom = _without_leading_zeros(numerator), _without_leading_zeros(denominator)
    if not bottom:
        raise DiagramError("denominator must have a coefficient other than 0", at=("denominator",))
    if not numerator:
        raise DiagramError("numerator must have a coefficient, got none", at=("numerator",))
    order = len(bottom) - 1
    excess = top[: max(0, len(top) - len(bottom))]
    if not all(isinstance(coefficient, np.ndarray) for coefficient in excess):
        raise DiagramError(
            f"numerator must be at most of the order of the denominator ({order}), got order {len(top) - 1}: "
            "an improper transfer function has no response",
            at=("numerator",),
        )
    leading = bottom[0]
    if not isinstance(leading, np.ndarray) and leading.real == 0:
        raise DiagramError(
            "denominator must not lose its order at this value: its derivative does not exist there",
            at=("denominator",),
        )
    monic = [coefficient / leading for coefficient in bottom[1:]]
    padded = _padded([coefficient / leading for coefficient in top[len(excess) :]], len(bottom))
    direct = padded[0]
    for coefficient in excess:
        # A member of a batch that is improper has no realisation; it must not spoil the others.
        direct = direct + np.where(coefficient == 0, 0.0, np.nan)
    remainder = [n - direct * m for n, m in zip(padded[1:], monic, strict=True)]
    if order == 0:
        return Realization.static(matrix([[direct]]))
    rows: list[list[Scalar]] = [[1.0 if j == i + 1 else 0.0 for j in range(order)] for i in range(order - 1)]
    rows.append([-coefficient for coefficient in reversed(monic)])
    a = matrix(rows)
    scale = _balancing(a)
    b = np.zeros((order, 1))
    b[-1, 0] = 1.0 / scale[-1]
    c = matrix([remainder[::-1]]) * scale
    size = _power_of_two(float(_typical(c).max(initial=0.0) / b[-1, 0]))
    return Realization(a=a * (scale / scale[:, None]), b=b * size, c=c / size, d=matrix([[direct]]))


def _without_leading_zeros(coefficients: Sequence[Scalar]) -> list[Scalar]:
    first = next((i for i, coefficient in enumerate(coefficients) if not absent(coefficient)), len(coefficients))
    return list(coefficients[first:])


def _padded(coefficients: Sequence[Scalar], length: int) -> list[Scalar]:
    """Return the polynomial with zeros for its missing highest powers."""
    return [*[0.0] * (length - len(coefficients)), *coefficients]


def _typical(values: Array) -> Array:
    """Return the magnitudes of the real parts; of a batch, the median over its members."""
    magnitude = np.abs(nominal(values).real)
    if not np.isfinite(magnitude).all():
        magnitude = np.nan_to_num(magnitude, posinf=_OVERSIZED)
    return np.asarray(np.median(magnitude, axis=0) if values.ndim > 2 else magnitude)


def _balancing(a: Array) -> Array:
    """Return the diagonal t of powers of two that balances diag(1/t) a diag(t)."""
    if a.shape[-1] == 1:
        return np.ones(1)
    _, _, _, scale, _ = lapack.dgebal(_typical(a), scale=1, permute=0)
    return np.asarray(scale)


def _power_of_two(ratio: float) -> float:
    """Return the power of two next to sqrt(ratio), which shares a gain between input and output."""
    if not 0 < ratio < _OVERSIZED:
        return 1.0
    return 2.0 ** round(0.5 * math.log2(ratio))


@dataclass(frozen=True, slots=True, kw_only=True)
class Root:
    """A real root, or with ``im`` the pair re ± j im."""

    re: Scalar
    im: Scalar | None

    @property
    def order(self) -> int:
        """Number of roots that this stands for."""
        return 1 if self.im is None else 2


@dataclass(frozen=True, slots=True, kw_only=True)
class _Section:
    """Two poles or one, and the zeros put over them; ``zeros`` is a polynomial, highest power first."""

    poles: tuple[Root, ...]
    zeros: tuple[Scalar, ...] = (1.0,)


def cascade(zeros: Sequence[Root], poles: Sequence[Root], gain: Scalar) -> Realization:
    """Return sections of first and second order in series, without ever multiplying out the polynomials.

    Real poles stay on the diagonal, complex pairs in rotation form, so that the poles of the result are exact.
    """
    complex_zeros = [zero for zero in zeros if zero.im is not None]
    real_zeros = [zero for zero in zeros if zero.im is None]
    pairs = [pole for pole in poles if pole.im is not None]
    singles = [pole for pole in poles if pole.im is None]
    groups: list[tuple[Root, ...]] = [(pair,) for pair in pairs]
    # A complex pair of zeros needs two poles under it; real poles stay single unless zeros want them together.
    while sum(len(g) == 2 or g[0].im is not None for g in groups) < len(complex_zeros):
        groups.append((singles.pop(), singles.pop()))
    groups += [(single,) for single in singles]

    sections: list[_Section] = []
    for group in sorted(groups, key=lambda g: -sum(root.order for root in g)):
        order = sum(root.order for root in group)
        if order == 2 and complex_zeros:
            zero = complex_zeros.pop()
            assert zero.im is not None  # the list holds nothing else
            over: tuple[Scalar, ...] = (1.0, -2.0 * zero.re, zero.re * zero.re + zero.im * zero.im)
        else:
            taken = [real_zeros.pop() for _ in range(min(order, len(real_zeros)))]
            over = (1.0,)
            for zero in taken:
                over = _times(over, zero.re)
        sections.append(_Section(poles=group, zeros=over))
    if not sections:
        return Realization.static(matrix([[gain]]))
    result = _realize_section(sections[0])
    for section in sections[1:]:
        result = _series(result, _realize_section(section))
    factor = gain[:, None, None] if isinstance(gain, np.ndarray) else gain
    return Realization(a=result.a, b=result.b, c=result.c * factor, d=result.d * factor)


def _times(polynomial: tuple[Scalar, ...], root: Scalar) -> tuple[Scalar, ...]:
    """Return polynomial(s) · (s - root)."""
    raised, lowered = [*polynomial, 0.0], [0.0, *(-root * p for p in polynomial)]
    return tuple(high + low for high, low in zip(raised, lowered, strict=True))


def _realize_section(section: _Section) -> Realization:
    if len(section.poles) == 1 and section.poles[0].im is None:
        pole = section.poles[0].re
        direct, constant = _padded(section.zeros, 2)
        return Realization(
            a=matrix([[pole]]), b=np.ones((1, 1)), c=matrix([[constant + direct * pole]]), d=matrix([[direct]])
        )
    link: Scalar
    total: Scalar
    product: Scalar
    # x1 = (s - q)/Δ u and x2 = link/Δ u, with Δ = s² - total s + product
    if len(section.poles) == 1:
        re, im = section.poles[0].re, section.poles[0].im
        assert im is not None  # a pair
        rows: list[list[Scalar]] = [[re, -im], [im, re]]
        link, q, total, product = im, re, 2.0 * re, re * re + im * im
    else:
        first, second = section.poles[0].re, section.poles[1].re
        rows = [[first, 0.0], [1.0, second]]
        link, q, total, product = 1.0, second, first + second, first * second
    n2, n1, n0 = _padded(section.zeros, 3)
    r1, r0 = n1 + n2 * total, n0 - n2 * product
    b = np.array([[1.0], [0.0]])
    return Realization(a=matrix(rows), b=b, c=matrix([[r1, (r0 + r1 * q) / link]]), d=matrix([[n2]]))


def _series(first: Realization, second: Realization) -> Realization:
    """Return ``second`` driven by ``first``."""
    link = second.b @ first.c
    batch = np.broadcast_shapes(first.a.shape[:-2], second.a.shape[:-2], link.shape[:-2])
    n1, n2 = first.a.shape[-1], second.a.shape[-1]
    a = np.zeros((*batch, n1 + n2, n1 + n2), dtype=np.result_type(first.a, second.a, link))
    a[..., :n1, :n1], a[..., n1:, n1:], a[..., n1:, :n1] = first.a, second.a, link
    b = _stacked(first.b, second.b @ first.d, axis=-2)
    c = _stacked(second.d @ first.c, second.c, axis=-1)
    return Realization(a=a, b=b, c=c, d=second.d @ first.d)


def _stacked(first: Array, second: Array, *, axis: int) -> Array:
    batch = np.broadcast_shapes(first.shape[:-2], second.shape[:-2])
    parts = [np.broadcast_to(part, (*batch, *part.shape[-2:])) for part in (first, second)]
    return np.concatenate(parts, axis=axis)
