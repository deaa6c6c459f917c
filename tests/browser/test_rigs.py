"""Rigs: their channels and calibrations, a measurement from a template on a simulated rig, watched live; a lost one tried again."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

from agent.process import Agent
from agent.settings_file import read
from rig_simulator.grpc_server import Server
from storage import open_database
from storage.models import AcquisitionAttempt
from storage.models import Agent as AgentRow
from storage.models.base import utc_now
from tests.browser.driving import KEY, Running, faults
from tests.integration.agent.lab import MEASUREMENT, RIG, make_bench
from tests.integration.api.rigs import AGENT

RIG_NAME = "bench of the pages"


@pytest.fixture(scope="module")
def answers() -> list[bool]:
    """What the person at the rig says, one after the other."""
    return []


@pytest.fixture(scope="module")
def rig(service: Running, client: httpx.Client, tmp_path_factory, answers) -> Iterator[str]:
    """A simulated rig with its agent; its id."""
    folder: Path = tmp_path_factory.mktemp("rig")
    file = folder / "agent.toml"
    due = '[inputs.calibration]\ndue = "2021-01-01"'
    patient = RIG.replace("deadline = 1.0", "deadline = 30.0")  # beside other tests
    file.write_text(patient.format(rig=RIG_NAME).replace("[inputs.calibration]", due))
    with closing(Server(make_bench(speed=1.0, noise=1e-3))) as server:
        given = {
            "service.url": service.url,
            "daq.server": f"127.0.0.1:{server.port}",
            "spool.folder": str(folder / "spool"),
        }
        agent = Agent(read(file, {"SERVOTUNE_AGENT_KEY": KEY}, given), name="lab PC", confirm=lambda *_: answers.pop(0))
        thread = threading.Thread(target=agent.run, daemon=True)
        thread.start()
        try:
            yield _known(client)
        finally:
            agent.stop()
            thread.join(60)
            assert not thread.is_alive()


def _known(client: httpx.Client) -> str:
    for _ in range(600):
        for found in client.get("/v1/rigs").json()["items"]:
            if found["name"] == RIG_NAME:
                return str(found["id"])
        threading.Event().wait(0.1)
    raise AssertionError("the agent did not report within 60 s")


def test_a_measurement_is_started_from_a_template_and_watched(page: Page, rig, client, answers) -> None:
    client.post("/v1/acquisition-templates", json=MEASUREMENT | {"rig": RIG_NAME, "name": "sine", "duration": 2})
    page.goto("/rigs")
    expect(page.get_by_test_id("agents")).to_contain_text("lab PC")
    page.get_by_role("link", name=f"Open {RIG_NAME}").click()
    expect(page.get_by_test_id("inputs").get_by_role("row").filter(has_text="position")).to_contain_text("overdue")
    expect(page.get_by_test_id("outputs")).to_contain_text("±4 V")
    channel = page.get_by_test_id("hardware").get_by_role("listitem").filter(has_text="cDAQ1Mod1/ai1")
    expect(channel.last.get_by_role("img", name="fits", exact=True)).to_be_visible()
    expect(page.get_by_test_id("hardware")).to_contain_text("simulated, its inputs are made-up signals")
    first_day = page.get_by_test_id("first-day").get_by_role("listitem")
    for line, state in (
        ("The hardware answers", "done"),
        ("The devices are", "to be looked at"),
        ("Every input", "done"),
    ):
        expect(first_day.filter(has_text=line).get_by_role("img", name=state, exact=True)).to_be_visible()
    expect(first_day.filter(has_text="Calibrations are")).to_contain_text("position: have the sensor calibrated")
    expect(first_day.filter(has_text="A first recording").get_by_role("img", name="not done yet")).to_be_visible()
    assert faults(page) == []
    page.get_by_role("link", name="Use sine").click()
    amplitude = page.get_by_role("textbox", name="Amplitude")
    expect(amplitude).to_have_value("2 V")
    amplitude.fill("400")
    page.get_by_role("checkbox", name="A person at the rig").check()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_role("button", name="Start it").click()
    # The limits of the output are the agent's; the service tells them at the field.
    expect(page.locator(".mantine-NumberInput-error")).to_be_visible()
    assert faults(page) == []
    amplitude.fill("2")
    page.get_by_role("checkbox", name="Keep what valve is told to play").check()
    answers.append(True)
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_role("button", name="Start it").click()
    page.wait_for_url("**/acquisitions/acq_*")
    expect(page.get_by_role("img", name="position over time")).to_be_visible()
    expect(page.get_by_role("link", name="Recording").first).to_be_visible()
    assert faults(page) == []
    page.get_by_role("link", name="Recording").first.click()
    for channel in ("loopback", "valve"):
        expect(page.get_by_role("img", name=f"{channel} over time")).to_be_visible()
    page.goto(f"/rigs/{rig}")
    expect(first_day.filter(has_text="A first recording").get_by_role("img", name="done", exact=True)).to_be_visible()


def test_what_a_person_at_the_rig_refuses_is_told_and_tried_again(page: Page, rig, client, answers) -> None:
    answers += [False, True]
    request = MEASUREMENT | {"rig": RIG_NAME, "name": "refused", "confirm": True, "duration": 0.2}
    made = client.post("/v1/acquisitions", json=request).json()
    page.goto(f"/acquisitions/{made['id']}")
    expect(page.get_by_text("the person at the rig has not agreed")).to_be_visible()
    page.get_by_role("button", name="Try again").click()
    page.get_by_role("button", name="I have looked: measure again").click()
    expect(page.get_by_role("heading", name="Attempt 2")).to_be_visible()
    expect(page.get_by_role("link", name="Recording").first).to_be_visible()


def test_what_is_filled_in_outlives_a_reload_and_becomes_a_template(page: Page, rig) -> None:
    page.goto(f"/rigs/{rig}/measure")
    page.get_by_role("textbox", name="Duration").fill("-3")
    page.get_by_role("textbox", name="Repetitions").fill("2000")
    page.get_by_role("checkbox", name="loopback").uncheck()
    page.get_by_role("checkbox", name="position").uncheck()
    # What is wrong is told where it stands, with the rule and with what was entered; nothing is sent.
    page.get_by_role("button", name="Start", exact=True).click()
    for told in ("must not be empty", "must be greater than 0, got -3", "must be at most 1000, got 2000"):
        expect(page.get_by_text(told)).to_be_visible()
    expect(page.get_by_text("at least one channel")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill("slow sine")
    page.get_by_role("textbox", name="Duration").fill("0.4")
    page.get_by_role("textbox", name="Repetitions").fill("2")
    page.get_by_role("checkbox", name="position").check()
    page.get_by_role("combobox", name="Drive").select_option("valve")
    page.get_by_role("combobox", name="Signal").select_option("sine")
    page.get_by_role("textbox", name="Frequency").fill("")
    page.get_by_role("button", name="Keep as template").click()
    expect(page.get_by_text("must be a number", exact=True)).to_be_visible()
    # A field that is not shown any more holds nothing back, and comes back as it was left.
    page.get_by_role("combobox", name="Signal").select_option("step")
    page.get_by_role("button", name="Keep as template").click()
    expect(page.get_by_text("Kept as template “slow sine”.")).to_be_visible()
    expect(page).to_have_url(re.compile("duration=0.4.*averages=2.*output=valve"))
    page.reload()
    expect(page.get_by_role("textbox", name="Name")).to_have_value("slow sine")
    expect(page.get_by_role("checkbox", name="loopback")).not_to_be_checked()
    expect(page.get_by_role("combobox", name="Drive")).to_have_value("valve")
    page.get_by_role("link", name="Back").click()
    page.get_by_role("link", name="Use slow sine").click()
    expect(page.get_by_role("textbox", name="Repetitions")).to_have_value("2")
    expect(page.get_by_role("textbox", name="Duration")).to_have_value("0.4 s")
    expect(page.get_by_role("checkbox", name="loopback")).not_to_be_checked()
    # Only what differs from the template stands in the address.
    assert page.url.split("?")[1].startswith("template=")
    assert "&" not in page.url


def test_a_recording_waits_for_its_trigger(page: Page, rig, client) -> None:
    page.goto(f"/rigs/{rig}/measure")
    page.get_by_role("textbox", name="Name").fill("stays away")
    page.get_by_role("checkbox", name="A person at the rig").uncheck()
    page.get_by_role("combobox", name="Trigger", exact=True).select_option("leaves a window")
    page.get_by_role("combobox", name="Channel of the trigger").select_option("position")
    low = page.get_by_role("textbox", name="Window from")
    low.fill("3")
    expect(low).to_have_value("3 mm")
    page.get_by_role("textbox", name="Window to").fill("2")
    page.get_by_role("textbox", name="Hysteresis").fill("-1")
    page.get_by_role("button", name="Start", exact=True).click()
    expect(page.get_by_text("must be 0 or more, got -1")).to_be_visible()
    page.get_by_role("textbox", name="Hysteresis").fill("0.1")
    page.get_by_role("button", name="Start", exact=True).click()
    # What only the service can tell stands at its field, too.
    expect(page.get_by_text("window must be [low, high] with low < high, got [3, 2] mm")).to_be_visible()
    assert faults(page) == []
    page.get_by_role("combobox", name="Trigger", exact=True).select_option("rises to a level")
    level = page.get_by_role("textbox", name="Level")
    expect(level).to_have_value("3 mm")
    expect(page).to_have_url(re.compile("trigger=rising"))
    page.reload()
    expect(level).to_have_value("3 mm")
    page.get_by_role("textbox", name="Waits at most").fill("600")
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_url("**/acquisitions/acq_*")
    expect(page.get_by_text("Waits for the trigger.")).to_be_visible()
    expect(page.get_by_role("img", name="position over time")).to_be_visible()
    asked = client.get(f"/v1/acquisitions/{page.url.rsplit('/', 1)[1]}").json()["document"]["trigger"]
    assert asked == {"channel": "position", "edge": "rising", "level": 3, "hysteresis": 0.1, "timeout": 600}
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_role("button", name="Try again")).to_be_visible()


def test_a_measurement_is_stopped_from_its_page(page: Page, rig, client) -> None:
    request = MEASUREMENT | {"rig": RIG_NAME, "name": "too long", "confirm": False, "duration": 90}
    made = client.post("/v1/acquisitions", json=request).json()
    page.goto(f"/acquisitions/{made['id']}")
    expect(page.get_by_test_id("live")).to_be_visible()
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_role("button", name="Try again")).to_be_visible()
    expect(page.get_by_role("heading", name="Attempt 1")).to_be_visible()
    assert client.get(f"/v1/acquisitions/{made['id']}").json()["status"] == "cancelled"


def _silent(service: Running, attempt: str) -> None:
    """Let the last word of an attempt's agent lie further back than a lease."""
    database = open_database(f"sqlite:///{service.folder / 'service.db'}")
    with database.session() as session:
        row = session.query(AcquisitionAttempt).filter_by(acquisition_id=attempt).one()
        row.lease_until = utc_now() - timedelta(seconds=1)
        session.get_one(AgentRow, row.agent_id).seen_at = utc_now() - timedelta(seconds=60)
    database.dispose()


