"""How a diagram of 300 blocks moves: the times between frames while it is panned, zoomed, and while a block is dragged."""

from __future__ import annotations

import json

import httpx
from playwright.sync_api import Page

COUNT = 300
MOVES = 120
#: Counts frames between two marks; a page that draws nothing new has frames, too, so that long ones are the page's own work.
_WATCH = """() => {
  window.__frames = [];
  window.__watching = true;
  let last = performance.now();
  const next = () => { const now = performance.now(); window.__frames.push(now - last); last = now; if (window.__watching) requestAnimationFrame(next); };
  requestAnimationFrame(next);
}"""
_PLACE = "name => document.querySelector(`.react-flow__node[data-id='${name}']`).style.transform"


def measured(page: Page, client: httpx.Client, *, moves: int = MOVES) -> dict[str, list[float]]:
    """Return the times between frames in ms, by what was done: one movement of the mouse a frame."""
    blocks: dict[str, object] = {"u": {"kind": "input"}}
    wires = []
    before = "u"
    for i in range(COUNT - 1):
        blocks[f"b{i}"] = {"kind": "gain", "gain": 1}
        wires.append({"from": before, "to": f"b{i}"})
        before = f"b{i}"
    document = {"name": "long", "blocks": blocks, "connections": wires, "outputs": {"y": before}}
    system = client.post("/v1/systems", json=document).json()["id"]
    places = {"": {name: {"x": 200 * (i % 20), "y": 110 * (i // 20)} for i, name in enumerate(blocks)}}
    picture = json.dumps({"places": places, "routes": {}})
    page.goto("/systems")
    page.evaluate("([id, kept]) => localStorage.setItem(`servotune-places-${id}`, kept)", [system, picture])
    page.goto(f"/systems/{system}/diagram")
    node = page.locator(".react-flow__node[data-id='b150']")
    node.wait_for()
    page.wait_for_function("() => document.querySelectorAll('.react-flow__node').length >= 300")
    pane = page.locator(".react-flow__pane").bounding_box()
    block = node.bounding_box()
    assert pane is not None
    assert block is not None
    was = page.evaluate(_PLACE, "b150")
    found = {
        "panning": _moved(page, pane["x"] + 20, pane["y"] + 10, moves),
        "zooming": _zoomed(page, pane["x"] + pane["width"] / 2, pane["y"] + pane["height"] / 2, moves),
    }
    block = node.bounding_box()
    assert block is not None
    found["dragging"] = _moved(page, block["x"] + block["width"] / 2, block["y"] + 4, moves)
    page.wait_for_function(f"was => ({_PLACE})('b150') !== was", arg=was)
    return found


def _moved(page: Page, x: float, y: float, moves: int) -> list[float]:
    """Move the mouse with its button down."""
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate(_WATCH)
    for i in range(moves):
        page.mouse.move(x + 2 * (i % 60), y + (i % 40))
    times = _seen(page, moves)
    page.mouse.up()
    return times


def _zoomed(page: Page, x: float, y: float, moves: int) -> list[float]:
    """Turn the wheel in and out again, so that as much is in sight at the end as was at the beginning."""
    page.mouse.move(x, y)
    page.evaluate(_WATCH)
    for i in range(moves):
        page.mouse.wheel(0, -20 if i % 20 < 10 else 20)
    return _seen(page, moves)


def _seen(page: Page, moves: int) -> list[float]:
    page.wait_for_function("count => window.__frames.length >= count", arg=min(moves, 10))
    times: list[float] = page.evaluate("() => { window.__watching = false; return window.__frames; }")
    return times
