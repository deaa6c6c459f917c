"""Random nonlinear loops, half of them with a part that ends their run: no metric without a whole run, no optimum on an incomplete one.

Which runs end is known by formula: z' = b + z² ends at π/(2 √b); x'' = -b² (sign x + sign(x')/2) from x = 1 switches without end at
6.309…/b. Both stand beside the loop whose error is looked at, so that nothing else tells that the run has ended.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, findings, measured_of
from engine.diagram.diagram import Block, Diagram, compile_system
from engine.exact.nonlinear.response import Response
from engine.metrics import catalogue
from engine.metrics._base import TimeMetric
from engine.model.metric_options import Options
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.search.result import Status
from tests.unit.engine.diagrams import block, document

LOOPS = 1000 if settings().max_examples > 1000 else 7
DURATION = 2.0
SLOWEST = 2 * (1 + 1 / 3) / (1 - math.sqrt(1 / 3))
"""When the twisting part has come to rest, for b = 1: its swings are each √(1/3) as long as the one before, of 8/3 the first."""
METRICS = tuple(k for k, m in catalogue().items() if issubclass(m, TimeMetric) and not m.mask)

Part = tuple[dict[str, Block], list[str], str]
"""Blocks, wires, and the output."""


def one(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number, even on a log scale."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def simple(rng: np.random.Generator) -> Part:
    """A controller with a lag, a law, a plant that may integrate."""
    size = one(rng, 0.05, 2.0)
    laws: Mapping[str, dict[str, Any]] = {
        "saturation": {"upper": size}, "dead_zone": {"lower": -0.1 * size, "upper": 0.1}, "backlash": {"width": 0.1 * size},
        "quantizer": {"step": 0.2 * size}, "rate_limiter": {"rising": 5 * size}, "relay": {"hysteresis": 0.2 * size},
        "lookup_table": {"points": [-1.0, 0.0, 1.0], "values": [-size, 0.0, 1.5]}, "zero_order_hold": {"sample_time": 0.05},
        "mr_damper_bingham": {"yield_force": [size], "damping": [0.5], "transition_velocity": 0.3},
        "friction": {"coulomb": size, "static": 1.5 * size, "transition_velocity": 0.1},
    }  # fmt: skip
    kind = str(rng.choice(list(laws)))
    denominator = np.poly([-one(rng, 0.5, 5.0), *([0.0] if rng.random() < 0.5 else [])]).tolist()
    blocks = {
        "e": block("sum", signs="+-"), "law": block(kind, **laws[kind]),
        "c": block("transfer_function", numerator=[one(rng, 0.3, 5.0)], denominator=[0.02, 1.0]),
        "p": block("transfer_function", numerator=[1.0], denominator=denominator),
    }  # fmt: skip
    if rng.random() < 0.25:
        blocks["d"] = block("delay", time=one(rng, 1e-3, 0.05))
        return blocks, ["r -> e.in1", "p -> d", "d -> e.in2", "e -> c", "c -> law", "law -> p"], "p"
    return blocks, ["r -> e.in1", "p -> e.in2", "e -> c", "c -> law", "law -> p"], "p"


def dry(rng: np.random.Generator) -> Part:
    """A mass that sticks, under PD or PID control."""
    values = {"coulomb": one(rng, 0.1, 5.0)}
    if rng.random() < 0.5:
        values |= {"static": 1.5 * values["coulomb"], "stribeck_velocity": 0.05}
    blocks = {
        "e": block("sum", signs="+-"), "n": block("sum", signs="+-"), "f": block("friction", **values),
        "c": block("pid", kp=one(rng, 5.0, 50.0), ki=float(rng.choice([0.0, 2.0])), kd=5.0, filter_frequency=200.0),
        "v": block("integrator"), "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> n.in1", "v -> f.velocity", "f -> n.in2", "n -> v", "v -> x"]
    return blocks, wires, "x"


def hydraulic(rng: np.random.Generator) -> Part:
    """A cylinder behind a spool valve; the reference is scaled down to its stroke."""
    blocks = {
        "g": block("gain", gain=0.05), "e": block("sum", signs="+-"), "k": block("gain", gain=one(rng, 2e-3, 2e-2)),
        "s": block("transfer_function", numerator=[1.0], denominator=[0.01, 1.0]),
        "valve": block("orifice_valve", overlap=float(rng.choice([0.0, 2e-5]))),
        "c": block("hydraulic_cylinder", initial_position=0.2, leakage=1e-12),
        "f": block("friction", coulomb=one(rng, 10.0, 200.0)),
        "at": block("passive_on", current=0.2), "o": block("sum", signs="+-"),
    }  # fmt: skip
    wires = [
        "r -> g", "g -> e.in1", "c.position -> o.in1", "at -> o.in2", "o -> e.in2", "e -> k", "k -> s", "s -> valve.spool",
        "c.pressure_a -> valve.pressure_a", "c.pressure_b -> valve.pressure_b", "valve.flow_a -> c.flow_a",
        "valve.flow_b -> c.flow_b", "c.velocity -> f", "f -> c.force",
    ]  # fmt: skip
    return blocks, wires, "o"


def pneumatic(rng: np.random.Generator) -> Part:
    """A cylinder with its valve."""
    blocks = {
        "g": block("gain", gain=0.05), "e": block("sum", signs="+-"), "k": block("gain", gain=one(rng, 2.0, 20.0)),
        "s": block("transfer_function", numerator=[1.0], denominator=[0.005, 1.0]), "lim": block("saturation"),
        "c": block("pneumatic_cylinder", initial_position=0.1), "at": block("passive_on", current=0.1), "o": block("sum", signs="+-"),
    }  # fmt: skip
    wires = [
        "r -> g", "g -> e.in1", "c.position -> o.in1", "at -> o.in2", "o -> e.in2", "e -> k", "k -> s", "s -> lim",
        "lim -> c.command",
    ]  # fmt: skip
    return blocks, wires, "o"


def semi_active(rng: np.random.Generator) -> Part:
    """A mass on a spring and a damper that is switched."""
    kind = str(rng.choice(["skyhook", "groundhook"]))
    first = {"skyhook": "velocity", "groundhook": "base_velocity"}[kind]
    blocks = {
        "n": block("sum", signs="+--"), "v": block("integrator"), "x": block("integrator"), "k": block("gain", gain=one(rng, 5.0, 50.0)),
        "law": block(kind, on=one(rng, 0.2, 1.0), transition=float(rng.choice([0.0, 0.01]))),
        "d": block("mr_damper_bingham", yield_force=[0.1, 1.0], damping=[0.5, 2.0], transition_velocity=0.1),
        "w": block("sum", signs="+-"), "road": block("transfer_function", numerator=[0.3], denominator=[0.3, 1.0]),
    }  # fmt: skip
    wires = [
        "r -> n.in1", "x -> k", "k -> n.in2", "d -> n.in3", "n -> v", "v -> x", "r -> road", "v -> w.in1", "road -> w.in2",
        "w -> d.velocity", "law -> d.current", f"v -> law.{first}", "w -> law.relative_velocity",
    ]  # fmt: skip
    return blocks, wires, "x"


def escape() -> Part:
    """z' = b r + z²."""
    blocks = {
        "b": block("gain", gain="=b"),
        "zn": block("sum", signs="++"),
        "zz": block("multiplication"),
        "z": block("integrator"),
    }
    return blocks, ["r -> b", "b -> zn.in1", "zz -> zn.in2", "zn -> z", "z -> zz.in1", "z -> zz.in2"], "z"


