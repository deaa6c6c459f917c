"""Designs side by side: chosen in the lists, in one table with closed forms, their curves laid over each other, by an address."""

from __future__ import annotations

import csv
import math
import re

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.places import ended, made
from tests.browser.soundness import faults_of_both_themes
from tests.browser.test_matching import LAG as FOUND
from tests.browser.test_matching import send

LAG = FOUND | {"name": "lag to be compared"}


@pytest.fixture(scope="module")
def lag(client: httpx.Client) -> str:
    """A lag of 0.1 s, and of 0.2 s in its second revision."""
    system = made(client, "/v1/systems", LAG)
    slower = {**LAG, "parameters": {**LAG["parameters"], "tau": {"value": 0.2, "unit": "s"}}}
    client.put(f"/v1/systems/{system}", json=slower, headers={"If-Match": '"1"'}).raise_for_status()
    return system


@pytest.fixture(scope="module")
def optimum(client: httpx.Client, lag: str) -> str:
    """The quickest of two time constants, 0.05 s."""
    asked = {
        "system": lag,
        "variables": [{"parameter": "tau", "lower": 0.05, "upper": 0.4}],
        "experiments": [{"name": "step", "input": {"port": "u", "signal": {"kind": "step"}}}],
        "goals": [{"metric": "rise_time", "experiment": "step", "output": "y", "sense": "minimize"}],
        "method": {"kind": "grid", "points": 2},
    }
    return made(client, "/v1/optimizations", asked)


def test_revisions_and_an_optimum_stand_side_by_side(page: Page, client: httpx.Client, lag: str, optimum: str) -> None:
    ended(client, f"/v1/jobs/{optimum}")
    page.goto(f"/systems/{lag}/revisions")
    page.get_by_role("checkbox", name="Choose revision 1").check()
    page.get_by_role("checkbox", name="Choose revision 2").check()
    page.get_by_role("link", name="Compare 2 designs").click()
    expect(page).to_have_url(re.compile(rf"/compare\?d={lag}%401&d={lag}%402$"))
    page.goto(f"{page.url}&d={optimum}&out=y")
    page.locator("[data-testid=plots][data-frame]").wait_for()
    with page.expect_download() as download:
        page.get_by_role("button", name="Table (CSV)").click()
    head, *rows = csv.reader(download.value.path().read_text().splitlines())
    found = {
        name: [float(cell) for cell in cells if cell]
        for name, _, *cells in rows
        if name in {"rise_time", "tau", "bandwidth"}
    }
    assert [label.split(", ")[1].split(" of ")[0] for label in head[2:]] == ["revision 1", "revision 2", "optimum"]
    # Of k/(tau s + 1): 10 to 90 % in tau ln 9; 3 dB below the static gain at sqrt(10^0.3 - 1)/tau.
    assert found["tau"] == [0.1, 0.2, pytest.approx(0.05, rel=1e-6)]
    assert found["rise_time"] == pytest.approx([tau * math.log(9) for tau in found["tau"]], rel=1e-9)
    assert found["bandwidth"] == pytest.approx([math.sqrt(10**0.3 - 1) / tau for tau in found["tau"]], rel=1e-6)
    # What is the same everywhere is no row, and no margin is where no loop is opened.
    assert not {row[0] for row in rows} & {"k", "phase_margin"}
    # The table is there before the curves of all three, and what is exported is what is shown.
    page.locator("[data-drawn='ok,ok,ok']").wait_for()
    page.get_by_role("button", name="Export y").click()
    with page.expect_download() as curves:
        page.get_by_role("menuitem", name="Table").click()
    columns, *lines = csv.reader(curves.value.path().read_text().splitlines())
    assert len(columns) == 6
    values = np.array(lines, dtype=float)
    for place, tau in enumerate(found["tau"]):
        time, y = values[:, 2 * place], values[:, 2 * place + 1]
        assert np.allclose(y, 1.5 * (1 - np.exp(-time / tau)), atol=1e-6)
    assert faults_of_both_themes(page, "light") == []
    page.get_by_role("button", name=re.compile("^Take .*optimum")).click()
    expect(page).to_have_url(re.compile(rf"/compare\?(?!.*{optimum})"))


