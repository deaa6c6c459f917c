"""A system document drawn in the editor, with nothing but the keyboard: block by block, signal by signal, loop inside loop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from playwright.sync_api import Page, expect

Document = dict[str, Any]


def draw(page: Page, document: Document) -> None:
    """Draw ``document`` on the canvas that is open and empty, with its subsystems."""
    drawn: str | None = None
    for name, follows in _order(document):
        if follows is None or follows != drawn:
            page.keyboard.press("Escape")  # nothing is selected: the new block is not connected
        block = document["blocks"][name]
        _say(page, "a", f"{name}: {block['kind']} {_values(block)}")
        drawn = name
        if "system" in block:
            _inside(page, name, block["system"])
    for source, wires in _remaining(document).items():
        _say(page, "/", _path(page, source))
        for port, to in wires:
            _say(page, "c", f"{port} > {to}" if port else to)
        for output, end in document["outputs"].items():
            if end.split(".")[0] == source:
                _say(page, "o", f"{output}: {end.split('.')[1]}" if "." in end else output)
    page.keyboard.press("Escape")
    for name, parameter in document.get("parameters", {}).items():
        field = page.get_by_label("New parameter")
        field.click()
        unit = f" {parameter['unit']}" if "unit" in parameter else ""
        bounds = f" [{_text(parameter['lower'])}, {_text(parameter['upper'])}]" if "lower" in parameter else ""
        page.keyboard.type(f"{name} = {parameter['value']}{unit}{bounds}")
        page.keyboard.press("Enter")
        expect(field).to_have_value("")
        page.keyboard.press("Escape")


def _inside(page: Page, name: str, system: Document) -> None:
    where = page.get_by_label("Where in the system").locator("[aria-current]")
    page.keyboard.press("Enter")
    expect(where).to_have_text(name)
    page.keyboard.press("Control+a")
    page.keyboard.press("Delete")
    expect(page.locator(".react-flow__node")).to_have_count(0)
    draw(page, system)
    page.keyboard.press("Alt+ArrowUp")
    expect(where).not_to_have_text(name)


def _say(page: Page, key: str, text: str) -> None:
    page.keyboard.press(key)
    line = page.get_by_role("dialog").get_by_role("combobox")
    expect(line).to_be_focused()
    page.keyboard.insert_text(text)  # as an input method gives it: all letters at once
    page.keyboard.press("Enter")
    expect(line).to_have_count(0)


def _path(page: Page, name: str) -> str:
    """Return a block's full path: blocks of other loops may have the same name."""
    # Not by the address, which is written behind the picture.
    above = page.get_by_label("Where in the system").locator("button").all_inner_texts()
    here = page.get_by_label("Where in the system").locator("[aria-current]").inner_text()
    return ".".join([*above[1:], here, name]) if above else name


def _order(document: Document) -> Iterator[tuple[str, str | None]]:
    """Return each block with the one that it is drawn behind: signals are followed as far as they go."""
    waiting = list(document["blocks"])
    last: str | None = None
    while waiting:
        name = next(
            (name for name in waiting if last is not None and _first(document, last) in _inputs(document, name)), None
        )
        yield (name, last) if name is not None else (waiting[0], None)
        last = name or waiting[0]
        waiting.remove(last)


def _first(document: Document, name: str) -> str:
    """Return the signal that a new block behind ``name`` gets."""
    block = document["blocks"][name]
    outputs = list(block["system"]["outputs"]) if "system" in block else []
    return f"{name}.{outputs[0]}" if len(outputs) > 1 else name


def _inputs(document: Document, name: str) -> list[str]:
    """Return the source of a block's first input, if it has one."""
    block = document["blocks"][name]
    if "system" in block:
        return []  # its ports come with what is inside
    return [w["from"] for w in document["connections"] if w["to"] in (name, f"{name}.in1", f"{name}.flow")]


def _remaining(document: Document) -> dict[str, list[tuple[str, str]]]:
    """Return, for each source, port and input of the signals that did not come with their blocks."""
    automatic = {(_first(document, last), name) for name, last in _order(document) if last is not None}
    found: dict[str, list[tuple[str, str]]] = {end.split(".")[0]: [] for end in document["outputs"].values()}
    for wire in document["connections"]:
        target = wire["to"].split(".")[0]
        if (wire["from"], target) in automatic and wire["to"] in (target, f"{target}.in1", f"{target}.flow"):
            continue
        source, _, port = wire["from"].partition(".")
        found.setdefault(source, []).append((port, shortest(document, wire["to"])))
    return found


def shortest(document: Document, end: str) -> str:
    """Return an input's name without its port where its block, a subsystem, has no other."""
    name, _, port = end.partition(".")
    system = document["blocks"][name].get("system")
    ports = [p for p, block in system["blocks"].items() if block["kind"] == "input"] if system else []
    return name if port and ports == [port] else end


def _values(block: Document) -> str:
    return " ".join(f"{key}={_text(value)}" for key, value in block.items() if key not in ("kind", "system"))


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return f"{value['value']} {value['unit']}"
    return ", ".join(_text(item) for item in value) if isinstance(value, list) else str(value)
