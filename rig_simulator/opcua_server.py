"""The bench as a controller with an OPC UA server: the object `Acquisition` of docs/agent.md, and the program behind it."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from asyncua import ua
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.crypto.truststore import TrustStore
from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions
from asyncua.server import Server as Ua

from rig_simulator.bench import Bench
from rig_simulator.controller import Controller, ControllerError

IDLE, READY, RUNNING, FAILED = range(4)

_DRIVES = 8
_WRITABLE = {"Request", "Command", "Rate", "BlockSamples", "Samples", "Output", "Heartbeat", "Taken"}
_PAUSE = 0.005
_LONGEST_WAIT = 0.25
_STARTS_WITHIN = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Security:
    """The certificate and key of a server, and the folder with the certificates of the clients that it lets in.

    With a ``user`` it lets in that one alone, by its ``password``.
    """

    certificate: Path
    private_key: Path
    trusted: Path
    user: str = ""
    password: str = ""


class _Users:
    """Who may come in: the one user of a controller that has one, else everybody."""

    def __init__(self, security: Security | None) -> None:
        self._security = security

    def get_user(
        self, iserver: object, username: str | None = None, password: str | None = None, certificate: object = None
    ) -> User | None:
        """Return a user who may read and write, None for a stranger; asyncua's name and arguments."""
        del iserver, certificate
        known = self._security
        if known is None or not known.user or (username, password) == (known.user, known.password):
            return User(role=UserRole.User)
        return None


