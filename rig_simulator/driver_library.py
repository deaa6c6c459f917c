"""The bench as NI's C library: generated trampolines back into Python, so that nidaqmx's own route through ctypes is used.

`libnidaqmx.so.1` is compiled with the C compiler of this machine and found through LD_LIBRARY_PATH, as NI's own would be.
A call arrives as the number of its function, its integers (pointers among them) and its doubles.
"""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rig_simulator import attributes
from rig_simulator.bench import Bench
from rig_simulator.channels import CALLS
from rig_simulator.devices import Task
from rig_simulator.faults import MESSAGES, DriverError

#: t task, s text, i int32, u uint32, q uint64, d double, p pointer, v what stands at the end of a variadic call.
FUNCTIONS = {
    "CreateTask": "sp",
    "StartTask": "t",
    "StopTask": "t",
    "ClearTask": "t",
    "IsTaskDone": "tp",
    "WaitUntilTaskDone": "td",
    "TaskControl": "ti",
    **{name: call.signature for name, call in CALLS.items()},
    "CfgSampClkTiming": "tsdiiq",
    "CfgDigEdgeStartTrig": "tsi",
    "ReadAnalogF64": "tidipupp",
    "ReadCounterF64Ex": "tidipupp",
    "ReadCounterU32Ex": "tidipupp",
    "ReadDigitalU32": "tidipupp",
    "WriteAnalogF64": "tiudippp",
    "WriteDigitalU32": "tiudippp",
    "ConfigureTEDS": "ss",
    "GetErrorString": "ipu",
    "GetExtendedErrorInfo": "pu",
    "GetSystemInfoAttribute": "ipu",
    "GetDeviceAttribute": "sipu",
    "GetPhysicalChanAttribute": "sipu",
    "GetTaskAttribute": "tipu",
    "GetReadAttribute": "tipu",
    "GetWriteAttribute": "tipu",
    "GetTimingAttribute": "tipu",
    "GetTrigAttribute": "tipu",
    "GetBufferAttribute": "tipu",
    "GetChanAttribute": "tsipu",
    "SetChanAttribute": "tsiv",
    "SetTimingAttribute": "tiv",
    "SetBufferAttribute": "tiv",
    "SetWriteAttribute": "tiv",
    "SetReadAttribute": "tiv",
    "SetTrigAttribute": "tiv",
}
_C = {
    "t": "void*",
    "s": "const char*",
    "i": "int",
    "u": "unsigned",
    "q": "unsigned long long",
    "d": "double",
    "p": "void*",
}
_WIDE = frozenset({0x1310, 0x193A, 0x1221, 0x192B})
"""Properties of 64 bits."""
_RATE, _TEXTS = 0x1344, frozenset({0x1308, 0x223D})
_TOO_SMALL = -200228
_CALLBACK = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_longlong), ctypes.POINTER(ctypes.c_double)
)


def source() -> str:
    """Return the C program of the library."""
    lines = [
        "typedef int (*callback)(int, long long*, double*);",
        "static callback target;",
        "void servotune_set(callback given) { target = given; }",
    ]
    for number, (name, signature) in enumerate(FUNCTIONS.items()):
        arguments, integers, doubles = [], [], []
        for i, kind in enumerate(signature):
            if kind == "v":  # an integer register and a floating-point register: one of them holds the value
                arguments += [f"long long a{i}", f"double b{i}"]
                integers.append(f"a{i}")
                doubles.append(f"b{i}")
            else:
                arguments.append(f"{_C[kind]} a{i}")
                (doubles if kind == "d" else integers).append(f"a{i}" if kind == "d" else f"(long long)a{i}")
        lines.append(
            f"int DAQmx{name}({', '.join(arguments)}) {{ long long n[] = {{{', '.join(integers) or '0'}}}; "
            f"double d[] = {{{', '.join(doubles) or '0'}}}; return target ? target({number}, n, d) : -1; }}"
        )
    return "\n".join(lines) + "\n"


def build(folder: Path, *, compiler: str) -> Path:
    """Compile the library into a folder for LD_LIBRARY_PATH.

    Raises
    ------
    subprocess.CalledProcessError
        When the compiler refuses.
    """
    program, library = folder / "nidaqmx.c", folder / "libnidaqmx.so.1"
    program.write_text(source())
    subprocess.run(  # noqa: S603 - the caller's compiler on our own program, no shell
        [compiler, "-shared", "-fPIC", "-O1", "-Wl,-soname,libnidaqmx.so.1", "-o", str(library), str(program)],
        check=True,
        capture_output=True,
    )
    link = folder / "libnidaqmx.so"
    link.unlink(missing_ok=True)
    link.symlink_to(library.name)
    return library


