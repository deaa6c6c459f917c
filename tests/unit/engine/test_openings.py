"""Several places opened together: the margins of an inner loop with the outer one open, as python-control has them."""

from __future__ import annotations

import control
import numpy as np
import pytest

from engine.analysis.frequency_study import frequency_response
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from tests.reference.systems import block, system

W = np.geomspace(0.1, 1000.0, 200)


def cascade(**changed: float) -> Diagram:
    """Position over speed over a drive with two lags: r -> P -> PI -> 20/((0.05 s + 1)(0.002 s + 1)) -> 1/s."""
    blocks = {
        "r": block("input"), "outer": block("sum", signs="+-"), "kv": block("p", kp="=kv"), "inner": block("sum", signs="+-"),
        "speed": block("pi", kp="=kp", ki=2.0),
        "drive": block("transfer_function", numerator=[20], denominator=[1e-4, 0.052, 1]), "way": block("integrator"),
    }  # fmt: skip
    wires = [
        "r -> outer.in1", "way -> outer.in2", "outer -> kv", "kv -> inner.in1", "drive -> inner.in2", "inner -> speed",
        "speed -> drive", "drive -> way",
    ]  # fmt: skip
    return system(blocks, wires, {"position": "way", "speed": "drive"}, {"kv": 10.0, "kp": 1.0} | changed)


S = control.tf("s")
DRIVE = 20 / (1e-4 * S**2 + 0.052 * S + 1)


@pytest.mark.parametrize("kp", [0.3, 1.0, 5.0])
def test_the_inner_loop_alone_is_that_of_python_control(kp: float) -> None:
    alone = (kp + 2 / S) * DRIVE
    study = frequency_response(
        cascade(),
        overrides={"kp": kp},
        open_at=("inner", "outer"),
        frequencies=W,
        metrics=["phase_margin", "sensitivity_peak"],
    )
    np.testing.assert_allclose(study.response, alone(1j * W), rtol=1e-10)
    _, phase, *_ = control.margin(alone)
    assert study.metrics["phase_margin"].value == pytest.approx(np.radians(phase), rel=1e-6)
    assert study.metrics["sensitivity_peak"].value == pytest.approx(
        float(control.norm(1 / (1 + alone), p="inf")), rel=1e-5
    )
    # cut at one place alone, the outer loop acts through the inner one
    whole = frequency_response(cascade(), overrides={"kp": kp}, open_at="inner", frequencies=W)
    np.testing.assert_allclose(whole.response, ((kp + 2 / S) * DRIVE * (1 + 10 / S))(1j * W), rtol=1e-10)


def test_the_first_place_is_the_cut_and_the_others_are_silent() -> None:
    # cut at the outer error with the drive's speed no longer fed back: r -> position without an inner loop
    study = frequency_response(cascade(), open_at=("outer", "inner"), frequencies=W)
    np.testing.assert_allclose(study.response, np.zeros(len(W)), atol=1e-15)  # nothing passes the opened inner error
    one = frequency_response(cascade(), open_at=("inner",), frequencies=W).response
    np.testing.assert_allclose(one, frequency_response(cascade(), open_at="inner", frequencies=W).response, rtol=1e-14)


def test_a_margin_has_its_derivative_and_its_own_stability() -> None:
    request = MetricRequest(metric="phase_margin", open_at=("inner", "outer"))
    ((found, gradient),) = measure(cascade(), [request], gradient=["kp", "kv"])
    h = 1e-5
    up, down = (measure(cascade(), [request], overrides={"kp": 1 + d})[0][0].value for d in (h, -h))
    assert gradient is not None
    assert gradient.values == pytest.approx([(up - down) / (2 * h), 0.0], rel=1e-6)
    # the outer loop with kv = 1e4 is unstable; what the inner loop tolerates alone is as it was
    ((same, _),) = measure(cascade(), [request], overrides={"kv": 1e4})
    assert same.value == pytest.approx(found.value, rel=1e-12)
    ((whole, _),) = measure(cascade(), [MetricRequest(metric="phase_margin", open_at="inner")], overrides={"kv": 1e4})
    assert whole.verdict is Verdict.UNSTABLE


def test_the_screening_leaves_it_to_the_exact_path() -> None:
    request = MetricRequest(metric="phase_margin", open_at=("inner", "outer"))
    path = MetricRequest(metric="bandwidth", source="r", target="position")
    found = Screening(cascade(), [request, path])({"kp": np.array([0.5, 1.0])})
    assert np.isnan(found.values[:, 0]).all()
    assert found.doubtful[:, 0].all()
    for kp, value in zip((0.5, 1.0), found.values[:, 1], strict=True):
        exact = measure(cascade(), [path], overrides={"kp": kp})[0][0].value
        assert value == pytest.approx(exact, rel=1e-6)


def test_two_places_of_one_signal_and_an_unknown_one_are_refused() -> None:
    with pytest.raises(DiagramError, match=r"different signals, got 'inner' and 'inner\.out' of one"):
        frequency_response(cascade(), open_at=("inner", "inner.out"))
    with pytest.raises(DiagramError, match="ghost"):
        frequency_response(cascade(), open_at=("inner", "ghost"))
