"""Published optima of controllers that are linear in their parameters: what the method `convex` has to reach.

maximise ki (least integrated error after a step of load)   subject to   |S| ≤ Ms, |T| ≤ Mt, |K S| ≤ Mks
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.masks import Corners, FrequencyBounds, Rational
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

LOAD = Experiment(name="load", signals={"load": make("step", {})})
LEAST_ERROR = Goal(metric="ie", experiment="load", output="y", sense=Sense.MINIMIZE)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem with its published optimum; ``parameter`` names what is compared, None the objective itself."""

    name: str
    problem: Problem
    published: float
    tolerance: float
    source: str
    parameter: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


def loop(
    *,
    controller: Block,
    parameters: Mapping[str, Parameter],
    numerator: Sequence[float],
    denominator: Sequence[float],
    feedback: Block | None = None,
) -> Diagram:
    """Return a loop of controller, plant and optionally a block in the feedback, with a load on the plant's input."""
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
    links = [
        ("reference", "error.in1"), ("error", "controller"), ("controller", "entry.in1"), ("load", "entry.in2"),
        ("entry", "plant"),
    ]  # fmt: skip
    if feedback is None:
        links.append(("plant", "error.in2"))
    else:
        blocks["feedback"] = feedback
        links += [("plant", "feedback"), ("feedback", "error.in2")]
    return compile_system(
        System(
            name="loop",
            parameters=dict(parameters),
            blocks=blocks,
            connections=tuple(Connection(source=source, target=target) for source, target in links),
            outputs={"y": "plant", "u": "controller"},
        )
    )


def gain(value: float, *, lower: float = 1e-5, upper: float = 200.0) -> Parameter:
    """Return a gain to be chosen, on a logarithmic scale where its range allows it."""
    return Parameter(value=value, lower=lower, upper=upper, scale="log" if lower > 0 else "linear")


PI = Block(kind="pi", values={"kp": "=kp", "ki": "=ki"})
CHOSEN = (Variable(parameter="kp"), Variable(parameter="ki"))

_PLANTS: dict[str, tuple[list[float], list[float], float, tuple[float, float]]] = {
    "1/(s+1)^3": ([1.0], [-1, -1, -1], 0.0, (0.3253, 0.6852)),
    "1/(s+1)^4": ([1.0], [-1, -1, -1, -1], 0.0, (0.1920, 0.3779)),
    "1/((s+1)(.2s+1)(.04s+1)(.008s+1))": ([15625.0], [-1, -5, -25, -125], 0.0, (2.585, 6.992)),
    "e^(-15s)/(s+1)^3": ([1.0], [-1, -1, -1], 15.0, (0.0266, 0.0482)),
    "1/(s(s+1)^2)": ([1.0], [0, -1, -1], 0.0, (0.0119, 0.0417)),
}
"""Numerator, poles, delay in the feedback (s), and the largest ki at Ms = 1.4 and 2."""


def astrom_hagglund(name: str, sensitivity: float) -> Case:
    """Return one entry of the Åström-Hägglund table: PI, largest ki under Ms.

    Parameters
    ----------
    name : str
        A key of the table of plants.
    sensitivity : float
        1.4 or 2.
    """
    numerator, poles, delay, largest = _PLANTS[name]
    published = largest[0] if sensitivity == 1.4 else largest[1]
    diagram = loop(
        controller=PI, parameters={"kp": gain(0.05), "ki": gain(0.001)}, numerator=numerator,
        denominator=np.poly(poles).tolist(), feedback=Block(kind="delay", values={"time": delay}) if delay else None,
    )  # fmt: skip
    return Case(
        name=f"{name}, Ms = {sensitivity:g}",
        problem=Problem(
            diagram=diagram, variables=CHOSEN, experiments=(LOAD,),
            goals=(LEAST_ERROR, Goal(metric="sensitivity_peak", open_at="controller", upper=sensitivity)),
        ),
        published=published, tolerance=0.005, parameter="ki",
        source="K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006, test batch of chapter 7; 2000 frequencies",
    )  # fmt: skip


