"""The decay rate of what decays last: against formulas, Lambert's W for a loop with a delay, and converged differences."""

from __future__ import annotations

import itertools
import math

import pytest
from scipy.special import lambertw

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from tests.reference.systems import block, system

REQUEST = MetricRequest(metric="spectral_abscissa")


def chain(*blocks: tuple[str, dict], **parameters: float) -> Diagram:
    """u -> each block -> y."""
    named = {f"b{k}": block(kind, **values) for k, (kind, values) in enumerate(blocks)}
    names = ["u", *named]
    wires = [f"{a} -> {b}" for a, b in itertools.pairwise(names)]
    return system({"u": block("input"), **named}, wires, {"y": names[-1]}, parameters)


def delayed_loop(gain: float, delay: float) -> Diagram:
    """x' = k (r - x)(t - delay): s + k e^(-s delay) = 0."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "k": block("gain", gain="=k"),
        "late": block("delay", time="=t"), "x": block("integrator"),
    }  # fmt: skip
    return system(blocks, ["r -> e.in1", "x -> e.in2", "e -> k", "k -> late", "late -> x"], {"y": "x"}, {"k": gain, "t": delay})  # fmt: skip


def test_it_is_the_rate_of_the_slowest_mode_with_its_derivatives() -> None:
    # poles -a, -z w ± j w √(1 - z²)
    mode = ("transfer_function", {"numerator": [1], "denominator": [1, "=2*z*w", "=w**2"]})
    lag = ("transfer_function", {"numerator": [1], "denominator": [1, "=a"]})
    diagram = chain(mode, lag, a=3.0, z=0.1, w=20.0)
    ((found, gradient),) = measure(diagram, [REQUEST], gradient=["a", "z", "w"])
    assert (found.unit, found.verdict) == ("1/s", Verdict.OK)
    assert found.value == pytest.approx(-2.0, rel=1e-12)
    assert found.at == pytest.approx(20 * math.sqrt(0.99), rel=1e-12)
    assert gradient is not None
    assert gradient.values == pytest.approx([0.0, -20.0, -0.1], abs=1e-12)
    assert not gradient.one_sided
    ((slow, _),) = measure(diagram, [REQUEST], overrides={"a": 0.5})
    assert slow.value == pytest.approx(-0.5, rel=1e-12)


def test_where_two_modes_decay_alike_it_has_a_kink() -> None:
    mode = ("transfer_function", {"numerator": [1], "denominator": [1, "=2*z*w", "=w**2"]})
    lag = ("transfer_function", {"numerator": [1], "denominator": [1, "=a"]})
    ((found, gradient),) = measure(chain(mode, lag, a=2.0, z=0.1, w=20.0), [REQUEST], gradient=["a", "z"])
    assert found.value == pytest.approx(-2.0, rel=1e-12)
    assert gradient is not None
    assert gradient.one_sided


@pytest.mark.parametrize(("gain", "delay"), [(0.2, 1.0), (1.0, 1.0), (1.7, 1.0), (30.0, 0.01)])
def test_with_a_delay_it_is_lamberts_function(gain: float, delay: float) -> None:
    # s + k e^(-s τ) = 0: s = W₀(-k τ) / τ;  ds/dk = -e^(-sτ) / (1 + s τ)
    s = complex(lambertw(-gain * delay)) / delay
    ((found, gradient),) = measure(delayed_loop(gain, delay), [REQUEST], gradient=["k", "t"])
    assert found.value == pytest.approx(s.real, rel=1e-10)
    assert gradient is not None
    slopes = s / gain / (1 + s * delay), -s * s / (1 + s * delay)
    assert gradient.values == pytest.approx([slope.real for slope in slopes], rel=1e-8)


def test_an_integrator_has_zero_a_growing_mode_its_rate_and_a_gain_none() -> None:
    lag = ("transfer_function", {"numerator": [1], "denominator": [1, 2]})
    ((integrating, _),) = measure(chain(lag, ("integrator", {})), [REQUEST])
    assert (integrating.value, integrating.verdict) == (0.0, Verdict.OK)
    ((growing, _),) = measure(chain(("transfer_function", {"numerator": [1], "denominator": [1, -3]})), [REQUEST])
    assert growing.value == pytest.approx(3.0, rel=1e-12)
    ((still, _),) = measure(chain(("gain", {"gain": 2.0})), [REQUEST])
    assert (still.value, still.verdict) == (None, Verdict.NOT_APPLICABLE)
