"""`servotune rig-simulator`: serves a simulated rig, and takes faults on command from standard input."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from api.runtime.arguments import parser_of, stopped_by_signals

if TYPE_CHECKING:
    from rig_simulator.bench import Bench

_FAULTS = """faults on command, a line each on standard input:
  unplug DEVICE [SAMPLE]   take a device away, at once or at some sample of a run
  plug DEVICE              bring it back
  swap DEVICE MODEL        put another module in its place
  overrun                  the next read comes too late
  freeze / thaw            answer nothing / answer again
  crash                    end at once, without tidying up
  levels                   print the V at which the outputs stand"""


def rig_simulator(argv: Sequence[str]) -> int:
    """Serve a simulated rig in place of an NI gRPC Device Server.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser = parser_of(
        "rig-simulator",
        "Serve a simulated rig in place of an NI gRPC Device Server, a controller or a logger. It stands in for hardware.",
        epilog=_FAULTS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("description", type=Path, help="TOML file: devices, plant, what is connected to what")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: %(default)s)")
    parser.add_argument("--port", type=int, default=31763, help="port, 0: a free one (default: %(default)s)")
    parser.add_argument(
        "--as",
        dest="door",
        choices=["nidaqmx", "opcua", "file"],
        default="nidaqmx",
        help="the driver of the agent that it is for (default: %(default)s)",
    )
    parser.add_argument("--folder", type=Path, help="of the files (--as file)")
    parser.add_argument("--watchdog", type=float, default=5.0, help="s without the agent after which outputs go to 0 V")
    parser.add_argument("--certificate", type=Path, help="of the OPC UA server, with --private-key and --trusted")
    parser.add_argument("--private-key", type=Path, help="of the OPC UA server")
    parser.add_argument("--trusted", type=Path, help="folder with the certificates of the agents that are let in")
    given = parser.parse_args(argv)

    import threading

    from rig_simulator.description import DescriptionError, read

    try:
        bench = read(given.description)
        server, where = _door(bench, given)
    except (DescriptionError, OSError) as error:
        sys.stderr.write(f"servotune rig-simulator: {error}\n")
        return 2
    stop = stopped_by_signals()
    _say(f"simulated rig on {where} (it stands in for hardware)")
    threading.Thread(target=_listen, args=(bench,), daemon=True).start()
    stop.wait()
    server.close()
    return 0


class _Door(Protocol):
    """What lets an agent in."""

    def close(self) -> None:
        """Stop."""


def _door(bench: Bench, given: argparse.Namespace) -> tuple[_Door, str]:
    """Return what serves a bench, and where; the libraries of the others need not be there."""
    if given.door == "file":
        from rig_simulator.file_writer import Writer

        if given.folder is None:
            raise OSError("--folder must be given with --as file")
        return Writer(bench, given.folder, watchdog=given.watchdog), str(given.folder)
    if given.door == "opcua":
        from rig_simulator import opcua_server

        files = (given.certificate, given.private_key, given.trusted)
        if any(files) and not all(files):
            raise OSError("--certificate, --private-key and --trusted must be given together")
        security = (
            opcua_server.Security(certificate=files[0], private_key=files[1], trusted=files[2]) if files[0] else None
        )
        controller = opcua_server.Server(
            bench, host=given.host, port=given.port, watchdog=given.watchdog, security=security
        )
        return controller, f"opc.tcp://{given.host}:{controller.port}"
    from rig_simulator.grpc_server import Server

    server = Server(bench, host=given.host, port=given.port)
    return server, f"{given.host}:{server.port}"


def _listen(bench: Bench) -> None:
    # not sys.stdin, whose lock this thread would hold when the interpreter ends, which is fatal
    for line in open(0, closefd=False):  # noqa: SIM115 - for as long as this process lives
        try:
            answer = obey(bench, line.split())
        except (ValueError, KeyError, IndexError) as error:
            answer = f"not understood: {error}"
        if answer:
            _say(answer)


def obey(bench: Bench, words: Sequence[str]) -> str:
    """Do what a line says, and return what is to be answered.

    Raises
    ------
    ValueError
        For a line that means nothing.
    """
    match list(words):
        case []:
            return ""
        case ["unplug", device, *sample]:
            bench.unplug(device, after=int(sample[0]) if sample else 0)
        case ["plug", device]:
            bench.plug(device)
        case ["swap", device, *model]:
            bench.devices[device].model = " ".join(model)
            bench.devices[device].serial += 1
        case ["overrun"]:
            bench.overrun()
        case ["freeze" | "thaw" as word]:
            (bench.awake.set if word == "thaw" else bench.awake.clear)()
        case ["crash"]:
            os._exit(1)
        case ["levels"]:
            return " ".join(f"{name}={value:g}" for name, value in sorted(bench.levels.items()))
        case _:
            raise ValueError(f"a command must be one of those of --help, got {' '.join(words)!r}")
    return f"done: {' '.join(words)}"


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
