"""Recordings: import with a preview, an upload that is interrupted and resumed, plots, a spectrum; keys; the page about the service."""

from __future__ import annotations

import io
import math
import re
from contextlib import closing

import h5py
import numpy as np
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from playwright.sync_api import Browser, Page, Route, expect

from tests.browser.driving import faults


def recording(rows: int) -> str:
    """A sine of 5 Hz and amplitude 2, sampled 1000 times a second, with decimal commas."""
    lines = ["Recorded on the test bench", "Time [s];Position [mm];Force (N)"]
    for i in range(rows):
        values = (i / 1000, 2 * math.sin(2 * math.pi * 5 * i / 1000), 0.5)
        lines.append(";".join(f"{value:.6f}".replace(".", ",") for value in values))
    return "\n".join(lines) + "\n"


def responses(lines: int) -> str:
    """A resonance at 12 Hz with 3 % of damping and its coherence, as a modal analyser exports them."""
    rows = ["Frequency [Hz];Re(tip/hammer) [mm/N];Im(tip/hammer) [mm/N];Coherence tip/hammer"]
    for i in range(lines):
        s = 2j * math.pi * (0.5 + 0.1 * i)
        value = 1 / (s**2 + 2 * 0.03 * 75.4 * s + 75.4**2)
        rows.append(f"{0.5 + 0.1 * i:.1f};{value.real:.9e};{value.imag:.9e};0.98")
    return "\n".join(rows) + "\n"


def test_a_file_of_frequency_responses_is_shown_and_has_modes(page: Page, tmp_path) -> None:
    file = tmp_path / "hammer.csv"
    file.write_text(responses(400))
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    # There is nothing to be mapped: what the file holds is shown, and taken whole.
    table = page.get_by_test_id("function-table")
    expect(table.get_by_role("row").filter(has_text="frequency response")).to_contain_text("400")
    expect(table.get_by_role("row").filter(has_text="frequency response")).to_contain_text("mm / N")
    expect(page.get_by_text("Frequency rises and is a frequency (Hz)")).to_be_visible()
    assert faults(page) == []
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_role("heading", name="Functions of frequency")).to_be_visible()
    expect(page.get_by_role("img", name="Magnitude")).to_be_visible()
    expect(page.get_by_role("img", name="Phase")).to_be_visible()
    assert faults(page) == []
    page.get_by_label("Drawn").select_option("tip over hammer, coherence")
    expect(page.get_by_role("img", name="Coherence")).to_be_visible()
    page.reload()
    expect(page.get_by_label("Drawn")).to_have_value("tip over hammer, coherence")
    page.get_by_role("link", name="Frequency response").click()
    expect(page.get_by_role("combobox", name="Input")).to_have_value("hammer")
    page.get_by_label("Natural frequencies").check()
    page.get_by_role("button", name="Estimate").click()
    expect(page.get_by_test_id("modes").get_by_role("row").nth(1)).to_contain_text("75.4")
    expect(page.get_by_text("As the file has them")).to_be_visible()
    assert faults(page) == []


def two_rates() -> bytes:
    """A force at 1000 samples/s, and a temperature and a switch at 10 samples/s."""
    target = io.BytesIO()
    with TdmsWriter(target) as writer:
        writer.write_segment(
            [
                ChannelObject(
                    "fast", "force", np.sin(np.arange(1000) / 50), {"wf_increment": 1e-3, "unit_string": "N"}
                ),
                ChannelObject(
                    "slow", "temperature", 20 + np.arange(77) / 10, {"wf_increment": 0.1, "unit_string": "degC"}
                ),
                ChannelObject("slow", "switch", np.arange(77) % 2, {"wf_increment": 0.1}),
            ]
        )
    return target.getvalue()


