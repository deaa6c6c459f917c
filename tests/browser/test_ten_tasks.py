"""The ten tasks of `examples/ten_tasks.py` on the pages: how many clicks each takes from sign-in, and how many seconds.

`pytest -s tests/browser/test_ten_tasks.py` prints the table. A click is a press of the mouse, or a choice in a list that the browser opens.
What is typed is none, but the click into its field is. Each task begins on the page that follows the sign-in.
"""

from __future__ import annotations

import csv
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

import servotune
from examples.ten_tasks import MOTOR, record
from tests.browser.drawing import draw
from tests.browser.driving import KEY, Running

MOST = 8
NAME = "Servo, Ogata example 5-2"
#: K. Ogata, Modern Control Engineering, 5th ed., example 5-2: a servo with velocity feedback.
FIGURE: dict[str, Any] = {
    "parameters": {"K": {"value": 5, "lower": 1, "upper": 12.5}, "Kh": {"value": 0.1, "lower": 0.01, "upper": 1}},
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "amplifier": {"kind": "gain", "gain": "=K"},
        "torque": {"kind": "sum", "signs": "+-"},
        "motor": {"kind": "transfer_function", "numerator": [1], "denominator": [1, 1]},
        "angle": {"kind": "integrator"},
        "tachometer": {"kind": "gain", "gain": "=Kh"},
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "error", "to": "amplifier"},
        {"from": "amplifier", "to": "torque.in1"},
        {"from": "torque", "to": "motor"},
        {"from": "motor", "to": "angle"},
        {"from": "motor", "to": "tachometer"},
        {"from": "tachometer", "to": "torque.in2"},
        {"from": "angle", "to": "error.in2"},
    ],
    "outputs": {"position": "angle"},
}
#: Counts what the mouse presses; kept over what loads the page anew.
_COUNT = """addEventListener("pointerdown", (event) => {
  if (event.isTrusted) sessionStorage.setItem("clicks", String(1 + Number(sessionStorage.getItem("clicks") ?? 0)));
}, true)"""


