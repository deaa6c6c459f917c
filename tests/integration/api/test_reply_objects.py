"""What a script or a notebook gets from a real service: objects, tables, arrays, plots."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import servotune

AXIS = {
    "name": "axis",
    "parameters": {"kp": {"value": 12.0, "unit": "1/s"}},
    "blocks": {
        "reference": {"kind": "input"},
        "sum": {"kind": "sum", "signs": "+-"},
        "controller": {"kind": "gain", "gain": "=kp"},
        "drive": {"kind": "transfer_function", "numerator": [1.0], "denominator": [0.02, 1.0, 0.0]},
    },
    "connections": [
        {"from": "reference", "to": "sum.in1"}, {"from": "drive", "to": "sum.in2"}, {"from": "sum", "to": "controller"},
        {"from": "controller", "to": "drive"},
    ],
    "outputs": {"position": "drive"},
}  # fmt: skip
STEP = {"port": "reference", "signal": {"kind": "step", "amplitude": 0.1}}


@pytest.fixture(scope="module")
def script(sqlite_service) -> Iterator[servotune.Client]:
    mpl.use("agg")
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["run"]) as client:
        yield client
    plt.close("all")


def test_a_simulation_is_metrics_a_table_and_a_plot(script) -> None:
    reply = script.simulate(AXIS, input=STEP, samples=200)
    assert (
        float(reply.metrics["position"].overshoot) == reply["variants"][0]["metrics"]["position"]["overshoot"]["value"]
    )
    table = reply.to_pandas()
    assert table["position"].to_numpy() == pytest.approx(reply.outputs["position"], abs=0)
    assert len(repr(reply)) < 200
    (axes,) = reply.plot()
    assert axes.get_xlabel() == "time (s)"
    assert np.allclose(axes.get_lines()[0].get_ydata(), reply.outputs["position"])
    assert "overshoot" in reply._repr_html_()


def test_variants_are_compared_in_one_table_and_one_plot(script) -> None:
    reply = script.simulate(AXIS, input=STEP, duration=1.0, samples=50, variants=[{"kp": 5.0}, {"kp": 20.0}])
    arrays = reply.to_xarray()
    assert dict(arrays.sizes) == {"variant": 2, "time": 50}
    assert arrays["position"].sel(variant=1).to_numpy() == pytest.approx(reply.variants[1].outputs["position"], abs=0)
    (axes,) = reply.plot()
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["kp = 5", "kp = 20"]


def test_a_frequency_response_is_drawn_as_bode_and_as_nyquist(script) -> None:
    reply = script.frequency_response(AXIS, open_at="controller")
    magnitude, phase = reply.plot()
    assert (magnitude.get_ylabel(), phase.get_ylabel()) == ("magnitude (dB)", "phase (°)")
    assert 10 ** (magnitude.get_lines()[0].get_ydata()[0] / 20) == pytest.approx(reply.variants[0].magnitude[0])
    (plane,) = reply.plot("nyquist")
    assert plane.get_lines()[0].get_xdata()[5] == reply.variants[0].real[5]
    with pytest.raises(ValueError, match="kind must be one of bode, nyquist, got 'nichols'"):
        reply.plot("nichols")
    assert float(reply.metrics.phase_margin) > 1.0


def test_influence_is_a_table_and_bars(script) -> None:
    reply = script.influence(
        AXIS, input="reference", output="position", parameters=["kp"], metrics=["overshoot", "rise_time"]
    )
    assert reply.to_pandas().loc["rise_time", "kp"] == reply.elasticities["rise_time"]["kp"].value
    assert [axes.get_title(loc="left") for axes in reply.plot()] == ["overshoot", "rise_time"]


def test_a_spectrum_is_a_table_and_a_plot(script) -> None:
    reply = script.spectrum(AXIS, input=STEP, output="position", quantity="amplitude", duration=2.0, samples=400)
    assert reply.to_pandas()["value"].to_numpy() == pytest.approx(reply.variants[0]["value"], abs=0)
    (axes,) = reply.plot()
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_an_optimum_tells_its_goals_in_a_table_and_its_responses_in_a_plot(script, sqlite_worker) -> None:
    job = script.optimize(
        AXIS,
        variables=[{"parameter": "kp", "lower": 1.0, "upper": 60.0}],
        experiments=[{"name": "step", "input": STEP}],
        goals=[{"metric": "rise_time", "sense": "minimize"}, {"metric": "overshoot", "upper": 0.05}],
    )
    found = job.wait(progress=False)
    goals = found.to_pandas()
    assert goals["metric"].tolist() == ["rise_time", "overshoot"]
    assert goals["after"][1] == pytest.approx(0.05, rel=1e-6)
    assert found.history_to_pandas().index.name == "evaluation"
    assert {line.get_label() for line in found.plot()[0].get_lines()} == {"before", "after"}
    assert found.plot("history")[0].get_xlabel() == "evaluations"
    assert found.best.kp == found["best"]["kp"]
    assert "converged" in repr(found)


def test_a_formula_goes_wherever_a_document_goes(script) -> None:
    drive = servotune.tf([1.0], [0.02, 1.0, 0.0], "drive")
    loop = servotune.feedback(servotune.gain("=kp") >> drive).system("axis", kp=servotune.quantity(12.0, "1/s"))
    built = script.simulate(loop, input=STEP | {"port": "r"}, samples=50)
    written = script.simulate(AXIS, input=STEP, samples=50)
    assert built.outputs["y"] == pytest.approx(written.outputs["position"], abs=1e-12)