def twist() -> Part:
    """x'' = -b² (sign x + sign(x')/2) from x = 1."""
    blocks = {
        "ta": block("relay"), "tb": block("relay", low=-0.5, high=0.5, hysteresis=1e-12), "tn": block("sum", signs="--"),
        "tv": block("integrator", gain="=b"), "tx": block("integrator", gain="=b", initial=1.0),
    }  # fmt: skip
    return blocks, ["ta -> tn.in1", "tb -> tn.in2", "tn -> tv", "tv -> tx", "tx -> ta", "tv -> tb"], "tx"


MAINS: tuple[tuple[Callable[[np.random.Generator], Part], float], ...] = (
    (simple, 0.5), (dry, 0.2), (hydraulic, 0.1), (pneumatic, 0.1), (semi_active, 0.1),
)  # fmt: skip


def built(seed: int) -> tuple[Diagram, float]:
    """Return a loop and the value of b from which on its run ends, infinite for every second one."""
    rng = np.random.default_rng([27, seed])
    make_main = MAINS[int(rng.choice(len(MAINS), p=[share for _, share in MAINS]))][0]
    blocks, wires, output = make_main(rng)
    threshold = math.inf
    if seed % 2:
        ends = int(rng.integers(2))
        more, others, _ = (escape, twist)[ends]()
        threshold = ((math.pi / (2 * DURATION)) ** 2, SLOWEST / DURATION)[ends]
    else:
        more, others = (
            {"b": block("gain", gain="=b"), "lag": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])},
            ["r -> b", "b -> lag"],
        )
    made = document({"r": block("input"), **blocks, **more}, [*wires, *others], {"y": output}, b=1.0)
    return compile_system(made), threshold


SIGNALS = {"r": make("step", {})}