class Work:
    """The tasks in the order of a working day, each from the page that follows the sign-in to its result."""

    def __init__(self, page: Page, folder: Path) -> None:
        self.page, self.folder = page, folder

    def button(self, name: str, role: Any = "button") -> Locator:
        return self.page.get_by_role(role, name=name, exact=True)

    def view(self, name: str) -> None:
        """Open a view of the system that was drawn."""
        self.page.get_by_role("link", name=NAME, exact=True).first.click()
        self.page.get_by_role("navigation", name="Views of the system").get_by_role("link", name=name).click()

    def new_system(self) -> None:
        """New system from a textbook figure"""
        self.button("New system").click()
        self.page.wait_for_url("**/diagram")
        self.page.locator(".react-flow__node").first.wait_for()
        self.page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})
        self.page.keyboard.press("Control+a")
        self.page.keyboard.press("Delete")
        draw(self.page, FIGURE)
        self.page.get_by_label("Name", exact=True).click()
        self.page.keyboard.press("Control+a")
        self.page.keyboard.type(NAME)
        self.page.keyboard.press("Enter")
        self.page.keyboard.press("Control+s")
        expect(self.page.get_by_test_id("check")).to_have_text("saved")
        self.system = re.search(r"sys_\w+", self.page.url)[0]  # type: ignore[index] # it was waited for

    def tune(self) -> None:
        """Tune it"""
        self.view("Optimise")
        self.button("Start").click()
        self.page.wait_for_url("**/jobs/job_*")
        expect(self.page.get_by_test_id("optimum")).to_be_visible()
        self.search = self.page.url.rsplit("/", 1)[1]

    def compare(self) -> None:
        """Compare two designs"""
        self.button("Jobs", "link").click()
        self.page.get_by_test_id("jobs").get_by_role("link", name="Optimisation").first.click()
        self.page.get_by_role("link", name=re.compile("^Compare with revision")).click()
        expect(self.page.get_by_test_id("comparison").get_by_role("row").filter(has_text="overshoot")).to_be_visible()

    def identify(self) -> None:
        """Import a recording and identify the motor from it"""
        self.button("Datasets", "link").click()
        with self.page.expect_file_chooser() as chooser:
            self.page.get_by_role("button", name=re.compile("^(Choose|Import)")).first.click()
        chooser.value.set_files(self.folder / "run 1.csv")
        self.button("Send").click()
        self.page.wait_for_url("**/import**")
        self.button("Import").click()
        self.page.wait_for_url(re.compile(r"/datasets/ds_\w+$"))
        self.page.get_by_role("link", name="Identify").click()
        self.page.get_by_role("combobox", name="System").click()
        self.page.get_by_role("option", name="Motor", exact=True).click()
        self.button("Find the values").click()
        self.page.wait_for_url("**/jobs/job_*")
        expect(self.page.get_by_test_id("identified").get_by_role("row").filter(has_text="J")).to_be_visible()

    def validate(self) -> None:
        """Validate the model"""
        self.button("Jobs", "link").click()
        self.page.get_by_test_id("jobs").get_by_role("link", name="Identification").first.click()
        self.page.get_by_role("link", name="Validate").click()
        self.page.get_by_role("combobox", name="Recording").click()
        self.page.get_by_role("option", name="run 1").click()
        self.button("Validate").click()
        expect(self.page.get_by_text(re.compile("^Passed"))).to_be_visible()

    def limit(self) -> None:
        """Find what limits the bandwidth"""
        self.view("Influence")
        self.button("bandwidth").click()
        expect(self.page.get_by_test_id("tornado")).to_contain_text("K")

    def export(self) -> None:
        """Export the numbers"""
        self.page.get_by_role("link", name=NAME, exact=True).first.click()
        self.button("Export position").click()
        with self.page.expect_download() as table:
            self.page.get_by_role("menuitem", name="Table").click()
        head, *lines = csv.reader(table.value.path().read_text().splitlines())
        assert len(head) >= 2
        assert len(lines) == 1000

    def plot(self) -> None:
        """Plot them"""
        self.page.get_by_role("link", name=NAME, exact=True).first.click()
        self.button("Export position").click()
        with self.page.expect_download() as picture:
            self.button("Picture (PNG)", "menuitem").click()
        assert picture.value.path().read_bytes().startswith(b"\x89PNG")

    def nightly(self) -> None:
        """Schedule the search for every night"""
        self.view("Optimise")
        self.page.get_by_role("link", name=re.compile("^Run by a schedule")).click()
        self.page.wait_for_url("**/schedules/new**")
        self.page.get_by_role("textbox", name="Name", exact=True).click()
        self.page.keyboard.type("every night")
        self.button("Save").click()
        self.page.wait_for_url(re.compile(r"/schedules/sch_\w+$"))
        expect(self.page.get_by_test_id("next").get_by_role("listitem")).to_have_count(5)

    def last_week(self) -> None:
        """Find last week's result"""
        self.page.get_by_role("button", name=re.compile("^Search")).click()
        expect(self.page.get_by_test_id("finder-state")).to_have_attribute("data-pending", "false")
        self.page.keyboard.type(f"optimisation {NAME}")
        self.page.get_by_test_id("found").locator("[data-kind=optima]").first.click()
        self.page.wait_for_url(f"**/jobs/{self.search}")
        expect(self.page.get_by_test_id("optimum")).to_be_visible()


TASKS: tuple[Callable[[Work], None], ...] = (
    Work.new_system, Work.tune, Work.compare, Work.identify, Work.validate, Work.limit, Work.export, Work.plot, Work.nightly,
    Work.last_week,
)  # fmt: skip


@pytest.fixture
def work(page: Page, service: Running, tmp_path: Path) -> Work:
    with servotune.connect(service.url, key=KEY) as own:
        own.systems.create(MOTOR)
        record(own, tmp_path / "run 1.csv")
    page.add_init_script(_COUNT)
    return Work(page, tmp_path)


def test_ten_tasks_take_few_clicks(work: Work) -> None:
    counted: dict[str, int] = {}
    for task in TASKS:
        work.page.goto("/systems")
        work.page.get_by_role("heading", level=1).wait_for()
        work.page.evaluate("sessionStorage.removeItem('clicks')")
        begun = time.monotonic()
        task(work)
        clicks = int(work.page.evaluate("sessionStorage.getItem('clicks') ?? '0'"))
        title = task.__doc__ or ""
        print(f"{title:<55} {clicks:>2} clicks {time.monotonic() - begun:6.1f} s")  # noqa: T201 -- the table
        counted[title] = clicks
    assert len(counted) == 10
    assert {title: clicks for title, clicks in counted.items() if not 0 < clicks <= MOST} == {}
