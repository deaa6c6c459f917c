"""Steps a, b, c: from the text that a data acquisition system wrote to a model of the drive that has been checked."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import servotune
from examples.demo.findings import PLACES, Check, DemoError, Estimate, Half, Recording
from examples.demo.systems import position_loop, published_model
from servotune.replies import ChannelData

DATA = Path(__file__).parents[1] / "data" / "servo_hydraulic_actuator"

INPUTS, OUTPUTS = {"reference": "command"}, {"measured": "position"}
"""What the recording says about the model: the command is its reference, the measured position its delayed output."""

ACTIVE_ABOVE = 0.4e-3
"""The active part is where the command is further than this from its mean (m), and one second around it."""

FREE = (
    {"parameter": "valve.flow_gain", "lower": 2e-5, "upper": 1e-3, "start": 1e-4},
    {"parameter": "valve.time_constant", "lower": 1e-4, "upper": 2e-2, "start": 2e-3},
)
DELAY = {"lower": 0, "upper": 2e-2, "start": 2e-3}

BARS = {"second": 95.0, "first": 91.0}
"""Least FIT (%) on the other half, by the half that estimated."""

INDISTINCT = 0.1
"""Difference of FIT (percentage points) below which the recording does not tell two places of the delay apart."""


def import_recording(client: servotune.Client, path: Path, description: Path) -> Recording:
    """Step a: send the file with its description, and find the active part of the chirp."""
    document = {"name": path.name, "format": "txt", "import": json.loads(description.read_text())}
    dataset = client.datasets.upload(document, path)
    command = client.datasets.channel(dataset["id"], "command")
    start, end = _active_part(command)
    middle = round((start + end) / 2, 3)
    return Recording(
        file=path.name,
        size=path.stat().st_size,
        dataset=dataset,
        active=(start, end),
        halves=(Half(name="first", window=(start, middle)), Half(name="second", window=(middle, end))),
        preview={name: client.datasets.channel(dataset["id"], name, points=1500) for name in ("command", "position")},
    )


def _active_part(command: ChannelData) -> tuple[float, float]:
    time, values = command["time"], command["values"]
    metres = {"m": 1.0, "mm": 1e-3}[command["unit"]]
    mean = sum(values) / len(values)
    active = [t for t, value in zip(time, values, strict=True) if abs(value - mean) * metres > ACTIVE_ABOVE]
    if not active:
        raise DemoError(f"The command never leaves its mean by more than {ACTIVE_ABOVE * 1e3} mm: nothing to identify.")
    return max(time[0], active[0] - 1.0), min(time[-1], active[-1] + 1.0)


def identify(client: servotune.Client, recording: Recording) -> tuple[Estimate, ...]:
    """Step b: estimate the drive from each half, with the delay at each of its two places."""
    jobs = [
        (place, half, _start_identification(client, recording, place, half))
        for place in PLACES
        for half in reversed(recording.halves)
    ]
    return tuple(Estimate(place=place, half=half, reply=job.wait()) for place, half, job in jobs)


def _start_identification(
    client: servotune.Client, recording: Recording, place: str, half: Half
) -> servotune.Job[servotune.replies.Identification]:
    document = position_loop("P")
    for delay in PLACES:
        document["blocks"][delay]["time"] = DELAY["start"] if delay == place else 0
    return client.identify(
        document,
        dataset=recording.dataset["id"],
        inputs=INPUTS,
        outputs=OUTPUTS,
        parameters=[*FREE, {"parameter": f"{place}.time"} | DELAY],
        offsets="estimate",
        estimation=half.window,
        validation=recording.other(half).window,
    )


def choose(estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
    """Choose where the delay sits by the fit on unseen data, and return the scenarios that follow, the base first.

    Where the fits do not differ, both places stay: the base is then the delay within the loop, which is harder to control.
    """
    fits = {place: sum(e.other_fit for e in estimates if e.place == place) / 2 for place in PLACES}
    kept = [place for place in PLACES if fits[place] > max(fits.values()) - INDISTINCT]
    return tuple(e for place in kept for e in estimates if e.place == place)


def require_bars(base: tuple[Estimate, ...]) -> None:
    """Stop when an estimate does not predict the half that it has not seen as well as it must."""
    for estimate in base:
        bar = BARS[estimate.half.name]
        if estimate.other_fit < bar:
            raise DemoError(
                f"The model estimated on the {estimate.half.name} half must reach a FIT of {bar:g} % on the other half, "
                f"got {estimate.other_fit:.2f} %."
            )


def driven(way: str) -> dict[str, Any]:
    """Return the inputs with what they are taken to do between their samples: as estimated, or as published."""
    return {port: {"channel": channel, "between_samples": way} for port, channel in INPUTS.items()}


def validate(client: servotune.Client, recording: Recording, base: tuple[Estimate, ...]) -> tuple[Check, ...]:
    """Step c: measured against simulated on the half that the estimate has not seen, and the published model there."""
    checks = []
    for estimate in base:
        half = recording.other(estimate.half)
        offsets = estimate.reply["offsets"]
        against = partial(
            client.validate,
            dataset=recording.dataset["id"],
            outputs=OUTPUTS,
            offsets=offsets,
            window=half.window,
        )
        checks.append(
            Check(
                estimate=estimate,
                half=half,
                reply=against(position_loop("P"), inputs=driven(estimate.between), parameters=estimate.scenario),
                published=against(published_model(), inputs=driven("linear")),
            )
        )
    return tuple(checks)
