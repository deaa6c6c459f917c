"""From a recording to parameters and a verdict: identified, kept, validated, and told what to try where it does not fit."""

from __future__ import annotations

import hashlib
import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import faults

LAG = {
    "name": "lag to be found",
    "parameters": {"k": {"value": 1.5}, "tau": {"value": 0.1, "unit": "s"}},
    "blocks": {
        "u": {"kind": "input"},
        "plant": {"kind": "transfer_function", "numerator": ["=k"], "denominator": ["=tau", 1]},
    },
    "connections": [{"from": "u", "to": "plant"}],
    "outputs": {"y": "plant"},
}
RATE, GAIN, TAU = 500.0, 2.0, 0.05


def send(client, name: str, channels: dict[str, tuple[str, np.ndarray]], rate: float) -> str:
    """Keep samples as a recording, and return its id."""
    described = [{"name": key, "unit": unit} for key, (unit, _) in channels.items()]
    request = {"name": name, "format": "raw", "sample_rate": rate, "channels": described}
    dataset = client.post("/v1/datasets", json=request).json()["id"]
    content = np.column_stack([values for _, values in channels.values()]).astype("<f8").tobytes()
    digest = hashlib.sha256(content).hexdigest()
    headers = {"Content-Type": "application/octet-stream"}
    client.put(f"/v1/datasets/{dataset}/segments/{digest}", content=content, headers=headers).raise_for_status()
    body = {"segments": [digest], "sha256": digest}
    client.post(f"/v1/datasets/{dataset}/commit", json=body).raise_for_status()
    return str(dataset)


