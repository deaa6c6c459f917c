"""Shaped commands on a simulated mode: residual vibration and its band as published, to 1e-4.

The formulas' own numbers (zeta = 0): ZV |cos(0.9 π/2)| = 0.1564, ZVD its square 0.0245, EI with V = 5 % 0.0243; the band in
which less than 5 % is left: 0.0637, 0.2871, 0.3995 of the frequency.
"""

from __future__ import annotations

import math

import pytest
from scipy.optimize import brentq

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.signals import make


def left(shaper: str, ratio: float) -> float:
    """Return what vibrates after a shaped step, relative to a plain one, when the mode lies at ``ratio`` of the frequency."""
    diagram = compile_system(
        System(
            blocks={
                "u": Block(kind="input"),
                "mode": Block(
                    kind="transfer_function",
                    values={"numerator": [ratio**2], "denominator": [1.0, 0.0, ratio**2]},
                ),
            },
            connections=(Connection(source="u", target="mode"),),
            outputs={"x": "mode"},
        )
    )
    signal = make("shaped", {"shaper": shaper, "frequency": 1.0, "command": {"kind": "step"}})
    end = signal.end()
    assert end is not None
    # without damping it swings for ever: two periods after the command tell; a plain step swings by 1 around its end
    subject = Evaluation(diagram).time_subject({"u": signal}, "x", duration=end + 4 * math.pi / ratio)
    rest = subject.curve.since(end)
    return float((rest.largest()[0] - rest.smallest()[0])[0].real) / 2


@pytest.mark.parametrize(("shaper", "beside"), [("zv", 0.1564), ("zvd", 0.0245), ("ei", 0.0243)])
@pytest.mark.parametrize("ratio", [0.9, 1.1])
def test_residual_vibration_at_a_frequency_that_is_10_percent_wrong(shaper: str, beside: float, ratio: float) -> None:
    assert left(shaper, ratio) == pytest.approx(beside, abs=1e-4)


@pytest.mark.parametrize(("shaper", "allowed"), [("zv", 0.0), ("zvd", 0.0), ("zvdd", 0.0), ("ei", 0.05)])
def test_residual_vibration_at_the_frequency_itself(shaper: str, allowed: float) -> None:
    assert left(shaper, 1.0) == pytest.approx(allowed, abs=1e-9)


@pytest.mark.parametrize(("shaper", "width"), [("zv", 0.0637), ("zvd", 0.2871), ("ei", 0.3995)])
def test_width_of_the_band_in_which_less_than_5_percent_is_left(shaper: str, width: float) -> None:
    below, above = (
        brentq(lambda ratio: left(shaper, ratio) - 0.05, *bracket, xtol=1e-6)
        for bracket in ((0.7, 0.975), (1.025, 1.3))
    )
    assert above - below == pytest.approx(width, abs=1e-4)
