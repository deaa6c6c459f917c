"""Eight channels at 51.2 kS/s, each of which hears a sine of its own: the slowest rises all the time and tells where a sample belongs, the others tell it to the sample."""

from __future__ import annotations

import httpx
import numpy as np

RATE = 51200
FREQUENCIES = {f"ai{i}": frequency for i, frequency in enumerate((1e-4, 37.0, 41.3, 53.9, 61.1, 71.7, 83.3, 97.9))}
PLACES = {name: f"cDAQ1Mod{1 + 2 * (i // 4)}/ai{i % 4}" for i, name in enumerate(FREQUENCIES)}
"""Four channels of each of two modules."""
AMPLITUDE, RANGE = 4.5, 5.0
STEP = RANGE / 2**23


def inputs() -> str:
    """Return the channels as an agent's settings have them."""
    return "".join(
        f'[[inputs]]\nname = "{name}"\nchannel = "{place}"\nrange = {RANGE}\n' for name, place in PLACES.items()
    )


def rig(*, speed: float) -> str:
    """Return the description of a simulated rig that has them."""
    sensors = "".join(
        f'[[sensors]]\nchannel = "{PLACES[name]}"\nhum = {AMPLITUDE}\nmains = {frequency}\n'
        for name, frequency in FREQUENCIES.items()
    )
    return (
        f'speed = {speed}\n[[devices]]\nname = "cDAQ1Mod1"\n[[devices]]\nname = "cDAQ1Mod3"\n'
        f'[[devices]]\nname = "cDAQ1Mod2"\nmodel = "NI 9260"\n{sensors}'
    )


def samples_in_their_places(client: httpx.Client, dataset: str) -> int:
    """Return how many samples came, each of which is the one that the rig has taken at that moment."""
    turns = 2 * np.pi * np.array(list(FREQUENCIES.values())) / RATE
    width, count, rest = 8 * len(FREQUENCIES), 0, b""
    with client.stream("GET", f"/v1/datasets/{dataset}/original", timeout=60) as reply:
        for part in reply.iter_bytes(4 * 1024 * 1024):
            data = rest + part
            whole = len(data) - len(data) % width
            values, rest = np.frombuffer(data[:whole], "<f8").reshape(-1, len(FREQUENCIES)), data[whole:]
            k = np.arange(count, count + values.shape[0])[:, None]
            # Half a step of the converter, and what rounding makes of an angle of 10^6 rad.
            assert np.abs(values - AMPLITUDE * np.sin(turns * k)).max(initial=0.0) < 0.5 * STEP + 1e-8
            count += values.shape[0]
    assert rest == b""
    return count