def first_order() -> Case:
    """Return case 8: 1/(4s+1), PI, Ms = Mt = 1.2, Mks = 10."""
    diagram = loop(
        controller=PI, parameters={"kp": gain(1.0), "ki": gain(0.5)}, numerator=[1.0], denominator=[4.0, 1.0]
    )
    return Case(
        name="8: 1/(4s+1), 1.2/1.2/10",
        problem=Problem(
            diagram=diagram, variables=CHOSEN, experiments=(LOAD,),
            goals=(
                LEAST_ERROR,
                Goal(metric="sensitivity_peak", open_at="controller", upper=1.2),
                Goal(metric="complementary_peak", open_at="controller", upper=1.2),
                Goal(metric="control_sensitivity_peak", source="reference", target="u", upper=10.0),
            ),
        ),
        published=13.7394, tolerance=0.001, parameter="ki",
        source="published 13.877 on 50 frequencies, where really Mt = 1.2047; 13.7394 on 2000 frequencies",
    )  # fmt: skip


def unstable_plant() -> Case:
    """Return case 10: 10/((s-1)(s+10)), PID, Ms = Mt = 1.4, Mks = 100 from 1e-3 to 1e3 rad/s."""
    diagram = loop(
        # an ideal derivative has no finite |K S| beyond the band, and this filter none in it
        controller=Block(kind="pid", values={"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": 1e6}),
        parameters={"kp": gain(5.0), "ki": gain(1.0), "kd": gain(0.05, lower=0.0, upper=5.0)},
        numerator=[10.0], denominator=[1.0, 9.0, -10.0],
    )  # fmt: skip
    band = FrequencyBounds(upper=Corners(frequencies=(1e-3, 1e3), magnitudes=(100.0, 100.0)))
    return Case(
        name="10: 10/((s-1)(s+10)), 1.4/1.4/100",
        problem=Problem(
            diagram=diagram, variables=(*CHOSEN, Variable(parameter="kd")), experiments=(LOAD,),
            goals=(
                LEAST_ERROR,
                Goal(metric="sensitivity_peak", open_at="controller", upper=1.4),
                Goal(metric="complementary_peak", open_at="controller", upper=1.4),
                Goal(metric="path_bound", source="reference", target="u", mask=band),
            ),
        ),
        published=5.3607, tolerance=0.001, parameter="ki",
        source="M. Hast et al., ECC 2013: 5.498 on the vendor's frequencies; 5.3607 on 2000 frequencies",
    )  # fmt: skip


def tracking(*, cutoff: float = 67.82) -> Case:
    """Return case 5 with its filter held: least max |T - 1|/|ME|, the tracking goal of systune.

    Parameters
    ----------
    cutoff : float
        Corner of the filter in the feedback, rad/s; that of the global optimum by default.
    """
    diagram = loop(
        controller=PI,
        parameters={"kp": gain(1e-4, lower=1e-6, upper=1e-2), "ki": gain(1e-3, upper=0.1)},
        numerator=[33e3, -6.6e6, 2.97e9], denominator=np.polymul([1, 12.5], [1, 25, 63e3]).tolist(),
        feedback=Block(kind="transfer_function", values={"numerator": [cutoff], "denominator": [1.0, cutoff]}),
    )  # fmt: skip
    error = FrequencyBounds(upper=Rational(numerator=(1.0, 0.04), denominator=(1.0, 40.0)))
    return Case(
        name="5: PI and a filter in the feedback, Tracking(0.05), filter held",
        problem=Problem(
            diagram=diagram, variables=CHOSEN,
            goals=(Goal(metric="error_bound", source="reference", target="y", mask=error, sense=Sense.MINIMIZE),),
        ),
        published=1.4296, tolerance=0.0003,
        source="systune reaches 1.43 (its page of showTunable); 1.4296 by global search",
    )  # fmt: skip


def cases() -> tuple[Case, ...]:
    """Return every case."""
    table = [astrom_hagglund(name, sensitivity) for name in _PLANTS for sensitivity in (1.4, 2.0)]
    return (tracking(), first_order(), unstable_plant(), *table)
