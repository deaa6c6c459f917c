"""The bench as an NI gRPC Device Server: the service `nidaqmx_grpc.NiDAQmx`, with the messages that come with nidaqmx.

A failed call ends with status UNKNOWN, the driver's text as its detail, the number as trailing metadata `ni-error`
(ni/grpc-device, source/server/converters.h).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NoReturn, TypeAlias

import grpc
import numpy as np
import session_pb2
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as service

from rig_simulator import attributes
from rig_simulator.bench import Bench
from rig_simulator.channels import CALLS, asked
from rig_simulator.faults import MESSAGES, DriverError

Context: TypeAlias = Any  # grpc has no types

_ATTRIBUTE = re.compile(
    r"(Get|Set)(SystemInfo|Device|Task|PhysicalChan|Chan|Read|Write|Timing|Buffer|Trig)Attribute\w*"
)
_INITIALIZE, _ATTACH = 1, 2
_CALLS_AT_ONCE = 16
_UNLIMITED = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]
_ALONE = [("grpc.so_reuseport", 0)]
"""Two servers at one port would each get some of the calls."""


class Driver(service.NiDAQmxServicer):
    """The calls of the driver; whatever is missing here is answered UNIMPLEMENTED."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def CreateTask(self, request: Any, context: Context) -> Any:  # noqa: N802 - NI's names
        """Make a task, or attach to the one of the same name."""
        name, how = request.session_name, request.initialization_behavior
        there = name in self._bench.tasks
        if how == _INITIALIZE and there:
            context.abort(grpc.StatusCode.ALREADY_EXISTS, f"session {name!r} exists already")
        if how == _ATTACH and not there:
            context.abort(grpc.StatusCode.FAILED_PRECONDITION, f"session {name!r} does not exist")
        task = self._bench.task(name) if there else self._bench.create(name)
        session = session_pb2.Session(name=task.name)
        return messages.CreateTaskResponse(task=session, new_session_initialized=not there)

    def CfgSampClkTiming(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Time a task."""
        task = self._bench.task(request.task.name)
        self._bench.set_clock(
            task,
            rate=request.rate,
            source=request.source,
            mode=request.sample_mode_raw,
            samples=request.samps_per_chan,
        )
        return messages.CfgSampClkTimingResponse()

    def CfgDigEdgeStartTrig(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Let a task wait for another's start."""
        self._bench.task(request.task.name).trigger = request.trigger_source
        return messages.CfgDigEdgeStartTrigResponse()

    def StartTask(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Start a task."""
        self._bench.start(self._bench.task(request.task.name))
        return messages.StartTaskResponse()

    def TaskControl(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Verify, reserve or commit a task."""
        self._bench.control(self._bench.task(request.task.name), request.action_raw or request.action)
        return messages.TaskControlResponse()

    def StopTask(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Stop a task."""
        self._bench.stop(self._bench.task(request.task.name))
        return messages.StopTaskResponse()

    def ClearTask(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Forget a task."""
        self._bench.clear(request.task.name)
        return messages.ClearTaskResponse()

    def IsTaskDone(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Say whether a task is done."""
        done = self._bench.is_done(self._bench.task(request.task.name))
        return messages.IsTaskDoneResponse(is_task_done=done)

    def WaitUntilTaskDone(self, request: Any, context: Context) -> Any:  # noqa: N802
        """Wait for the end of a task."""
        task = self._bench.task(request.task.name)
        self._bench.wait(task, request.time_to_wait, cancelled=lambda: not context.is_active())
        return messages.WaitUntilTaskDoneResponse()

    def ReadAnalogF64(self, request: Any, context: Context) -> Any:  # noqa: N802
        """Read samples; fewer than were asked for come with a status."""
        status, values = self._read(request, context)
        count = values.shape[1]
        whole = np.zeros((values.shape[0], max(request.num_samps_per_chan, count)))
        whole[:, :count] = values
        flat = (whole if request.fill_mode_raw == 0 else whole.T).ravel()
        return messages.ReadAnalogF64Response(status=status, read_array=flat, samps_per_chan_read=count)

    def ReadCounterF64Ex(self, request: Any, context: Context) -> Any:  # noqa: N802
        """Read positions."""
        status, values = self._read(request, context)
        padded = np.zeros(max(request.num_samps_per_chan, values.shape[1]))
        padded[: values.shape[1]] = values[0]
        return messages.ReadCounterF64ExResponse(status=status, read_array=padded, samps_per_chan_read=values.shape[1])

    def ReadCounterU32Ex(self, request: Any, context: Context) -> Any:  # noqa: N802
        """Read counts."""
        status, values = self._read(request, context)
        padded = np.zeros(max(request.num_samps_per_chan, values.shape[1]), dtype=np.uint32)
        padded[: values.shape[1]] = values[0]
        return messages.ReadCounterU32ExResponse(status=status, read_array=padded, samps_per_chan_read=values.shape[1])

    def ReadDigitalU32(self, request: Any, context: Context) -> Any:  # noqa: N802
        """Read lines; the value of a line is in the bit of its number."""
        task = self._bench.task(request.task.name)
        status, values = self._read(request, context)
        count = values.shape[1]
        whole = np.zeros((values.shape[0], max(request.num_samps_per_chan, count)), dtype=np.uint32)
        whole[:, :count] = values.astype(np.uint32) << np.array(
            [[channel.line] for channel in task.channels], dtype=np.uint32
        )
        flat = (whole if request.fill_mode_raw == 0 else whole.T).ravel()
        return messages.ReadDigitalU32Response(status=status, read_array=flat, samps_per_chan_read=count)

    def _read(self, request: Any, context: Context) -> tuple[int, Any]:
        task = self._bench.task(request.task.name)
        return self._bench.read(
            task, request.num_samps_per_chan, request.timeout, cancelled=lambda: not context.is_active()
        )

    def WriteAnalogF64(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Write samples."""
        return messages.WriteAnalogF64Response(samps_per_chan_written=self._write(request))

    def WriteDigitalU32(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Write lines."""
        return messages.WriteDigitalU32Response(samps_per_chan_written=self._write(request))

    def _write(self, request: Any) -> int:
        task = self._bench.task(request.task.name)
        values = np.array(request.write_array)
        shape = (len(task.channels), request.num_samps_per_chan)
        data = values.reshape(shape) if request.data_layout_raw == 0 else values.reshape(shape[::-1]).T
        return self._bench.write(task, data, auto_start=request.auto_start)

    def ConfigureTEDS(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Look for a sensor with a data sheet."""
        attributes.data_sheet(self._bench, request.physical_channel)
        return messages.ConfigureTEDSResponse()

    def GetErrorString(self, request: Any, _: Context) -> Any:  # noqa: N802
        """Return the sentence of a number."""
        return messages.GetErrorStringResponse(error_string=MESSAGES.get(request.error_code, "Unknown."))

    def create_channels(self, call: str, request: Any) -> None:
        """Add channels of some kind to a task."""
        made = CALLS[call]
        self._bench.create_channels(self._bench.task(request.task.name), made, asked(made, request))

    def attribute(self, verb: str, family: str, request: Any, response: Any) -> Any:
        """Read or set a property."""
        number = request.attribute_raw or request.attribute
        owner = _owner(family, request)
        channel = getattr(request, "channel", "")
        if verb == "Set":
            value = getattr(request, "value_raw", 0) or request.value
            attributes.put(self._bench, family, owner, number, value, channel=channel)
            return response
        value = attributes.get(self._bench, family, owner, number, channel=channel)
        name = "value_raw" if "value_raw" in response.DESCRIPTOR.fields_by_name else "value"
        if isinstance(value, list):
            getattr(response, name).extend(value)
        elif isinstance(value, bytes):
            response.value = value
        else:
            setattr(response, name, value)
        return response


def _owner(family: str, request: Any) -> str:
    match family:
        case "SystemInfo":
            return ""
        case "Device":
            return str(request.device_name)
        case "PhysicalChan":
            return str(request.physical_channel)
    return str(request.task.name)


class _Door(grpc.ServerInterceptor):
    """Sends attributes and channels to one method each, and turns the driver's errors into NI's metadata."""

    def __init__(self, driver: Driver, bench: Bench) -> None:
        self._driver, self._bench = driver, bench

    def intercept_service(self, continuation: Callable[[Any], Any], details: Any) -> Any:
        """Return the handler of a call."""
        name = details.method.rsplit("/", 1)[1]
        handler = continuation(details)
        if handler is None or handler.response_streaming:
            return handler
        attribute = _ATTRIBUTE.fullmatch(name)
        reply = getattr(messages, f"{name}Response", None)

        def call(request: Any, context: Context) -> Any:
            self._bench.awake.wait()
            try:
                if attribute is not None and reply is not None:
                    return self._driver.attribute(attribute[1], attribute[2], request, reply())
                if name in CALLS and reply is not None:
                    self._driver.create_channels(name, request)
                    return reply()
                return handler.unary_unary(request, context)
            except DriverError as error:
                _fail(context, error)

        return grpc.unary_unary_rpc_method_handler(call, handler.request_deserializer, handler.response_serializer)


def _fail(context: Context, error: DriverError) -> NoReturn:
    told = [("ni-error", str(error.code))]
    if error.read is not None:
        told.append(("ni-samps-per-chan-read", str(error.read)))
    context.set_trailing_metadata(told)
    context.abort(grpc.StatusCode.UNKNOWN, str(error))
    raise AssertionError  # abort() raises


class Server:
    """A device server on a port of this machine.

    Parameters
    ----------
    bench : Bench
    port : int
        0 takes a free one.
    credentials : optional
        `grpc.ssl_server_credentials(...)`, as a device server with `security` in its configuration has them.
    """

    def __init__(self, bench: Bench, *, host: str = "127.0.0.1", port: int = 0, credentials: Any = None) -> None:
        self.bench = bench
        self._pool = ThreadPoolExecutor(_CALLS_AT_ONCE)
        driver = Driver(bench)
        self._server = grpc.server(self._pool, interceptors=[_Door(driver, bench)], options=[*_UNLIMITED, *_ALONE])
        service.add_NiDAQmxServicer_to_server(driver, self._server)
        place = f"{host}:{port}"
        secure = credentials is not None
        self.port = int(
            self._server.add_secure_port(place, credentials) if secure else self._server.add_insecure_port(place)
        )
        if not self.port:
            raise OSError(f"the port {port} of {host} must be free, it is not")
        self._server.start()

    def close(self) -> None:
        """Stop, whoever is still calling."""
        self.bench.awake.set()
        self._server.stop(None).wait(5)
        self._pool.shutdown(wait=False, cancel_futures=True)
