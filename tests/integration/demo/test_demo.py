"""The demonstration reaches its bars, and its report says what the service said: change the recording, and the report changes."""

from __future__ import annotations

import copy
import math
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from examples.demo import report, tuning
from examples.demo.analysing import metric
from examples.demo.findings import Understanding
from examples.demo.units import measured, signed
from tests.integration.demo.conftest import LATER, Demonstration, Understood

ROOT = Path(__file__).parents[3]


def test_the_command_ends_well_and_says_what_to_try_next(original: Demonstration):
    assert original.code == 0
    letters = [line[0] for line in original.said.splitlines() if re.match("[a-h]  ", line)]
    assert letters == list("abcdefgh")
    assert "make serve" in original.said
    assert "curl" in original.said
    assert "examples/step_response.py" in original.said
    assert len(original.page) > 100_000


def test_a_step_that_fails_ends_the_demonstration_with_one_sentence(tmp_path: Path):
    broken = tmp_path / "0A.txt"
    broken.write_text("Header Size:  7\n" * 7 + "1, now, not a number, 0, 0\n")
    command = [sys.executable, "-m", "examples.demo", "--recording", str(broken), "--workdir", str(tmp_path / "work")]
    command += ["--report", str(tmp_path / "report.html")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("The demonstration stopped at step a (recording): ")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "report.html").exists()


def test_each_half_is_predicted_from_the_other_as_well_as_it_must_be(original: Demonstration):
    # The bars of the issue; the published model and "output = command" are the ones of examples/data/.../SOURCE.md.
    fits = {check.half.name: check.reply["outputs"]["measured"] for check in original.findings.checks}
    assert fits["first"]["fit_percent"] >= 95.0
    assert fits["second"]["fit_percent"] >= 91.0
    for check in original.findings.checks:
        assert check.reply["verdict"] == "pass"
        assert check.reply["outputs"]["measured"]["baselines"]["input"]["fit_percent"] < 50.0


def test_identification_and_validation_tell_the_same_fit(original: Demonstration):
    for check in original.findings.checks:
        assert check.reply["outputs"]["measured"]["fit_percent"] == pytest.approx(check.estimate.other_fit, abs=1e-6)


def test_every_optimum_holds_its_limits_in_every_scenario(original: Demonstration):
    findings = original.findings
    for key, behaviour in findings.tuned.items():
        for index in range(len(findings.scenarios)):
            for name, limit in findings.limits.items():
                value = metric(behaviour, name, index)["value"]
                assert value <= limit * (1 + 1e-6), (key, index, name)


def test_the_tuned_laws_are_better_than_the_proportional_one(original: Demonstration):
    findings = original.findings
    count = range(len(findings.scenarios))
    for law in ("PID", "PD2"):
        fast, strong = (findings.tuned[f"{law} {aim}"] for aim in tuning.AIMS)
        before = max(metric(findings.start, "response_time", i)["value"] for i in count)
        assert max(metric(fast, "response_time", i)["value"] for i in count) < before / 2
        before = min(metric(findings.start, "max_acceleration", i)["value"] for i in count)
        assert min(metric(strong, "max_acceleration", i)["value"] for i in count) > 2 * before


def test_grid_and_gradient_agree(original: Demonstration):
    # The grid is coarse: it may miss the optimum by one of its cells, the gradient may not be worse than the grid.
    for law, aim in original.findings.aims:
        grid, gradient = (original.findings.search(law, aim, method).reached for method in ("grid", "gradient"))
        sign = 1 if aim == "response_time" else -1
        assert sign * gradient <= sign * grid * (1 + sign * 1e-3), (law, aim)
        assert abs(grid - gradient) <= 0.1 * gradient, (law, aim)


def test_a_later_measurement_is_found_as_a_longer_delay(original: Demonstration, changed: Understood):
    def lateness(understood: Understanding) -> list[float]:
        return [
            estimate.scenario["valve.time_constant"] + estimate.scenario[f"{estimate.place}.time"]
            for estimate in understood.estimates
            if estimate.place == "recording"
        ]

    # Behind the loop the delay is visible by itself: it grows by just what the recording was shifted.
    for before, after in zip(lateness(original.findings), lateness(changed.found), strict=True):
        assert after - before == pytest.approx(LATER * 1e-3, abs=0.3e-3)


