"""Searches whose ranges begin at a gain of exactly 0, where a controller loses a state or a loop its only gain."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import servotune


@pytest.fixture(scope="module")
def client() -> Iterator[servotune.Client]:
    with servotune.local() as client:
        yield client


def abscissa(kp: float, ki: float, kd: float) -> float:
    """Return the rightmost root of 1 + C G: the PID with a filter of 300 rad/s, and 4/(0.05 s² + 0.95 s - 1)."""
    over, under = np.array([kp]), np.array([1.0])
    if kd:
        over, under = np.polyadd(np.polymul(over, [1 / 300, 1]), [kd, 0]), np.array([1 / 300, 1])
    if ki:
        over, under = np.polyadd(np.polymul(over, [1, 0]), ki * under), np.polymul(under, [1, 0])
    return float(np.roots(np.polyadd(np.polymul(under, [0.05, 0.95, -1]), 4 * over)).real.max())


def test_poles_of_every_candidate_are_those_of_its_own_system(client: servotune.Client) -> None:
    pid = servotune.block("pid", "ctl", kp="=kp", ki="=ki", kd="=kd", filter_frequency=300.0)
    loop = servotune.feedback(pid >> servotune.tf([4], [0.05, 0.95, -1]))
    system = loop.system("axis", input="r", output="y", kp=1, ki=0.5, kd=0.05)
    variables = [
        {"parameter": "kp", "lower": 0.5, "upper": 1.5, "scale": "linear"},
        {"parameter": "ki", "lower": 0, "upper": 1},
        {"parameter": "kd", "lower": 0, "upper": 0.1},
    ]
    goals = [{"metric": "spectral_abscissa", "sense": "minimize"}]
    found = client.optimize(
        system, variables=variables, goals=goals, method={"kind": "grid", "points": 3}
    ).wait(progress=False)  # fmt: skip
    assert dict(found.best) == {"kp": 1.5, "ki": 0.0, "kd": 0.0}
    assert found.objective == pytest.approx(abscissa(1.5, 0.0, 0.0), rel=1e-12)


def test_a_search_goes_on_from_a_gain_of_zero(client: servotune.Client) -> None:
    loop = servotune.feedback(servotune.block("pi", "ctl", kp="=kp", ki="=ki") >> servotune.tf([10], [1, 10]))
    variables = [{"parameter": "kp", "lower": 0.5, "upper": 2}, {"parameter": "ki", "lower": 0, "upper": 4}]
    found = client.optimize(
        loop.system("a", input="r", output="y", kp=1, ki=0.0), variables=variables,
        goals=[{"metric": "spectral_abscissa", "sense": "minimize"}], method={"kind": "gradient"},
    ).wait(progress=False)  # fmt: skip
    assert dict(found.best) == pytest.approx({"kp": 2.0, "ki": 0.0})
    assert found.objective == pytest.approx(-30.0)


@pytest.mark.parametrize("method", ["grid", "gradient"])
@pytest.mark.parametrize(
    "goal", [{"metric": "complementary_peak", "open_at": "error"}, {"metric": "resonance_peak", "from": "r", "to": "y"}]
)
def test_a_peak_of_zero_is_one(client: servotune.Client, goal: dict[str, str], method: str) -> None:
    loop = servotune.feedback(servotune.gain("=kp") >> servotune.tf([1], [1, 1]))
    found = client.optimize(
        loop.system("a", input="r", output="y", kp=1), variables=[{"parameter": "kp", "lower": 0, "upper": 4}],
        goals=[goal | {"sense": "minimize"}], method={"kind": method},
    ).wait(progress=False)  # fmt: skip
    assert (dict(found.best), found.objective) == ({"kp": 0.0}, 0.0)
