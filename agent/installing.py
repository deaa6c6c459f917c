"""`servotune agent install`: what makes the agent a service of its computer, a unit of systemd or the XML of WinSW.

A service has neither this terminal's variables nor its folder: the settings are judged as the service will find them.
"""

from __future__ import annotations

import contextlib
import math
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree as ET

from agent.errors import SettingsError
from agent.settings import Settings
from agent.settings_file import read

Platform = Literal["linux", "windows"]
HERE: Platform = "windows" if sys.platform == "win32" else "linux"

_NAME, _USER = "servotune-agent", "servotune"
_TITLE, _DOC = "Servotune lab agent", "Measures on the rig of this PC for the service."
_STATE = re.compile(r"/var/lib/([\w.-]+)", re.ASCII)
_PLAIN = re.compile(r"[\w/.+:@=-]+", re.ASCII)
_FROM_OUTSIDE = "must be given in the settings: a service has none of this terminal's variables and arguments"


@dataclass(frozen=True, slots=True, kw_only=True)
class Installed:
    """What a service starts: this Python with a settings file, in that file's folder; ``stop`` s are left for its end."""

    python: str
    settings: str
    folder: str
    spool: str
    stop: int

    def command(self, *what: str) -> list[str]:
        """Return the command line; -P: no module in the service's folder is taken for one of ours."""
        return [self.python, "-P", "-m", "servotune", "agent", *what, "--settings", self.settings]


def judged(path: Path | None, arguments: Mapping[str, Any], *, platform: Platform = HERE) -> Installed:
    """Return what a service would start with these settings.

    Parameters
    ----------
    path : Path, optional
        The TOML file.
    arguments : mapping
        ``section.name`` -> value, as given beside the file: none may be.

    Raises
    ------
    SettingsError
        Why the service could not start, or would move nothing.
    """
    if path is None:
        raise SettingsError("--settings must be given: a service is started with a file")
    for name, value in arguments.items():
        if value is not None:
            raise SettingsError(f"{name} {_FROM_OUTSIDE}")
    settings = _as_the_service_finds_it(path.absolute())
    made = Installed(
        python=sys.executable,
        settings=str(path.absolute()),
        folder=str(path.absolute().parent),
        spool=settings.spool.folder,
        stop=_stop_seconds(settings),
    )
    for text in (made.python, made.settings, made.spool):
        _check_path(text, platform)
    if platform == "linux" and set(made.python) & set("$\\\"'"):
        raise SettingsError(f"the path of Python must hold no $, quotes and \\ for systemd, got {made.python}")
    return made


def _as_the_service_finds_it(path: Path) -> Settings:
    if not path.is_file():
        raise SettingsError(f"--settings must be a file, got {path}")
    with contextlib.chdir(path.parent):
        settings = read(path, {}, {})
        if not settings.service.key_file:
            raise SettingsError(f"service.key_file {_FROM_OUTSIDE}, and no key is written into its file")
        if not settings.key():
            raise SettingsError(f"key_file must hold a key, {settings.service.key_file} is empty")
    if not Path(settings.spool.folder).is_absolute():
        raise SettingsError(f"spool.folder must be a whole path for a service, got {settings.spool.folder}")
    if settings.rig.confirm:
        raise SettingsError(
            "rig.confirm must be false for a service: nobody is at its terminal, and no drive would begin"
        )
    return settings


def _check_path(text: str, platform: Platform) -> None:
    if not text.isprintable():
        raise SettingsError(f"a path must hold no control characters, got {text!r}")
    if platform == "windows" and "%" in text:
        raise SettingsError(f"a path must hold no %, between which WinSW reads names of variables, got {text}")


def _stop_seconds(settings: Settings) -> int:
    """Return the longest end: the service's answer and the last upload, hardware that is late, the way home of all outputs."""
    ways = [
        max(output.soft_stop, (output.amplitude + abs(output.safe)) / output.slew * math.pi / 2)
        for output in settings.outputs
    ]
    return math.ceil(2 * settings.service.timeout + 3 * settings.daq.deadline + sum(ways))


def content(installed: Installed, *, platform: Platform) -> str:
    """Return the file's content."""
    return _unit(installed) if platform == "linux" else _wrapper(installed)


