"""The live channel: curves and metrics over a WebSocket, newest values first."""

from __future__ import annotations

import itertools
import json
import struct
import time
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.integration.api.documents import upload
from tests.support.patience import PATIENCE

LAG = {
    "name": "lag",
    "parameters": {"k": {"value": 2, "lower": 1, "upper": 4}, "tau": {"value": 0.2, "unit": "s", "lower": 0.01}},
    "blocks": {
        "u": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "plant": {"kind": "transfer_function", "numerator": ["=k"], "denominator": ["=tau", 1, 0]},
    },
    "connections": [
        {"from": "u", "to": "error.in1"},
        {"from": "plant", "to": "error.in2"},
        {"from": "error", "to": "plant"},
    ],
    "outputs": {"y": "plant"},
}
OPEN: dict[str, Any] = {
    "type": "open",
    "system": LAG,
    "parameters": ["k", "tau"],
    "frequency": {"open_at": "error"},
    "metrics": ["overshoot", "phase_margin", "bandwidth"],
    "duration": 4,
    "samples": 400,
}


def opened(service: Any, key: str = "run") -> ClientConnection:
    with service.client(key) as client:
        ticket = client.post("/v1/tickets").json()["ticket"]
    return connect(service.url.replace("http", "ws") + f"/v1/live?ticket={ticket}", proxy=None)


def heard(socket: ClientConnection) -> dict[str, Any]:
    return json.loads(socket.recv(timeout=PATIENCE))


