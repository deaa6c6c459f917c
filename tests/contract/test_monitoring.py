"""The dashboard and the alert rules ask for numbers that the service tells, and the rules fire as their own tests say."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from api.telemetry.metrics import Metrics
from storage import open_database

FOLDER = Path(__file__).parents[2] / "deploy" / "monitoring"
RULES: list[dict[str, Any]] = yaml.safe_load((FOLDER / "alerts.yml").read_text())["groups"][0]["rules"]
PANELS: list[dict[str, Any]] = json.loads((FOLDER / "grafana-dashboard.json").read_text())["panels"]
ASKED = [rule["expr"] for rule in RULES] + [target["expr"] for panel in PANELS for target in panel["targets"]]
OF_PROMETHEUS = {"up"}
"""Numbers that Prometheus has of everything that it asks."""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Names of the series that a service has."""
    database = open_database(f"sqlite:///{tmp_path_factory.mktemp('metrics') / 'service.db'}")
    database.migrate()
    metrics = Metrics()
    metrics.read_from(database)
    text = metrics.text().decode()
    database.dispose()
    found = set()
    for name, kind in re.findall(r"^# TYPE (\S+) (\S+)$", text, flags=re.MULTILINE):
        found |= {f"{name}_{part}" for part in ("bucket", "sum", "count")} if kind == "histogram" else {name}
    return found


@pytest.mark.parametrize("expression", ASKED)
def test_numbers_that_are_asked_for_are_told(expression: str, told: set[str]) -> None:
    names = set(re.findall(r"\b(?:servotune|process)_\w+|\bup\b", expression))
    assert names
    assert names <= told | OF_PROMETHEUS


def test_every_number_of_ours_is_on_the_dashboard(told: set[str]) -> None:
    shown = " ".join(target["expr"] for panel in PANELS for target in panel["targets"])
    ours = {re.sub(r"_(sum|count|bucket|created)$", "", name) for name in told if name.startswith("servotune_")}
    assert {name for name in ours if name not in shown} == set()


def test_panels_have_names_and_places_of_their_own() -> None:
    assert len({panel["id"] for panel in PANELS}) == len({panel["title"] for panel in PANELS}) == len(PANELS)
    taken: set[tuple[int, int]] = set()
    for panel in PANELS:
        x, y, w, h = (panel["gridPos"][key] for key in "xywh")
        cells = {(x + i, y + j) for i in range(w) for j in range(h)}
        assert x + w <= 24
        assert not taken & cells, panel["title"]
        taken |= cells


def test_every_alert_is_explained() -> None:
    page = (FOLDER.parents[1] / "docs" / "operations.md").read_text()
    for rule in RULES:
        assert f"`{rule['alert']}`" in page


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool must be installed (Debian: prometheus)")
def test_rules_fire_as_their_own_tests_say() -> None:
    done = subprocess.run(
        ["promtool", "test", "rules", "alerts-test.yml"], cwd=FOLDER, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