def target(installed: Installed, *, platform: Platform) -> Path:
    """Return where the file belongs: WinSW wants it beside its program, which lies with the settings."""
    if platform == "linux":
        return Path("/etc/systemd/system") / f"{_NAME}.service"
    return Path(installed.folder) / f"{_NAME}.xml"


def write(path: Path, text: str, *, force: bool) -> None:
    """Write the file.

    Raises
    ------
    SettingsError
        When there is one already that says something else, or it cannot be written.
    """
    try:
        if path.exists() and not force:
            raise SettingsError(
                f"{path} is there already: give --force to replace it, --print to see what would be in it"
            )
        path.write_text(text, encoding="utf-8", newline="\n")
        path.chmod(0o644)
    except OSError as error:
        who = "an administrator" if HERE == "windows" else "root (sudo)"
        raise SettingsError(f"{path} must be writable: {error.strerror}; run it as {who}, or give --to") from error


def next_commands(installed: Installed, path: Path, *, platform: Platform) -> list[str]:
    """Return what is to be run next, in this order."""
    if platform == "windows":
        program = f'& "{path.with_suffix(".exe")}"'
        return [
            f'copy WinSW-x64.exe "{path.with_suffix(".exe")}"   # of https://github.com/winsw/winsw/releases',
            f"{program} install",
            f"{program} start",
            f"{program} status",
        ]
    spool = shlex.quote(installed.spool)
    return [
        f"id {_USER} || sudo useradd --system --home-dir {spool} {_USER}",
        f"sudo install --directory --owner {_USER} --group {_USER} --mode 0700 {spool}",
        f"sudo -u {_USER} {shlex.join(installed.command('check'))}",
        "sudo systemctl daemon-reload",
        f"sudo systemctl enable --now {_NAME if path == target(installed, platform=platform) else shlex.quote(str(path))}",
        f"journalctl --unit {_NAME} --follow",
    ]


def _unit(installed: Installed) -> str:
    python, *arguments = installed.command()
    start = " ".join([_quoted(python), *(_quoted(argument).replace("$", "$$") for argument in arguments)])
    state = _STATE.fullmatch(installed.spool)
    lines = [
        f"# /etc/systemd/system/{_NAME}.service, written by `servotune agent install`",
        "[Unit]",
        f"Description={_TITLE}",
        "Wants=network-online.target",
        "After=network-online.target",
        "",
        "[Service]",
        f"ExecStart={start}",
        f"WorkingDirectory={installed.folder.replace('%', '%%')}",
        "Environment=PYTHONUNBUFFERED=1",
        f"User={_USER}",
        "UMask=0077",
        *([f"StateDirectory={state[1]}", "StateDirectoryMode=0700"] if state else []),
        "Restart=always",
        "RestartSec=5",
        "# SIGTERM brings the rig to rest and the samples to disk: soft stops, and the deadlines of hardware and service.",
        "KillSignal=SIGTERM",
        f"TimeoutStopSec={installed.stop}",
        "",
        "[Install]",
        "WantedBy=multi-user.target",
    ]
    return "".join(f"{line}\n" for line in lines)


def _quoted(word: str) -> str:
    """Return a word of a unit's command line."""
    word = word.replace("%", "%%")
    if _PLAIN.fullmatch(word):
        return word
    return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _wrapper(installed: Installed) -> str:
    python, *arguments = installed.command()
    root = ET.Element("service")
    for name, value in {
        "id": _NAME,
        "name": _TITLE,
        "description": _DOC,
        "executable": python,
        "arguments": subprocess.list2cmdline(arguments),
        "workingdirectory": installed.folder,
        "startmode": "Automatic",
        "delayedAutoStart": "true",
        "stoptimeout": f"{installed.stop} sec",
    }.items():
        ET.SubElement(root, name).text = value
    ET.SubElement(root, "onfailure", action="restart", delay="5 sec")
    for name, value in {"PYTHONUNBUFFERED": "1", "PYTHONUTF8": "1"}.items():
        ET.SubElement(root, "env", name=name, value=value)
    log = ET.SubElement(root, "log", mode="roll-by-size")
    ET.SubElement(log, "sizeThreshold").text = "10240"  # KB
    ET.SubElement(log, "keepFiles").text = "8"
    ET.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
