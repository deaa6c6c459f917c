"""The study of the programmed delay runs against a service with a worker, and finds what theory says."""

from __future__ import annotations

import re

import pytest

from examples import programmed_delay
from tests.integration.api.conftest import Service


@pytest.fixture(scope="module")
def service(sqlite_service: Service) -> Service:
    """One kind of database is enough for an example; the worker of the other tests works on its database."""
    return sqlite_service


def test_programmed_delay(service: Service, worker: None, tmp_path, capsys) -> None:
    figure = tmp_path / "programmed-delay.png"
    arguments = ["--url", service.url, "--key", service.keys["run"], "--figure", str(figure)]
    assert programmed_delay.main(arguments) == 0
    said = capsys.readouterr().out
    for name in programmed_delay.MOVEMENTS:
        (row,) = re.findall(rf"^ *{name}: .* a delay of ([\d.]+) ms: ([\d.]+) %", said, flags=re.MULTILINE)
        assert float(row[1]) < 2
    (found,) = re.findall(r"Best delay ([\d.]+) ms \(half a damped period is ([\d.]+) ms\)", said)
    assert abs(float(found[0]) / float(found[1]) - 1) < 0.02
    left = {
        name: float(value)
        for name, value in re.findall(
            r"^(trapezoid|programmed delay|shaped, \w+) +([\d.e-]+) mm", said, flags=re.MULTILINE
        )
    }
    assert len(left) == 5
    assert left["programmed delay"] < 0.05 * left["trapezoid"]
    assert left["shaped, ZVD"] < 0.05 * left["trapezoid"]
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_it_says_in_one_line_that_no_service_answers(capsys) -> None:
    assert programmed_delay.main(["--url", "http://127.0.0.1:1", "--key", "none"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
