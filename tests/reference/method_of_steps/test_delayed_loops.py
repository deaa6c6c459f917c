"""Random loops of nonlinear laws with pure delays of 0.1 to 50 ms, held against the method of steps: curves, events, metrics, slopes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import settings

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.reference.method_of_steps._loops import cases

COUNT = 100
CASES = cases(COUNT, seed=2)
if settings().max_examples <= 1000:
    CASES = [*CASES[:4], CASES[85]]  # in the last a backlash is left 1e-13 s before the axis sticks
WIDTH = 1e-4
"""Relative change of a number for a difference; of two widths the differences of fourth order are made."""


def signals(case):
    kind = {**case.signal}
    return {"r": make(kind.pop("kind"), kind)}


def readings(case, found):
    """Return the largest value and the root of the mean square of the first output."""
    name = next(iter(case.outputs.values()))
    return found.peak(name), math.sqrt(found.integral(lambda t, y: y**2, name) / case.end)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_loop_with_delays(case):
    reference = case.loop(case.numbers).run(case.end)
    made = compile_system(case.document)
    outcome = Evaluation(made).simulated(signals(case), case.end).outcome
    assert outcome.verdict is Verdict.OK, outcome.advice
    # inside the pieces of the reference: where signals jump, one instant of rounding may lie on either side
    times = np.array([0.37 * a + 0.63 * b for a, b in zip(reference.starts, reference.ends, strict=True)])
    for index, (output, name) in enumerate(case.outputs.items()):
        expected = reference.at(times, name)
        assert list(made.outputs)[index] == output
        np.testing.assert_allclose(
            outcome.output(index).sample(times), expected, rtol=0, atol=1e-8 * np.abs(expected).max(), err_msg=output
        )
    edges = np.array(outcome.record.times)
    for event in reference.events:
        assert np.abs(edges - event).min() <= 1e-9

    output = next(iter(case.outputs))
    names = ("peak", "control_effort_rms")
    wanted = [MetricRequest(metric=m, signals=signals(case), output=output, duration=case.end) for m in names]
    first = CASES.index(case) % len(case.turned)
    turned = [*case.turned.items(), *case.turned.items()][first : first + 2]  # each number has its turn
    measured = measure(made, wanted, gradient=[parameter for parameter, _ in turned])
    expected = readings(case, reference)
    for (value, _), known, metric in zip(measured, expected, names, strict=True):
        assert value.value == pytest.approx(known, rel=1e-6), metric
    for place, (parameter, number) in enumerate(turned):
        for (_, slopes), known, metric, (slope, error) in zip(
            measured, expected, names, _differences(case, number), strict=True
        ):
            scale = abs(known / case.numbers[number])
            # else events come or go within its width
            if error <= 1e-7 * scale and not slopes.one_sided:
                assert slopes.values[place] == pytest.approx(slope, rel=1e-6, abs=1e-6 * scale), (metric, parameter)


def _differences(case, number):
    """Return the slopes of the readings by a number, with how far two differences of unlike widths are apart."""
    value, found = case.numbers[number], []
    for width in (WIDTH, 2 * WIDTH):
        up, down = (
            np.array(readings(case, case.loop({**case.numbers, number: value * (1 + side * width)}).run(case.end)))
            for side in (1, -1)
        )
        found.append((up - down) / (2 * width * value))
    best = (4 * found[0] - found[1]) / 3
    return list(zip(best, np.abs(best - found[0]), strict=True))
