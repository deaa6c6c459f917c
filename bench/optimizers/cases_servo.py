"""The servo loop with an inner velocity loop: least settling time under overshoot, |S| and acceleration; and the systune case."""

from __future__ import annotations

from bench import inner_velocity_loop as inner
from bench.optimizers.cases_convex import CHOSEN, Case, gain, loop
from engine.diagram.diagram import Block
from engine.model.masks import FrequencyBounds, Rational
from engine.model.metric_options import Options
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

BEST_KNOWN = 0.0757
"""Settling time, s: 2.4 million candidates of a cross-entropy search on a grid of 1000 samples."""
WITHIN = 0.01
BOX = {"kp": (5.0, 60.0), "td1": (0.003, 0.04), "td2": (1e-4, 1.5e-3), "tf": (0.0015, 0.008), "kv": (0.02, 0.8)}
OVERSHOOT, SENSITIVITY, ACCELERATION = 0.01, 1.6, 1500.0
STEP = Experiment(name="step", signals={"reference": make("step", {})})


def settling() -> Case:
    """Return the job: five logarithmic variables, three constraints."""
    return Case(
        name="servo loop: least settling time under three constraints",
        problem=Problem(
            diagram=inner.diagram(),
            variables=tuple(
                Variable(parameter=name, lower=low, upper=high, scale="log") for name, (low, high) in BOX.items()
            ),
            experiments=(STEP,),
            goals=(
                Goal(metric="settling_time", experiment="step", output="position", sense=Sense.MINIMIZE),
                Goal(metric="overshoot", experiment="step", output="position", upper=OVERSHOOT),
                Goal(metric="sensitivity_peak", open_at=inner.CUT, upper=SENSITIVITY),
                Goal(
                    metric="max_acceleration",
                    experiment="step",
                    output="acceleration",
                    upper=ACCELERATION,
                    options=Options(derivative=0),
                ),
            ),
        ),
        published=BEST_KNOWN,
        tolerance=WITHIN,
        source="cross-entropy search, 2.4 million candidates: 0.0757 s",
    )


def tracking() -> Case:
    """Return case 5: PI and the corner of a filter in the feedback, the tracking goal of systune."""
    diagram = loop(
        controller=Block(kind="pi", values={"kp": "=kp", "ki": "=ki"}),
        parameters={
            "kp": gain(1e-4, lower=1e-6, upper=1e-2), "ki": gain(1e-3, lower=1e-4, upper=0.1),
            "corner": gain(50.0, lower=1.0, upper=1000.0),
        },
        numerator=[33e3, -6.6e6, 2.97e9], denominator=[1.0, 37.5, 63312.5, 787500.0],
        feedback=Block(kind="transfer_function", values={"numerator": ["=corner"], "denominator": [1.0, "=corner"]}),
    )  # fmt: skip
    error = FrequencyBounds(upper=Rational(numerator=(1.0, 0.04), denominator=(1.0, 40.0)))
    return Case(
        name="5: PI and a filter in the feedback, Tracking(0.05)",
        problem=Problem(
            diagram=diagram, variables=(*CHOSEN, Variable(parameter="corner")),
            goals=(Goal(metric="error_bound", source="reference", target="y", mask=error, sense=Sense.MINIMIZE),),
        ),
        published=1.4296, tolerance=0.0003,
        source="systune reaches 1.43 (its page of showTunable); 1.4296 by global search",
    )  # fmt: skip
