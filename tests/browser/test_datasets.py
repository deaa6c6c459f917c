"""Recordings: import with a preview, an upload that is interrupted and resumed, plots, a spectrum; keys; the page about the service."""

from __future__ import annotations

import math
import re

import h5py
import numpy as np
import pytest
import scipy.io
from playwright.sync_api import Page, expect

from tests.browser.driving import faults


def recording(rows: int) -> str:
    """A sine of 5 Hz and amplitude 2, sampled 1000 times a second, with decimal commas."""
    lines = ["Recorded on the test bench", "Time [s];Position [mm];Force (N)"]
    for i in range(rows):
        values = (i / 1000, 2 * math.sin(2 * math.pi * 5 * i / 1000), 0.5)
        lines.append(";".join(f"{value:.6f}".replace(".", ",") for value in values))
    return "\n".join(lines) + "\n"


def test_a_text_file_is_understood_imported_and_looked_at(page: Page, tmp_path, client) -> None:
    file = tmp_path / "bench run.csv"
    file.write_text(recording(4000))
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    # A worker has found layout, instants, names and units.
    expect(page.get_by_role("textbox", name="Unit of column 2")).to_have_value("mm", timeout=90_000)
    expect(page.get_by_role("combobox", name="Between columns")).to_have_value(";")
    expect(page.get_by_role("combobox", name="Instants in")).to_have_value("0")
    assert faults(page) == []
    page.get_by_role("textbox", name="Unit of column 3").fill("furlongs per fortnight squared ((")
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.get_by_role("row").filter(has_text="Force")).to_contain_text("unit")
    page.get_by_role("textbox", name="Unit of column 3").fill("kN")
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_text("4000 samples")).to_be_visible(timeout=60_000)
    expect(page.get_by_role("heading", name="Spectrum of position")).to_be_visible()
    expect(page.get_by_role("img", name="position over time")).to_be_visible()
    assert faults(page) == []
    page.get_by_role("button", name="Zoom in").click()
    expect(page.get_by_label("From")).to_have_value("1.333")
    with page.expect_download() as table:
        page.get_by_role("button", name="Export Spectrum of position").click()
        page.get_by_role("menuitem", name="Table").click()
    rows = [line.split(",") for line in table.value.path().read_text().splitlines()[1:]]
    peak = max((row for row in rows if row[1]), key=lambda row: float(row[1]))
    # 5 Hz and 2 mm, on lines as far apart as the recording is short; Hann's window shows at least 85 % between two lines.
    assert float(peak[0]) == pytest.approx(2 * math.pi * 5, abs=2 * math.pi * 0.8)
    assert 0.84 * 2 <= float(peak[1]) * (1e3 if float(peak[1]) < 0.01 else 1) <= 2.01


@pytest.mark.parametrize("ending", ["mat", "h5"])
def test_a_file_of_its_own_format_is_mapped_too(page: Page, tmp_path, ending) -> None:
    file = tmp_path / f"rig.{ending}"
    time = np.arange(2000) / 500.0
    if ending == "mat":
        scipy.io.savemat(file, {"t": time, "force": np.sin(time), "junk": np.array([[1.0]])})
    else:
        with h5py.File(file, "w") as made:
            made["t"], made["force"] = time, np.sin(time)
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    row = (
        page.get_by_role("row")
        .filter(has_text="2000 samples")
        .filter(has=page.get_by_role("checkbox", name="Take force"))
    )
    expect(row).to_be_visible(timeout=90_000)
    row.get_by_role("checkbox").check()
    if page.get_by_role("checkbox", name="Take t", exact=True).is_checked():
        page.get_by_role("checkbox", name="Take t", exact=True).uncheck()
    page.get_by_role("combobox", name="Instants in").select_option(label="t")
    row.get_by_role("textbox", name=re.compile("^Name of column")).fill("push")
    row.get_by_role("textbox", name=re.compile("^Unit of column")).fill("kN")
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_text("2000 samples, 500 a second")).to_be_visible(timeout=90_000)
    expect(page.get_by_role("img", name="push over time in kN")).to_be_visible()


