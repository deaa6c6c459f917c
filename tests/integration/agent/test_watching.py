"""What is wrong with a channel is told while it is recorded, and stays with the measurement."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from rig_simulator.devices import Device
from rig_simulator.sensors import Sensor

POSITION = "cDAQ1Mod1/ai1"
SLOWEST = 51_200 / 31
"""samples/s of an NI 9234."""
LISTEN: dict[str, Any] = {"drive": None, "duration": 1.5, "pre_trigger": 0, "sample_rate": SLOWEST}


def warned(done: dict[str, Any]) -> list[tuple[str, str, str]]:
    return [(warning["pointer"], warning["level"], warning["detail"]) for warning in done["warnings"]]


def test_an_overload_and_a_broken_cable_are_told_at_once_and_kept(lab) -> None:
    lab.bench.speed = 1.0
    lab.bench.sensors["cDAQ1Mod1/ai0"] = Sensor(noise=1e-3, hum=6.0, mains=1.0)  # beyond 5 V after 0.16 s
    lab.bench.sensors[POSITION] = Sensor(noise=1e-3, breaks=0.5)
    with lab.agent():
        asked = lab.ask(**LISTEN | {"duration": 600})
        job = lab.get(asked)["job"]
        lab.until(
            lambda: (
                lab.client.get(f"/v1/jobs/{job}").json()["message"]
                == "recording; overload: loopback; drop-out: position"
            )
        )
        lab.client.post(f"/v1/acquisitions/{asked}/cancel").raise_for_status()
        lab.wait(asked)
        lab.until(lambda: lab.runs() == [])
        lab.bench.speed = 0.0
        done = lab.wait(lab.ask(**LISTEN))
    facts = done["attempts"][0]["facts"]
    values, rate = lab.samples(done["dataset"]), facts["actual_rate"]
    over = abs(values[:, 0]) >= 0.9995 * 5
    channels = facts["channels"]
    assert channels["loopback"]["overload"] == {"count": int(over.sum()), "first": int(over.argmax()) / rate}
    broken = math.ceil(0.5 * rate)
    count, first = values.shape[0] - broken, broken / rate
    assert channels["position"]["drop-out"] == {"count": count, "first": first}
    overload = f"loopback reached its range of 5 V: {over.sum()} samples, first at {over.argmax() / rate:.4g} s; "
    drop_out = f"position has dropped out, it did not change by a bit: {count} samples, first at {first:.4g} s; "
    assert warned(done) == [
        (
            "/channels/0",
            "warning",
            overload + "the hardware has no larger one: lower the signal",
        ),
        ("/channels/1", "warning", drop_out + "see to its sensor and cable"),
    ]


def test_a_quiet_measurement_has_no_warnings(lab) -> None:
    with lab.agent():
        done = lab.wait(lab.ask(sample_rate=SLOWEST))
    assert done["warnings"] == []
    channels = done["attempts"][0]["facts"]["channels"]
    assert channels["loopback"].keys() == {"largest"}
    values = lab.samples(done["dataset"])
    assert [channels[name]["largest"] for name in ("loopback", "position")] == abs(values).max(axis=0).tolist()


def test_a_rate_that_the_module_does_not_have_is_told(lab) -> None:
    with lab.agent():
        done = lab.wait(lab.ask(**LISTEN | {"sample_rate": 10}))
    detail = "sample_rate must be one that the hardware has: 10 samples/s were asked for, it took 1651.61"
    assert ("/sample_rate", "warning", detail) in warned(done)


def test_a_finer_range_is_advised_where_the_module_has_one(lab) -> None:
    lab.bench.devices["cDAQ1Mod1"] = Device(name="cDAQ1Mod1", model="NI 9205", serial=0x01A2B3C4)
    lab.bench.sensors[POSITION] = replace(lab.bench.sensors[POSITION], hum=0.5)
    settings = lab.settings()
    fitting = replace(
        settings,
        devices=(),
        inputs=tuple(replace(entry, range=10.0) for entry in settings.inputs),
    )
    with lab.agent(fitting):
        done = lab.wait(lab.ask(**LISTEN))
    assert done["status"] == "done", done
    detail = "position: 0.5 V of 10 V used; range = 1 would resolve it 10 times finer"
    still = "loopback was 0 V from the beginning to the end; so are a sensor or a cable that are off"
    assert warned(done) == [("/channels/0", "information", still), ("/channels/1", "information", detail)]
