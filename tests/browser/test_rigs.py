"""Rigs: their channels and calibrations, a measurement from a template on a simulated rig, watched live; a lost one tried again."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

from agent.process import Agent
from agent.settings import read
from rig_simulator.grpc_server import Server
from tests.browser.driving import KEY, Running, faults
from tests.integration.agent.lab import MEASUREMENT, RIG, make_bench

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
    with closing(Server(make_bench(speed=1.0))) as server:
        given = {
            "service.url": service.url,
            "daq.server": f"127.0.0.1:{server.port}",
            "spool.folder": str(folder / "spool"),
        }
        agent = Agent(read(file, {"SERVOTUNE_AGENT_KEY": KEY}, given), name="lab PC", confirm=lambda _: answers.pop(0))
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
    answers.append(True)
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_role("button", name="Start it").click()
    page.wait_for_url("**/acquisitions/acq_*")
    expect(page.get_by_role("img", name="position over time")).to_be_visible(timeout=60_000)
    expect(page.get_by_role("link", name="Recording").first).to_be_visible(timeout=60_000)
    assert faults(page) == []
    page.get_by_role("link", name="Recording").first.click()
    expect(page.get_by_role("img", name="loopback over time")).to_be_visible()


def test_what_a_person_at_the_rig_refuses_is_told_and_tried_again(page: Page, rig, client, answers) -> None:
    answers += [False, True]
    request = MEASUREMENT | {"rig": RIG_NAME, "name": "refused", "confirm": True, "duration": 0.2}
    made = client.post("/v1/acquisitions", json=request).json()
    page.goto(f"/acquisitions/{made['id']}")
    expect(page.get_by_text("the person at the rig has not agreed")).to_be_visible(timeout=60_000)
    page.get_by_role("button", name="Try again").click()
    page.get_by_role("button", name="I have looked: measure again").click()
    expect(page.get_by_role("heading", name="Attempt 2")).to_be_visible()
    expect(page.get_by_role("link", name="Recording").first).to_be_visible(timeout=60_000)
