"""The `servotune` command: which commands it finds, and what it says when one cannot run."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint, PackageNotFoundError
from pathlib import Path

import pytest

from servotune import main

GROUP = main.GROUP
ROOT = Path(__file__).parents[3]


def echo(arguments: list[str]) -> int:
    """Say what it was given.

    Not shown in the overview.
    """
    sys.stdout.write(" ".join(arguments))
    return 7


def needing(_: list[str]) -> int:
    """Ask for an optional package while it runs."""
    raise ModuleNotFoundError(name="nidaqmx.constants")


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, EntryPoint]]:
    """Three installed commands: one that runs, two whose optional package is absent, from the start and later."""
    points = {
        "echo": EntryPoint("echo", f"{__name__}:echo", GROUP),
        "needing": EntryPoint("needing", f"{__name__}:needing", GROUP),
        "broken": EntryPoint("broken", "a_package_that_nobody_has.commands:run", GROUP),
    }
    monkeypatch.setattr(main, "entry_points", lambda *, group: tuple(points.values()) if group == GROUP else ())
    # A process asks once, and another test of this one may have asked already.
    vars(main.servotune).pop("_points", None)
    yield points
    vars(main.servotune).pop("_points", None)


def test_a_command_gets_its_arguments_and_gives_its_exit_code(installed, capsys):
    assert main.main(["echo", "--port", "8000"]) == 7
    assert capsys.readouterr().out == "--port 8000"


def test_help_lists_the_commands_in_one_line_each(installed, capsys):
    assert main.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert "  echo     Say what it was given.\n" in out
    assert "Not shown" not in out
    assert "a_package_that_nobody_has" in out


def test_an_unknown_command_is_answered_with_the_known_ones(installed, capsys):
    assert main.main(["serv"]) == 2
    assert "'serv'; the commands are: broken, echo, needing" in capsys.readouterr().err


def test_a_missing_package_is_named_with_the_cure(installed, capsys):
    assert main.main(["broken"]) == 3
    assert capsys.readouterr().err == (
        "servotune broken: needs the Python package 'a_package_that_nobody_has', which is not installed: "
        "pip install a_package_that_nobody_has\n"
    )


def test_the_cure_names_the_extra_that_brings_the_package(installed, capsys, monkeypatch: pytest.MonkeyPatch):
    needs = {
        "servotune": ["httpx>=0.28", 'matplotlib>=3 ; extra == "notebook"'],
        "servotune-agent": ["servotune==0.1.0", "nidaqmx[grpc]>=1.1; extra == 'nidaqmx'"],
    }

    def requires(name: str) -> list[str]:
        if name not in needs:
            raise PackageNotFoundError(name)
        return needs[name]

    monkeypatch.setattr(main, "requires", requires)
    assert main._missing(ModuleNotFoundError(name="matplotlib.figure")).endswith("pip install 'servotune[notebook]'")
    assert main._cure("nidaqmx") == main._cure("grpc") == "pip install 'servotune-agent[nidaqmx]'"
    assert main._cure("httpx") == "pip install --force-reinstall servotune"
    assert main._cure("fastapi") == "pip install fastapi"
    assert main.main(["needing"]) == 3
    assert capsys.readouterr().err.endswith("pip install 'servotune-agent[nidaqmx]'\n")


def test_a_command_of_another_distribution_is_told_with_its_name(installed, capsys):
    assert main.main(["serve", "--port", "8000"]) == 2
    assert "'serve' comes with another package: pip install servotune-server" in capsys.readouterr().err


def test_the_client_needs_nothing_of_the_server():
    # A lab PC has the base install only: importing the client must not touch the server's rooms or packages.
    script = (
        "import sys, servotune, servotune.main\n"
        "foreign = {'engine', 'optimizers', 'storage', 'api', 'fastapi', 'pydantic', 'sqlalchemy', 'numpy', 'matplotlib'}\n"
        "print(sorted(foreign & {name.partition('.')[0] for name in sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
