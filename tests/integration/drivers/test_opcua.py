"""A controller behind OPC UA: sessions that are lost, a ring that is read too late, certificates."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from asyncua.crypto.cert_gen import dump_private_key_as_pem, generate_private_key, generate_self_signed_app_certificate
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID

from agent.drivers.opcua.controller import Controller
from agent.drivers.opcua.driver import Opcua
from agent.drivers.opcua.settings import OpcuaSettings
from agent.errors import AttemptError
from rig_simulator.devices import Device
from rig_simulator.opcua_server import Security, Server
from tests.integration.agent.lab import make_bench
from tests.integration.drivers.cable import Cable
from tests.integration.drivers.rigs import LOOPBACK, POSITION, VALVE
from tests.integration.drivers.test_conformance import STEP_OF_CONVERTER, all_of, failure, sine, step, until


@pytest.fixture(params=["arrays", "subscription"])
def way(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@contextlib.contextmanager
def controller(*, speed: float = 1.0, **options: object) -> Iterator[Server]:
    devices = [
        Device(name="cDAQ1Mod1", model="a controller's", serial=0x01A2B3C4, inputs=8),
        Device(name="cDAQ1Mod2", model="a controller's", serial=2, outputs=2, divider=0),
    ]
    server = Server(make_bench(speed=speed, devices=devices), **options)  # type: ignore[arg-type] # those of a server
    try:
        yield server
    finally:
        server.close()


@contextlib.contextmanager
def connected(port: int, **settings: object) -> Iterator[Opcua]:
    given = {"server": f"opc.tcp://127.0.0.1:{port}", "chunk": 0.05, "deadline": 60.0, **settings}
    driver = Opcua(OpcuaSettings(**given), rig="bench-1")  # type: ignore[arg-type] # those of a controller
    try:
        yield driver
    finally:
        driver.close()


def test_a_lost_session_loses_no_sample(way) -> None:
    with controller(watchdog=60.0) as server:
        cable = Cable(server.port)
        with connected(cable.port, way=way) as driver, driver.run((LOOPBACK, POSITION), 1000.0, seconds=2.0) as running:
            samples = 4000
            drive = sine(running.rate, samples)
            running.prepare(samples, drive)
            running.start()
            blocks, read = [], 0
            while read < samples:
                blocks.append(running.read())
                read += blocks[-1].shape[1]
                if read < 3000:
                    cable.cut()
            assert running.halt() == VALVE.safe
        assert cable.connections > 3
        cable.close()
    values = np.concatenate(blocks, axis=1)
    assert values.shape == (2, samples)
    assert np.abs(values[0] - drive.block(0, samples)).max() < STEP_OF_CONVERTER


def test_a_network_that_stays_away_ends_the_run_and_the_controller_comes_to_rest_by_itself(way) -> None:
    with controller(watchdog=1.0) as server:
        cable = Cable(server.port)
        with (
            connected(cable.port, way=way, deadline=2.0) as driver,
            driver.run((LOOPBACK,), 1000.0, seconds=60.0) as running,
        ):
            running.prepare(90_000, step(running.rate, 90_000))
            running.start()
            until(lambda: running.read()[0, -1] > 0.5)
            cable.cut(for_good=True)
            assert failure(running, []) == "server_unreachable"
        until(lambda: server.bench.levels["cDAQ1Mod2/ao0"] == 0.0)
        cable.close()


def test_a_ring_that_is_read_too_late_is_told_and_never_filled_with_something_else(way) -> None:
    with controller(watchdog=60.0, blocks=4) as server, connected(server.port, way=way) as driver:
        watching = Controller(OpcuaSettings(server=f"opc.tcp://127.0.0.1:{server.port}"))
        with driver.run((LOOPBACK,), 1000.0, seconds=60.0) as running:
            running.prepare(90_000, None)
            running.start()
            running.read()
            until(lambda: watching.read("Written")[0] > 40)
            got: list[np.ndarray] = []
            assert failure(running, got) == "overrun"
            assert len(got) <= (4 if way == "subscription" else 0)
        watching.connection.close()


def test_a_drive_that_the_controller_has_no_room_for_is_refused() -> None:
    with controller(size=1000) as server, connected(server.port) as driver:
        says = r"valve must have at most 8000 samples .*, it has 8001"
        with (
            pytest.raises(AttemptError, match=says) as caught,
            driver.run((LOOPBACK,), 1000.0, seconds=10.0) as running,
        ):
            running.prepare(8001, sine(running.rate, 8001))
        assert caught.value.code == "unsupported_setting"
        long = VALVE.__class__(name="valve", channel=VALVE.channel, amplitude=4.0, soft_stop=30.0)
        server.bench.speed = 100.0
        driver.rest(long, level=2.0)  # a way of 30 s in as many steps as there is room for
        assert server.bench.levels["cDAQ1Mod2/ao0"] == 0.0


def test_an_object_that_is_none_of_ours_is_refused() -> None:
    with controller() as server:
        for node, says in (
            ("ns=0;i=2253", "must have the variables of docs/agent.md, it lacks Request"),
            ("ns=2;s=Acquisitoin", "Acquisitoin must have the variables of docs/agent.md"),
            ("Acquisition", "daq.object must be a node such as ns=2;s=Acquisition, got 'Acquisition'"),
        ):
            with connected(server.port, object=node, deadline=5.0) as driver, pytest.raises(AttemptError, match=says):
                driver.devices()


def certificate(folder: Path, name: str) -> tuple[str, str]:
    """Make a certificate and its key."""
    key = generate_private_key()
    made = generate_self_signed_app_certificate(
        key,
        name,
        {"organizationName": "lab"},
        [x509.UniformResourceIdentifier(f"urn:{name}"), x509.DNSName("localhost")],
        [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH],
        days=1,
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.pem").write_bytes(dump_private_key_as_pem(key))
    (folder / f"{name}.der").write_bytes(made.public_bytes(Encoding.DER))
    return str(folder / f"{name}.der"), str(folder / f"{name}.pem")


def test_an_encrypted_connection_is_for_known_agents_and_for_the_known_controller(tmp_path) -> None:
    own, own_key = certificate(tmp_path / "plc", "plc")
    agent, agent_key = certificate(tmp_path / "agent", "agent")
    stranger, stranger_key = certificate(tmp_path / "stranger", "stranger")
    (tmp_path / "trusted").mkdir()
    shutil.copy(agent, tmp_path / "trusted")
    security = Security(certificate=Path(own), private_key=Path(own_key), trusted=tmp_path / "trusted")
    known = {"certificate": agent, "private_key": agent_key, "server_certificate": own, "deadline": 5.0}
    with controller(speed=0.0, security=security) as server:
        with connected(server.port, **known) as driver:
            assert "signed and encrypted" in driver.description
            with driver.run((LOOPBACK,), 1000.0, seconds=1.0) as running:
                drive = sine(running.rate, 1000)
                running.prepare(1000, drive)
                running.start()
                assert np.abs(all_of(running)[0] - drive.block(0, 1000)).max() < STEP_OF_CONVERTER
            driver.rest(VALVE)
        for change, codes in (
            ({"certificate": stranger, "private_key": stranger_key}, {"server_refuses"}),
            ({"server_certificate": stranger}, {"server_refuses", "server_unreachable"}),
            ({"certificate": "", "private_key": "", "server_certificate": ""}, {"server_refuses"}),
            ({"private_key": str(tmp_path / "nowhere.pem")}, {"no_certificate"}),
            ({"server_certificate": agent_key}, {"no_certificate"}),
        ):
            with connected(server.port, **known | change) as driver:
                with pytest.raises(AttemptError) as caught:
                    driver.devices()
                assert caught.value.code in codes, (change, caught.value.detail)


def test_a_user_comes_in_by_the_password_alone(tmp_path) -> None:
    own, own_key = certificate(tmp_path / "plc", "plc")
    agent, agent_key = certificate(tmp_path / "agent", "agent")
    (tmp_path / "trusted").mkdir()
    shutil.copy(agent, tmp_path / "trusted")
    security = Security(
        certificate=Path(own), private_key=Path(own_key), trusted=tmp_path / "trusted", user="rig", password="pässword"
    )
    (tmp_path / "right").write_text("pässword\n", encoding="utf-8")
    (tmp_path / "wrong").write_text("password\n", encoding="utf-8")
    (tmp_path / "empty").write_text("")
    known = {"certificate": agent, "private_key": agent_key, "server_certificate": own, "deadline": 5.0}
    with controller(speed=0.0, security=security) as server:
        with connected(server.port, **known, user="rig", password_file=str(tmp_path / "right")) as driver:
            assert driver.devices()[0]["name"] == "PLC"
        for user, file, code in (
            ("rig", "wrong", "server_refuses"),
            ("gir", "right", "server_refuses"),
            ("", "right", "server_refuses"),
            ("rig", "empty", "no_password"),
            ("rig", "nowhere", "no_password"),
        ):
            given = known | {"user": user, "password_file": str(tmp_path / file)}
            with connected(server.port, **given) as driver:
                with pytest.raises(AttemptError) as caught:
                    driver.devices()
                assert caught.value.code == code, (user, file, caught.value.detail)
                assert "pässword" not in caught.value.detail
