"""A search is ended within an evaluation: a simulation asks at its steps, and the best point until then is proven."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from engine.model.interruption import inside, interruptible, look
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.search.limits import Limited
from optimizers.search.result import Status, Unwatched
from tests.reference.systems import block, system


def late_loop() -> Problem:
    """Return a limited PI loop with a delay, which only the exact path follows, in thousands of steps."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "pi": block("pi", kp="=kp", ki=1.0),
        "limit": block("saturation", lower=-2.5, upper=2.5), "late": block("delay", time=0.05),
        "plant": block("transfer_function", numerator=[1.0], denominator=[0.5, 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "plant -> e.in2", "e -> pi", "pi -> limit", "limit -> late", "late -> plant"]
    move = {"r": make("sine", {"amplitude": 2.0, "frequency": 6.0})}
    return Problem(
        diagram=system(blocks, wires, {"y": "plant", "e": "e"}, {"kp": 2.0}),
        variables=(Variable(parameter="kp", lower=0.5, upper=5.0),),
        experiments=(Experiment(name="move", signals=move, duration=2.0),),
        goals=(Goal(metric="ise", experiment="move", output="e", sense=Sense.MINIMIZE),),
    )


class Impatient:
    """Cancels at the third look within an evaluation, once there is a best point."""

    def __init__(self) -> None:
        self.best_points = self.within = self.between = 0

    def progress(self, fraction: float, message: str) -> None:
        """Ignore it."""

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Count it."""
        self.best_points += 1

    def cancelled(self) -> bool:
        """Count the look."""
        if inside():
            self.within += 1
        else:
            self.between += 1
        return self.within >= 3


@pytest.mark.parametrize("method", ["gradient", "global"])
def test_a_cancel_is_heard_within_an_evaluation(method: str) -> None:
    monitor = Impatient()
    found = minimize(method, late_loop(), {}, monitor=monitor)
    assert found.status is Status.CANCELLED
    assert monitor.within == 3  # nothing was computed behind it that asks again
    assert monitor.best_points >= 1
    assert found.certificate.valid
    assert found.goals[0].after.value is not None


def test_the_proof_has_time_for_an_evaluation_that_is_still_going_on() -> None:
    now = [0.0]
    limited = Limited(Unwatched(), 100.0, clock=lambda: now[0])
    with interruptible(lambda: None):
        now[0] = 19.0
        assert not limited.cancelled()
        now[0] = 30.0  # it takes 30 s already: four such would not fit
        assert limited.cancelled()
    now[0] = 1.0
    limited = Limited(Unwatched(), 100.0, clock=lambda: now[0])
    with interruptible(lambda: None):
        for second in range(2, 12):  # looks within an evaluation of 10 s do not make it ten short ones
            now[0] = float(second)
            assert not limited.cancelled()
    assert not limited.cancelled()
    now[0] = 61.0
    assert not Limited(Unwatched(), 100.0, clock=lambda: now[0]).cancelled()
    assert limited.cancelled()


def test_nobody_asks_outside() -> None:
    look()
    asked: list[int] = []
    with interruptible(lambda: asked.append(1)):
        look()
        assert inside()
    look()
    assert asked == [1]
    assert not inside()
