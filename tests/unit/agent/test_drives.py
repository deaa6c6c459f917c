"""The agent's signals are the engine's, sample for sample; the agent itself imports none of it."""

from __future__ import annotations

import numpy as np
import pytest

from agent.drives import signal_of
from agent.errors import AttemptError
from engine.signals import make

T = np.arange(0, 4000) / 1000.0


@pytest.mark.parametrize(
    "document",
    [
        {"kind": "step", "amplitude": 2.0, "start": 0.5},
        {"kind": "sine", "amplitude": 1.5, "frequency": 12.0, "phase": 0.3},
        {"kind": "chirp", "amplitude": 1.0, "start_frequency": 1.0, "end_frequency": 40.0, "duration": 3.0},
        {"kind": "multisine", "amplitude": 0.5, "fundamental": 3.0, "harmonics": [1.0, 3.0, 4.0]},
        {"kind": "trapezoid", "distance": 2.0, "max_velocity": 1.0, "max_acceleration": 4.0},
        {"kind": "trapezoid", "distance": -0.1, "max_velocity": 1.0, "max_acceleration": 4.0},
        {"kind": "sampled", "time": [0.0, 1.0, 1.5], "values": [0.0, 2.0, -1.0]},
    ],
    ids=lambda document: document["kind"],
)
def test_signals_are_those_of_the_engine(document) -> None:
    engine = make(document["kind"], {key: value for key, value in document.items() if key != "kind"})
    assert np.abs(signal_of(document)(T) - engine.value(T)).max() < 1e-12


def test_a_stepped_sine_changes_its_frequency_without_a_jump() -> None:
    document = {"kind": "stepped_sine", "amplitude": 2.0, "frequencies": [10.0, 25.0], "dwell": 1.3, "phase": 0.2}
    u = signal_of(document)
    early, late = T[T < 1.3], T[(T >= 1.3) & (T < 2.6)]
    assert np.abs(u(early) - 2 * np.sin(10 * early + 0.2)).max() < 1e-12
    # At 1.3 s the phase is 0.2 + 13 rad, whatever the frequency is from there on.
    assert np.abs(u(late) - 2 * np.sin(25 * (late - 1.3) + 13.2)).max() < 1e-12
    assert np.all(u(T[T >= 2.6]) == 0.0)


def test_what_it_does_not_know_it_does_not_play() -> None:
    with pytest.raises(AttemptError, match="signal must be one of step, sine"):
        signal_of({"kind": "music"})
