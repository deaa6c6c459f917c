"""Zeros of paths: against the numbers that they were made of, in open and closed loops, with hidden modes and with delays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.frequency_study import frequency_response
from engine.diagram.diagram import Diagram
from engine.exact.frequency.zeros import zeros
from tests.reference.systems import block, system


def loop(controller: Any, plant: Any, *, forward: float = 0.0, back: float = 0.0) -> Diagram:
    """r -> e -> C -> delay -> (+ load) -> P -> y, back through another delay."""
    blocks = {
        "r": block("input"), "load": block("input", role="disturbance"), "e": block("sum", signs="+-"), "c": controller,
        "late": block("delay", time=forward), "s": block("sum", signs="++"), "p": plant, "back": block("delay", time=back),
    }  # fmt: skip
    wires = [
        "r -> e.in1",
        "back -> e.in2",
        "e -> c",
        "c -> late",
        "late -> s.in1",
        "load -> s.in2",
        "s -> p",
        "p -> back",
    ]
    return system(blocks, wires, {"y": "p", "u": "c"})


def found(diagram: Diagram, source: str = "r", target: str = "y") -> np.ndarray | None:
    return zeros(Evaluation(diagram).path(source, target).response.system)


def zpk(zeros_: Any, poles: Any, gain: float) -> Any:
    def listed(values: Any) -> list[Any]:
        return [[float(v.real), float(v.imag)] if np.iscomplex(v) else float(np.real(v)) for v in values]

    return block("zero_pole_gain", zeros=listed(zeros_), poles=listed(poles), gain=gain)


def drawn(random: np.random.Generator, count: int) -> np.ndarray:
    """Return distinct numbers, half of them in conjugate pairs, over three decades; some to the right."""
    pairs = int(random.integers(0, count // 2 + 1))
    size = np.exp(random.uniform(-2.0, 5.0, count - pairs))
    angle = np.where(np.arange(count - pairs) < pairs, random.uniform(0.3, 1.2, count - pairs), 0.0)
    values = -size * np.exp(1j * angle)
    return np.concatenate([values, values[:pairs].conj()])


def same(got: np.ndarray, wanted: np.ndarray, relative: float) -> None:
    assert len(got) == len(wanted)
    left = list(wanted)
    for value in got:
        nearest = min(left, key=lambda other: abs(other - value))
        assert abs(nearest - value) <= relative * abs(nearest), (value, nearest)
        left.remove(nearest)


@pytest.mark.parametrize("delays", [{}, {"forward": 0.3}, {"back": 0.2}, {"forward": 0.3, "back": 0.2}])
def test_paths_of_random_loops_have_the_zeros_that_they_were_made_with(delays: dict[str, float]) -> None:
    random = np.random.default_rng(2711)
    for _ in range(60):
        n = int(random.integers(2, 5))
        p_poles, p_zeros = drawn(random, n), drawn(random, int(random.integers(0, n)))
        c_poles, c_zeros = drawn(random, 2), drawn(random, int(random.integers(0, 3)))
        diagram = loop(zpk(c_zeros, c_poles, 0.01), zpk(p_zeros, p_poles, 1.0), **delays)
        same(found(diagram), np.concatenate([c_zeros, p_zeros]), 1e-6)
        same(found(diagram, "load"), np.concatenate([c_poles, p_zeros]), 1e-6)
        same(found(diagram, "r", "u"), np.concatenate([c_zeros, p_poles]), 1e-6)


def test_a_hidden_mode_is_no_zero() -> None:
    # (s + 1)/(s + 2) · 1/(s + 1): the pole at -1 is not driven
    blocks = {
        "r": block("input"), "a": block("transfer_function", numerator=[1, 1], denominator=[1, 2]),
        "b": block("transfer_function", numerator=[1], denominator=[1, 1]),
    }  # fmt: skip
    assert found(system(blocks, ["r -> a", "a -> b"], {"y": "b"})).size == 0


def test_a_right_half_plane_zero_and_a_notch_are_where_they_are() -> None:
    blocks = {
        "r": block("input"), "valve": block("transfer_function", numerator=[-1, 4], denominator=[1, 3, 9]),
        "notch": block("transfer_function", numerator=[1, 0, 25], denominator=[1, 10, 25]),
    }  # fmt: skip
    got = found(system(blocks, ["r -> valve", "valve -> notch"], {"y": "notch"}))
    np.testing.assert_allclose(got, [4, -5j, 5j], atol=1e-12)


def test_delays_beside_each_other_make_zeros_without_end() -> None:
    blocks = {"r": block("input"), "late": block("delay", time=0.5), "s": block("sum", signs="++")}
    assert found(system(blocks, ["r -> late", "late -> s.in1", "r -> s.in2"], {"y": "s"})) is None


def test_what_passes_nothing_on_has_none() -> None:
    blocks = {"r": block("input"), "other": block("input"), "lag": block("transfer_function", numerator=[1], denominator=[1, 1])}  # fmt: skip
    assert found(system(blocks, ["other -> lag"], {"y": "lag"})).size == 0


def test_a_frequency_response_tells_those_of_what_it_shows() -> None:
    diagram = loop(
        block("pi", kp=2.0, ki=6.0), block("transfer_function", numerator=[1, 7], denominator=[1, 2, 5]), forward=0.01
    )
    np.testing.assert_allclose(frequency_response(diagram, source="r", target="y").zeros, [-3, -7], rtol=1e-9)
    np.testing.assert_allclose(frequency_response(diagram, open_at="e").zeros, [-3, -7], rtol=1e-9)
    np.testing.assert_allclose(
        frequency_response(diagram, source="load", target="y").zeros, [0, -7], rtol=1e-9, atol=1e-9
    )