def test_an_agent_that_is_lost_and_comes_back_is_shown(page: Page, service, client) -> None:
    registered = AGENT | {"rig": "silent bench", "name": "PC that sleeps"}
    agent = client.post("/v1/agents", json=registered).json()["id"]
    made = client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": "silent bench", "name": "unheard"}).json()
    assert client.post(f"/v1/agents/{agent}/claim").status_code == 200
    page.goto(f"/acquisitions/{made['id']}")
    expect(page.get_by_text("The agent has it.")).to_be_visible()
    _silent(service, made["id"])
    expect(page.get_by_text("The agent was not heard of any more")).to_be_visible()
    page.get_by_role("button", name="Try again").click()
    # It may have moved, or still be moving: a person has to look first.
    expect(page.get_by_role("dialog")).to_contain_text("Look at the rig before you say yes")
    page.get_by_role("button", name="Not now").click()
    page.goto("/rigs")
    row = page.get_by_test_id("agents").get_by_role("row").filter(has_text="PC that sleeps")
    expect(row).to_contain_text("not heard of")
    page.get_by_role("link", name="Open silent bench").click()
    expect(page.get_by_role("heading", name="silent bench", level=1)).to_be_visible()
    page.get_by_role("link", name="Measure", exact=True).click()
    expect(page.get_by_text("No agent answers for this rig now")).to_be_visible()
    assert client.post("/v1/agents", json=registered).json()["id"] == agent
    page.go_back()
    expect(page.get_by_text("ready", exact=True)).to_be_visible()


