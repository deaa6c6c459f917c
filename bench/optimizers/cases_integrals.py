"""Published optima of integrals of the error: PI and PID loops under a load or a reference step, and standard forms.

minimise ∫ |e| dt or ∫ t |e| dt   subject to   |S| ≤ Ms, |T| ≤ Mt
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bench.optimizers.cases_convex import CHOSEN, PI, Case, gain
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

LOAD = Experiment(name="load", signals={"load": make("step", {})})
REFERENCE = Experiment(name="reference", signals={"reference": make("step", {})})


def loop(
    *, controller: Block, parameters: Mapping[str, Parameter], numerator: Sequence[float], denominator: Sequence[float],
    delay: float = 0.0, delayed: str = "y",
) -> Diagram:  # fmt: skip
    """Return a loop of controller, plant and a delay, with a load on the plant's input.

    ``delayed`` is the output ``y``, or only the ``feedback``, so that a response to a load begins at once.
    """
    blocks = {
        "reference": Block(kind="input"),
        "load": Block(kind="input", values={"role": "disturbance"}),
        "error": Block(kind="sum", values={"signs": "+-"}),
        "controller": controller,
        "entry": Block(kind="sum", values={"signs": "++"}),
        "plant": Block(
            kind="transfer_function", values={"numerator": list(numerator), "denominator": list(denominator)}
        ),
    }
    fed_back = "plant"
    if delay:
        blocks["transport"] = Block(kind="delay", values={"time": delay})
        fed_back = "transport"
    links = [
        ("reference", "error.in1"), (fed_back, "error.in2"), ("error", "controller"), ("controller", "entry.in1"),
        ("load", "entry.in2"), ("entry", "plant"), *([("plant", "transport")] if delay else []),
    ]  # fmt: skip
    return compile_system(
        System(
            name="loop",
            parameters=dict(parameters),
            blocks=blocks,
            connections=tuple(Connection(source=source, target=target) for source, target in links),
            outputs={"y": fed_back if delayed == "y" else "plant", "u": "controller"},
        )
    )


def robust_pi(name: str, sensitivity: float, published: float) -> Case:
    """Return a PI loop with the least IAE after a step of load under Ms.

    Parameters
    ----------
    name : str
        Plant: one of 1/(s+1)^3, 1/(s+1)^4, e^(-s)/(s+1).
    sensitivity : float
        Ms.
    published : float
        The least IAE.
    """
    lags, delay = {"1/(s+1)^3": (3, 0.0), "1/(s+1)^4": (4, 0.0), "e^(-s)/(s+1)": (1, 1.0)}[name]
    diagram = loop(
        controller=PI, parameters={"kp": gain(0.4, lower=0.05, upper=5.0), "ki": gain(0.15, lower=0.02, upper=3.0)},
        numerator=[1.0], denominator=np.poly([-1.0] * lags).tolist(), delay=delay,
    )  # fmt: skip
    return Case(
        name=f"least IAE after a load, {name}, Ms = {sensitivity:g}",
        problem=Problem(
            diagram=diagram, variables=CHOSEN, experiments=(LOAD,),
            goals=(
                Goal(metric="iae", experiment="load", output="y", sense=Sense.MINIMIZE),
                Goal(metric="sensitivity_peak", open_at="controller", upper=sensitivity),
            ),
        ),
        published=published, tolerance=0.001,
        source="K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006; optimum by dense search",
    )  # fmt: skip


ROVIRA_LOPEZ = {
    ("load", "iae"): (0.6186, 0.6087),
    ("load", "itae"): (0.7526, 0.7179),
    ("reference", "iae"): (1.0180, 1.0152),
    ("reference", "itae"): (0.6822, 0.6814),
}
"""Criterion with the published formulas, and its optimum."""


def formulas(command: str, metric: str) -> Case:
    """Return case 15: e^(-0.5s)/(s+1), PI, against the formulas of Lopez (load) and Rovira (reference)."""
    diagram = loop(
        controller=PI, parameters={"kp": gain(1.5, lower=0.2, upper=5.0), "ki": gain(1.0, lower=0.1, upper=5.0)},
        numerator=[1.0], denominator=[1.0, 1.0], delay=0.5, delayed="y" if command == "reference" else "feedback",
    )  # fmt: skip
    by_formula, optimum = ROVIRA_LOPEZ[command, metric]
    return Case(
        name=f"15: e^(-0.5s)/(s+1), {metric.upper()} after a {command} step",
        problem=Problem(
            diagram=diagram, variables=CHOSEN, experiments=(LOAD if command == "load" else REFERENCE,),
            goals=(Goal(metric=metric, experiment=command, output="y", sense=Sense.MINIMIZE),),
        ),
        published=optimum, tolerance=0.001,
        source=f"formulas of A. A. Rovira and A. M. Lopez (1967-69): {by_formula}; optimum {optimum} by dense search",
    )  # fmt: skip


STANDARD_FORMS = {
    2: ((1.505,), (1.4,)),
    3: ((1.783, 2.172), (1.75, 2.15)),
    4: ((1.952, 3.346, 2.647), (2.1, 3.4, 2.7)),
    5: ((2.066, 4.497, 4.673, 3.257), (2.8, 5.0, 5.5, 3.4)),
}
"""Coefficients of s^(n-1) … s of the optimal forms and of the published ones; the first and the last are 1."""


ITAE_OF_FORMS = {2: 1.9518595, 3: 3.1382623, 4: 4.5912808, 5: 6.3215700}
"""ITAE at the optimal coefficients: partial fractions integrated on two million points (scipy, not this engine)."""


def standard_form(order: int) -> Diagram:
    """Return 1/(s^n + a1 s^(n-1) + … + 1) with the coefficients as parameters, at the published ones."""
    _, published = STANDARD_FORMS[order]
    names = [f"a{k}" for k in range(1, order)]
    return compile_system(
        System(
            name="standard form",
            parameters={
                name: Parameter(value=value, lower=0.5 * value, upper=1.6 * value)
                for name, value in zip(names, published, strict=True)
            },
            blocks={
                "reference": Block(kind="input"),
                "form": Block(
                    kind="transfer_function",
                    values={"numerator": [1.0], "denominator": [1.0, *(f"={name}" for name in names), 1.0]},
                ),
            },
            connections=(Connection(source="reference", target="form"),),
            outputs={"y": "form"},
        )
    )


def itae_form(order: int) -> Case:
    """Return case 16: least ITAE of a step of a standard form; what is compared is ITAE at the optimal coefficients."""
    diagram = standard_form(order)
    names = [f"a{k}" for k in range(1, order)]
    return Case(
        name=f"16: ITAE form of order {order}",
        problem=Problem(
            diagram=diagram, variables=tuple(Variable(parameter=name) for name in names), experiments=(REFERENCE,),
            goals=(Goal(metric="itae", experiment="reference", output="y", sense=Sense.MINIMIZE),),
        ),
        published=ITAE_OF_FORMS[order], tolerance=0.001,
        source="D. Graham, R. C. Lathrop, AIEE Trans. 72 (1953): the published forms are 1.9, 0.16, 0.76 and 11.6 % off",
    )  # fmt: skip


def real_filter() -> Case:
    """Return case 14: 1/((2s+1)²(0.5s+1)), PID with N = 100, least IAE over 10 s under Ms = Mt = 1.2."""
    diagram = loop(
        controller=Block(kind="pid", values={"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": 100.0}),
        parameters={
            "kp": gain(2.0, lower=0.2, upper=10.0), "ki": gain(0.5, lower=0.05, upper=5.0),
            "kd": gain(2.0, lower=0.2, upper=10.0),
        },
        numerator=[1.0], denominator=np.polymul(np.polymul([2.0, 1.0], [2.0, 1.0]), [0.5, 1.0]).tolist(),
    )  # fmt: skip
    return Case(
        name="14: 1/((2s+1)²(0.5s+1)), IAE over 10 s, 1.2/1.2",
        problem=Problem(
            diagram=diagram, variables=(*CHOSEN, Variable(parameter="kd")),
            experiments=(Experiment(name="reference", signals=REFERENCE.signals, duration=10.0),),
            goals=(
                Goal(metric="iae", experiment="reference", output="y", sense=Sense.MINIMIZE),
                Goal(metric="sensitivity_peak", open_at="controller", upper=1.2),
                Goal(metric="complementary_peak", open_at="controller", upper=1.2),
            ),
        ),
        published=1.43719, tolerance=0.001,
        source="published 1.3720 without the filter, where really Ms = 1.2092; 1.43719 with it",
    )  # fmt: skip


def parabola() -> Case:
    """Return case 18: minimise x² subject to x² - 4x + 1 <= 0, as gains of two outputs."""
    settle = {"numerator": [1.0], "denominator": [1.0, 1.0]}
    diagram = compile_system(
        System(
            name="parabola",
            parameters={"x": Parameter(value=1.5, lower=0.05, upper=2.0)},
            blocks={
                "u": Block(kind="input"),
                "lag": Block(kind="transfer_function", values=settle),
                "f": Block(kind="gain", values={"gain": "=x*x"}),
                # one more than the constraint, so that the peak of a step is it
                "g": Block(kind="gain", values={"gain": "=x*x-4*x+2"}),
            },
            connections=tuple(
                Connection(source=source, target=target)
                for source, target in (("u", "lag"), ("lag", "f"), ("lag", "g"))
            ),
            outputs={"f": "f", "g": "g"},
        )
    )
    step = Experiment(name="step", signals={"u": make("step", {})})
    return Case(
        name="18: x² under x² - 4x + 1 <= 0",
        problem=Problem(
            diagram=diagram, variables=(Variable(parameter="x"),), experiments=(step,),
            goals=(
                Goal(metric="peak", experiment="step", output="f", sense=Sense.MINIMIZE),
                Goal(metric="peak", experiment="step", output="g", upper=1.0),
            ),
        ),
        published=7 - 4 * 3**0.5, tolerance=1e-6,
        source="sdo.optimize page of Simulink Design Optimization: 0.0716, which violates by 0.001; (2 - √3)²",
    )  # fmt: skip


def cases() -> tuple[Case, ...]:
    """Return every case."""
    return (
        real_filter(),
        *(formulas(command, metric) for command, metric in ROVIRA_LOPEZ),
        *(itae_form(order) for order in STANDARD_FORMS),
        parabola(),
        robust_pi("1/(s+1)^3", 1.4, 3.0739),
        robust_pi("1/(s+1)^3", 2.0, 1.606),
        robust_pi("1/(s+1)^4", 1.4, 5.2091),
        robust_pi("1/(s+1)^4", 2.0, 3.0384),
        robust_pi("e^(-s)/(s+1)", 1.4, 2.6813),
        robust_pi("e^(-s)/(s+1)", 2.0, 1.5831),
    )
