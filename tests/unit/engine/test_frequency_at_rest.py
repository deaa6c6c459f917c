"""Frequency responses at ω = 0 and at poles on the imaginary axis, against the transfer functions by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.frequency_study import frequency_response
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from tests.unit.engine.diagrams import block, document

ASKED = np.array([0.0, 0.5, 3.0])


def chain(numerator: list[float], denominator: list[float], **blocks) -> Diagram:
    plant = block("transfer_function", numerator=numerator, denominator=denominator)
    wires = ["u -> plant"] if not blocks else ["u -> line", "line -> plant"]
    return compile_system(document({"u": block("input"), "plant": plant, **blocks}, wires, {"y": "plant"}))


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([2.0, 6.0], [1.0, 2.0, 4.0]),
        ([1.0, 0.0], [1.0, 1.0]),  # 0 at rest
        ([-5.0], [1.0, 1.0]),  # negative at rest: π or -π, as beside it
        ([1.0], [1.0, -2.0]),  # unstable: the gain at rest is there all the same
        ([3.0], [2.0]),  # no states
    ],
)
def test_at_rest_it_is_the_static_gain(numerator, denominator):
    found = frequency_response(chain(numerator, denominator), source="u", target="y", frequencies=ASKED)
    expected = np.polyval(numerator, 1j * ASKED) / np.polyval(denominator, 1j * ASKED)
    np.testing.assert_allclose(found.response, expected, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(np.exp(1j * found.phase[1:]), expected[1:] / np.abs(expected[1:]), rtol=1e-12)
    assert np.isnan(found.phase[0]) if expected[0] == 0 else abs(found.phase[0] - found.phase[1]) < math.pi
    assert found.unbounded == ()


def test_asking_at_rest_turns_no_other_phase():
    """-1/(s+1)² passes -π only by where it begins; the same with and without ω = 0."""
    diagram = chain([-1.0], [1.0, 2.0, 1.0])
    alone = frequency_response(diagram, source="u", target="y", frequencies=ASKED[1:])
    both = frequency_response(diagram, source="u", target="y", frequencies=ASKED)
    np.testing.assert_array_equal(both.phase[1:], alone.phase)


def test_at_a_delay_it_is_the_static_gain():
    found = frequency_response(
        chain([4.0], [1.0, 2.0], line=block("delay", time=0.3)), source="u", target="y", frequencies=ASKED
    )
    np.testing.assert_allclose(found.response, 4 * np.exp(-0.3j * ASKED) / (1j * ASKED + 2), rtol=1e-13)


@pytest.mark.parametrize(
    ("denominator", "pole", "verdict"),
    [
        ([1.0, 1.0, 0.0], 0.0, Verdict.INTEGRATING),
        ([1.0, 0.0, 0.0], 0.0, Verdict.INTEGRATING),
        ([1.0, 0.0, 9.0], 3.0, Verdict.MARGINAL),
        ([1.0, 1.0, 9.0, 9.0], 3.0, Verdict.MARGINAL),
        ([0.1, 1.0, 0.9, 9.0], 3.0, Verdict.MARGINAL),
    ],
)
def test_at_a_pole_on_the_axis_there_is_none_and_why(denominator, pole, verdict):
    found = frequency_response(chain([1.0], denominator), source="u", target="y", frequencies=ASKED)
    assert [(at.frequency, at.verdict) for at in found.unbounded] == [(pole, verdict)]
    there = np.isclose(ASKED, pole, rtol=0, atol=0)
    assert np.isnan(found.response[there]).all()
    assert np.isnan(found.phase[there]).all()
    expected = 1 / np.polyval(denominator, 1j * ASKED[~there])
    np.testing.assert_allclose(found.response[~there], expected, rtol=1e-12)
    np.testing.assert_allclose(np.exp(1j * found.phase[~there]), expected / np.abs(expected), rtol=1e-10)


def test_an_open_loop_has_its_gain_at_rest_too():
    """L = 20/(s + 4) and 20/(s (s + 4))."""
    for order, at_rest in (([1.0, 4.0], 5.0), ([1.0, 4.0, 0.0], None)):
        diagram = compile_system(
            document(
                {
                    "r": block("input"),
                    "e": block("sum", signs="+-"),
                    "plant": block("transfer_function", numerator=[20.0], denominator=order),
                },
                ["r -> e.in1", "plant -> e.in2", "e -> plant"],
                {"y": "plant"},
            )
        )
        found = frequency_response(diagram, open_at="e", frequencies=ASKED)
        np.testing.assert_allclose(found.response[1:], 20 / np.polyval(order, 1j * ASKED[1:]), rtol=1e-13)
        if at_rest is None:
            assert [point.verdict for point in found.unbounded] == [Verdict.INTEGRATING]
        else:
            assert found.response[0] == pytest.approx(at_rest, rel=1e-14)
