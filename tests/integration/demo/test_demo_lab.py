"""A day in the lab, as its user sees it: service, worker, simulated rig and agent as processes of their own."""

from __future__ import annotations

import pytest

from examples.demo_lab import __main__ as demo
from examples.demo_lab.axis import DRIVERS, HIDDEN, START_GAIN, TRUTH
from examples.demo_lab.figure import draw
from examples.demo_lab.processes import lab


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_rig_is_understood_and_made_better(tmp_path, capsys, driver) -> None:
    with lab(tmp_path / "lab", driver=driver) as running:
        findings = demo.run(running)
    textbook, identified = findings.errors
    assert textbook > 10.0
    assert identified < 1.5
    # What the recording can tell is found: the flow gain, and the lag and the delay together (7.5 ms) better than one by one.
    assert findings.parameters["flow_gain"] == pytest.approx(TRUTH["flow_gain"], rel=0.03)
    late = findings.parameters["valve_lag"] + findings.parameters["delay"]
    assert late == pytest.approx(TRUTH["valve_lag"] + TRUTH["delay"], rel=0.05)
    # The mode of the frame, which no element of the library has, and nothing else.
    (swing,) = findings.swings
    assert swing.frequency == pytest.approx(HIDDEN, rel=0.03)
    assert swing.damping_ratio == pytest.approx(0.03, abs=0.02)
    assert findings.gain > 2 * START_GAIN
    # Measured with the new law: what was predicted, and within what was allowed (2 %, with the noise of the sensor on top).
    assert findings.after.response_time < 0.25 * findings.before.response_time
    assert findings.after.response_time == pytest.approx(findings.predicted["response_time"], rel=0.15)
    assert findings.after.overshoot < 0.03
    draw(findings, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 20_000
    assert "scheduled    every night at 3" in capsys.readouterr().out
