"""Pictures of every page, for the documentation: ``make screenshots`` writes docs/screenshots, with a service of its own."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from playwright.sync_api import BrowserContext, sync_playwright

from tests.browser.driving import ROOT, launched, running, signed_in

TARGET = ROOT / "docs" / "screenshots"
_TEMPLATES = ROOT / "web" / "src" / "features" / "systems" / "templates.json"
_PANEL = "s=motor.resistance,motor.inertia,motor.torque_constant&in=voltage&amp=24&path=voltage,speed&cmp=motor.resistance:0.33,0.5,0.8"
_SEARCH = {
    "variables": [
        {"parameter": "law.kp", "lower": 0.001, "upper": 0.1},
        {"parameter": "law.kd1", "lower": 1e-6, "upper": 1e-4},
    ],
    "experiments": [{"name": "step", "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 0.1}}}],
    "goals": [
        {"metric": "response_time", "experiment": "step", "output": "velocity", "sense": "minimize"},
        {"metric": "overshoot", "experiment": "step", "output": "velocity", "upper": 0.05},
    ],
    "method": {"kind": "gradient", "starts": 2, "seed": 1},
}


def main() -> None:
    """Write one picture for each page."""
    TARGET.mkdir(parents=True, exist_ok=True)
    documents = {t["id"]: t.get("document") for t in json.loads(_TEMPLATES.read_text(encoding="utf-8"))}
    with tempfile.TemporaryDirectory() as folder, running(Path(folder)) as service, sync_playwright() as playwright:
        with service.client() as client:
            made = {
                name: client.post("/v1/systems", json=documents[name]).json()["id"]
                for name in ("dc-motor", "hydraulic-velocity", "servo-hydraulic-position")
            }
            hydraulic = made["hydraulic-velocity"]
            job = client.post("/v1/optimizations", json={"system": hydraulic, **_SEARCH}).json()["id"]
        pages = {
            "systems": ("/systems", "h2#templates"),
            "panel": (f"/systems/{made['dc-motor']}/panel?{_PANEL}", "[data-testid=plots][data-frame]"),
            "diagram": (f"/systems/{made['servo-hydraulic-position']}/diagram", ".react-flow__edge"),
            "influence": (f"/systems/{hydraulic}/influence?row=overshoot", "[data-testid=influence]"),
            "optimise": (f"/systems/{hydraulic}/optimise", "form button[type=submit]"),
            "job": (f"/jobs/{job}", "[data-testid=optimum]"),
        }
        browser = launched(playwright)
        light = signed_in(browser, service.url, size=(1280, 860))
        for name, (address, there) in pages.items():
            _take(light, address, there, TARGET / f"{name}.png")
        dark = signed_in(browser, service.url, size=(1280, 860), scheme="dark")
        _take(dark, *pages["panel"], TARGET / "panel-dark.png")
        browser.close()


def _take(context: BrowserContext, address: str, there: str, path: Path) -> None:
    page = context.new_page()
    page.goto(address)
    page.locator(there).first.wait_for(timeout=180_000)
    page.wait_for_timeout(1500)  # layouts and metrics that come after the first picture
    page.screenshot(path=path)
    page.close()


if __name__ == "__main__":
    main()