def test_groups_of_a_file_are_taken_by_their_boxes(page: Page, tmp_path, client) -> None:
    file = tmp_path / "rates.tdms"
    file.write_bytes(two_rates())
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    groups = page.get_by_test_id("import-groups")
    expect(groups).to_contain_text("1 of 1 channel, 1000 samples, 1000 a second")
    expect(groups).to_contain_text("2 of 2 channels, 77 samples, 10 a second")
    assert faults(page) == []
    take = page.get_by_role("checkbox", name="Take temperature")
    groups.get_by_role("checkbox", name="slow").uncheck()
    expect(take).not_to_be_checked()
    groups.get_by_role("checkbox", name="slow").check()
    expect(take).to_be_checked()
    page.get_by_role("checkbox", name="Take switch").uncheck()
    expect(groups).to_contain_text("1 of 2 channels")
    page.get_by_label("Name of column 2").fill("oil")
    expect(page).to_have_url(re.compile("1.name=oil"))  # what was changed stands in the address
    page.reload()
    expect(groups).to_contain_text("1 of 2 channels")
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    groups = page.get_by_role("navigation", name="Groups of the file")
    expect(groups).to_contain_text("fast")
    expect(page.get_by_text("1000 samples")).to_be_visible()
    assert faults(page) == []
    first = client.get(f"/v1/datasets/{page.url.rsplit('/', 1)[1]}").json()
    assert [(one["name"], one["sample_rate"], one["channels"]) for one in first["groups"]] == [
        ("fast", 1000, ["force"]),
        ("slow", 10, ["oil"]),
    ]
    groups.get_by_role("link", name="slow").click()
    expect(page.get_by_role("heading", name="rates: slow")).to_be_visible()
    expect(page.get_by_role("img", name="oil over time")).to_be_visible()


def test_uneven_instants_are_resampled_where_that_is_chosen(page: Page, tmp_path, client) -> None:
    times = np.cumsum(np.random.default_rng(5).uniform(0.6, 1.4, size=300)) / 100
    file = tmp_path / "uneven.csv"
    file.write_text("time [s],x [mm]\n" + "".join(f"{t:.6f},{math.sin(t):.6f}\n" for t in times))
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    expect(page.get_by_text("300 samples at uneven instants")).to_be_visible()
    page.get_by_label("Uneven instants").select_option("resample")
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.get_by_label("Resampled to")).to_have_attribute("aria-invalid", "true")
    page.get_by_label("Resampled to").fill("200")
    page.get_by_label("Between them").select_option("cubic")
    assert faults(page) == []
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    where = f"/v1/datasets/{page.url.rsplit('/', 1)[1]}"
    expect(page.get_by_role("img", name="x over time")).to_be_visible()
    made = client.get(where).json()
    assert (made["status"], made["sample_rate"], made["uneven"]) == ("ready", 200, False)