class Server:
    """A controller on a port of this machine.

    Parameters
    ----------
    bench : Bench
    port : int
        0 takes a free one.
    blocks, size : int
        Of the ring of samples: how many, and the numbers in each.
    watchdog : float
        s without a heartbeat after which outputs go to 0 V.
    security : Security, optional
        Encrypted and signed, for known clients alone; without it anybody comes in.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        blocks: int = 64,
        size: int = 65_536,
        watchdog: float = 5.0,
        security: Security | None = None,
    ) -> None:
        self.bench = bench
        self.port = port or _free_port(host)
        self._host, self._blocks, self._size, self._watchdog, self._security = host, blocks, size, watchdog, security
        self._controller = Controller(bench)
        self._inputs, self._outputs = self._controller.ranges("ai"), self._controller.ranges("ao")
        self._nodes: dict[str, tuple[ua.NodeId, ua.VariantType]] = {}
        self._state, self._run, self._samples, self._taken = IDLE, 0, 0, 0
        self._written, self._answered, self._heard, self._beat = 0, 0, 0.0, -1
        self._over = threading.Event()
        self._ready = threading.Event()
        self._error: BaseException | None = None
        logging.getLogger("asyncua").setLevel(logging.ERROR)
        self._thread = threading.Thread(target=self._work, name="controller", daemon=True)
        self._thread.start()
        if not self._ready.wait(_STARTS_WITHIN) or self._error is not None:
            raise OSError(f"the port {self.port} of {host} must be free for OPC UA: {self._error}")

    def close(self) -> None:
        """Stop, whoever is still connected."""
        self._over.set()
        self.bench.awake.set()
        self._thread.join(_STARTS_WITHIN)

    def _work(self) -> None:
        try:
            asyncio.run(self._serve())
        except OSError as error:
            self._error = error
            self._ready.set()

    async def _serve(self) -> None:
        server = Ua(user_manager=_Users(self._security))
        await server.init()
        server.set_endpoint(f"opc.tcp://{self._host}:{self.port}")
        await self._secure(server)
        self._server = server
        await self._declare(await server.register_namespace("urn:servotune:acquisition"))
        async with server:
            self._ready.set()
            while not self._over.is_set():
                self.bench.awake.wait()  # holds the whole server: a frozen controller answers nobody
                await self._cycle()

    async def _secure(self, server: Ua) -> None:
        if self._security is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            return
        server.set_security_policy(
            [ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt],
            permission_ruleset=SimpleRoleRuleset(),
        )
        await server.load_certificate(self._security.certificate)
        await server.load_private_key(self._security.private_key)
        trusted = TrustStore([self._security.trusted], [])
        await trusted.load()
        options = CertificateValidatorOptions.TIME_RANGE | CertificateValidatorOptions.TRUSTED
        server.set_certificate_validator(CertificateValidator(options, trusted))

    async def _declare(self, space: int) -> None:
        parent = await self._server.nodes.objects.add_object(_identifier("Acquisition", space), f"{space}:Acquisition")
        kind = ua.VariantType
        numbers = {f"Block{i}": ([0.0], kind.Double) for i in range(self._blocks)}
        numbers |= {f"Drive{i}": ([0.0], kind.Double) for i in range(_DRIVES)}
        for name, (value, type_) in {
            "Name": ("PLC", kind.String),
            "Model": ("simulated controller", kind.String),
            "Serial": (self._controller.serial, kind.String),
            "Simulated": (True, kind.Boolean),
            "Inputs": (list(self._inputs), kind.String),
            "InputRanges": (list(self._inputs.values()), kind.Double),
            "Outputs": (list(self._outputs), kind.String),
            "OutputRanges": (list(self._outputs.values()), kind.Double),
            "BlockSize": (self._size, kind.UInt32),
            "State": (IDLE, kind.Int32),
            "Answer": (0, kind.UInt32),
            "ErrorCode": ("", kind.String),
            "Error": ("", kind.String),
            "ActualRate": (0.0, kind.Double),
            "Written": (0, kind.UInt64),
            "Played": (0, kind.UInt64),
            "Newest": ([0.0], kind.Double),
            "Request": (0, kind.UInt32),
            "Command": (0, kind.Int32),
            "Rate": (1000.0, kind.Double),
            "BlockSamples": (100, kind.UInt32),
            "Samples": (0, kind.UInt64),
            "Output": (-1, kind.Int32),
            "Heartbeat": (0, kind.UInt32),
            "Taken": (0, kind.UInt64),
            **numbers,
        }.items():
            identifier = _identifier(f"Acquisition.{name}", space)
            node = await parent.add_variable(identifier, f"{space}:{name}", value, type_)
            if name in _WRITABLE or name.startswith("Drive"):
                await node.set_writable()
            self._nodes[name] = (identifier, type_)

    async def _put(self, **values: Any) -> None:
        for name, value in values.items():
            identifier, kind = self._nodes[name]
            await self._server.write_attribute_value(identifier, ua.DataValue(ua.Variant(value, kind)))

    async def _get(self, name: str) -> Any:
        return await self._server.get_node(self._nodes[name][0]).read_value()

    async def _cycle(self) -> None:
        """Do what was asked for, then go on with what runs: once in a while, as a controller does."""
        request = int(await self._get("Request"))
        if request != self._answered:
            await self._obey(request)
        if self._state != RUNNING:
            await asyncio.sleep(_PAUSE)
            return
        try:
            await self._listen()
            await self._advance()
        except ControllerError as error:
            await self._fail(error)

    async def _obey(self, request: int) -> None:
        try:
            await self._do(int(await self._get("Command")), request)
        except ControllerError as error:
            await self._fail(error)
        self._answered = request
        await self._put(State=self._state, Answer=request)

    async def _do(self, command: int, request: int) -> None:
        match command:
            case 1:  # prepare
                actual = self._controller.prepare(float(await self._get("Rate")), list(self._inputs))
                await self._put(ActualRate=actual)
                self._state = READY
            case 2:  # arm
                self._samples = int(await self._get("Samples"))
                self._controller.arm(self._samples, await self._output(), await self._drive())
            case 3:  # start
                self._run, self._written, self._taken = request, 0, 0
                self._heard = time.monotonic()
                await self._put(Written=0, Played=0, Taken=0)
                self._controller.start()
                self._state = RUNNING
            case 4:  # stop
                self._controller.stop()
                await self._put(Played=self._controller.played)
                self._state = IDLE
            case 5:  # rest
                self._samples = int(await self._get("Samples"))
                output, rate, way = await self._output(), float(await self._get("Rate")), await self._drive()
                await asyncio.to_thread(self._controller.rest, output or "", way, rate=rate)
                self._state = IDLE
            case _:
                raise ControllerError("unknown_command", f"Command must be one of 1 to 5, got {command}")

    async def _output(self) -> str | None:
        number = int(await self._get("Output"))
        return None if number < 0 else list(self._outputs)[number]

    async def _drive(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        if int(await self._get("Output")) < 0:
            return np.zeros(0)
        parts = -(-self._samples // self._size)
        found = [np.array(await self._get(f"Drive{i}"), dtype=np.float64) for i in range(parts)]
        return np.concatenate(found)[: self._samples]

    async def _fail(self, error: ControllerError) -> None:
        self._controller.stop()
        self._state = FAILED
        played = self._controller.played
        await self._put(State=FAILED, ErrorCode=error.code, Error=str(error), Played=played)

    async def _listen(self) -> None:
        """See whether somebody is there who reads: otherwise nothing may go on moving."""
        beat = int(await self._get("Heartbeat"))
        if beat != self._beat:
            self._beat, self._heard = beat, time.monotonic()
        if time.monotonic() > self._heard + self._watchdog:
            self._controller.to_zero()
            text = f"no heartbeat came within {self._watchdog:g} s: the outputs are at 0 V"
            raise ControllerError("heartbeat_lost", text)

    async def _advance(self) -> None:
        """Put the next samples into the ring."""
        if self.bench.speed == 0.0 and self._written - int(await self._get("Taken")) >= self._blocks // 2:
            await asyncio.sleep(_PAUSE)  # without a clock of its own it goes as fast as it is read
            return
        most = min(int(await self._get("BlockSamples")), (self._size - 3) // len(self._inputs))
        values = await asyncio.to_thread(self._controller.take, most, within=_LONGEST_WAIT)
        if values.shape[1]:
            block = [float(self._run), float(self._taken), float(values.shape[1]), *values.T.ravel().tolist()]
            self._taken += values.shape[1]
            self._written += 1
            await self._put(
                **{f"Block{(self._written - 1) % self._blocks}": block}, Newest=block, Written=self._written
            )
        await self._put(Played=self._controller.played)
        if self._taken == self._samples:
            self._state = IDLE
            await self._put(State=IDLE)


def _identifier(name: str, space: int) -> ua.NodeId:
    return ua.NodeId(ua.String(name), ua.Int16(space))


def _free_port(host: str) -> int:
    with socket.create_server((host, 0)) as probe:
        return int(probe.getsockname()[1])