def test_the_page_of_a_search_leads_to_a_comparison_and_so_does_the_list_of_jobs(
    page: Page, client: httpx.Client, lag: str, optimum: str
) -> None:
    ended(client, f"/v1/jobs/{optimum}")
    page.goto("/jobs?kind=optimization")
    page.get_by_role("checkbox", name=f"Choose {optimum}").check()
    page.get_by_role("link", name="Compare 1 design", exact=True).click()
    expect(page).to_have_url(re.compile(rf"/compare\?d={optimum}$"))
    page.goto(f"/jobs/{optimum}")
    page.get_by_role("link", name="Compare with revision 2").click()
    expect(page).to_have_url(re.compile(rf"/compare\?d={lag}%402&d={optimum}$"))
    expect(page.get_by_test_id("comparison").locator("thead a")).to_have_count(2)


def test_a_recording_lies_over_the_curves_and_another_design_is_added(
    page: Page, client: httpx.Client, lag: str
) -> None:
    time = np.arange(500) / 500
    bench = send(client, "step of the lag", {"y": ("", 1.5 * (1 - np.exp(-time / 0.1)))}, 500.0)
    page.goto(f"/compare?d={lag}@1&ds=y~{bench}~y~0~0&v=step:y")
    expect(page.get_by_test_id("recording")).to_have_text("y → y")
    expect(page.get_by_text(re.compile("y, measured"))).to_be_visible()
    # What it tells by itself stands beside the design: of 1.5 (1 - exp(-10 t)) to 0.998 s, in straight lines between samples.
    expect(page.get_by_test_id("comparison")).to_have_attribute("aria-busy", "false")
    with page.expect_download() as download:
        page.get_by_role("button", name="Table (CSV)").click()
    head, *rows = csv.reader(download.value.path().read_text().splitlines())
    assert head[-1] == "y, recorded"
    found = {name: cells for name, _, *cells in rows}
    end = 1 - math.exp(-9.98)
    assert float(found["rise_time"][1]) == pytest.approx(0.1 * math.log((1 - 0.1 * end) / (1 - 0.9 * end)), rel=1e-4)
    assert float(found["peak"][1]) == pytest.approx(1.5 * end, rel=1e-9)
    assert found["bandwidth"][1] == ""
    page.get_by_role("button", name="Add a design").click()
    page.get_by_role("combobox", name="System, optimum, model or recording").click()
    page.get_by_role("option", name=LAG["name"], exact=True).first.click()
    page.get_by_role("dialog").get_by_role("button", name="Add a design").click()
    expect(page.get_by_test_id("comparison").locator("thead a")).to_have_count(3)
    page.get_by_role("button", name="Take y, recorded out").click()
    expect(page.get_by_test_id("comparison").locator("thead a")).to_have_count(2)
    expect(page).not_to_have_url(re.compile(bench))


