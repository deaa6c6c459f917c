"""Slopes of margins and poles of two rates by times and gains, against converged differences of the test's own lifted map.

A rate cannot be moved alone, for then nothing repeats any more: both follow one parameter T.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram, compile_system
from tests.reference.test_sampled_loops import AXES, MS, Axis
from tests.unit.engine.diagrams import block, document

STEP = Fraction(1, 200)


def with_one_time(axis: Axis) -> Diagram:
    """Return an axis whose sample times are multiples of the parameter T."""
    made = axis.diagram
    blocks = {name: dict(one.values) for name, one in made.system.blocks.items()}
    blocks["position"]["sample_time"] = f"={float(axis.slow / axis.fast)!r} * T"
    blocks["speed"]["sample_time"] = "=T"
    wires = [f"{c.source} -> {c.target}" for c in made.system.connections]
    kinds = {name: one.kind for name, one in made.system.blocks.items()}
    own = {name: block(kinds[name], **values) for name, values in blocks.items()}
    return compile_system(document(own, wires, {"y": "axis.load_angle"}, T=float(axis.fast * MS)))


def moved(axis: Axis, name: str, share: Fraction) -> Axis:
    """Return an axis with one of its parameters changed by a share of it."""
    if name == "T":
        return replace(axis, slow=axis.slow * (1 + share), fast=axis.fast * (1 + share))
    field = {"speed.delay": "fast_delay", "position.delay": "slow_delay", "speed.offset": "fast_offset",
             "position.offset": "slow_offset", "speed.kp": "kp", "axis.stiffness": "stiffness"}[name]  # fmt: skip
    value = getattr(axis, field)
    return replace(axis, **{field: value * (1 + share if isinstance(value, Fraction) else 1 + float(share))})


def slope(axis: Axis, name: str, value) -> float:
    """The elasticity's numerator dv/d ln p, by central differences of which Richardson takes out two powers."""
    steps = (STEP, STEP / 2, STEP / 4)
    by = [(value(moved(axis, name, h)) - value(moved(axis, name, -h))) / (2 * float(h)) for h in steps]
    once = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(by)]
    return float((16 * once[1] - once[0]) / 15)


def edge(axis: Axis, *, factor: str, near: float, turned: bool) -> float:
    def height(x: float) -> float:
        return axis.radius(**{factor: np.exp(-1j * x) if turned else x}) - 1

    return float(brentq(height, 0.97 * near, 1.03 * near, xtol=1e-15, rtol=1e-14))


def later(axis: Axis, *, factor: str, near: float) -> float:
    """The delay margin, s."""
    found = brentq(lambda x: axis.radius(**{factor: Fraction(1000 * x)}) - 1, 0.98 * near, 1.02 * near, xtol=1e-16)
    return float(found)


def abscissa(axis: Axis, *, period: Fraction) -> float:
    scale = axis.slow / AXES[6].slow
    return float(np.log(axis.radius()) / (float(period * scale) * 1e-3))


@pytest.mark.parametrize(("place", "factor", "delayed"), [("position", "k_position", "later_position"), ("speed", "k_speed", "later_speed")])  # fmt: skip
def test_margins_move_as_the_map_says(place, factor, delayed):
    axis = AXES[6]
    names = ["T", "speed.delay", "position.delay", "speed.offset", "position.offset", "speed.kp", "axis.stiffness"]
    asked = [MetricRequest(metric=m, open_at=place) for m in ("gain_margin_up", "phase_margin", "delay_margin")]
    asked.append(MetricRequest(metric="spectral_abscissa"))
    found = measure(with_one_time(axis), asked, gradient=names)
    values = [value.value for value, _ in found]
    own = [
        partial(edge, factor=factor, near=values[0], turned=False),
        partial(edge, factor=factor, near=abs(values[1]), turned=True),
        partial(later, factor=delayed, near=values[2]),
        partial(abscissa, period=axis.slow),
    ]
    for metric, (value, slopes), value_of in zip(asked, found, own, strict=True):
        if metric.metric == "delay_margin" and place == "position":
            # what is read at samples alone is late by whole samples: the margin is a step, and has no slope
            assert np.isnan(slopes.values).all()
            continue
        for k, name in enumerate(names):
            scale = {"T": float(axis.fast * MS), "speed.delay": float(axis.fast_delay * MS),
                     "position.delay": float(axis.slow_delay * MS), "speed.offset": float(axis.fast_offset * MS),
                     "position.offset": float(axis.slow_offset * MS), "speed.kp": axis.kp, "axis.stiffness": axis.stiffness}[name]  # fmt: skip
            assert slopes.values[k] * scale == pytest.approx(
                slope(axis, name, value_of), rel=1e-6, abs=1e-8 * abs(value.value)
            )