def run(diagram: Diagram, b: float) -> Response:
    return Evaluation(diagram, {"b": b}).simulated(SIGNALS, DURATION)


def whole(response: Response) -> bool:
    return response.outcome.verdict is Verdict.OK and response.outcome.end >= DURATION * (1 - 1e-12)


@pytest.mark.parametrize("seed", range(LOOPS))
def test_no_metric_without_a_whole_run(seed: int) -> None:
    diagram, threshold = built(seed)
    around = threshold if math.isfinite(threshold) else 1.0
    requests = [
        MetricRequest(
            metric=m,
            signals=SIGNALS,
            output="y",
            duration=DURATION,
            band=(0.5, 5.0),
            options=Options(recovery_band=0.1, derivative=0),
        )
        for m in METRICS
    ]
    for b in (0.5 * around, 1.5 * around):
        evaluation = Evaluation(diagram, {"b": b})  # one run for the response and all metrics
        response = evaluation.simulated(SIGNALS, DURATION)
        assert not (b > threshold and whole(response))
        for metric, request, finding in zip(METRICS, requests, findings(evaluation, requests), strict=True):
            found = measured_of(diagram, request, finding)
            if whole(response):
                assert found.verdict not in {Verdict.UNSTABLE, Verdict.DOUBTFUL} or found.value is None, metric
            else:
                assert (found.value, found.verdict) == (None, response.outcome.verdict), metric
                assert "s of 2 s: " in found.advice, metric


@pytest.mark.parametrize("seed", range(LOOPS))
def test_no_optimum_on_an_incomplete_run(seed: int) -> None:
    diagram, threshold = built(seed)
    around = threshold if math.isfinite(threshold) else 1.0
    problem = Problem(
        diagram=diagram,
        variables=(Variable(parameter="b", lower=0.5 * around, upper=2.0 * around, scale="log"),),
        experiments=(Experiment(name="step", signals=SIGNALS, duration=DURATION),),
        goals=(Goal(metric="iae", experiment="step", output="y", sense=Sense.MINIMIZE),),
    )
    found = minimize("grid", problem, {"points": 4})
    (proof,) = found.certificate.goals
    if found.certificate.valid:
        assert found.best["b"] < threshold
        assert whole(run(diagram, found.best["b"]))
        assert proof.independent is None or proof.independent == pytest.approx(found.objective, rel=1e-3)
    else:
        assert found.status is Status.INFEASIBLE
        assert math.isnan(found.objective)
        assert proof.measured.verdict in {Verdict.UNSTABLE, Verdict.DOUBTFUL, Verdict.TOO_SHORT, Verdict.ILL_POSED}
        assert proof.measured.advice
        assert "of 2 s" in found.goals[0].after.advice or found.goals[0].after.verdict is Verdict.ILL_POSED
        # what the grid had besides was no better: there is no whole run among its points
        assert not any(whole(run(diagram, float(b))) for b in found.map.axes["b"])


def issued(part: Part, variable: str, lower: float, upper: float, duration: float) -> Problem:
    """Return the search of one variable for the least error under a step."""
    blocks, wires, output = part
    diagram = compile_system(document({"r": block("input"), **blocks}, wires, {"y": output}))
    return Problem(
        diagram=diagram,
        variables=(Variable(parameter=variable, lower=lower, upper=upper),),
        experiments=(Experiment(name="step", signals=SIGNALS, duration=duration),),
        goals=(Goal(metric="iae", experiment="step", output="y", sense=Sense.MINIMIZE),),
    )


@pytest.mark.parametrize(
    ("part", "variable", "lower", "upper", "duration"),
    [(semi_active, "law.on", 0.2, 1.0, 4.0), (hydraulic, "k.gain", 2e-3, 2e-2, 0.3)],
)
def test_switched_dampers_and_axes_that_stick(part, variable, lower, upper, duration):
    """Where the best run is whole, a second integration finds the same; where none is, the result says when they end."""
    problem = issued(part(np.random.default_rng(5)), variable, lower, upper, duration)
    found = minimize("grid", problem, {"points": 3})
    (proof,) = found.certificate.goals
    for value, violation in zip(found.map.axes[variable], found.map.violation, strict=True):
        run = Evaluation(problem.diagram, {variable: float(value)}).simulated(SIGNALS, duration)
        assert (run.outcome.verdict is Verdict.OK) == (violation < 1.0)
    if found.certificate.valid:
        assert proof.independent is not None
        assert abs(proof.independent - found.objective) <= proof.tolerance + 1e-9
        assert proof.tolerance <= 1e-2 * found.objective
    else:
        assert found.status is Status.INFEASIBLE
        assert f"of {duration:g} s" in found.goals[0].after.advice
