"""Responses that ripple while they swing slowly: what the compiled kernels sample, beside roots of series that miss none."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from engine.analysis.measuring import MetricRequest
from engine.batch.linear.responses import Responses
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.signals import make
from tests.reference.systems import block, system
from tests.reference.test_batch_kernels import resonant_loop

METRICS = ("overshoot", "peak_time", "settling_time", "rise_time")
GAINS = ("kp", "ki", "kd")
CANDIDATES = 400
SEEDS = (*range(6), 26, 36, 74, 81, 179, 195)
"""Of the last six some candidates were told a lower tip, or an earlier end of a swing, than there is."""


def requests(input_: str) -> list[MetricRequest]:
    return [MetricRequest(metric=name, signals={input_: make("step", {})}, output="y") for name in METRICS]


def loop(rng: np.random.Generator) -> Diagram:
    """Return a position loop over one or two lightly damped resonances, some with an antiresonance beside."""
    blocks = {
        "r": block("input"),
        "error": block("sum", signs="+-"),
        "pid": block("pid", kp="=kp", ki="=ki", kd="=kd", filter_frequency=float(10 ** rng.uniform(2, 3))),
        "drive": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0, 0.0]),
    }
    way = ["error", "pid"]
    for k in range(rng.integers(1, 3)):
        w, z, beside = 10 ** rng.uniform(1, 2.3), 10 ** rng.uniform(-3, -1), rng.uniform(0.6, 1.4)
        numerator = [beside**-2, 2 * z * w / beside, w * w] if rng.random() < 0.7 else [w * w]
        blocks[f"arm{k}"] = block("transfer_function", numerator=numerator, denominator=[1.0, 2 * z * w, w * w])
        way.append(f"arm{k}")
    way.append("drive")
    wires = [f"{one} -> {other}" for one, other in pairwise(way)]
    start = {"kp": 10 ** rng.uniform(-0.5, 1), "ki": 10 ** rng.uniform(-1, 0.7), "kd": 10 ** rng.uniform(-2.5, -0.5)}
    return system(blocks, ["r -> error.in1", "drive -> error.in2", *wires], {"y": "drive"}, start)


def off(diagram: Diagram, candidates: dict[str, np.ndarray], asked: list[MetricRequest]) -> tuple[int, list[str]]:
    """Return how many numbers both vouch for, and those that differ."""
    found = Screening(diagram, asked)(candidates, second_opinion=False)
    exact = Responses(diagram, asked, tuple(candidates))(candidates)
    both = ~found.doubtful & ~exact.doubtful & (found.growth < 0)[:, None]
    near = np.array([1e-5 if name == "peak_time" else 1e-7 for name in METRICS])  # a tip is flat
    with np.errstate(invalid="ignore"):
        apart = both & (np.abs(found.values - exact.values) > near * np.maximum(1.0, np.abs(exact.values)))
    said = [
        f"{METRICS[j]} of {[float(column[i]) for column in candidates.values()]}: {found.values[i, j]}, exact {exact.values[i, j]}"
        for i, j in np.argwhere(apart)
    ]
    return int(both.sum()), said


def test_a_tip_between_two_samples_is_found_or_doubted() -> None:
    total, wrong = 0, []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        diagram = loop(rng)
        candidates = {
            name: diagram.parameters[name].value * 10 ** rng.uniform(-0.4, 0.4, CANDIDATES) for name in GAINS
        }  # fmt: skip
        compared, said = off(diagram, candidates, requests("r"))
        total, wrong = total + compared, wrong + said
    assert wrong == []
    assert total > 5_000


def test_one_alone_is_told_what_it_is_told_among_others() -> None:
    diagram = resonant_loop()
    rng = np.random.default_rng(77)
    names = ("kp", "ki", "kd", "wa", "za", "w", "z", "lag")
    candidates = {name: diagram.parameters[name].value * np.exp(rng.uniform(-0.1, 0.1, 60)) for name in names}
    for k in (28, 53, 59):
        compared, wrong = off(diagram, {name: column[[k]] for name, column in candidates.items()}, requests("r"))
        assert wrong == []
        assert compared
