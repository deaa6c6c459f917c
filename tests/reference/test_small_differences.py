"""An error that good feed-forward leaves is a small difference of large signals: told as exactly as it is known, not refused.

P F = 1 / (1 + 2 d s/w + s²/w²) exactly, where the gains of the feed-forward are those of the inverse plant, so that

    E/R = (2 d s/w + s²/w²) / (1 + 2 d s/w + s²/w²) / (1 + C P):

nothing cancels in it, and the reference follows it as it stands.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.linalg import expm

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

KP, KD, FILTER, FRICTION, MASS = 100.0, 2.0, 2000.0, 0.2, 0.01
D = 1 / math.sqrt(2)
MOVE = {"distance": 1.0, "max_velocity": 1.0, "max_acceleration": 10.0, "max_jerk": 100.0}


def drive(roll_off, law=None):
    """PD and feed-forward round 1/(s (m s + b)); with the outputs e = r - y and y, and a law for the force if there is one."""
    return compile_system(
        document(
            {"r": block("input"), "error": block("sum", signs="+-"),
             "pd": block("pd", kp=KP, kd=KD, filter_frequency=FILTER),
             "ahead": block("feed_forward", kv=FRICTION, ka=MASS, filter_frequency=roll_off),
             "force": block("sum", signs="++"), "limit": law or block("gain", gain=1.0),
             "plant": block("transfer_function", numerator=[1.0], denominator=[MASS, FRICTION, 0.0])},
            ["r -> error.in1", "plant -> error.in2", "error -> pd", "pd -> force.in1", "r -> ahead", "ahead -> force.in2",
             "force -> limit", "limit -> plant"],
            {"e": "error", "y": "plant"},
        )
    )  # fmt: skip


def truth(roll_off):
    """Return the largest error and ∫e² dt of the move, from exponentials of all equations, those of the command included.

    g'' + 2 d w g' + w² g = 2 d w r' + r''; the loop behind it: m y'' + b y' = PD(g - y).
    """
    w, pd = roll_off, KP + KD * FILTER
    a = np.zeros((8, 8))  # g, g', y, y', f, r', r'', r'''
    a[0, 1] = a[2, 3] = a[5, 6] = a[6, 7] = 1.0
    a[1, :2], a[1, 5:7] = (-w * w, -2 * D * w), (2 * D * w, 1.0)
    a[3, [0, 2, 3, 4]] = np.array([pd, -pd, -FRICTION, -KD * FILTER]) / MASS
    a[4, [0, 2, 4]] = FILTER, -FILTER, -FILTER
    step, count = 2.5e-5, 4000
    forward = expm(step * a)
    x, error = np.zeros(8), [0.0]
    for jerk in (100, -100, *[0] * 8, -100, 100, *[0] * 10):  # of 0.1 s each
        x[7] = jerk
        for _ in range(count):
            x = forward @ x
            error.append(x[0] - x[2])
    return max(error), simpson(np.square(error), dx=step)


@pytest.mark.parametrize(("roll_off", "least"), [(2e3, 1e-10), (1e4, 1e-10), (1e5, 3e-10)])
def test_the_error_that_feed_forward_leaves(roll_off, least):
    """It is known to what rounding leaves of the position, and the reply says how well that is."""
    found = simulate(drive(roll_off), signals={"r": make("s_curve", MOVE)})
    peak, square = truth(roll_off)
    assert found.verdict is Verdict.OK
    (remark,) = [remark for remark in found.warnings if remark.at == ("outputs", "e")]
    known = float(re.search(r"leaves (\S+) of its largest", remark.detail).group(1))
    assert 1e-9 < known < 1e-3
    assert known * peak < least  # at the fastest roll-off it was 4e-11 on one processor and 1.3e-10 on another
    top = found.metrics["e"]["peak"]
    assert top.verdict is Verdict.OK
    assert top.value == pytest.approx(peak, rel=known + 1e-7, abs=0)
    assert found.metrics["y"]["ise"].value == pytest.approx(square, rel=4 * known + 1e-7, abs=0)
    (remark,) = [remark for remark in found.warnings if remark.at == ("outputs", "y")]
    assert "the error of output y" in remark.detail


def test_what_is_rounding_alone_has_no_value():
    """A roll-off thousands of times as fast as the loop leaves no digits of the error; the position is as good as ever."""
    found = simulate(drive(3e5), signals={"r": make("s_curve", MOVE)})
    assert {measured.verdict for measured in found.metrics["e"].values()} == {Verdict.DOUBTFUL}
    assert any(remark.at == ("outputs", "e") for remark in found.warnings)
    assert found.metrics["y"]["peak"].value == pytest.approx(1.0, abs=1e-7)