def test_a_text_file_is_understood_imported_and_looked_at(page: Page, tmp_path, client) -> None:
    file = tmp_path / "bench run.csv"
    file.write_text(recording(4000))
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    # A worker has found layout, instants, names and units.
    expect(page.get_by_role("textbox", name="Unit of column 2")).to_have_value("mm")
    expect(page.get_by_role("combobox", name="Between columns")).to_have_value(";")
    expect(page.get_by_role("combobox", name="Instants in")).to_have_value("0")
    assert faults(page) == []
    page.get_by_role("textbox", name="Unit of column 3").fill("furlongs per fortnight squared ((")
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.get_by_role("row").filter(has_text="Force")).to_contain_text("unit")
    page.get_by_role("textbox", name="Unit of column 3").fill("kN")
    page.get_by_role("textbox", name="Scale of column 3").fill("0")
    page.get_by_role("textbox", name="Name of column 2").fill("")
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.get_by_text("must not be 0, got 0")).to_be_visible()
    expect(page.get_by_text("must not be empty")).to_be_visible()
    page.get_by_role("textbox", name="Name of column 2").fill("position")
    page.get_by_role("textbox", name="Scale of column 3").fill("2")
    page.get_by_role("textbox", name="Scale of column 3").blur()
    # The address holds what was changed in the proposal.
    page.reload()
    expect(page.get_by_role("textbox", name="Unit of column 3")).to_have_value("kN")
    expect(page.get_by_role("textbox", name="Scale of column 3")).to_have_value("2")
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_text("4000 samples")).to_be_visible()
    expect(page.get_by_role("heading", name="Spectrum of position")).to_be_visible()
    expect(page.get_by_role("img", name="position over time")).to_be_visible()
    assert faults(page) == []
    page.get_by_role("button", name="Zoom in").click()
    expect(page.get_by_label("From")).to_have_value("1.333")
    page.get_by_label("From").fill("3.5")
    page.get_by_label("From").press("Enter")
    expect(page.get_by_text("must lie between 0 and 2.666 s, got 3.5 s")).to_be_visible()
    page.get_by_role("button", name="Whole recording").click()
    expect(page.get_by_label("From")).to_have_value("0")
    # Curves of the stretch before stand until those of this one have come.
    expect(page.locator("[aria-busy=true]")).to_have_count(0)
    with page.expect_download() as table:
        page.get_by_role("button", name="Export Spectrum of position").click()
        page.get_by_role("menuitem", name="Table").click()
    rows = [line.split(",") for line in table.value.path().read_text().splitlines()[1:]]
    peak = max((row for row in rows if row[1]), key=lambda row: float(row[1]))
    # 5 Hz and 2 mm, on lines as far apart as the recording is short; Hann's window shows at least 85 % between two lines.
    assert float(peak[0]) == pytest.approx(2 * math.pi * 5, abs=2 * math.pi * 0.8)
    assert 0.84 * 2 <= float(peak[1]) * (1e3 if float(peak[1]) < 0.01 else 1) <= 2.01
    # A stretch that is marked in one plot is looked at in all of them, with its own samples, and stands in the address.
    plot = page.get_by_role("img", name="position over time").locator(".u-over")
    plot.scroll_into_view_if_needed()
    over = plot.bounding_box()
    assert over is not None
    y = over["y"] + over["height"] / 2
    page.mouse.move(over["x"] + 0.25 * over["width"], y)
    page.mouse.down()
    page.mouse.move(over["x"] + 0.5 * over["width"], y, steps=4)
    page.mouse.up()
    expect(page).to_have_url(re.compile(r"[?&]from=.*&to="))
    marked = dict(part.split("=") for part in page.url.split("?")[1].split("&"))
    start, end = float(marked["from"]), float(marked["to"])
    assert start == pytest.approx(1.0, abs=0.1)
    assert end == pytest.approx(2.0, abs=0.1)
    page.get_by_role("combobox", name="Drawn").click()
    page.get_by_role("listbox", name="Drawn").get_by_role("option", name="Force").click()
    expect(page.get_by_role("img", name="force over time")).to_have_count(0)
    page.reload()
    expect(page.get_by_label("From")).to_have_value(marked["from"])
    with page.expect_download() as table:
        page.get_by_role("button", name="Export position").click()
        page.get_by_role("menuitem", name="Table").click()
    instants = [float(line.split(",")[0]) for line in table.value.path().read_text().splitlines()[1:]]
    assert start - 0.002 <= instants[0] < instants[-1] <= end + 0.002
    assert len(instants) == pytest.approx((end - start) * 1000, abs=2)  # every sample of it
    expect(page.get_by_role("img", name="force over time")).to_have_count(0)


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
    expect(row).to_be_visible()
    row.get_by_role("checkbox").check()
    if page.get_by_role("checkbox", name="Take t", exact=True).is_checked():
        page.get_by_role("checkbox", name="Take t", exact=True).uncheck()
    page.get_by_role("combobox", name="Instants in").select_option(label="t")
    row.get_by_role("textbox", name=re.compile("^Name of column")).fill("push")
    row.get_by_role("textbox", name=re.compile("^Unit of column")).fill("kN")
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_text("2000 samples, 500 a second")).to_be_visible()
    expect(page.get_by_role("img", name="push over time in kN")).to_be_visible()


