"""Intervals of 95 % hold the truth in 90 to 99 % of simulated recordings, in white and in coloured noise.

`make proof` simulates 200 recordings; a few are simulated everywhere, with bounds that 1 in 10 000 correct estimators
would miss: binomial(n, 0.95), its quantiles by scipy.stats.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings
from scipy.signal import lfilter
from scipy.stats import binom

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.exact.time.sampled import simulate_sampled
from optimizers.identification import identify
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording

H = 0.005
SAMPLES = 800
COMMAND = np.repeat(np.random.default_rng(7).choice([-1.0, 1.0], size=40), 20)
TRUTH = {"w": 12.0, "d": 0.4, "k": 2.0}
RECORDINGS = 200 if settings().max_examples >= 1000 else 16
"""The profile of `make proof` has thousands of examples."""

SYSTEM = compile_system(
    System(
        name="second order",
        parameters={name: Parameter(value=value, lower=0.01, upper=100.0) for name, value in TRUTH.items()},
        blocks={
            "u": Block(kind="input"),
            "plant": Block(
                kind="transfer_function", values={"numerator": ["=k*w**2"], "denominator": [1.0, "=2*d*w", "=w**2"]}
            ),
        },
        connections=(Connection(source="u", target="plant"),),
        outputs={"y": "plant"},
    )
)
CLEAN = simulate_sampled(SYSTEM.realize(), COMMAND[None], H)[0]

COLOURS = {"white": ([1.0], [1.0]), "lag": ([1.0], [1.0, -0.9]), "resonance": ([1.0, 0.4], [1.0, -1.6, 0.8])}


@pytest.mark.parametrize("colour", COLOURS)
def test_the_truth_is_within_the_intervals_as_often_as_they_say(colour: str) -> None:
    inside = dict.fromkeys(TRUTH, 0)
    for seed in range(RECORDINGS):
        noise = lfilter(*COLOURS[colour], np.random.default_rng(seed).normal(size=SAMPLES + 300))[300:]
        recording = Recording(inputs={"u": COMMAND}, outputs={"y": CLEAN + 0.2 * noise / noise.std()}, sample_time=H)
        problem = Identification(
            diagram=SYSTEM, experiments=(RecordedExperiment(recording=recording, split=1.0),),
            parameters=tuple(Variable(parameter=name) for name in TRUTH), offsets=True,
        )  # fmt: skip
        found = identify(problem, rng=np.random.default_rng(0))
        for name, value in TRUTH.items():
            estimate = found.parameters[name]
            assert estimate.lower95 is not None
            assert estimate.upper95 is not None
            inside[name] += estimate.lower95 <= value <= estimate.upper95
    least = 0.90 * RECORDINGS if RECORDINGS == 200 else binom.ppf(1e-4, RECORDINGS, 0.95)
    most = 0.99 * RECORDINGS if RECORDINGS == 200 else RECORDINGS
    assert all(least <= count <= most for count in inside.values()), inside