def test_sweeps_are_shown_live_and_lead_back_to_the_form(page: Page, rig, client) -> None:
    page.goto(f"/rigs/{rig}/measure?channels=%5B%22loopback%22%5D&duration=0.3&output=valve&averages=2")
    page.get_by_role("button", name="Show live, record nothing").click()
    page.wait_for_url("**/acquisitions/acq_*")
    expect(page.get_by_role("img", name="loopback over time")).to_be_visible()
    expect(page.get_by_text("nothing is recorded")).to_be_visible()
    expect(page.get_by_test_id("live")).to_have_attribute("data-samples", re.compile(r"^\d{3}$"))
    assert faults(page) == []
    page.get_by_role("button", name="Stop").click()
    expect(page.get_by_role("button", name="Stop")).to_be_hidden()
    page.get_by_role("link", name="Record, or change").click()
    expect(page.get_by_role("textbox", name="Name")).to_have_value("Live")
    expect(page.get_by_role("textbox", name="Duration")).to_have_value("0.3 s")
    expect(page.get_by_role("checkbox", name="position")).not_to_be_checked()


def test_each_sweep_of_the_scope_begins_at_its_trigger(page: Page, rig, client) -> None:
    page.goto(f"/rigs/{rig}/measure?channels=%5B%22position%22%5D&duration=0.3&pre_trigger=0.1&name=scope")
    # Noise of some micrometres goes through zero again and again.
    page.get_by_role("combobox", name="Trigger", exact=True).select_option("rises to a level")
    page.get_by_role("button", name="Show live, record nothing").click()
    page.wait_for_url("**/acquisitions/acq_*")
    expect(page.get_by_test_id("live")).to_have_attribute("data-samples", re.compile(r"^\d{3}$"))
    asked = client.get(f"/v1/acquisitions/{page.url.rsplit('/', 1)[1]}").json()["document"]
    assert (asked["record"], asked["trigger"]["edge"], asked["pre_trigger"]) == (False, "rising", 0.1)
    page.get_by_role("button", name="Stop").click()
    expect(page.get_by_role("button", name="Stop")).to_be_hidden()


def test_a_channel_that_did_not_fit_is_told_in_the_form(page: Page, client) -> None:
    told = {"what": "input position", "told": "range must be at most 5, got 10", "remedy": "correct this entry"}
    document = AGENT["document"] | {"findings": [told | {"result": "fails"}]}
    made = client.post("/v1/agents", json=AGENT | {"rig": "misfits", "instance": "misfits-0001", "document": document})
    page.goto(f"/rigs/{made.json()['rig_id']}/measure")
    sentence = page.get_by_text("range must be at most 5, got 10 – correct this entry")
    expect(sentence).to_be_visible()
    assert faults(page) == []
    page.get_by_role("checkbox", name="position").uncheck()
    expect(sentence).to_be_hidden()
