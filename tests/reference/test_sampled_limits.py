"""Batches of loops whose samplers have limits, held against difference equations by hand and against the exact path.

u_k = v_k within lower and upper, no further than rate T from u_{k-1};   clamping: the integral part waits;
back-calculation: I takes (u - v) T/T_t;   increment: v_k = u_{k-1} + Δ(v without limits)_k
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from tests.reference.test_sampled_batches import FILTER, LATER, MOVE, PERIOD, STEP, held, loop

GAINS: Mapping[str, tuple[float, ...]] = {
    "pid.kp": (9.0, 20.0, 14.0),
    "pid.ki": (12.0, 36.0, 48.0),
    "pid.kd": (0.3, 0.6, 0.4),
}
LIMITS: Mapping[str, Mapping[str, Any]] = {
    "clamping": {"lower": -12.0, "upper": 12.0},
    "one side": {"upper": 9.0, "derivative_rule": "tustin"},
    "back-calculation": {"lower": -12.0, "upper": 12.0, "anti_windup": "back_calculation"},
    "winding up": {"lower": -12.0, "upper": 12.0, "anti_windup": "none"},
    "rate": {"rate": 1500.0, "lower": -5.0, "upper": 10.0},
    "rate, tracked": {"rate": 2000.0, "anti_windup": "back_calculation", "tracking_time": 0.05},
    "increment": {"form": "increment", "lower": -10.0, "upper": 10.0},
    "increment, rate": {"form": "increment", "rate": 800.0},
}
PARTS = 400
"""Of a period, in the equations by hand."""


def by_hand(
    law: Mapping[str, Any], delay: float, gains: Sequence[float], duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the output and what drives the plant, on a fine grid."""
    kp, ki, kd = gains
    phi, gamma = held(PERIOD / PARTS)
    lower, upper, reach = law.get("lower", -np.inf), law.get("upper", np.inf), law.get("rate", np.inf) * PERIOD
    rule, tracking = law.get("anti_windup", "clamping"), law.get("tracking_time", kp / ki)
    x, integral, last, derived = np.zeros(2), 0.0, 0.0, 0.0
    driving = u = min(max(0.0, lower), upper)
    outputs, efforts = [], []
    for _ in range(round(duration / PERIOD)):
        error, before, filtered = 1.0 - x[0], integral, derived
        kick = FILTER * kd * (error - last)
        if law.get("derivative_rule") == "tustin":
            derived = ((2 - FILTER * PERIOD) * derived + 2 * kick) / (2 + FILTER * PERIOD)
        else:
            derived = (derived + kick) / (1 + FILTER * PERIOD)
        if law.get("form") == "increment":
            wanted = u + kp * (error - last) + ki * PERIOD * error + derived - filtered
        else:
            integral += ki * PERIOD * error
            wanted = kp * error + integral + derived
        last, u = error, min(max(min(max(wanted, u - reach), u + reach), lower), upper)
        if rule == "clamping" and (wanted - u) * (integral - before) > 0:
            integral = before
        if rule == "back_calculation":
            integral += PERIOD / tracking * (u - wanted)
        for part in range(PARTS):
            driving = u if part == round(delay / PERIOD * PARTS) else driving
            outputs.append(x[0])
            efforts.append(driving)
            x = phi @ x + gamma * driving
    return np.array([*outputs, x[0]]), np.array([*efforts, driving])


@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("delay", [0.0, 0.004])
def test_responses_by_difference_equations(name: str, delay: float) -> None:
    duration, law = 0.7, LIMITS[name]
    asked = [
        MetricRequest(metric=metric, signals=STEP, output=output, duration=duration)
        for metric, output in (("peak", "y"), ("ise", "y"), ("iae", "y"), ("peak", "u"), ("control_effort_rms", "u"))
    ]
    found = Screening(loop(delay=delay, **law), asked, threads=1)({path: np.array(own) for path, own in GAINS.items()})
    assert not found.doubtful.any()
    for row, gains in enumerate(zip(*GAINS.values(), strict=True)):
        y, u = by_hand(law, delay, gains, duration)
        width = PERIOD / PARTS
        expected = [
            np.abs(y).max(), np.trapezoid((1 - y) ** 2, dx=width), np.trapezoid(np.abs(1 - y), dx=width), np.abs(u).max(),
            np.sqrt((u[:-1] ** 2).sum() * width / duration),
        ]  # fmt: skip
        np.testing.assert_allclose(found.values[row], expected, rtol=2e-6)
        assert np.abs(u).max() < max(law.get("upper", np.inf), 0.0) * (1 + 1e-12)


@pytest.mark.parametrize("signals", [STEP, LATER, MOVE], ids=["step", "later", "move"])
@pytest.mark.parametrize("name", ["clamping", "rate", "increment"])
def test_the_exact_path_has_the_same_numbers(name: str, signals: Mapping[str, Any]) -> None:
    diagram = loop(**LIMITS[name])
    metrics = ("overshoot", "rise_time", "settling_time", "itae", "ie", "steady_state_error", "max_velocity")
    asked = [MetricRequest(metric=metric, signals=signals, output="y", duration=0.6) for metric in metrics]
    found = Screening(diagram, asked, threads=1)({path: np.array(own[:1]) for path, own in GAINS.items()})
    exact = measure(diagram, asked, overrides={path: own[0] for path, own in GAINS.items()})
    told = ~found.doubtful[0]
    assert told.mean() >= 0.5
    for value, (measured, _), known in zip(found.values[0], exact, told, strict=True):
        if known and measured.value is None:
            assert not np.isfinite(value)
        elif known:
            assert value == pytest.approx(measured.value, rel=1e-9, abs=1e-11)


