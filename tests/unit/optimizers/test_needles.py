"""A bound over frequency that is broken only in a needle: whatever a search saw of it, its result is certified on the needle itself."""

from __future__ import annotations

import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.model.masks import Corners, FrequencyBounds
from engine.signals import make
from optimizers.evaluation.certificate import certify
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

BOUND = FrequencyBounds(upper=Corners(frequencies=(1e-3, 1e3), magnitudes=(1.0, 1.0)))


def needles(*dampings: float) -> Problem:
    """Return 1 - G = h Σ 2ζω_k s/(s² + 2ζω_k s + ω_k²), needles of height h at 1, 3, 9 ... rad/s, and an output h to be made large.

    Far from each other's centres the others add less than 1e-4 of their height: h = 1 is the best that the bound on |1 - G| leaves.
    """
    blocks = {"u": Block(kind="input"), "aside": Block(kind="gain", values={"gain": "=h"})}
    wires = [("u", "aside"), ("u", "error.in1")]
    for k, damping in enumerate(dampings):
        omega = 3.0**k
        blocks[f"mode{k}"] = Block(
            kind="transfer_function",
            values={
                "numerator": [f"={2 * damping * omega!r}*h", 0.0],
                "denominator": [1.0, 2 * damping * omega, omega**2],
            },
        )
        wires += [("u", f"mode{k}"), (f"mode{k}", f"error.in{k + 2}")]
    blocks["error"] = Block(kind="sum", values={"signs": "+" + "-" * len(dampings)})
    return Problem(
        diagram=compile_system(
            System(
                parameters={"h": Parameter(value=0.5, lower=0.1, upper=50.0)},
                blocks=blocks,
                connections=tuple(Connection(source=a, target=b) for a, b in wires),
                outputs={"y": "error", "h": "aside"},
            )
        ),
        variables=(Variable(parameter="h"),),
        experiments=(Experiment(name="step", signals={"u": make("step", {})}),),
        goals=(
            Goal(metric="peak", experiment="step", output="h", sense=Sense.MAXIMIZE),
            Goal(metric="error_bound", source="u", target="y", mask=BOUND, upper=1.0),
        ),
    )


DAMPINGS = [(1e-3,), (1e-5,), (1e-7,), (1e-3, 1e-5, 1e-6, 1e-4)]


@pytest.mark.parametrize("dampings", DAMPINGS)
def test_a_certificate_finds_the_needle(dampings: tuple[float, ...]) -> None:
    refused = certify(needles(*dampings), {"h": 1.01})
    assert not refused.valid
    assert refused.worst_violation == pytest.approx(0.01, rel=0.05)
    assert certify(needles(*dampings), {"h": 0.99}).valid


@pytest.mark.parametrize(
    ("method", "dampings"), [("gradient", DAMPINGS[0]), ("gradient", DAMPINGS[3]), ("global", DAMPINGS[1])]
)
def test_a_search_ends_at_the_bound_and_not_beyond(method: str, dampings: tuple[float, ...]) -> None:
    found = minimize(method, needles(*dampings), {"max_evaluations": 1000})
    assert found.certificate.valid
    assert found.certificate.worst_violation <= 1e-6
    assert found.best["h"] == pytest.approx(1.0, rel=1e-3)