def of_a_lag(samples: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """A noisy command held between samples, and the exact answer of GAIN/(TAU s + 1) with 1 % noise."""
    noise = np.random.default_rng(4)
    # Straight lines between corners, of which the answer in closed form is known: u = a + b t over each step.
    u = np.repeat(noise.standard_normal(samples // 20), 20)
    y = np.full(samples, GAIN * u[0])  # at rest under its first value
    step, decay = 1 / RATE, np.exp(-1 / RATE / TAU)
    for i in range(1, samples):
        a, b = u[i - 1], (u[i] - u[i - 1]) / step
        forced_0, forced_1 = a - b * TAU, a + b * step - b * TAU
        y[i] = GAIN * forced_1 + (y[i - 1] - GAIN * forced_0) * decay
    return u, y + 0.01 * noise.standard_normal(samples)


@pytest.fixture(scope="module")
def system(client) -> str:
    return str(client.post("/v1/systems", json=LAG).json()["id"])


@pytest.fixture(scope="module")
def recording(client) -> str:
    u, y = of_a_lag()
    return send(client, "lag on the bench", {"u": ("", u), "y": ("", y)}, RATE)


def test_a_model_fails_is_identified_and_passes(page: Page, client, system, recording) -> None:
    page.goto("/validate")
    page.get_by_role("combobox", name="System").fill("lag to be found")
    page.get_by_role("option", name="lag to be found").click()
    page.get_by_role("combobox", name="Recording").fill("lag on")
    page.get_by_role("option", name="lag on the bench").click()
    # Channels of the same name are taken for the signals.
    expect(page.get_by_role("combobox", name="Channel of y")).to_have_value("y")
    expect(page).to_have_url(re.compile(r"in\.u=u.*out\.y=y"))
    assert faults(page) == []
    page.get_by_role("button", name="Validate").click()
    page.wait_for_url("**/jobs/job_*")
    expect(page.get_by_text("Not passed: a relative error above 10 %")).to_be_visible()
    expect(page.get_by_test_id("diagnosis").get_by_role("row").filter(has_text="tau")).to_be_visible()
    expect(page.get_by_role("region", name="y", exact=True).locator("[role=img] svg")).to_have_count(5)
    assert faults(page) == []

    page.goto(f"/identify?system={system}&dataset={recording}&p=k,tau")
    expect(page.get_by_test_id("sought").get_by_role("row")).to_have_count(3)
    page.get_by_role("textbox", name="At most, tau").fill("-1 kg")
    page.get_by_role("textbox", name="At most, tau").press("Enter")
    page.get_by_role("button", name="Find the values").click()
    expect(page.get_by_test_id("sought").get_by_role("row").filter(has_text="tau")).to_contain_text("kg")
    assert faults(page) == []
    page.get_by_role("textbox", name="At most, tau").fill("1")
    page.get_by_role("textbox", name="At most, tau").press("Enter")
    page.get_by_role("button", name="What will it take?").click()
    expect(page.get_by_test_id("expected")).to_contain_text(re.compile(r"About \d+ simulations, [\d.]+ s on one core"))
    assert faults(page) == []
    page.get_by_role("button", name="Find the values").click()
    page.wait_for_url("**/jobs/job_*")
    job = page.url.rsplit("/", 1)[1]
    row = page.get_by_test_id("identified").get_by_role("row").filter(has_text="tau")
    expect(row).to_be_visible()
    lower, upper = (float(text) for text in row.get_by_role("cell").nth(2).inner_text().split(" … "))
    assert lower < TAU < upper
    expect(page.get_by_test_id("correlation")).to_be_visible()
    expect(page.get_by_test_id("effort")).to_contain_text("Expected were about")
    expect(page.get_by_test_id("fits")).to_contain_text("where it was not")
    assert faults(page) == []
    page.get_by_role("button", name="Save as revision").click()
    expect(page.get_by_text("Kept as revision 2.")).to_be_visible()
    kept = client.get(f"/v1/systems/{system}").json()["document"]["parameters"]["k"]["value"]
    assert (kept["value"] if isinstance(kept, dict) else kept) == pytest.approx(GAIN, rel=0.02)

    page.get_by_role("link", name="Validate").click()
    page.get_by_role("combobox", name="Recording").fill("lag on")
    page.get_by_role("option", name="lag on the bench").click()
    page.get_by_role("button", name="Validate").click()
    page.wait_for_url(lambda url: "/jobs/" in url and not url.endswith(job))
    expect(page.get_by_text(re.compile("^Passed"))).to_be_visible()


def test_a_recording_is_processed_and_a_model_made_of_it_alone(page: Page, client, system, recording) -> None:
    page.goto(f"/datasets/{recording}")
    page.get_by_role("link", name="Process").click()
    page.get_by_role("textbox", name="Name of the new").fill("cut and filtered")
    page.get_by_role("button", name="Cut", exact=True).click()
    page.get_by_role("textbox", name="From").fill("1")
    page.get_by_role("textbox", name="From").press("Tab")
    page.get_by_role("button", name="Filter", exact=True).click()
    page.get_by_role("button", name="Make the recording").click()
    # What must be said and is not is told at its field, and so is what the service finds wrong.
    expect(page.get_by_test_id("step").nth(1)).to_contain_text("must not be empty")
    page.get_by_role("combobox", name="Band").select_option("low_pass")
    page.get_by_role("textbox", name="Edge").fill("900 Hz")
    page.get_by_role("textbox", name="Edge").press("Tab")
    page.get_by_role("button", name="Make the recording").click()
    expect(page.get_by_test_id("step").nth(1)).to_contain_text("must be < 1570.8 rad/s")
    assert faults(page) == []
    page.get_by_role("textbox", name="Edge").fill("100 Hz")
    page.get_by_role("textbox", name="Edge").press("Tab")
    page.get_by_role("button", name="Make the recording").click()
    page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
    made = page.url.rsplit("/", 1)[1]
    expect(page.get_by_text("2500 samples")).to_be_visible()
    steps = client.get(f"/v1/datasets/{made}").json()["processing"]["steps"]
    assert [step["kind"] for step in steps] == ["cut", "filter"]

    page.get_by_role("link", name="Identify").click()
    # Several recordings at once: the second is one more experiment.
    page.get_by_role("combobox", name="System").fill("lag to be found")
    page.get_by_role("option", name="lag to be found").click()
    page.get_by_role("button", name="Add a recording").click()
    page.get_by_test_id("further").get_by_role("combobox", name="Recording").fill("lag on")
    page.get_by_role("option", name="lag on the bench").click()
    expect(page.get_by_test_id("further").get_by_role("combobox", name="Channel of y")).to_have_value("y")
    expect(page).to_have_url(re.compile("more="))
    page.get_by_role("button", name="Find the values").click()
    page.wait_for_url("**/jobs/job_*")
    asked = client.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}/request").json()
    assert [experiment["dataset"] for experiment in asked["experiments"]] == [made, recording]

    page.goto(f"/identify?dataset={recording}&method=transfer_function")
    page.get_by_role("combobox", name="Inputs", exact=True).fill("u")
    page.get_by_role("option", name="u", exact=True).click()
    page.get_by_role("combobox", name="Outputs").fill("y")
    page.get_by_role("option", name="y", exact=True).click()
    page.get_by_role("textbox", name="Orders").fill("1; 2")
    page.get_by_role("textbox", name="Orders").press("Tab")
    assert faults(page) == []
    page.get_by_role("button", name="Find the values").click()
    page.wait_for_url("**/jobs/job_*")
    expect(page.get_by_role("button", name="Keep the model as a system")).to_be_visible()
