"""Recordings that begin in motion though nobody has said so: the errors tell, whatever the colour of the noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from engine.diagram.diagram import Block
from engine.model.between_samples import BetweenSamples
from optimizers.identification.result import Identified
from optimizers.recorded.recording import RecordedExperiment, Recording
from tests.unit.optimizers.test_identified_experiments import H, diagram, identified

GAIN, LAG = 3.0, 0.4


def found(seed: int, *, colour: float, moving: bool, initial_states: bool = False, levels: int = 30) -> Identified:
    """Identify a lag from a recording that begins at rest under its first input, or in motion."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.choice([-1.0, 1.0], size=levels), 20)
    y, a = np.empty(len(u)), np.exp(-H / LAG)
    y[0] = -GAIN * u[0] if moving else GAIN * u[0]
    for k in range(len(u) - 1):
        y[k + 1] = a * y[k] + (1 - a) * GAIN * u[k]
    noise = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], 0.05 * random.normal(size=len(u)))
    recording = Recording(
        inputs={"u": u}, outputs={"y": y + noise}, sample_time=H, between_samples={"u": BetweenSamples.HOLD}
    )
    plant = Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": ["=tau", 1.0]})
    made = diagram({"plant": plant}, "u -> plant", {"tau": 0.5, "k": 2.0})
    experiment = RecordedExperiment(recording=recording, name="run", split=1.0)
    return identified(made, experiment, names=("tau", "k"), initial_states=initial_states)


def told(result: Identified) -> list[str]:
    return [sentence for sentence in result.warnings if "begin at rest" in sentence]


@pytest.mark.parametrize("colour", [0.0, 0.8, 0.97])
def test_a_recording_that_begins_in_motion_is_told_and_one_at_rest_is_not(colour: float) -> None:
    for seed in range(6):
        assert told(found(seed, colour=colour, moving=False)) == []
        (sentence,) = told(found(seed, colour=colour, moving=True))
        assert sentence.startswith("run does not seem to begin at rest")


def test_a_long_recording_is_looked_at_where_it_begins() -> None:
    for moving in (False, True):
        assert (told(found(0, colour=0.5, moving=moving, levels=1500)) != []) == moving


def test_the_advice_cures_it() -> None:
    missed = {False: 0, True: 0}
    for seed in range(10):
        for way in missed:
            result = found(seed, colour=0.0, moving=True, initial_states=way)
            gain = result.parameters["k"]
            missed[way] += not gain.lower95 <= GAIN <= gain.upper95
            assert way == (told(result) == [])
    assert missed[False] >= 5
    assert missed[True] <= 2
