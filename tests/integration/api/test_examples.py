"""The example scripts run against a service as their pages say."""

from __future__ import annotations

import re
import sys

from examples import many_loops, step_response
from tests.integration.api.conftest import Service


def test_step_response(sqlite_service: Service, monkeypatch, capsys) -> None:
    command = ["step_response.py", "--url", sqlite_service.url, "--key", sqlite_service.keys["run"]]
    monkeypatch.setattr(sys, "argv", command)
    assert step_response.main() == 0
    said = capsys.readouterr().out
    assert said.count("kp = ") == 3
    assert "The strongest lever: " in said


def test_many_loops(sqlite_service: Service, tmp_path, capsys) -> None:
    figure = tmp_path / "many-loops.png"
    key = sqlite_service.keys["run"]
    assert many_loops.main(["--url", sqlite_service.url, "--key", key, "--figure", str(figure)]) == 0
    said = capsys.readouterr().out
    for name in many_loops.LOOPS:
        (row,) = re.findall(rf"^{name} +(\d+) rad/s +([\d.]+) °", said, flags=re.MULTILINE)
        assert float(row[1]) > 45, name
    assert re.search(r"without notch .* unstable", said)
    assert len(re.findall(r"^ *with(?:out)? ", said, flags=re.MULTILINE)) == 2 * len(many_loops.CORRECTIONS)
    # Following at 0.1 m/s without feed-forward costs v/kp = 8.33 mm.
    assert re.search(r"^nothing .* 8\.33 mm", said, flags=re.MULTILINE)
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_an_example_says_in_one_line_that_no_service_answers(capsys) -> None:
    assert many_loops.main(["--url", "http://127.0.0.1:1", "--key", "none"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
