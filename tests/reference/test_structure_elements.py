"""What diagrams are made of against its formulas, by plain complex arithmetic; and every linear element has such a formula.

Drives, mechanics and sensors are in test_drive_elements, control laws and corrections in test_control_elements, at 40 digits.
Here elements are met through a whole diagram, at several frequencies and at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import control
import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.elements import catalogue
from engine.elements._nonlinear import NonlinearElement
from tests.reference import test_control_elements, test_drive_elements
from tests.reference.systems import block, system

FREQUENCIES = (0.01, 0.7, 5.0, 61.0, 900.0)

Rows = Sequence[Sequence[complex]]
Formula = Callable[[complex], Rows]
"""s -> one row for each output, with an entry for each input."""


def filtered(s: complex) -> complex:
    """Return s/(1 + s/w), w = 50 rad/s."""
    return s / (1 + s / 50.0)


def pade(s: complex) -> complex:
    numerator, denominator = control.pade(0.03, 4)
    return complex(np.polyval(numerator, s) / np.polyval(denominator, s))


MIMO = {
    "A": [[-2.0, 1.0, 0.0], [0.0, -3.0, 4.0], [-1.0, 0.0, -5.0]],
    "B": [[1.0, 0.5], [0.0, 2.0], [3.0, 0.0]],
    "C": [[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]],
    "D": [[0.1, 0.0], [0.0, -0.7]],
}


def mimo(s: complex) -> Rows:
    # by Cramer's rule: x_k = det(sI - A with column k replaced by b) / det(sI - A)
    whole = s * np.eye(3) - np.array(MIMO["A"])
    b, c, d = (np.array(MIMO[name]) for name in "BCD")

    def x(k: int, column: int) -> complex:
        replaced = whole.copy()
        replaced[:, k] = b[:, column]
        return complex(np.linalg.det(replaced) / np.linalg.det(whole))

    return [[sum(c[i, k] * x(k, j) for k in range(3)) + d[i, j] for j in range(2)] for i in range(2)]


CASES: list[tuple[str, Mapping[str, Any], Formula]] = [
    ("gain", {"gain": -2.5}, lambda s: [[-2.5]]),
    ("sum", {"signs": "+--+"}, lambda s: [[1, -1, -1, 1]]),
    ("integrator", {"gain": 4.0}, lambda s: [[4 / s]]),
    ("delay", {"time": 0.03}, lambda s: [[np.exp(-0.03 * s)]]),
    ("delay", {"time": 0.03, "approximation": "pade", "order": 4}, lambda s: [[pade(s)]]),
    ("p", {"kp": 3.0}, lambda s: [[3.0]]),
    ("p", {"kp": 3.0, "setpoint_weight_p": 0.4}, lambda s: [[1.2, -3.0]]),
    ("pi", {"kp": 3.0, "ki": 2.0}, lambda s: [[3 + 2 / s]]),
    ("pi", {"kp": 3.0, "integral_time": 1.5, "setpoint_weight_p": 0.4}, lambda s: [[1.2 + 2 / s, -3 - 2 / s]]),
    ("pd", {"kp": 3.0, "kd": 0.5, "filter_frequency": 50.0}, lambda s: [[3 + 0.5 * filtered(s)]]),
    ("pd",
     {"kp": 3.0, "derivative_time": 0.2, "filter_frequency": 50.0, "setpoint_weight_p": 0.4, "setpoint_weight_d": 0.1},
     lambda s: [[1.2 + 0.06 * filtered(s), -3 - 0.6 * filtered(s)]]),
    ("transfer_function", {"numerator": [2.0, 0.0, 7.0], "denominator": [0.3, 4.0, 5.0, 6.0]},
     lambda s: [[(2 * s * s + 7) / (0.3 * s**3 + 4 * s * s + 5 * s + 6)]]),
    ("transfer_function", {"numerator": [2.0, 1.0], "denominator": [4.0, 5.0]}, lambda s: [[(2 * s + 1) / (4 * s + 5)]]),
    ("zero_pole_gain", {"zeros": [3.0], "poles": [[-1.0, 7.0], [-1.0, -7.0], -20.0], "gain": -6.0},
     lambda s: [[-6 * (s - 3) / (((s + 1) ** 2 + 49) * (s + 20))]]),
    ("state_space", MIMO, mimo),
]  # fmt: skip


def gains(kind: str, given: Mapping[str, Any], frequencies: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the responses (outputs, inputs, frequencies) of an element in a diagram, and its static gains, NaN where none."""
    element = catalogue()[kind]
    ports = element.ports({param.name: param.default for param in element.parameters} | dict(given))
    inputs = {f"u{k}": block("input") for k in range(len(ports.inputs))}
    wires = [f"u{k} -> it.{port}" for k, port in enumerate(ports.inputs)]
    outputs = {f"y{k}": f"it.{port}" for k, port in enumerate(ports.outputs)}
    whole = Evaluation(system({**inputs, "it": block(kind, **given)}, wires, outputs), None)
    paths = [[whole.path(source, target) for source in inputs] for target in outputs]
    found = [[path.response(np.array(frequencies)) for path in row] for row in paths]
    rest = [[np.nan if path.static is None else path.static[0].real for path in row] for row in paths]
    return np.array(found), np.array(rest, dtype=float)