def test_an_upload_that_breaks_off_goes_on_where_it_was(page: Page, tmp_path, client) -> None:
    file = tmp_path / "long.csv"
    file.write_text(recording(180_000))  # two segments
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if request.method == "PUT" else None)
    held: list[Route] = []

    def cut(route: Route) -> None:
        """Let the first piece through, keep the second one waiting, and lose the third, which is the second again."""
        count = sum(request == route.request.url for request in sent)
        if len(sent) == 1:
            route.continue_()
        elif count == 1:
            held.append(route)
        else:
            route.abort()

    page.route("**/segments/*", cut)
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    with page.expect_request(lambda request: request.method == "PUT" and len(sent) == 2):
        page.get_by_role("button", name="Send").click()
    bar = page.get_by_role("progressbar", name="Sent")
    expect(bar).to_have_attribute("aria-valuenow", re.compile(r"^[5-9]\d"))
    page.get_by_role("button", name="Stop").click()
    expect(page.get_by_text("was interrupted")).to_be_visible()
    expect(bar).to_have_count(0)
    assert len(held) == 1
    page.get_by_role("button", name="Go on").click()
    expect(page.get_by_role("alert")).to_contain_text("the connection was lost")
    assert len(sent) == 3
    page.unroute("**/segments/*")
    page.reload()
    sent.clear()
    page.locator("input[type=file]").set_input_files(file)
    expect(page.get_by_text("was interrupted")).to_be_visible()
    page.get_by_role("button", name="Go on").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    assert len(sent) == 1
    page.get_by_role("button", name="Import", exact=True).click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    expect(page.get_by_text("180000 samples")).to_be_visible()


def test_the_list_is_searched_by_name(page: Page, client) -> None:
    for name in ("chirp of the morning", "chirp of the evening"):
        client.post("/v1/datasets", json={"name": name, "format": "csv"}).raise_for_status()
    # Of pages of one recording each only the newest has been loaded: it is the service that searches.
    page.route(
        "**/v1/datasets?*", lambda route: route.continue_(url=re.sub(r"limit=\d+", "limit=1", route.request.url))
    )
    page.goto("/datasets")
    listed = page.get_by_test_id("datasets").get_by_role("link")
    expect(listed).to_have_text(["chirp of the evening"])
    page.get_by_role("searchbox", name="Search").fill("Chirp of the m")
    expect(listed).to_have_text(["chirp of the morning"])
    expect(page).to_have_url(re.compile(r"\?q=Chirp"))
    page.get_by_role("searchbox", name="Search").fill("nothing of the kind")
    expect(page.get_by_text("No recording is called “nothing of the kind”.")).to_be_visible()
    assert faults(page) == []


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


def test_a_key_that_may_only_read_is_told_so(browser: Browser, page: Page, service) -> None:
    page.goto("/access")
    page.get_by_role("textbox", name="Name").fill("display in the hall")
    for scope in ("write", "compute", "acquire"):
        box = page.get_by_role("checkbox", name=scope, exact=True)
        if box.is_checked():
            box.uncheck()
    page.get_by_role("button", name="Make a key").click()
    key = page.get_by_test_id("new-key").inner_text()
    with closing(browser.new_context(base_url=service.url)) as hall:
        reader = hall.new_page()
        reader.goto("/access")
        reader.get_by_test_id("key").fill(key)
        reader.locator("button[type=submit]").click()
        expect(reader.get_by_text("This page needs an admin key")).to_be_visible()
        reader.goto("/datasets")
        reader.locator("input[type=file]").set_input_files(
            {"name": "run.csv", "mimeType": "text/csv", "buffer": b"t,x\n0,1\n1,2\n"}
        )
        reader.get_by_role("button", name="Send").click()
        expect(reader.get_by_role("alert")).to_contain_text("write")


def test_a_file_that_is_not_what_it_is_called_is_refused_with_its_reason(page: Page) -> None:
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(
        {"name": "rig.mat", "mimeType": "application/octet-stream", "buffer": b"\x89PNG\r\n\x1a\n" + bytes(5000)}
    )
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    expect(page.get_by_role("alert")).to_contain_text("MATLAB")
    assert faults(page) == []
    page.get_by_role("link", name="Send it as another format").click()
    page.wait_for_url("**/datasets")


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
    page.goto("/docs/api")
    page.locator("[id=operations-tag-schedules], .opblock-tag-section").first.wait_for()
    assert [url for url in asked if not url.startswith((service.url, "data:"))] == []
