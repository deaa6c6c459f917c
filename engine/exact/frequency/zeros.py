"""Zeros of a path: where its transfer function vanishes.

    r the least with C A^(r-1) B ≠ 0 (0 where D ≠ 0);   on {x: C x = C A x = ... = C A^(r-1) x = 0}
    x' = A x - B (C A^r x) / (C A^(r-1) B) keeps the output 0: its eigenvalues are the zeros

There are n - r of them, each found once: none at infinity has to be told from a large one. With delays the zeros are those of

    N(s, θ) = det [[s I - A, -B2, -B1], [-C2, diag(θ) - D22, -D21], [C1, D12, D11]],   θ_i = e^(s τ_i)

which are as many as without where N(s, θ) = g(s) Π θ_i^k_i: then θ may be any numbers. Otherwise they have no end.

References
----------
A. Isidori, Nonlinear Control Systems, 3rd ed., section 4.3 (the zero dynamics of a linear system).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.path import connected, evenly_scaled, minimal
from engine.model.linear_system import LaneSystem

Complex = npt.NDArray[np.complex128]
Real = npt.NDArray[np.float64]

_CANCELS = 1e-10
"""What is left of a sum is 0 below this part of its terms."""
_SAME = 1e-6
"""Numbers that differ by less than this part are the same."""
_TURN = 1.37


def zeros(system: LaneSystem) -> Complex | None:
    """Return the zeros of a path, rad/s, by falling real part; none of a path that passes nothing on.

    Parameters
    ----------
    system : LaneSystem
        One input, one output.

    Returns
    -------
    ndarray or None
        None where delays act beside each other or in a circle, so that the zeros have no end.
    """
    value = system.value
    if not value.m:
        return _of_rational(value)
    return _of_rational(_held(value)) if _factors(value) else None


def _factors(system: LaneSystem) -> bool:
    """Return whether N(s, θ) is a product of what s makes and of powers of θ: a geometric row of θ makes one of N."""
    rate = max(float(np.linalg.norm(system.a[0])), float(1 / system.delays[0].max()))
    for s in rate * np.array([0.3, 1.1]) * np.exp(0.7j):
        sign, size = np.linalg.slogdet(np.stack([_numerator(system, s, _turns(system) ** k) for k in (1, 2, 3)]))
        if not np.isfinite(size).all():  # it passes nothing on
            continue
        ratio = sign[0] * sign[2] / sign[1] ** 2 * np.exp(size[0] + size[2] - 2 * size[1])
        if not abs(ratio - 1) <= _SAME:
            return False
    return True


def _turns(system: LaneSystem) -> Real:
    return np.asarray(_TURN ** (1 + np.arange(system.m) / system.m))


def _numerator(system: LaneSystem, s: complex, turns: Real) -> Complex:
    return np.block(
        [
            [s * np.eye(system.n) - system.a[0], -system.b2[0], -system.b1[0]],
            [-system.c2[0], np.diag(turns) - system.d22[0], -system.d21[0]],
            [system.c1[0], system.d12[0], system.d11[0]],
        ]
    ).astype(complex)


def _held(system: LaneSystem) -> LaneSystem:
    """Return the system with every delay as a gain, a little different for each."""
    loop = np.diag(_turns(system)) - system.d22[0]
    x, u = np.linalg.solve(loop, system.c2[0]), np.linalg.solve(loop, system.d21[0])
    nothing = system.part(np.arange(system.n), np.arange(0))
    return replace(
        nothing,
        a=nothing.a + system.b2 @ x, b1=nothing.b1 + system.b2 @ u,
        c1=nothing.c1 + system.d12 @ x, d11=nothing.d11 + system.d12 @ u,
    )  # fmt: skip


def _of_rational(system: LaneSystem) -> Complex:
    at_rest = replace(system, x0=np.zeros_like(system.x0))  # a state that only its beginning drives is hidden
    own = evenly_scaled(minimal(connected(at_rest, [0], [0])))
    a, b, c, d = own.a[0], own.b1[0][:, 0], own.c1[0][0], float(own.d11[0, 0, 0])
    if d:
        return _sorted(a - np.outer(b, c) / d)
    rows: list[Real] = []
    row = c
    while len(rows) < own.n and row.any():
        row = row / np.linalg.norm(row)
        rows.append(row)
        first, ahead = float(row @ b), row @ a
        if abs(first) > _CANCELS * float(np.abs(row) @ np.abs(b)):
            inside = np.linalg.qr(np.array(rows).T, mode="complete")[0][:, len(rows) :]  # at right angles to all rows
            return _sorted(inside.T @ (a - np.outer(b, ahead) / first) @ inside)
        row = ahead
    return np.zeros(0, dtype=complex)


def _sorted(matrix: Real) -> Complex:
    found = np.linalg.eigvals(matrix).astype(complex)
    return found[np.lexsort((found.imag, -found.real))]