def test_an_upload_that_breaks_off_goes_on_where_it_was(page: Page, tmp_path, client) -> None:
    file = tmp_path / "long.csv"
    file.write_text(recording(180_000))  # two segments
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if request.method == "PUT" else None)
    broken = {"count": 0}

    def cut(route) -> None:
        broken["count"] += 1
        if broken["count"] == 2:
            route.abort()
        else:
            route.continue_()

    page.route("**/segments/*", cut)
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    expect(page.get_by_role("alert")).to_contain_text("the connection was lost")
    page.unroute("**/segments/*")
    page.reload()
    sent.clear()
    page.locator("input[type=file]").set_input_files(file)
    expect(page.get_by_text("was interrupted")).to_be_visible()
    page.get_by_role("button", name="Go on").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    assert len(sent) == 1
    page.get_by_role("button", name="Import", exact=True).click(timeout=90_000)
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_text("180000 samples")).to_be_visible(timeout=60_000)


def test_a_key_is_made_shown_once_used_and_revoked(page: Page, service) -> None:
    page.goto("/access")
    page.get_by_role("textbox", name="Name").fill("lab PC")
    page.get_by_role("button", name="Make a key").click()
    key = page.get_by_test_id("new-key").inner_text()
    with service.client() as client:
        client.headers["Authorization"] = f"Bearer {key}"
        assert client.get("/v1/systems").status_code == 200
        page.reload()
        expect(page.get_by_test_id("new-key")).to_have_count(0)
        # Replaced: the old key opens no more, the new one does.
        page.get_by_role("button", name="Rotate lab PC").click()
        page.get_by_role("textbox", name="The old one opens").fill("0")
        page.get_by_role("button", name="Make the new key").click()
        second = page.get_by_test_id("new-key").inner_text()
        assert client.get("/v1/systems").status_code == 401
        client.headers["Authorization"] = f"Bearer {second}"
        assert client.get("/v1/systems").status_code == 200
        page.get_by_role("button", name="Revoke lab PC").click()
        expect(page.get_by_role("button", name="Revoke lab PC")).to_have_count(0)
        assert client.get("/v1/systems").status_code == 401


def test_a_workspace_is_made_and_given_a_limit(page: Page, client) -> None:
    page.goto("/access")
    page.get_by_role("textbox", name="New workspace").fill("bench 3")
    page.get_by_role("button", name="Make a workspace").click()
    page.wait_for_url("**/access?workspace=ws_*")
    room = page.url.rsplit("=", 1)[1]
    limit = page.get_by_role("textbox", name="Limit: Stored bytes")
    limit.fill("-5")
    limit.press("Enter")
    page.get_by_role("button", name="Keep the limits").click()
    expect(page.get_by_test_id("quotas").get_by_role("row").filter(has_text="Stored bytes")).to_contain_text("0")
    limit.fill("5G")
    limit.press("Enter")
    page.get_by_role("button", name="Keep the limits").click()
    expect(page.get_by_test_id("quotas").get_by_role("row").filter(has_text="Stored bytes")).to_contain_text("5 GB")
    assert client.get(f"/v1/workspaces/{room}").json()["document"]["limits"] == {"stored_bytes": 5_000_000_000}
    assert faults(page) == []


def test_the_service_tells_how_it_is(page: Page) -> None:
    page.goto("/about")
    expect(page.get_by_test_id("checks").get_by_role("row").filter(has_text="Worker")).to_contain_text("ok")


def test_the_reference_comes_from_the_service_alone(page: Page, service) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto("/docs")
    page.locator("[id=operations-tag-schedules], .opblock-tag-section").first.wait_for()
    assert [url for url in asked if not url.startswith((service.url, "data:"))] == []
