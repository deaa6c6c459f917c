"""Pictures of every page, for the documentation: ``make screenshots`` writes docs/screenshots, with a service of its own.

Names behind the command (``python -m tests.browser.screenshots front map``) take these pictures only. ``--every FOLDER`` writes every page
into a folder instead, on windows 1280, 1440 and 1920 px wide in both themes: to be looked at, not to be kept.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

import httpx
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, Page, ViewportSize, sync_playwright

from agent.process import Agent
from agent.settings_file import read
from rig_simulator.grpc_server import Server
from tests.browser.driving import KEY, ROOT, Running, launched, running, signed_in
from tests.browser.places import (
    CALM,
    PANEL,
    QUICK,
    SEARCH,
    STUDIES,
    ended,
    imported,
    items,
    made,
    struck,
    templates,
    until,
)
from tests.browser.test_matching import LAG, RATE, of_a_lag, send
from tests.integration.agent.lab import MEASUREMENT, RIG, make_bench

TARGET = ROOT / "docs" / "screenshots"
SIZE = (1280, 860)
TABLET = (820, 1180)
#: The windows on which every page is looked at, px.
WINDOWS = ((1280, 860), (1440, 900), (1920, 1080))
#: Pages longer than this are cut, px.
_LONGEST = 2000
#: The searches of the walks, so fine that there is something to look at.
_SEARCH = {**SEARCH, "method": {"kind": "gradient", "starts": 2, "seed": 1}}
_MAP = {**SEARCH, "method": {"kind": "grid", "points": 15}}
_FRONT = {**SEARCH, "goals": [QUICK, {**CALM, "sense": "minimize"}], "method": {"kind": "pareto", "population": 24, "generations": 12, "seed": 1}}  # fmt: skip
_COMPARED = "s=controller.kp,controller.integral_time,controller.kd&in=reference&amp=0.01&loop=controller&sn=soft~1~controller.kp=120&sn=stiff~1~controller.kp=260&ref=1&r.controller.kp=160&g=overshoot<0.2&v=step:position,bode,phase,nyquist"


def main(wanted: Sequence[str] = (), every: Path | None = None) -> None:
    """Write one picture for each page, and of some pages one in the dark theme and one on a tablet, too; or every page at every size."""
    (every or TARGET).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, running(Path(place)) as service, sync_playwright() as playwright:
        folder = Path(place)
        with service.client() as client, laboratory(service, folder) as rig:
            browser = launched(playwright)
            light = signed_in(browser, service.url, size=SIZE)
            pages = prepared(client, light, folder, rig)
            if every is not None:
                at_every_size(browser, service.url, pages, wanted, every)
                return
            way_in = browser.new_context(base_url=service.url, viewport={"width": SIZE[0], "height": SIZE[1]})
            dark = signed_in(browser, service.url, size=SIZE, scheme="dark")
            tablet = signed_in(browser, service.url, size=TABLET, touch=True)
            shots = [
                (way_in, "sign-in", SIGN_IN),
                *((light, name, page) for name, page in pages.items() if name not in LOOKED_AT),
                *(
                    (dark, f"{name}-dark", pages[name])
                    for name in ("panel", "diagram", "optimum", "front", "validated")
                ),
                *((tablet, f"{name}-tablet", pages[name]) for name in ("panel", "diagram", "optimise")),
            ]
            for context, name, (address, there) in shots:
                if not wanted or name in wanted:
                    taken(context, address, there, TARGET / f"{name}.png")
            browser.close()


def at_every_size(
    browser: Browser, url: str, pages: dict[str, tuple[str, str]], wanted: Sequence[str], target: Path
) -> None:
    """Write page-width-theme.png of every page."""
    for width, height in WINDOWS:
        for scheme in ("light", "dark"):
            viewport: ViewportSize = {"width": width, "height": height}
            outside = browser.new_context(base_url=url, viewport=viewport, color_scheme=scheme)
            inside = signed_in(browser, url, size=(width, height), scheme=scheme)
            # What a file that is being described holds is known to the browser that has sent it.
            own = {"import": (imported(inside, target, "bench run.csv"), pages["import"][1])}
            for name, (address, there) in {"sign-in": SIGN_IN, **pages, **own}.items():
                if not wanted or name in wanted:
                    context = outside if name == "sign-in" else inside
                    taken(context, address, there, target / f"{name}-{width}-{scheme}.png")
            outside.close()
            inside.close()


def prepared(client: httpx.Client, context: BrowserContext, folder: Path, rig: str) -> dict[str, tuple[str, str]]:
    """Return picture -> address of its page and what is there when the page has come."""
    documents = templates()
    motor, hydraulic, position = (made(client, "/v1/systems", documents[name]) for name in STUDIES)
    revised(client, position)
    loops = made(
        client, "/v1/systems", json.loads((ROOT / "examples/systems/many_loops.json").read_text(encoding="utf-8"))
    )
    lag = made(client, "/v1/systems", LAG)
    u, y = of_a_lag()
    bench = send(client, "lag on the bench", {"u": ("", u), "y": ("", y)}, RATE)
    hammer = send(client, "hammer test", struck(40_000), 200.0)
    matched = {"system": lag, "dataset": bench, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    optimum, front, grid = (
        made(client, "/v1/optimizations", {"system": hydraulic, **what}) for what in (_SEARCH, _FRONT, _MAP)
    )
    unknowns = [{"parameter": "k", "lower": 0.1, "upper": 10}, {"parameter": "tau", "lower": 0.01, "upper": 1}]
    found = made(client, "/v1/identifications", {**matched, "parameters": unknowns})
    verdict = made(client, "/v1/validations", matched)
    frf = {"dataset": hammer, "input": "force", "output": "x", "keep": True}
    response = made(client, "/v1/frfs", frf)
    kept = client.post("/v1/frfs", json=frf).json()["id"]
    nightly = {"kind": "optimization", "body": {"system": hydraulic, **_MAP}}
    schedule = made(client, "/v1/schedules", {"name": "nightly map", "cron": "30 2 * * mon-fri", "job": nightly})
    measured = MEASUREMENT | {"rig": RIG_NAME, "name": "step of the bench", "duration": 1}
    acquisition = made(client, "/v1/acquisitions", measured)
    for job in (optimum, front, grid, found, verdict):
        ended(client, f"/v1/jobs/{job}")
    ended(client, f"/v1/acquisitions/{acquisition}")
    return {
        "systems": ("/systems", "h2#templates"),
        "panel": (f"/systems/{motor}/panel?{PANEL}", _PANEL_THERE),
        "compare": (f"/systems/{position}/panel?{_COMPARED}", _PANEL_THERE),
        "diagram": (f"/systems/{position}/diagram?at=controller", "[data-laid=true] .react-flow__node"),
        "frames": (f"/systems/{loops}/diagram?frames=1", ".react-flow__node"),
        "revisions": (f"/systems/{position}/revisions", "tbody tr"),
        "influence": (f"/systems/{hydraulic}/influence?row=overshoot", "[data-testid=influence]"),
        "optimise": (f"/systems/{hydraulic}/optimise", "form button[type=submit]"),
        "optimum": (f"/jobs/{optimum}", "[data-testid=optimum]"),
        "front": (f"/jobs/{front}", "[data-testid=front] canvas, [data-testid=front] svg"),
        "map": (f"/jobs/{grid}", "[data-testid=map]"),
        "jobs": ("/jobs", "[data-testid=jobs]"),
        "recordings": ("/datasets", "tbody tr"),
        "recording": (f"/datasets/{bench}", "[role=img] canvas"),
        "import": (imported(context, folder, "bench run.csv"), "[data-testid=import] table"),
        "process": (f"/datasets/{bench}/process?name=filtered&steps={_STEPS}", "[data-testid=step]"),
        "frf": (f"/datasets/{hammer}/frf?input=force&outputs=x&segment=16&modes=1", "[data-testid=modes] tr"),
        "lineage": (f"/lineage/{response}", "[data-testid=graph] .react-flow__node"),
        "identify": (f"/identify?system={lag}&dataset={bench}&p=k,tau", "[data-testid=sought]"),
        "identified": (f"/jobs/{found}", "[data-testid=identified]"),
        "validate": (f"/validate?system={lag}&dataset={bench}", "form"),
        "validated": (f"/jobs/{verdict}", "[data-testid=diagnosis]"),
        "schedules": ("/schedules", "tbody tr"),
        "schedule": (f"/schedules/{schedule}", "[data-testid=next] li"),
        "schedule-form": (f"/schedules/{schedule}/edit", "form"),
        "rigs": ("/rigs", "tbody tr"),
        "rig": (f"/rigs/{rig}", "[data-testid=inputs]"),
        "measure": (f"/rigs/{rig}/measure", "form"),
        "measurement": (f"/acquisitions/{acquisition}", "h1"),
        "access": ("/access", "[data-testid=keys]"),
        "about": ("/about", "[data-testid=checks]"),
        "reference": ("/docs/api", ".info"),
        "designs": (f"/compare?d={position}@1&d={position}@2", "[data-testid=plots][data-frame]"),
        "kept": (f"/results/{kept}", "[data-testid=frf] [role=img] svg"),
        "identify-direct": (f"/identify?dataset={bench}&method=transfer_function", "button[type=submit]"),
        "schedule-new": (f"/schedules/new?kind=validation&body={quote(json.dumps(matched))}", "form"),
        "nowhere": ("/nothing-here", "h1, h2"),
        "docs": ("/docs/", "h1"),
    }


RIG_NAME = "bench 1"
#: The panel has its metrics, and its curves can be pulled.
_PANEL_THERE = "body:has([data-testid=metrics][data-stale=false]):has([data-zone^='pull:']) [data-testid=plots]"
SIGN_IN = ("/systems", "[data-testid=key]")
#: Pages that are looked at, and of which no picture is kept.
LOOKED_AT = ("designs", "kept", "identify-direct", "schedule-new", "nowhere", "docs")
_STEPS = quote(json.dumps([{"kind": "filter", "band": "low_pass", "frequency": {"value": 40, "unit": "Hz"}}]))


def revised(client: httpx.Client, system: str) -> None:
    """Give a system a second revision with another gain."""
    found = client.get(f"/v1/systems/{system}")
    document = found.json()["document"]
    document["blocks"]["controller"]["kp"] = 170
    client.put(f"/v1/systems/{system}", json=document, headers={"If-Match": found.headers["ETag"]}).raise_for_status()


@contextmanager
def laboratory(service: Running, folder: Path) -> Iterator[str]:
    """A simulated rig and its agent; the rig's id."""
    file = folder / "agent.toml"
    file.write_text(RIG.replace("deadline = 1.0", "deadline = 30.0").format(rig=RIG_NAME))
    with closing(Server(make_bench(speed=1.0))) as server:
        given = {
            "service.url": service.url,
            "daq.server": f"127.0.0.1:{server.port}",
            "spool.folder": str(folder / "spool"),
        }
        agent = Agent(read(file, {"SERVOTUNE_AGENT_KEY": KEY}, given), name="lab PC", confirm=lambda *_: True)
        thread = threading.Thread(target=agent.run, daemon=True)
        thread.start()
        try:
            with service.client() as client:
                yield until(lambda: next((one["id"] for one in items(client, "/v1/rigs")), None))
        finally:
            agent.stop()
            thread.join()


def taken(context: BrowserContext, address: str, there: str, file: Path) -> None:
    """Write the picture of a page."""
    page = context.new_page()
    page.goto(address)
    page.locator(there).first.wait_for()
    settled(page)
    # Long pages as a whole, within reason; what fills its window is as large as that.
    size = context.pages[-1].viewport_size or {"width": SIZE[0], "height": SIZE[1]}
    length = min(int(page.evaluate("document.documentElement.scrollHeight")), _LONGEST)
    if length > size["height"]:
        page.set_viewport_size({"width": size["width"], "height": length})
        settled(page)
    page.screenshot(path=file)
    page.close()
    # Pages have few colours: a palette of 256 takes a third of the bytes.
    Image.open(file).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)


def settled(page: Page) -> None:
    """Wait for layouts, charts and metrics that come after the first picture."""
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(1500)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(prog="screenshots", description=main.__doc__)
    arguments.add_argument("names", nargs="*", help="the pictures to take, all without it")
    arguments.add_argument("--every", type=Path, metavar="FOLDER", help="every page at three widths in both themes")
    said = arguments.parse_args()
    main(said.names, said.every)
