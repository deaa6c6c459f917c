"""The front panel of every study: all of its plots are painted, planes are true to scale, and no metric is left without a word."""

from __future__ import annotations

import json
from typing import Any

import httpx
import pytest
from playwright.sync_api import Locator, Page

from tests.browser.driving import ROOT
from tests.browser.places import until
from tests.browser.soundness import quiet

#: Studies whose documents are examples, kept in files of their own.
_FILES = {"many-loops": "many_loops", "intelligent-damper": "intelligent_damper"}
_STUDIES = json.loads((ROOT / "web" / "src" / "features" / "systems" / "templates.json").read_text(encoding="utf-8"))
#: Its metrics are not waited for: with their slopes they are a simulation of many seconds.
_UNMEASURED = "intelligent-damper"
#: Titles of plots that neither show a curve nor say why there is none. A curve has a hue; axes, grid and labels are grey.
_BLANK = """() => [...document.querySelectorAll('[data-testid=plots] section')].filter(section => {
  const picture = section.querySelector('[role=img]');
  if (picture.hasAttribute('data-empty')) return !picture.getAttribute('aria-description');
  const canvas = section.querySelector('canvas');
  const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [r, g, b, a] = [data[i], data[i + 1], data[i + 2], data[i + 3]];
    if (a > 0 && Math.max(r, g, b) - Math.min(r, g, b) > 40) count++;
  }
  return count <= 10;
}).map(section => section.getAttribute('aria-label'))"""


def _document(study: dict[str, Any]) -> Any:
    if study["id"] not in _FILES:
        return study["document"]
    return json.loads((ROOT / "examples" / "systems" / f"{_FILES[study['id']]}.json").read_text(encoding="utf-8"))


def _read(page: Page, plot: Locator, x: float, y: float) -> tuple[float, float]:
    """Return what the plot reads under the mouse, at these parts of its width and height."""
    read = plot.locator("span.numbers").first
    plane = plot.locator(".u-over")

    def told() -> bool:
        box = plane.bounding_box()
        assert box is not None
        # What is below the mouse is read when it moves: a picture that is made anew meanwhile waits for the next time.
        page.mouse.move(box["x"] + x * box["width"] - 1, box["y"] + y * box["height"])
        page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
        return "·" in read.inner_text()

    until(told)
    right, up = read.inner_text().split("·")
    return float(right.split()[0]), float(up.split()[0])


def _width(plot: Locator) -> float:
    """Return how wide the plane of a plot is drawn, px."""
    return float(plot.locator(".u-over").evaluate("over => over.clientWidth"))


def _stretch(page: Page, plot: Locator) -> float:
    """Return how many times longer a unit is across than up."""
    plot.scroll_into_view_if_needed()
    box = plot.locator(".u-over").bounding_box()
    assert box is not None
    (left, top), (right, bottom) = _read(page, plot, 0.05, 0.05), _read(page, plot, 0.95, 0.95)
    return (box["width"] / (right - left)) / (box["height"] / (top - bottom))


@pytest.mark.parametrize("study", _STUDIES, ids=[study["id"] for study in _STUDIES])
def test_the_panel_of_a_study_is_painted_as_a_whole(page: Page, client: httpx.Client, study: dict[str, Any]) -> None:
    system = client.post("/v1/systems", json=_document(study)).json()["id"]
    with quiet(page) as told:
        page.goto(f"/systems/{system}/panel?{study['panel']}")
        page.locator("[data-testid=plots][data-frame]").wait_for()
        assert page.get_by_test_id("plots").locator("section").count() >= 3
        page.wait_for_function(f"() => ({_BLANK})().length === 0")
        if study["id"] != _UNMEASURED:
            page.locator("[data-testid=metrics][data-stale=false]").wait_for()
            metrics = page.locator("[data-metric]").all_inner_texts()
            assert len(metrics) >= 5
            # Each is a number, or a word for why there is none.
            assert [text for text in metrics if text.strip() in ("", "…")] == []
        # Pictures are made anew while the page settles.
        page.wait_for_load_state("networkidle")
        for title in ("Nyquist", "Poles"):
            for plot in page.get_by_role("region", name=title, exact=True).all():
                if plot.get_by_role("img").first.get_attribute("data-empty") is None:
                    until(lambda plot=plot: _stretch(page, plot) == pytest.approx(1, rel=0.01))
                    # A window of another size has planes of another shape, which are fitted once the page has been laid out anew.
                    before = _width(plot)
                    page.set_viewport_size({"width": 1111, "height": 800})
                    until(lambda plot=plot, before=before: _width(plot) != before)
                    until(lambda plot=plot: _stretch(page, plot) == pytest.approx(1, rel=0.01))
                    page.set_viewport_size({"width": 1280, "height": 800})
                    until(lambda plot=plot, before=before: _width(plot) == before)
    assert told == []