class Library:
    """The driver of this process: what nidaqmx calls comes to a bench, as long as this object lives.

    Parameters
    ----------
    bench : Bench
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._names = list(FUNCTIONS)
        self._handles: dict[int, str] = {}
        self._last = ""
        self._callback = _CALLBACK(self._call)
        self._library = ctypes.CDLL("libnidaqmx.so.1")
        self._library.servotune_set(self._callback)

    def _call(self, number: int, integers: Any, doubles: Any) -> int:
        name = self._names[number]
        try:
            return self._dispatch(name, self._arguments(FUNCTIONS[name], integers, doubles))
        except DriverError as error:
            self._last = str(error)
            return error.code

    def _arguments(self, signature: str, integers: Any, doubles: Any) -> list[Any]:
        found: list[Any] = []
        i = d = 0
        for kind in signature:
            if kind == "d":
                found.append(doubles[d])
                d += 1
                continue
            value = integers[i]
            i += 1
            match kind:
                case "v":
                    found.append((value, doubles[d]))
                    d += 1
                case "s":
                    found.append((ctypes.string_at(value) if value else b"").decode())
                case "i":
                    found.append(ctypes.c_int32(value).value)
                case "t":
                    found.append(self._handles.get(value, ""))
                case _:
                    found.append(value)
        return found

    def _dispatch(self, name: str, a: Sequence[Any]) -> int:
        if name.endswith("Attribute"):
            return self._attribute(name, a)
        if name in CALLS:
            self._create(name, a)
            return 0
        if name == "ConfigureTEDS":
            attributes.data_sheet(self._bench, a[0])
            return 0
        return self._run(name, a)

    def _run(self, name: str, a: Sequence[Any]) -> int:
        bench = self._bench
        if name.startswith("Read"):
            kind = ctypes.c_uint32 if name in {"ReadDigitalU32", "ReadCounterU32Ex"} else ctypes.c_double
            return self._read(a, kind)
        match name:
            case "CreateTask":
                return self._create_task(a)
            case "WriteAnalogF64" | "WriteDigitalU32":
                return self._write(a, ctypes.c_uint32 if name == "WriteDigitalU32" else ctypes.c_double)
            case "GetErrorString" | "GetExtendedErrorInfo":
                known = name == "GetErrorString"
                text = MESSAGES.get(a[0], "Unknown.") if known else self._last
                return _text(text, *a[int(known) :])
            case "ClearTask":
                bench.clear(a[0])
                return 0
        self._control(name, bench.task(a[0]), a)
        return 0

    def _control(self, name: str, task: Task, a: Sequence[Any]) -> None:
        bench = self._bench
        match name:
            case "StartTask":
                bench.start(task)
            case "StopTask":
                bench.stop(task)
            case "TaskControl":
                bench.control(task, a[1])
            case "IsTaskDone":
                _put(ctypes.c_uint32, a[1], bench.is_done(task))
            case "WaitUntilTaskDone":
                bench.wait(task, a[1])
            case "CfgSampClkTiming":
                bench.set_clock(task, rate=a[2], source=a[1], mode=a[4], samples=a[5])
            case "CfgDigEdgeStartTrig":
                task.trigger = a[1]

    def _create_task(self, a: Sequence[Any]) -> int:
        task = self._bench.create(a[0])
        handle = max(self._handles, default=0x1000) + 8
        self._handles[handle] = task.name
        ctypes.c_void_p.from_address(a[1]).value = handle
        return 0

    def _create(self, name: str, a: Sequence[Any]) -> None:
        call = CALLS[name]
        self._bench.create_channels(self._bench.task(a[0]), call, dict(zip(call.names, a[1:], strict=True)))

    def _read(self, a: Sequence[Any], kind: Any) -> int:
        task = self._bench.task(a[0])
        status, values = self._bench.read(task, a[1], a[2])
        count = values.shape[1]
        whole = np.zeros((values.shape[0], max(a[1], count)))
        whole[:, :count] = values
        if kind is ctypes.c_uint32 and task.kind != "CI":  # the value of a line is in the bit of its number
            whole *= np.array([[2.0**channel.line] for channel in task.channels])
        target = np.ctypeslib.as_array((kind * a[5]).from_address(a[4]))
        target[: whole.size] = (whole if a[3] == 0 else whole.T).ravel()
        _put(ctypes.c_int32, a[6], count)
        return status

    def _write(self, a: Sequence[Any], kind: Any) -> int:
        task = self._bench.task(a[0])
        count = ctypes.c_int32(a[1]).value
        values = np.ctypeslib.as_array((kind * (count * len(task.channels))).from_address(a[5]))
        shape = (len(task.channels), count)
        data = values.reshape(shape) if a[4] == 0 else values.reshape(shape[::-1]).T
        return _put(ctypes.c_int32, a[6], self._bench.write(task, data, auto_start=bool(a[2])))

    def _attribute(self, name: str, a: Sequence[Any]) -> int:
        family = name[3 : -len("Attribute")]
        lead = {"SystemInfo": 0, "Chan": 2}.get(family, 1)
        owner, channel = (a[0] if lead else ""), (a[1] if lead == 2 else "")
        number, rest = a[lead], a[lead + 1 :]
        if name.startswith("Set"):
            whole, real = rest[0]
            value = ctypes.string_at(whole).decode() if number in _TEXTS else real if number == _RATE else whole
            attributes.put(self._bench, family, owner, number, value, channel=channel)
            return 0
        value = attributes.get(self._bench, family, owner, number, channel=channel)
        if isinstance(value, str):
            return _text(value, rest[0], rest[1])
        if isinstance(value, list | bytes):
            return _array(value, rest[0], rest[1])
        kind = ctypes.c_double if isinstance(value, float) else ctypes.c_uint64 if number in _WIDE else ctypes.c_uint32
        return _put(kind, rest[0], value)


def _put(kind: Any, address: int, value: Any) -> int:
    if address:
        kind.from_address(address).value = value
    return 0


def _array(values: list[float] | list[int] | bytes, address: int, size: int) -> int:
    """Put numbers where they are asked for; asked for with no room, tell how many there are."""
    if not ctypes.c_uint32(size).value:
        return len(values)
    kind = (
        ctypes.c_uint8
        if isinstance(values, bytes)
        else ctypes.c_double
        if isinstance(values[0], float)
        else ctypes.c_int32
    )
    (kind * len(values)).from_address(address)[:] = list(values)
    return 0


def _text(text: str, address: int, size: int) -> int:
    """Put a text where it is asked for; asked for with no room, tell how much it needs."""
    data = text.encode() + b"\0"
    size = ctypes.c_uint32(size).value
    if not size:
        return len(data)
    if size < len(data):
        return _TOO_SMALL
    ctypes.memmove(address, data, len(data))
    return 0