@pytest.mark.parametrize(("kind", "given", "formula"), CASES, ids=[f"{k}-{n}" for n, (k, _, _) in enumerate(CASES)])
def test_response(kind: str, given: Mapping[str, Any], formula: Formula) -> None:
    found, rest = gains(kind, given, FREQUENCIES)
    for k, frequency in enumerate(FREQUENCIES):
        np.testing.assert_allclose(found[..., k], np.array(formula(1j * frequency)), rtol=1e-12)
    nearly_at_rest = np.array(formula(1e-12 + 0j))
    lasting = np.abs(nearly_at_rest) < 1e6  # an integrator has no static gain
    np.testing.assert_array_equal(np.isfinite(rest), lasting)
    np.testing.assert_allclose(rest[lasting], nearly_at_rest[lasting].real, rtol=1e-9)


ALL_PATHS = [
    *((kind, given, law) for kind, given, law in test_drive_elements.CASES),
    *((kind, given, lambda s, p, law=law: [[law(s, p)]]) for kind, given, law in test_control_elements.CASES),
]


@pytest.mark.parametrize("number", range(len(ALL_PATHS)), ids=[f"{k}-{n}" for n, (k, _, _) in enumerate(ALL_PATHS)])
def test_drives_and_laws_in_a_diagram_and_at_rest(number: int) -> None:
    kind, given, law = ALL_PATHS[number]
    mp = test_drive_elements.mp
    numbers = test_drive_elements.exact(given)
    found, rest = gains(kind, given, (0.3, 70.0))
    for k, s in enumerate((mp.mpc(0, 0.3), mp.mpc(0, 70.0))):
        expected = test_drive_elements.plain(mp.matrix(law(s, numbers)))
        largest = np.abs(expected).max(axis=1, keepdims=True)
        # in double precision a load pressure is what large pressures leave of one another
        np.testing.assert_array_less(np.abs(found[..., k] - expected), 1e-8 * np.abs(expected) + 1e-13 * largest)
    still = test_drive_elements.plain(mp.matrix(law(mp.mpf("1e-14"), numbers))).real
    lasting = np.abs(still) <= 1e6 * np.abs(found[..., 0])
    for i, j in np.ndindex(still.shape):
        assert bool(lasting[i, j]) is not math.isnan(rest[i, j]), (i, j)
        if lasting[i, j]:
            rounding = 1e-12 * float(np.abs(found[i, j]).max())  # a zero at rest is a difference
            assert rest[i, j] == pytest.approx(still[i, j], rel=1e-7, abs=rounding), (i, j)


def test_every_linear_element_has_a_formula_of_its_own() -> None:
    linear = {kind for kind, element in catalogue().items() if not issubclass(element, NonlinearElement)}
    with_formula = {kind for kind, _, _ in [*CASES, *ALL_PATHS]}
    assert with_formula >= linear - {"input"}  # an input is driven from outside: there is nothing to compute