def frame(data: bytes | str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    assert isinstance(data, bytes)
    (length,) = struct.unpack_from("<I", data)
    header = json.loads(data[4 : 4 + length])
    arrays, place = {}, 4 + length
    for entry in header["arrays"]:
        size = int(np.prod(entry["shape"]))
        arrays[entry["name"]] = np.frombuffer(data, "<f4", size, place).reshape(entry["shape"])
        place += 4 * size
    assert place == len(data)
    return header, arrays


def say(socket: ClientConnection, **message: Any) -> None:
    socket.send(json.dumps(message))


def test_curves_and_metrics_are_those_of_the_formulas(sqlite_service) -> None:
    with opened(sqlite_service) as socket:
        say(socket, **OPEN)
        told = heard(socket)
        assert told["type"] == "opened"
        assert [p["path"] for p in told["parameters"] if not p["bound"]] == ["k", "tau"]
        say(socket, type="set", seq=7, vectors=[[2.0, 0.2], [4.0, 0.2]])
        header, arrays = frame(socket.recv(timeout=PATIENCE))
        assert header["seq"] == 7
        assert [v["verdict"] for v in header["variants"]] == ["ok", "ok"]
        for variant, k in enumerate((2.0, 4.0)):
            # y'' tau + y' + k y = k: a swing of natural frequency sqrt(k/tau) and damping 1/(2 sqrt(k tau)).
            w0, d = np.sqrt(k / 0.2), 1 / (2 * np.sqrt(k * 0.2))
            wd = w0 * np.sqrt(1 - d**2)
            t = np.linspace(0, 4, 400)
            y = 1 - np.exp(-d * w0 * t) * (np.cos(wd * t) + d * w0 / wd * np.sin(wd * t))
            assert arrays["outputs"][variant, 0] == pytest.approx(y, abs=2e-7)
            s = 1j * arrays["frequency"].astype(float)
            loop = k / (s * (0.2 * s + 1))
            assert arrays["response"][variant, 0] == pytest.approx(loop.real, rel=1e-5)
            assert arrays["response"][variant, 1] == pytest.approx(loop.imag, rel=1e-5)
            poles = arrays["poles"][variant]
            assert sorted(poles[1]) == pytest.approx([-wd, wd], rel=1e-6)
        told = heard(socket)
        assert (told["type"], told["seq"], told["variant"]) == ("metrics", 7, 0)
        d = 1 / (2 * np.sqrt(2 * 0.2))
        overshoot = np.exp(-np.pi * d / np.sqrt(1 - d**2))
        assert told["metrics"]["overshoot"]["value"] == pytest.approx(overshoot, rel=1e-9)
        # d ln(overshoot)/d ln k: overshoot = exp(-pi d/sqrt(1-d^2)), d ~ k^(-1/2), so pi d/(2 (1-d^2)^(3/2)).
        assert told["elasticities"]["overshoot"]["k"] == pytest.approx(np.pi * d / (2 * (1 - d**2) ** 1.5), rel=1e-9)


def test_the_newest_values_win(sqlite_service) -> None:
    with opened(sqlite_service) as socket:
        say(socket, **OPEN)
        heard(socket)
        for seq in range(200):
            say(socket, type="set", seq=seq, vectors=[[1.0 + seq / 100, 0.2]])
        answered, deadline = [], time.monotonic() + PATIENCE
        while time.monotonic() < deadline and (not answered or answered[-1] != 199):
            data = socket.recv(timeout=PATIENCE)
            if isinstance(data, bytes):
                answered.append(frame(data)[0]["seq"])
        assert answered[-1] == 199
        assert answered == sorted(answered)
        assert len(answered) < 200


def test_curves_do_not_wait_for_metrics_that_take_long(sqlite_service) -> None:
    # Elasticities of 25 lags by 50 parameters take seconds, curves milliseconds.
    numbers = range(25)
    parameters = {f"k{n}": {"value": 1} for n in numbers} | {f"t{n}": {"value": 0.01 * (n + 1)} for n in numbers}
    lags = {
        f"lag{n}": {"kind": "transfer_function", "numerator": [f"=k{n}"], "denominator": [f"=t{n}", 1]} for n in numbers
    }
    wires = [{"from": a, "to": b} for a, b in itertools.pairwise(["u", *lags])]
    blocks = {"u": {"kind": "input"}, **lags}
    chain = {"parameters": parameters, "blocks": blocks, "connections": wires, "outputs": {"y": "lag24"}}
    values = [entry["value"] for entry in parameters.values()]
    with opened(sqlite_service) as socket:
        say(socket, type="open", system=chain, parameters=list(parameters), metrics=["rise_time"], duration=4)
        assert heard(socket)["type"] == "opened"
        say(socket, type="set", seq=1, vectors=[values])
        assert frame(socket.recv(timeout=PATIENCE))[0]["seq"] == 1
        time.sleep(0.3)  # its metrics are under way now
        say(socket, type="set", seq=2, vectors=[[2.0, *values[1:]]])
        assert frame(socket.recv(timeout=PATIENCE))[0]["seq"] == 2
        # what was given up has left nothing behind: the next system is measured
        say(socket, **OPEN)
        assert heard(socket)["type"] == "opened"
        say(socket, type="set", seq=3, vectors=[[2.0, 0.2]])
        assert frame(socket.recv(timeout=PATIENCE))[0]["seq"] == 3
        told = heard(socket)
        assert (told["type"], told["seq"]) == ("metrics", 3)


def test_a_system_with_a_delay_takes_the_exact_path(sqlite_service) -> None:
    delayed = {
        "blocks": {"u": {"kind": "input"}, "late": {"kind": "delay", "time": 0.5}},
        "connections": [{"from": "u", "to": "late"}],
        "outputs": {"y": "late"},
    }
    with opened(sqlite_service) as socket:
        say(socket, type="open", system=delayed, parameters=["late.time"], duration=1, samples=101)
        assert heard(socket)["type"] == "opened"
        say(socket, type="set", seq=1, vectors=[[0.25], [0.75]])
        _, arrays = frame(socket.recv(timeout=PATIENCE))
        t = np.linspace(0, 1, 101)
        for variant, late in enumerate((0.25, 0.75)):
            away = np.abs(t - late) > 1e-9
            assert (arrays["outputs"][variant, 0][away] == (t > late)[away]).all()


def test_what_is_wrong_is_told_at_its_place_and_the_channel_stays_open(sqlite_service) -> None:
    with opened(sqlite_service) as socket:
        say(socket, type="set", seq=3, vectors=[[1.0]])
        told = heard(socket)
        assert (told["type"], told["seq"], told["problem"]["status"]) == ("problem", 3, 409)
        socket.send("{not json")
        assert heard(socket)["problem"]["status"] == 422
        socket.send('{"type": "set", "seq": ' + 100_000 * "[" + 100_000 * "]" + "}")
        assert "at most 128 levels deep" in heard(socket)["problem"]["detail"]
        socket.send('{"type": "set", "seq": 1, "seq": 2, "vectors": [[1.0]]}')
        assert "a key must stand once in an object, got 'seq' twice" in heard(socket)["problem"]["detail"]
        say(socket, **{**OPEN, "parameters": ["nothing"]})
        assert heard(socket)["problem"]["errors"][0]["pointer"] == "/parameters/0"
        say(socket, **{**OPEN, "system": "sys_nowhere"})
        assert heard(socket)["problem"]["errors"][0]["pointer"] == "/system"
        say(socket, **OPEN)
        assert heard(socket)["type"] == "opened"
        say(socket, type="set", seq=4, vectors=[[1.0]])
        assert heard(socket)["problem"]["detail"] == "a vector must be 2 numbers, got 1"
        say(socket, type="set", seq=5, vectors=[[1.0, -1.0]])
        header, arrays = frame(socket.recv(timeout=PATIENCE))
        assert header["variants"][0]["verdict"] == "unstable"
        assert np.isfinite(arrays["outputs"][0, 0, :10]).all()


@pytest.mark.parametrize(("query", "code"), [("", 1008), ("?ticket=guessed", 1008)])
def test_nobody_comes_in_without_a_ticket(sqlite_service, query, code) -> None:
    with pytest.raises(Exception, match="403"):
        connect(sqlite_service.url.replace("http", "ws") + "/v1/live" + query, proxy=None)


def test_the_ticket_of_a_key_revoked_since_opens_nothing(sqlite_service) -> None:
    with sqlite_service.client("admin") as admin:
        made = admin.post("/v1/keys", json={"name": "lent", "scopes": ["run"]}).json()
        ticket = admin.post("/v1/tickets", headers={"Authorization": f"Bearer {made['key']}"}).json()["ticket"]
        assert admin.delete(f"/v1/keys/{made['id']}").status_code == 204
    with pytest.raises(Exception, match="403"):
        connect(sqlite_service.url.replace("http", "ws") + f"/v1/live?ticket={ticket}", proxy=None)


def test_who_may_only_read_may_not_compute(sqlite_service) -> None:
    with pytest.raises((ConnectionClosed, Exception), match=r"403|scope"), opened(sqlite_service, "read") as socket:
        socket.recv(timeout=PATIENCE)


def test_a_recording_comes_at_the_instants_of_the_picture_in_si_with_its_noise(sqlite_service) -> None:
    rate = 1000
    time = np.arange(6 * rate) / rate
    values = 100 + np.minimum(time, 1.0) * 2000 + np.random.default_rng(5).normal(0.0, 5.0, time.size)
    described = {"name": "a ramp", "format": "raw", "sample_rate": rate, "channels": [{"name": "a", "unit": "mm"}]}
    with sqlite_service.client() as client:
        dataset = upload(client, described, values.astype("<f8").tobytes(), segment=values.nbytes).json()["id"]
    with opened(sqlite_service) as socket:
        overlay = {"output": "y", "dataset": dataset, "channel": "a", "start": 0.5}
        say(socket, **OPEN | {"measured": [overlay, {**overlay, "relative": True}]})
        first, second = heard(socket)["measured"]
        # 0.1 m and a rise of 2 m in the first second, seen from 0.5 s on: 1.1 m at first, 2.1 m at last; 5 mm of noise.
        assert first["values"][0] == pytest.approx(1.1, abs=0.02)
        assert first["values"][-1] == pytest.approx(2.1, abs=0.02)
        assert first["sigma"] == pytest.approx(0.005, rel=0.1)
        assert first["high"][7] - first["low"][7] == pytest.approx(4 * first["sigma"], rel=1e-9)
        assert second["values"][0] == 0.0
        assert second["values"][-1] == pytest.approx(1.0, abs=0.02)
        say(socket, **OPEN | {"measured": [{**overlay, "channel": "b"}]})
        problem = heard(socket)["problem"]
        assert problem["errors"][0]["pointer"] == "/measured/0/channel"
        say(socket, **OPEN | {"measured": [{**overlay, "output": "z"}]})
        assert heard(socket)["problem"]["errors"][0]["pointer"] == "/measured/0/output"
