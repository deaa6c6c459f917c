"""Every metric keeps the promises that the API, the pages and the optimisers rely on: found by discovery, one loop serves all.

The loop is a position loop with a PID controller, whose reference, load and output are known, and whose parameters can be scaled in
time. What a metric needs to be asked for (an output, a path, a mask, a number) follows from what it declares.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import engine.metrics
from api.units.conversion import factor
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.metrics import Metric
from engine.model.masks import Corners, Envelope, FrequencyBounds, Mask, Polyline
from engine.model.metric_options import Options
from engine.model.verdicts import Measured, Verdict
from engine.signals import make
from tests.reference.batch_agreement import compare
from tests.reference.systems import block, system

METRICS = engine.metrics.catalogue()
GAINS = ("kp", "ki", "mass")
RELATIVE = 1e-6
"""Agreement of a slope with its differences, on the scale of the metric itself where the slope is small."""


def loop(*, slower: float = 1.0, kp: float = 26.0) -> Diagram:
    """Return r -> PID -> 1 / (mass s² + 2 s) with a load; ``slower`` stretches its time and changes no amplitude."""
    k = slower
    return system(
        {
            "r": block("input"),
            "load": block("input"),
            "e": block("sum", signs="+-"),
            "controller": block("pid", kp="=kp", ki=f"=ki/{k!r}", kd=2.0 * k, filter_frequency=200.0 / k),
            "force": block("sum", signs="+-"),
            "plant": block("transfer_function", numerator=[1.0], denominator=[f"=mass*{k * k!r}", 2.0 * k, 0.0]),
        },
        [
            "r -> e.in1", "plant -> e.in2", "e -> controller", "controller -> force.in1", "load -> force.in2",
            "force -> plant",
        ],
        {"position": "plant", "control": "controller"},
        {"kp": kp, "ki": 40.0, "mass": 0.5},
    )  # fmt: skip


def mask_of(metric: type[Metric], amplitude: float, slower: float) -> Mask | None:
    """Return what a whole curve is held against, stretched like the loop and its command."""
    times = tuple(slower * t for t in (0.05, 0.4, 2.0))
    if metric.mask == "envelope":
        return Envelope(upper=Polyline(times=times, values=tuple(amplitude * v for v in (1.1, 1.05, 1.01))))
    if metric.mask == "reference":
        return Polyline(times=times, values=tuple(amplitude * v for v in (0.2, 0.9, 1.0)))
    if metric.mask:
        places = tuple(w / slower for w in (0.5, 10.0, 300.0))
        return FrequencyBounds(upper=Corners(frequencies=places, magnitudes=(3.0, 2.0, 4.0)))
    return None


def request(kind: str, *, amplitude: float = 1.0, slower: float = 1.0) -> MetricRequest:
    """Return a metric as one asks for it: of a step of the reference, of r -> position, of the loop cut at the error."""
    metric = METRICS[kind]
    options = Options(
        **{
            name: value
            for name, value in {
                "recovery_band": 0.001 * amplitude, "noise_density": 0.01 * slower, "derivative": getattr(metric, "order", 0),
            }.items()
            if name in metric.options
        }
    )  # fmt: skip
    given: dict[str, Any] = {"metric": kind, "mask": mask_of(metric, amplitude, slower), "options": options}
    if metric.domain == "loop":
        given["open_at"] = "e"
    elif metric.domain == "path":
        given |= {"source": "r", "target": "control" if kind == "control_sensitivity_peak" else "position"}
    elif metric.domain == "time":
        # a load after the reference for what is about loads, or begins when the command ends
        reference = {"kind": "step", "amplitude": amplitude}
        load = {"amplitude": 0.5 * amplitude, "start": 3.0 * slower}
        signals = {"r": make(reference.pop("kind"), reference)}
        if kind == "recovery_time":
            signals["load"] = make("step", load)
        given |= {"signals": signals, "output": "control" if "effort" in kind else "position"}
        if kind == "control_effort_rms":  # a mean over time
            given["duration"] = 5.0 * slower
        if kind == "band_energy":
            given["band"] = (1.0 / slower, 50.0 / slower)
    return MetricRequest(**given)


def value(kind: str, *, amplitude: float = 1.0, slower: float = 1.0, **overrides: float) -> Measured:
    found, _ = measure(loop(slower=slower), [request(kind, amplitude=amplitude, slower=slower)], overrides=overrides)[0]
    return found


def test_one_file_is_one_metric() -> None:
    files = {path.stem for path in Path(engine.metrics.__path__[0]).glob("*.py") if not path.stem.startswith("_")}
    assert {kind: metric.__module__ for kind, metric in METRICS.items()} == {
        name: f"engine.metrics.{name}" for name in files
    }


@pytest.mark.parametrize("kind", METRICS)
def test_words(kind: str) -> None:
    metric = METRICS[kind]
    assert metric.title[0].isupper()
    assert len(metric.title) <= 40
    assert metric.definition.endswith(".")
    assert metric.source
    assert metric.better in {"lower", "higher"}
    assert metric.range[0] < metric.range[1]
    units = metric.unit.replace("output", "m").replace("input", "m").replace("/s**0.5", "")
    assert units == "1" or factor(units, units) == 1
    if metric.usual_unit:
        assert metric.usual_unit in {"deg", "%", "dB"}


@pytest.mark.parametrize("kind", METRICS)
def test_it_has_a_value_on_an_ordinary_loop(kind: str) -> None:
    found = value(kind)
    if found.value is None:  # nothing is wrong with the loop: it is only as good as can be
        assert found.verdict in {Verdict.NEVER_CROSSES, Verdict.NOT_OSCILLATORY}, found
        assert METRICS[kind].absent_is_infinite
        assert found.advice
        return
    assert found.verdict is Verdict.OK, found
    compared = float(METRICS[kind].distance(np.array([found.value]))[0])
    low, high = METRICS[kind].range
    assert low <= compared <= high


@pytest.mark.parametrize("kind", METRICS)
def test_its_slopes_are_the_limits_of_its_differences(kind: str) -> None:
    diagram, asked = loop(), [request(kind)]
    (found, slopes), *_ = measure(diagram, asked, gradient=GAINS)
    if found.value is None:
        return
    assert slopes is not None
    assert not slopes.one_sided
    for place, name in enumerate(GAINS):
        at = diagram.parameters[name].value

        def change(step: float, name: str = name, at: float = at) -> float:
            up, down = (
                measure(diagram, asked, overrides={name: at * (1 + sign * step)})[0][0].value for sign in (1, -1)
            )
            assert up is not None
            assert down is not None
            return (up - down) / (2 * step)

        # Richardson: the error of a central difference falls with the square of its step
        coarse, fine = change(2e-3), change(1e-3)
        limit = fine + (fine - coarse) / 3
        exact = slopes.values[place] * at
        assert exact == pytest.approx(limit, rel=RELATIVE, abs=RELATIVE * max(abs(found.value), 1e-3)), name


@pytest.mark.parametrize("kind", METRICS)
def test_it_grows_with_the_powers_that_it_declares(kind: str) -> None:
    metric, found = METRICS[kind], value(kind)
    if found.value is None:
        return
    larger = value(kind, amplitude=3.0).value
    slower = value(kind, slower=4.0).value
    # what it declares is of the output that is named; of a position it is differentiated first
    time_power = metric.time_power - (getattr(metric, "order", None) or 0)
    assert larger == pytest.approx(found.value * 3.0**metric.amplitude_power, rel=1e-9)
    assert slower == pytest.approx(found.value * 4.0**time_power, rel=1e-8)


@pytest.mark.parametrize("kind", METRICS)
def test_an_unstable_loop_has_a_verdict_and_advice(kind: str) -> None:
    found = value(kind, mass=-0.5)
    if METRICS[kind].domain == "system":
        assert found.value is not None or found.verdict is Verdict.NOT_OSCILLATORY  # poles are there whatever they do
        return
    if request(kind).duration is not None:  # what a window says of it is a number
        assert found.value is not None
        return
    assert found.value is None, found
    assert found.verdict is Verdict.UNSTABLE, found
    assert found.advice


@pytest.mark.parametrize("kind", METRICS)
def test_many_at_once_are_what_each_is_alone(kind: str) -> None:
    diagram, asked = loop(), [request(kind)]
    screening = Screening(diagram, asked, threads=1)
    rng = np.random.default_rng(list(METRICS).index(kind))
    values = {name: diagram.parameters[name].value * np.exp(rng.normal(0.0, 0.2, 12)) for name in GAINS}
    screened = screening(values)
    again = screening({name: column[::-1].copy() for name, column in values.items()})
    np.testing.assert_array_equal(screened.doubtful, again.doubtful[::-1])
    sure = ~screened.doubtful[:, 0]
    # whatever its neighbours are, a candidate's number is the same
    np.testing.assert_allclose(screened.values[sure], again.values[::-1][sure], rtol=1e-12)
    agreement = compare(diagram, asked, values, screened)
    assert agreement.wrong == []
    if screening.compiled(GAINS):
        assert agreement.share_doubtful <= 0.1


def test_numbers_that_a_metric_takes_are_asked_for_by_name() -> None:
    for kind, metric in METRICS.items():
        for name in metric.options:
            bare = request(kind)
            bare = MetricRequest(
                **{key: getattr(bare, key) for key in ("metric", "signals", "output", "source", "target")}
            )
            found, _ = measure(loop(), [bare])[0]
            if bare.options.lacking((name,)):
                assert found.value is None
                assert name in found.advice
            else:
                assert found.value is None or math.isfinite(found.value)
