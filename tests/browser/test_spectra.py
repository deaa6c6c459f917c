"""Frequency responses with bounds, coherence and modes; where they come from; the way home as one file."""

from __future__ import annotations

import re
import zipfile

import numpy as np
import pytest
import scipy.signal
from playwright.sync_api import Page, expect

from tests.browser.driving import faults
from tests.browser.test_matching import send

RATE, NATURAL, DAMPING = 200.0, 60.0, 0.05


@pytest.fixture(scope="module")
def recording(client) -> str:
    """One mode, m = 1 kg, driven by noise: x/F = 1/(s^2 + 2 zeta w s + w^2), simulated by scipy."""
    noise = np.random.default_rng(7)
    force = noise.standard_normal(40_000)
    time = np.arange(force.size) / RATE
    system = scipy.signal.TransferFunction([1.0], [1.0, 2 * DAMPING * NATURAL, NATURAL**2])
    _, x, _ = scipy.signal.lsim(system, force, time)
    x = x + 1e-3 * np.std(x) * noise.standard_normal(x.size)
    return send(client, "hammer", {"force": ("N", force), "x": ("m", x)}, RATE)


@pytest.fixture(scope="module")
def model(client) -> str:
    mode = {"kind": "transfer_function", "numerator": [1], "denominator": [1, 2 * DAMPING * NATURAL, NATURAL**2]}
    document = {
        "name": "one mode",
        "blocks": {"f": {"kind": "input"}, "mode": mode},
        "connections": [{"from": "f", "to": "mode"}],
        "outputs": {"x": "mode"},
    }
    return str(client.post("/v1/systems", json=document).json()["id"])


def test_a_resonance_is_found_with_its_bounds(page: Page, client, recording, model) -> None:
    page.goto(f"/datasets/{recording}")
    page.get_by_role("link", name="Frequency response").click()
    page.get_by_role("button", name="Estimate").wait_for()
    assert faults(page) == []
    page.get_by_role("textbox", name="Confidence").fill("2")
    page.get_by_role("button", name="Estimate").click()
    expect(page.get_by_text("must lie between 0.5 and 1")).to_be_visible()
    page.get_by_role("textbox", name="Confidence").fill("0.95")
    page.get_by_role("textbox", name="Segment").fill("16")
    page.get_by_role("checkbox", name="Find natural frequencies").check()
    page.get_by_role("button", name="Estimate").click()
    expect(page).to_have_url(re.compile("segment=16.*modes=1"))
    row = page.get_by_test_id("modes").get_by_role("row").nth(1)
    expect(row).to_be_visible()
    found, _, interval = (row.get_by_role("cell").nth(i).inner_text() for i in range(3))
    assert float(found) == pytest.approx(NATURAL, rel=0.01)
    lower, upper = (float(text) for text in interval.split(" … "))
    assert lower < float(found) < upper
    expect(page.get_by_test_id("frf").locator("[role=img] svg")).to_have_count(3)
    assert faults(page) == []
    # A model on the same lines, and how far it is from the measurement.
    page.get_by_role("combobox", name="Against a model").select_option(model)
    page.get_by_role("combobox", name="From").select_option("f")
    page.get_by_role("combobox", name="To", exact=True).select_option("x")
    page.get_by_role("button", name="Estimate").click()
    expect(page).to_have_url(re.compile(f"[&?]system={model}"))
    told = page.get_by_test_id("against-model")
    expect(told).to_be_visible()
    body = {"dataset": recording, "input": "force", "output": "x", "segment": 16, "window": "hann"}
    held = client.post("/v1/frfs", json=body | {"system": model, "from": "f", "to": "x"}).json()
    within = held["outputs"]["x"]["simulated"]["within_percent"]
    assert float(re.search(r"on ([0-9.]+) %", told.inner_text())[1]) == pytest.approx(within, rel=0.01)
    page.get_by_role("button", name="Keep for export").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="Universal file").click()
    # A delimiter, then the number of the kind of dataset.
    assert download.value.path().read_text().split()[:2] == ["-1", "58"]
    # What was kept has an address of its own, and what is said of it leads there.
    page.get_by_role("link", name="Open what was kept").click()
    page.wait_for_url("**/results/res_*")
    expect(page.get_by_test_id("frf").locator("[role=img] svg")).to_have_count(3)
    page.get_by_role("button", name="Comments", exact=True).click()
    page.get_by_label("Your comment").fill("the coupling is loose at 60 rad/s")
    page.keyboard.press("Control+Enter")
    expect(page.get_by_role("dialog", name="Comments").get_by_role("listitem")).to_have_count(1)
    kept = page.url.rsplit("/", 1)[1]
    for words, kind in (("coupling is loose", "comments"), (kept, "results")):
        page.goto("/about")
        page.get_by_test_id("checks").wait_for()
        page.keyboard.press("Control+k")
        expect(page.get_by_test_id("finder-state")).to_have_attribute("data-pending", "false")
        page.keyboard.type(words)
        page.get_by_test_id("found").locator(f"[data-kind={kind}]").click()
        page.wait_for_url(f"**/results/{kept}")


