"""Gains at rest where numbers are up to twelve decades from the usual, against the laws of the elements in many digits.

A law has a value at rest where it stays the same from s = 1e-70 to 1e-73, none where it grows, and 0 where it falls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import Diagram
from engine.elements import catalogue
from engine.model.errors import DiagramError, UnresolvedError
from engine.model.verdicts import Verdict
from tests.reference.mpmath_oracle import mp
from tests.reference.systems import block, system
from tests.reference.test_control_elements import CASES as CONTROL
from tests.reference.test_drive_elements import CASES as DRIVES
from tests.reference.test_drive_elements import exact, numbers, replaced

CASES = [(kind, values, law, False) for kind, values, law in DRIVES] + [
    (kind, values, law, True) for kind, values, law in CONTROL
]


def alone(kind: str, values: Mapping[str, Any]) -> tuple[Diagram, list[str], list[str]]:
    """Return one element between inputs and outputs of its own, and their names."""
    element = catalogue()[kind]
    ports = element.ports({param.name: param.default for param in element.parameters} | dict(values))
    inputs = [f"u{k}" for k in range(len(ports.inputs))]
    outputs = {f"y{k}": f"it.{port}" for k, port in enumerate(ports.outputs)}
    blocks = {name: block("input") for name in inputs} | {"it": block(kind, **values)}
    wires = [f"{name} -> it.{port}" for name, port in zip(inputs, ports.inputs, strict=True)]
    return system(blocks, wires, outputs), inputs, list(outputs)


def limit(near: Any, nearer: Any) -> Any:
    """Return where a gain goes at rest; None where it grows."""
    if not near or abs(nearer) < abs(near) / 30:
        return mp.mpf(0)
    return None if abs(nearer) > 30 * abs(near) else mp.re(near)


def agree(diagram: Diagram, source: str, target: str, near: Any, nearer: Any) -> None:
    try:
        path = Evaluation(diagram).path(source, target)
    except UnresolvedError:
        return  # told in words
    expected = limit(near, nearer)
    assert (path.static is None) == (expected is None)
    if path.static is None:
        assert path.verdict is not Verdict.OK
    else:
        assert float(abs(mp.mpf(float(path.static[0])) - expected)) <= 1e-12 * abs(float(expected))


@given(st.data(), st.sampled_from(CASES), st.integers(-12, 12))
def test_each_number_of_each_element(data: st.DataObject, case: Any, decades: int) -> None:
    kind, values, law, single = case
    varied = [entry for entry in numbers(values) if entry[2]]
    if not varied:
        return
    name, index, value = data.draw(st.sampled_from(varied))
    changed = replaced(values, name, index, value * 10.0**decades)
    try:
        diagram, inputs, outputs = alone(kind, changed)
    except DiagramError:
        return  # beyond a bound of the element
    with mp.workdps(260):
        near, nearer = (law(mp.mpf(10) ** -power, exact(changed)) for power in (70, 73))
        if single:
            near, nearer = [[near]], [[nearer]]
        for i, source in enumerate(inputs):
            for o, target in enumerate(outputs):
                agree(diagram, source, target, near[o][i], nearer[o][i])


@st.composite
def wide(draw: st.DrawFn) -> float:
    return draw(st.sampled_from([-1.0, 1.0, 1.0])) * draw(st.floats(1.0, 10.0)) * 10.0 ** draw(st.integers(-12, 11))


def polynomials() -> st.SearchStrategy[tuple[list[float], list[float]]]:
    coefficient = st.one_of(wide(), wide(), wide(), st.just(0.0))
    return st.integers(1, 5).flatmap(
        lambda n: st.tuples(
            st.lists(coefficient, min_size=1, max_size=n + 1),
            st.tuples(wide(), st.lists(coefficient, min_size=n, max_size=n)).map(lambda d: [d[0], *d[1]]),
        )
    )


def value(coefficients: Sequence[float], s: Any) -> Any:
    total = mp.mpf(0)
    for coefficient in coefficients:
        total = total * s + mp.mpf(coefficient)
    return total


@given(polynomials())
def test_quotients_of_polynomials_and_their_loops(polynomial: tuple[list[float], list[float]]) -> None:
    top, bottom = polynomial
    plant = block("transfer_function", numerator=top, denominator=bottom)
    single = system({"u": block("input"), "g": plant}, ["u -> g"], {"y": "g"})
    with mp.workdps(260):
        near, nearer = ((value(top, s), value(bottom, s)) for s in (mp.mpf(10) ** -70, mp.mpf(10) ** -73))
        agree(single, "u", "y", near[0] / near[1], nearer[0] / nearer[1])
        try:
            loop = system(
                {"u": block("input"), "e": block("sum", signs="+-"), "g": plant},
                ["u -> e.in1", "g -> e.in2", "e -> g"],
                {"y": "g", "e": "e"},
            )
        except DiagramError:
            return  # a direct gain of -1 all round
        for target, share in (("y", 0), ("e", 1)):
            agree(loop, "u", target, near[share] / sum(near), nearer[share] / sum(nearer))


@given(st.lists(st.tuples(wide(), wide()), min_size=1, max_size=4), wide())
def test_products_of_roots(roots: list[tuple[float, float]], gain: float) -> None:
    poles = [-abs(pole) for pole, _ in roots]
    zeros = [zero for _, zero in roots[1:]]
    plant = block("zero_pole_gain", zeros=zeros, poles=poles, gain=gain)
    diagram = system({"u": block("input"), "g": plant}, ["u -> g"], {"y": "g"})
    with mp.workdps(100):
        expected = mp.mpf(gain)
        for zero in zeros:
            expected *= -mp.mpf(zero)
        for pole in poles:
            expected /= -mp.mpf(pole)
        agree(diagram, "u", "y", expected, expected)


@given(st.integers(1, 4).flatmap(lambda n: st.lists(wide(), min_size=n * n + 2 * n + 1, max_size=n * n + 2 * n + 1)))
def test_matrices(entries: list[float]) -> None:
    n = next(n for n in range(1, 5) if n * n + 2 * n + 1 == len(entries))
    a = [entries[k * n : (k + 1) * n] for k in range(n)]
    b, c, d = entries[n * n : n * n + n], entries[n * n + n : n * n + 2 * n], entries[-1]
    plant = block("state_space", A=a, B=[[entry] for entry in b], C=[c], D=[[d]])
    diagram = system({"u": block("input"), "g": plant}, ["u -> g"], {"y": "g"})
    with mp.workdps(260):
        gains = []
        for power in (70, 73):
            states = mp.lu_solve(mp.mpf(10) ** -power * mp.eye(n) - mp.matrix(a), mp.matrix(b))
            gains.append(sum(mp.mpf(entry) * state for entry, state in zip(c, states, strict=True)) + mp.mpf(d))
        agree(diagram, "u", "y", *gains)


@pytest.mark.parametrize(
    ("kind", "name", "factor"),
    [
        ("linear_hydraulic_motor", "leakage", 1e12),
        ("linear_hydraulic_motor", "external_leakage", 1e-12),
        ("linear_hydraulic_motor", "viscous_friction", 1e12),
        ("two_inertia", "damping", 1e12),
        ("two_inertia", "gear_ratio", 1e-12),
        ("compliant_arm", "base_shape", 1e12),
        ("linear_pneumatic_motor", "leakage", 1e-12),
        ("mass_spring_damper", "stiffness", 1e-12),
        ("rotary_hydraulic_motor", "leakage", 1e12),
        ("rc_network", "r1", 1e12),
    ],
)
def test_families_that_lost_their_digits(kind: str, name: str, factor: float) -> None:
    for case in CASES:
        if case[0] == kind and name in case[1]:
            values, law, single = case[1:]
            index, value = next((i, v) for n, i, v in numbers(values) if n == name)
            changed = replaced(values, name, index, value * factor)
            diagram, inputs, outputs = alone(kind, changed)
            with mp.workdps(260):
                near, nearer = (law(mp.mpf(10) ** -power, exact(changed)) for power in (70, 73))
                for i, source in enumerate(inputs):
                    for o, target in enumerate(outputs):
                        pair = (near, nearer) if single else (near[o][i], nearer[o][i])
                        agree(diagram, source, target, *pair)


def test_slopes_of_what_lost_its_digits() -> None:
    _, values, law, _ = next(case for case in CASES if case[0] == "linear_hydraulic_motor" and "rod_area" in case[1])
    changed = replaced(values, "leakage", None, values["leakage"] * 1e12)
    diagram, _, _ = alone("linear_hydraulic_motor", changed)
    varied = [name for name, _, _ in numbers(changed)]
    evaluation = Evaluation(diagram, None, [f"it.{name}" for name in varied])
    path = evaluation.path("u0", "y1")
    assert path.static is not None
    got = evaluation.derivatives(path.static)
    with mp.workdps(260):
        s, step = mp.mpf(10) ** -70, mp.mpf(10) ** -40
        for name, slope in zip(varied, got, strict=True):
            ends = [
                law(s, exact(changed) | {name: mp.mpf(changed[name]) * (1 + sign * step)})[1][0] for sign in (1, -1)
            ]
            expected = (ends[0] - ends[1]) / (2 * step * mp.mpf(changed[name]))
            assert slope == pytest.approx(float(expected), rel=1e-12), name


def test_numbers_rounded_to_sixteen_digits_hide_what_they_mean_to_hide() -> None:
    # two masses pulled together, their matrix in rounded numbers: the motion of both is seen to 1e-17 of them
    m1, m2, k = 0.3, 0.7, 11.0
    a = [[0.0, 1.0, 0.0, 0.0], [-k / m1, -0.1 / m1, k / m1, 0.1 / m1], [0.0, 0.0, 0.0, 1.0], [k / m2, 0.1 / m2, -k / m2, -0.1 / m2]]  # fmt: skip
    plant = block("state_space", A=a, B=[[0.0], [1 / m1], [0.0], [-1 / m2]], C=[[1.0, 0.0, -1.0, 0.0]], D=[[0.0]])
    path = Evaluation(system({"u": block("input"), "g": plant}, ["u -> g"], {"y": "g"})).path("u", "y")
    assert path.verdict is Verdict.OK
    assert path.static is not None
    assert path.static[0] == pytest.approx(1 / k, rel=1e-12)