def test_an_identified_model_and_a_recording_are_compared(page: Page, client: httpx.Client, lag: str) -> None:
    time = np.arange(1000) / 500
    since = np.maximum(time - 0.5, 0)
    step = {"u": ("", (time >= 0.5).astype(float)), "y": ("", 1.5 * (1 - np.exp(-since / 0.15)))}
    bench = send(client, "lag with 150 ms", step, 500.0)
    asked = {
        "system": lag, "dataset": bench, "inputs": {"u": "u"}, "outputs": {"y": "y"},
        "parameters": [{"parameter": "tau", "lower": 0.01, "upper": 1}],
    }  # fmt: skip
    job = made(client, "/v1/identifications", asked)
    ended(client, f"/v1/jobs/{job}")
    page.goto(f"/jobs/{job}")
    page.get_by_role("link", name="Compare with revision 2").click()
    expect(page).to_have_url(re.compile(rf"/compare\?d={lag}%402&d={job}$"))
    with page.expect_download() as download:
        page.get_by_role("button", name="Table (CSV)").click()
    head, *rows = csv.reader(download.value.path().read_text().splitlines())
    assert [label.split(", ")[1].split(" of ")[0] for label in head[2:]] == ["revision 2", "model"]
    found = {name: [float(cell) for cell in cells if cell] for name, _, *cells in rows if name in {"rise_time", "tau"}}
    # The recording was made with 0.15 s; from 10 to 90 % a lag goes in tau ln 9.
    assert found["tau"] == [0.2, pytest.approx(0.15, rel=0.01)]
    assert found["rise_time"] == pytest.approx([tau * math.log(9) for tau in found["tau"]], rel=1e-9)
    page.get_by_role("button", name="Add a design").click()
    page.get_by_role("combobox", name="System, optimum, model or recording").fill("lag with 150")
    page.get_by_role("option", name="lag with 150 ms").click()
    page.get_by_label("Channel").select_option("y")
    assert faults_of_both_themes(page, "light") == []
    page.get_by_role("dialog").get_by_role("button", name="Overlay a recording").click()
    expect(page.get_by_test_id("recording")).to_have_text("y → y")
    expect(page.get_by_text(re.compile("y, measured"))).to_be_visible()
    page.goto("/compare")
    page.get_by_role("button", name="Add a design").click()
    page.get_by_role("combobox", name="System, optimum, model or recording").click()
    page.get_by_role("option", name=re.compile(rf"^{LAG['name']}, ")).last.click()
    page.get_by_role("dialog").get_by_role("button", name="Add a design").click()
    expect(page).to_have_url(re.compile(r"/compare\?d=job_"))


def test_a_design_beyond_the_first_page_of_the_list_is_found_by_its_name_and_by_going_on(
    page: Page, client: httpx.Client
) -> None:
    old = made(client, "/v1/systems", LAG | {"name": "the oldest of three"})
    for name in ("younger", "youngest"):
        made(client, "/v1/systems", LAG | {"name": name})
    # A page of one system: what a hundred others would do.
    page.route(
        "**/v1/systems?limit=100*", lambda route: route.continue_(url=route.request.url.replace("limit=100", "limit=1"))
    )
    page.goto("/compare")
    page.get_by_role("button", name="Add a design").click()
    field = page.get_by_role("combobox", name="System, optimum, model or recording")
    field.click()
    wanted = page.get_by_role("option", name="the oldest of three", exact=True)
    expect(page.get_by_role("option", name="youngest", exact=True)).to_be_visible()
    expect(wanted).to_have_count(0)
    field.fill("oldest of")
    wanted.click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Add a design").click()
    expect(page).to_have_url(re.compile(rf"/compare\?d={old}%401$"))
    page.get_by_role("button", name="Add a design").click()
    field.click()
    expect(page.get_by_role("option", name="youngest", exact=True)).to_be_visible()
    for name in ("younger", "the oldest of three"):
        dialog.get_by_role("button", name="Show more").click()
        expect(page.get_by_role("option", name=name, exact=True)).to_be_visible()


def test_what_cannot_be_compared_is_told(page: Page, lag: str) -> None:
    page.goto(f"/compare?d={lag}@1&d={lag}@99&d=job_nothing")
    expect(page.get_by_role("alert").filter(has_text="job_nothing")).to_be_visible()
    expect(page.get_by_role("alert").filter(has_text="99")).to_be_visible()
    expect(page.get_by_test_id("comparison").locator("thead a")).to_have_count(1)
    page.get_by_role("button", name="Take job_nothing out").click()
    expect(page).not_to_have_url(re.compile("job_nothing"))