def test_a_spectrum_and_curves_that_are_kept_are_drawn(page: Page, client, recording, model) -> None:
    step = {"port": "f", "signal": {"kind": "step"}}
    for path, body, charts in (
        ("spectra", {"dataset": recording, "channel": "x"}, 1),
        ("simulations", {"system": model, "input": step}, 1),
        ("frequency-responses", {"system": model, "from": "f", "to": "x"}, 2),
    ):
        kept = client.post(f"/v1/{path}", json=body | {"keep": True}).json()["id"]
        page.goto(f"/results/{kept}")
        expect(page.get_by_test_id("kept").locator("[role=img] :is(svg, canvas)")).to_have_count(charts)
        assert faults(page) == []
    with page.expect_download() as download:
        page.get_by_role("link", name="Report, PDF").click()
    assert download.value.path().read_bytes().startswith(b"%PDF-")
    page.goto("/results/res_nothing")
    expect(page.get_by_role("alert")).to_contain_text("res_nothing")


def test_a_spectrum_is_kept_as_it_is_shown(page: Page, client, recording) -> None:
    page.goto(f"/datasets/{recording}?channel=x&quantity=density&segment=8&from=10&to=90")
    page.get_by_role("button", name="Keep", exact=True).click()
    page.get_by_role("link", name="Open what was kept").click()
    page.wait_for_url("**/results/res_*")
    expect(page.get_by_test_id("kept").locator("[role=img] canvas")).to_have_count(1)
    request = client.get(f"/v1/results/{page.url.rsplit('/', 1)[1]}").json()["request"]
    asked = {"dataset": recording, "channel": "x", "part": [10, 90], "quantity": "density", "segment": 8}
    assert {name: request[name] for name in asked} == asked
    # Another view is another spectrum, which is not kept yet.
    page.go_back()
    page.get_by_role("combobox", name="Shown").select_option("amplitude")
    expect(page.get_by_role("button", name="Keep", exact=True)).to_be_visible()


def test_a_result_leads_back_to_its_samples_and_leaves_as_one_file(page: Page, client, recording) -> None:
    body = {"dataset": recording, "input": "force", "output": "x", "keep": True}
    kept = client.post("/v1/frfs", json=body).json()["id"]
    page.goto(f"/lineage/{kept}?direction=up")
    expect(page.get_by_test_id("graph").locator(".react-flow__node")).to_have_count(2)
    expect(page.get_by_test_id("graph").locator(".react-flow__edge")).to_have_count(1)
    assert faults(page) == []
    with page.expect_download() as download:
        page.get_by_role("button", name="Export as one file").click()
    assert zipfile.is_zipfile(download.value.path())
    page.get_by_test_id("graph").get_by_role("link", name="hammer").click()
    page.wait_for_url(f"**/datasets/{recording}")