def test_a_later_measurement_changes_what_is_said_and_shown(
    original: Demonstration, changed: Understood, tmp_path: Path
):
    # Identification, validation, starting point, influence: each step tells other numbers.
    for letter in "bcde":
        before, after = (set(_said(text, letter)) for text in (original.said, changed.said))
        assert len(before - after) > 0.4 * len(before), letter
    # And so does the page, although the searches that it shows are the same.
    report.write(replace(original.findings, **vars(changed.found)), tmp_path / "report.html")
    before = set(_numbers(original.page))
    after = set(_numbers((tmp_path / "report.html").read_text(encoding="utf-8")))
    assert len(before - after) > 0.5 * len(before)


def test_the_numbers_of_the_report_are_those_of_the_replies(original: Demonstration):
    findings, text = original.findings, " ".join(_Text.of(original.page))
    for estimate in findings.estimates:
        assert f"{estimate.other_fit:.2f} %" in text
    for check in findings.checks:
        assert f"{check.published['outputs']['measured']['fit_percent']:.2f} %".replace("-", "\N{MINUS SIGN}") in text
    for search in findings.searches:
        assert measured(search.aim, search.reply["goals"][0]["after"]) in text
    for row in findings.influence["elasticities"].values():
        for entry in row.values():
            if entry["value"] is not None:
                assert signed(entry["value"]) in text


@pytest.mark.parametrize("part", ["estimates", "checks", "start", "influence", "searches"])
def test_no_number_is_written_by_hand(original: Demonstration, tmp_path: Path, part: str):
    # Double every number of one kind of reply: what the report shows of it must change.
    findings = original.findings
    changed = replace(findings, **{part: _doubled(getattr(findings, part))})
    if part == "estimates":
        changed = replace(changed, scenarios=changed.estimates[: len(findings.scenarios)])
    report.write(changed, tmp_path / "report.html")
    assert _numbers((tmp_path / "report.html").read_text(encoding="utf-8")) != _numbers(original.page)


def test_the_report_needs_no_network(original: Demonstration):
    page = _References()
    page.feed(original.page)
    assert page.references
    outside = [reference for reference in page.references if not reference.startswith(("#", "data:"))]
    assert outside == []
    assert "<script" not in original.page
    assert "@import" not in original.page
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", original.page))


def _doubled(value):
    """Return a copy with every float doubled, wherever it sits."""
    if isinstance(value, float):
        return 2.0 * value if math.isfinite(value) else value
    if isinstance(value, dict):
        return {
            key: item if key in ("axes", "curves", "map", "worst_interval") else _doubled(item)
            for key, item in value.items()
        }
    if isinstance(value, list | tuple):
        return type(value)(_doubled(item) for item in value)
    if hasattr(value, "reply"):
        return replace(value, reply=_doubled(value.reply))
    if hasattr(value, "steps"):
        return replace(value, steps=_doubled(value.steps), loops=_doubled(value.loops))
    return copy.copy(value)


class _Text(HTMLParser):
    """Collects the visible text of a page, without its figures and styles."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._hidden = 0

    @classmethod
    def of(cls, page: str) -> list[str]:
        parser = cls()
        parser.feed(page)
        return parser.parts

    def handle_starttag(self, tag, attrs):
        self._hidden += tag in ("svg", "style")

    def handle_endtag(self, tag):
        self._hidden -= tag in ("svg", "style")

    def handle_data(self, data):
        if not self._hidden and data.strip():
            self.parts.append(data.strip())


class _References(HTMLParser):
    """Collects whatever a browser would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.references: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ("src", "href", "xlink:href", "srcset") and value]


def _numbers(page: str) -> list[str]:
    return [number for part in _Text.of(page) for number in re.findall(r"[+\N{MINUS SIGN}]?\d+\.\d+", part)]


def _said(text: str, letter: str) -> list[str]:
    """Return the numbers of one step on the terminal."""
    step = re.search(rf"^{letter}  .*?(?=^[a-z]  |\Z)", text, flags=re.DOTALL | re.MULTILINE)
    assert step, text
    return re.findall(r"[+-]?\d+\.\d+", step[0])