def test_a_run_until_rest() -> None:
    asked = [MetricRequest(metric=metric, signals=STEP, output="y") for metric in ("overshoot", "settling_time", "iae")]
    diagram = loop(**LIMITS["back-calculation"])
    found = Screening(diagram, asked, threads=1)({path: np.array(own[:1]) for path, own in GAINS.items()})
    exact = measure(diagram, asked, overrides={path: own[0] for path, own in GAINS.items()})
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[0], [measured.value for measured, _ in exact], rtol=1e-7)


@pytest.mark.parametrize("name", LIMITS)
def test_slopes(name: str) -> None:
    """By gains and by limits, against central differences of the equations by hand."""
    law, duration = LIMITS[name], 0.5
    varied = [
        path for path in ("pid.kp", "pid.ki", "pid.kd", "pid.upper", "pid.rate") if path[4:] in law or path in GAINS
    ]
    at = {path: GAINS[path][0] if path in GAINS else float(law[path[4:]]) for path in varied}
    lanes = {path: np.array([value + 1e-30j * (path == other) for other in varied]) for path, value in at.items()}
    asked = [MetricRequest(metric="ise", signals=STEP, output="y", duration=duration)]
    found = Screening(loop(**law), asked, threads=1)(lanes)
    assert not found.doubtful.any()

    def error(changed: Mapping[str, float]) -> float:
        own = {path[4:]: value for path, value in changed.items()}
        gains = [own.pop(gain) for gain in ("kp", "ki", "kd")]
        y, _ = by_hand({**law, **own}, 0.004, gains, duration)
        return float(np.trapezoid((1 - y) ** 2, dx=PERIOD / PARTS))

    for lane, path in enumerate(varied):
        width = 1e-4 * at[path]
        expected = (error({**at, path: at[path] + width}) - error({**at, path: at[path] - width})) / (2 * width)
        assert found.values[lane, 0].imag / 1e-30 == pytest.approx(expected, rel=1e-4, abs=1e-9)


def test_before_the_first_output_it_is_as_near_to_0_as_its_limits_allow() -> None:
    law, duration = {"lower": 0.5, "upper": 12.0, "rate": 900.0}, 0.3
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=duration) for metric in ("peak", "ise")]
    at = {path: own[0] for path, own in GAINS.items()}
    assert Screening(loop(**law), asked)({path: np.array([value]) for path, value in at.items()}).doubtful.all()
    y, _ = by_hand(law, 0.004, list(at.values()), duration)
    expected = [y.max(), np.trapezoid((1 - y) ** 2, dx=PERIOD / PARTS)]
    exact = [measured.value for measured, _ in measure(loop(**law), asked, overrides=at)]
    np.testing.assert_allclose(exact, expected, rtol=2e-6)


METRICS = ("peak", "ise", "overshoot", "settling_time", "steady_state_error")


def assert_exact(diagram: Diagram, kp: float, doubtful: list[bool]) -> None:
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=0.5) for metric in METRICS]
    found = Screening(diagram, asked)({"pid.kp": np.array([kp])})
    assert not found.growth[0] >= 0
    assert found.doubtful[0].tolist() == doubtful
    exact = measure(diagram, asked, overrides={"pid.kp": kp})
    for value, (measured, _), unknown in zip(found.values[0], exact, doubtful, strict=True):
        if not unknown and measured.value is None:
            assert np.isnan(value)
        elif not unknown:
            assert value == pytest.approx(measured.value, rel=1e-9)
    endless = [MetricRequest(metric="overshoot", signals=STEP, output="y")]
    assert Screening(diagram, endless)({"pid.kp": np.array([kp])}).doubtful.all()


def test_of_what_rests_at_a_limit_nobody_says_where() -> None:
    """The load is held by 1.5 where the limit is 1.2: the exact path has what looks at the end."""
    assert_exact(
        loop(lower=-1.2, upper=1.2, denominator=(0.05, 1.0, 1.5)),
        9.0,
        [metric not in {"peak", "ise"} for metric in METRICS],
    )


def test_a_limit_that_is_just_what_it_takes_to_rest_changes_nothing_there() -> None:
    law = {"form": "increment", "lower": -1.5, "upper": 1.5, "denominator": (0.05, 1.0, 1.5), "ki": 40.0}
    diagram = loop(**law)
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=4.0) for metric in METRICS]
    found = Screening(diagram, asked)({"pid.kp": np.array([4.0])})
    assert not found.doubtful.any()
    exact = [measured.value for measured, _ in measure(diagram, asked, overrides={"pid.kp": 4.0})]
    np.testing.assert_allclose(found.values[0], exact, rtol=1e-9, atol=1e-11)


def test_what_runs_away_but_for_its_limits_is_followed() -> None:
    assert_exact(loop(lower=-12.0, upper=12.0), 300.0, [False] * 5)


def test_numbers_do_not_depend_on_who_stands_beside() -> None:
    random = np.random.default_rng(4)
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=0.5) for metric in ("peak", "iae")]
    screening = Screening(loop(**LIMITS["rate"]), asked, threads=2)
    candidates = {"pid.kp": random.uniform(2, 30, 40), "pid.upper": random.uniform(4, 20, 40)}
    whole = screening(candidates)
    for k in (0, 17, 39):
        alone = screening({name: values[k : k + 1] for name, values in candidates.items()})
        np.testing.assert_array_equal(alone.values[0], whole.values[k])
