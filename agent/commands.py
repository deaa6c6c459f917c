"""`servotune agent`: the process on the lab PC."""

from __future__ import annotations

import _thread
import argparse
import math
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from agent.settings import Settings


def agent(argv: Sequence[str]) -> int:
    """Measure on the rig of this PC for the service.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code: 2 for settings that make no sense; of a check 1 when something does not fit.
    """
    given = _parser().parse_args(argv)

    import logging
    import signal
    import socket

    from agent.errors import SettingsError
    from agent.process import Agent
    from agent.settings_file import read
    from agent.spool import held
    from agent.terminal import Terminal

    logging.basicConfig(
        level=given.log_level.upper(), format="%(asctime)s %(levelname)s %(name)s: %(message)s", stream=sys.stderr
    )
    for library in ("httpx", "asyncua"):
        logging.getLogger(library).setLevel(logging.WARNING)
    os.umask(0o077)  # samples and keys are this user's alone
    chosen = {
        "service.url": given.url,
        "rig.name": given.rig,
        "daq.server": given.daq_server,
        "spool.folder": given.spool,
    }
    with ExitStack() as stack:
        try:
            if given.what == "install":
                return _install(given, chosen)
            settings = read(given.settings, os.environ, chosen)
            settings.key()
            if given.what == "check":
                return _check(settings, given.rate)
            stack.enter_context(held(Path(settings.spool.folder)))
            process = Agent(settings, name=socket.gethostname(), confirm=Terminal(settings.rig.confirm_seconds))
        except (SettingsError, OSError) as error:
            sys.stderr.write(f"servotune agent: {error}\n")
            return 2
        for number in (signal.SIGTERM, signal.SIGINT):
            # From a thread: a handler runs within whatever this one does, and waits for ever for a lock that this one holds.
            signal.signal(number, lambda *_: _thread.start_new_thread(process.stop, ()))
        _let_memory_go()
        process.run()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="servotune agent",
        description="Measure on the rig of this PC for the service. The key comes from SERVOTUNE_AGENT_KEY or a file.",
    )
    parser.add_argument(
        "what",
        nargs="?",
        choices=["run", "check", "install"],
        default="run",
        help="run: measure until it is stopped (default). check: list devices, try every configured channel without an output, "
        "name what does not fit and the remedy; exit code 1 when something does not. install: write what makes it a service of "
        "this computer, and tell what to run next",
    )
    parser.add_argument("--settings", type=Path, help="TOML file: the rig, its channels, their limits")
    parser.add_argument("--url", help="address of the service")
    parser.add_argument("--rig", help="name of the rig")
    parser.add_argument("--daq-server", help="address of an NI gRPC Device Server or of a controller")
    parser.add_argument("--spool", help="folder where samples wait for the service")
    parser.add_argument(
        "--rate", type=float, help="samples/s at which check tries channels (default: 1000, or 10 for slow ones)"
    )
    installing = parser.add_argument_group(
        "install", "a unit of systemd, or the XML of WinSW, for this Python and --settings"
    )
    installing.add_argument("--print", action="store_true", help="print the file, write nothing")
    installing.add_argument("--platform", choices=["linux", "windows"], help="default: of this computer")
    installing.add_argument("--to", type=Path, help="the file (default: where systemd looks; beside the settings)")
    installing.add_argument("--force", action="store_true", help="replace a file that is there")
    parser.add_argument("--log-level", default="info", choices=["debug", "info", "warning", "error"])
    return parser


def _check(settings: Settings, rate: float | None) -> int:
    from agent.checking import check, table
    from agent.errors import SettingsError

    if rate is not None and not 0.0 < rate < math.inf:
        raise SettingsError(f"--rate must be finite and > 0 samples/s, got {rate:g}")
    findings = check(settings, rate=rate)
    sys.stdout.write(f"{table(findings)}\n")
    return int(any(entry.result == "fails" for entry in findings))


def _install(given: argparse.Namespace, chosen: Mapping[str, str | None]) -> int:
    from agent import installing

    platform = given.platform or installing.HERE
    service = installing.judged(given.settings, chosen, platform=platform)
    content = installing.content(service, platform=platform)
    if given.print:
        sys.stdout.write(content)
        return 0
    path = (given.to or installing.target(service, platform=platform)).absolute()
    installing.write(path, content, force=given.force)
    following = "\n".join(f"    {line}" for line in installing.next_commands(service, path, platform=platform))
    where = ", in PowerShell as an administrator" if platform == "windows" else ""
    sys.stdout.write(f"{path} is written; run next{where}:\n\n{following}\n")
    return 0


def _let_memory_go() -> None:
    """Let what was freed go back to the system at once: days of blocks of all sizes would otherwise leave holes.

    mallopt(3): M_MMAP_THRESHOLD (-3) as it begins, M_ARENA_MAX (-8) for a few threads. Elsewhere than on glibc nothing happens.
    """
    if sys.platform == "linux":
        import ctypes

        change = getattr(ctypes.CDLL(None), "mallopt", None)
        if change is not None:
            change(-3, 128 * 1024)
            change(-8, 2)
