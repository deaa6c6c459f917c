"""Curves of many parameter sets of one diagram at once, for a picture that follows a slider.

y(k h) = C exp(A k h) x(0) + ..., by doubling: the states of 2^k instants give those of the next 2^k in one product;
G(jω) = D + C (jω - T)⁻¹ B by back substitution in the complex Schur form A = Q T Qᴴ.

Both are right to rounding where the exact path is, but find no events: metrics come from :mod:`engine.analysis.study`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, matrix_balance, schur

from engine.model.linear_system import LinearSystem

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


def step_response(system: LinearSystem, steps: Mapping[int, float], length: float, samples: int) -> Real:
    """Return all outputs at ``samples`` instants of 0..``length``, both ends included, shape (outputs, samples).

    Parameters
    ----------
    system : LinearSystem
        Without delays, real.
    steps : mapping of input number to amplitude
        Commands that jump at 0.
    length : float
        s, > 0.
    samples : int
        At least 2.

    Raises
    ------
    ValueError
        For a system with delays, whose states are not finitely many.
    """
    if system.delays.size:
        raise ValueError(f"the system must be without delays, got {system.delays.size}")
    n = system.states
    command = np.zeros(len(system.inputs))
    for number, amplitude in steps.items():
        command[number] = amplitude
    scale = _scale(system.a)
    # One more state, constant 1, is the command: its row is 0, its column B u.
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n] = system.a * (scale / scale[:, None])
    whole[:n, n] = system.b1 @ command / scale
    read = np.concatenate([system.c1 * scale, (system.d11 @ command)[:, None]], axis=1)
    states = np.concatenate([system.x0 / scale, [1.0]])[:, None]
    with np.errstate(all="ignore"):  # a response that grows leaves the numbers; whoever draws it cuts it off
        forward = expm(whole * (length / (samples - 1)))
        while states.shape[1] < samples:
            states = np.concatenate([states, forward @ states], axis=1)
            forward = forward @ forward
        return np.asarray(read @ states[:, :samples])


def frequency_response(system: LinearSystem, source: int, target: int, frequency: Real) -> Complex:
    """Return G(jω) from one input to one output, shape (k,); delays are exact, a pole on the axis gives infinity.

    Parameters
    ----------
    system : LinearSystem
        Real.
    source, target : int
        Numbers of the input and the output.
    frequency : ndarray (k,)
        rad/s, > 0.
    """
    s: Complex = np.asarray(1j * frequency, dtype=np.complex128)
    given = np.concatenate([system.b1[:, [source]], system.b2], axis=1)
    read = np.concatenate([system.c1[[target]], system.c2])
    direct = np.block(
        [[system.d11[[target]][:, [source]], system.d12[[target]]], [system.d21[:, [source]], system.d22]]
    )
    with np.errstate(all="ignore"):
        response = direct + _resolvent(system.a, given, read, s)
        if not system.delays.size:
            return np.asarray(response[:, 0, 0])
        late = np.exp(-s[:, None] * system.delays)[:, :, None]
        inner = np.linalg.solve(np.eye(system.delays.size) - late * response[:, 1:, 1:], late * response[:, 1:, :1])
        return np.asarray((response[:, :1, :1] + response[:, :1, 1:] @ inner)[:, 0, 0])


def _resolvent(a: Real, b: Real, c: Real, s: Complex) -> Complex:
    """Return C (s - A)⁻¹ B for every s, shape (k, outputs, inputs)."""
    n = a.shape[0]
    if n == 0:
        return np.zeros((s.size, c.shape[0], b.shape[1]), dtype=complex)
    scale = _scale(a)
    triangle, turn = schur(a * (scale / scale[:, None]), output="complex")
    right = turn.conj().T @ (b / scale[:, None])
    x = np.empty((n, s.size, b.shape[1]), dtype=complex)
    for i in range(n - 1, -1, -1):
        known = np.tensordot(triangle[i, i + 1 :], x[i + 1 :], axes=1) if i + 1 < n else 0.0
        x[i] = (right[i] + known) / (s - triangle[i, i])[:, None]
    return np.asarray(np.tensordot((c * scale) @ turn, x, axes=1).transpose(1, 0, 2))


def _scale(a: Real) -> Real:
    """Return powers of two by which states are divided so that rounding does not depend on their units."""
    if a.size == 0:
        return np.ones(0)
    _, transform = matrix_balance(a, permute=False)
    return np.asarray(np.diag(transform))
