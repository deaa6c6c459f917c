"""The integrated error, whose value under integral action is 1/ki after a load and 1/(ki P(0)) after a reference."""

import numpy as np
import pytest

from bench.optimizers.cases_convex import PI, gain, loop
from engine.analysis.study import MetricRequest, measure
from engine.model.verdicts import Verdict
from engine.signals import make

KI = 0.13


def integrated(port: str, *, ki: float = KI, amplitude: float = 1.0, duration: float | None = None):
    diagram = loop(
        controller=PI, parameters={"kp": gain(0.4), "ki": gain(ki, lower=0.0)}, numerator=[2.5],
        denominator=np.poly([-1, -2, -3]).tolist(),
    )  # fmt: skip
    signals = {port: make("step", {"amplitude": amplitude, "start": 0.2})}
    request = MetricRequest(metric="ie", signals=signals, output="y", duration=duration)
    return measure(diagram, [request], gradient=["kp", "ki"])[0]


def test_after_a_load_it_is_the_inverse_of_the_integral_gain() -> None:
    found, slopes = integrated("load", amplitude=3.0)
    assert found.value == pytest.approx(3.0 / KI, rel=1e-9)
    # elasticities -1 by ki and 0 by kp
    assert slopes is not None
    assert slopes.values * [0.4, KI] / found.value == pytest.approx([0.0, -1.0], abs=1e-8)


def test_after_a_reference_the_static_gain_comes_in() -> None:
    found, _ = integrated("reference")
    assert found.value == pytest.approx(6.0 / 2.5 / KI, rel=1e-9)


def test_without_integral_action_it_diverges() -> None:
    assert integrated("load", ki=0.0)[0].verdict is Verdict.DIVERGES


def test_up_to_a_duration_it_is_the_area_so_far() -> None:
    # y' = -y + 1 from the step on, seen as an error of opposite sign: ∫ = T - 1 + e^-T
    diagram = loop(controller=PI, parameters={"kp": gain(0.0, lower=0.0), "ki": gain(0.0, lower=0.0)}, numerator=[1.0],
                   denominator=[1.0, 1.0])  # fmt: skip
    request = MetricRequest(metric="ie", signals={"load": make("step", {})}, output="y", duration=2.0)
    assert measure(diagram, [request])[0][0].value == pytest.approx(1 + np.exp(-2.0), rel=1e-10)
