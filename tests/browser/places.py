"""One of everything that has a page, and where its page is: what the walks through all pages go by."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import numpy as np
from playwright.sync_api import BrowserContext

from tests.browser.driving import ROOT
from tests.browser.test_datasets import recording as text_recording
from tests.browser.test_matching import LAG, RATE, of_a_lag, send
from tests.integration.api.rigs import AGENT, MEASUREMENT, RIG, deliver, samples
from tests.support.patience import PATIENCE

_UNDER_WAY = {"queued", "claimed", "running", "uploading", "parsing"}
_TEMPLATES = ROOT / "web" / "src" / "features" / "systems" / "templates.json"
STUDIES = ("dc-motor", "hydraulic-velocity", "servo-hydraulic-position")
PANEL = "s=motor.resistance,motor.inertia,motor.torque_constant&in=voltage&amp=24&path=voltage,speed&pl=motor.resistance&cmp=motor.resistance:0.33,0.5,0.8"
_STEP = {"name": "step", "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 0.1}}}
QUICK = {"metric": "response_time", "experiment": "step", "output": "velocity", "sense": "minimize"}
CALM = {"metric": "overshoot", "experiment": "step", "output": "velocity"}
_GAIN = {"parameter": "law.kp", "lower": 0.001, "upper": 0.1}
_RATE = {"parameter": "law.kd1", "lower": 1e-6, "upper": 1e-4}
SEARCH = {
    "variables": [_GAIN, _RATE],
    "experiments": [_STEP],
    "goals": [QUICK, {**CALM, "upper": 0.05}],
    "method": {"kind": "gradient", "starts": 1, "seed": 1},
}
#: What a search can find out besides an optimum: other structures, other methods, how sure it is.
_WHOLE = {
    **SEARCH,
    "variables": [_GAIN],
    "uncertain": [{"parameter": "motor.leakage", "lower": 1e-10, "upper": 1.2e-10}],
    "yield_samples": 20,
    "cross_check": ["grid"],
}
_MAP = {**SEARCH, "goals": [QUICK, CALM | {"upper": 0.05}], "method": {"kind": "grid", "points": 5}}
_FRONT = {
    **SEARCH,
    "goals": [QUICK, {**CALM, "sense": "minimize"}],
    "method": {"kind": "pareto", "points": 6, "population": 16, "generations": 2},
}
#: A form that says all that a search can be told: every way to choose, every kind of goal, ranges that are not known better.
_FORM: dict[str, Any] = {
    "experiments": [
        {
            "name": "step",
            "commands": [{"port": "reference", "signal": {"kind": "step", "amplitude": 1}}],
            "duration": 2,
        },
        {"name": "slowly", "commands": [{"port": "reference", "signal": {"kind": "ramp", "slope": 0.5}}]},
    ],
    "variables": [
        {"parameter": "law.kp", "chosen": "range", "lower": 0.001, "upper": 0.1, "scale": "log", "start": 0.02},
        {"parameter": "law.kd1", "chosen": "list", "choices": [1e-5, 2e-5]},
        {"parameter": "law.kd2", "chosen": "tied", "expression": "=law.kp/20"},
    ],
    "scenarios": "motor.mass = 5.5k",
    "across": "mean",
    "uncertain": [{"parameter": "motor.leakage", "lower": 1e-10, "upper": 2e-10}],
    "draws": 100,
    "structures": [{"id": "", "name": "stiffer", "added": "", "ranges": ""}],
    "method": "gradient",
    "options": {"starts": 3},
    "others": ["grid"],
    "priority": "low",
    "limit": 60,
}
_BARE = {"output": "velocity", "experiment": "", "from": "reference", "loop": "error", "sense": "", "soft": False}
_FORM["goals"] = [
    {**_BARE, "metric": "peak", "target": 1.1, "tolerance": 0.2, "soft": True, "weight": 2},
    {**_BARE, "metric": "envelope", "upperCurve": "0: 1.1; 5: 1.02", "lowerCurve": "0.5: 0.9; 5: 0.98"},
    {**_BARE, "metric": "tracking_error", "sense": "minimize", "reference": "0: 0; 1: 1"},
    {**_BARE, "metric": "sensitivity_bound", "upperCurve": "1: 2; 1000: 3"},
    {**_BARE, "metric": "bandwidth", "lower": 10},
]


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A wrong entry of a form: label -> what is filled in, the buttons that send it, and what the service says of it at a field."""

    fill: Mapping[str, str] = field(default_factory=dict)
    press: tuple[str, ...]
    at: str
    said: str


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a page is, what is on it when it has come, the job that must have ended before, and what its form may get wrong."""

    address: str
    there: str
    job: str = ""
    mistakes: tuple[Mistake, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Places:
    """Pages by name, in the order in which they are best looked at: what a job works on comes late."""

    client: httpx.Client
    listed: dict[str, Place] = field(default_factory=dict)

    def add(self, name: str, address: str, there: str, *mistakes: Mistake, job: str = "") -> None:
        """List a page."""
        self.listed[name] = Place(address=address, there=there, job=job, mistakes=mistakes)

    def wait(self, name: str) -> Place:
        """Return a page as soon as what it shows is there."""
        place = self.listed[name]
        if place.job:
            ended(self.client, f"/v1/jobs/{place.job}")
        return place


def of_models(client: httpx.Client) -> Places:
    """Make systems and what is computed from them alone."""
    documents = templates()
    motor, hydraulic, position = (made(client, "/v1/systems", documents[name]) for name in STUDIES)
    structures = [{"name": name, "system": hydraulic} for name in ("as it is", "the same again")]
    whole = {**_WHOLE, "alternatives": structures}
    bodies = ({"system": hydraulic, **body} for body in (_MAP, _FRONT, whole))
    grid, front, optimum = (made(client, "/v1/optimizations", body) for body in bodies)
    changed = json.loads(json.dumps(documents["dc-motor"]).replace("0.5", "0.33"))
    client.put(f"/v1/systems/{motor}", json=changed, headers={"If-Match": '"1"'}).raise_for_status()
    of = Places(client=client)
    of.add("systems", "/systems", "article")
    of.add("panel", f"/systems/{motor}/panel?{PANEL}", "[data-testid=plots][data-frame]")
    of.add("diagram", f"/systems/{position}/diagram", ".react-flow__viewport:has(.react-flow__edge) .react-flow__node")
    of.add("influence", f"/systems/{hydraulic}/influence?row=overshoot", "[data-testid=tornado]")
    search = f"/systems/{hydraulic}/optimise?f={quote(json.dumps(_FORM))}"
    mass = Mistake(fill={"At least, goal 5": "3 kg"}, press=("Start",), at="At least, goal 5", said="kg")
    of.add("optimise", search, "form button[type=submit]", mass)
    of.add("revisions", f"/systems/{motor}/revisions", "[data-testid=difference]")
    both = f"/compare?d={motor}@1&d={motor}@2"
    of.add("compare", both, "[data-testid=plots][data-frame]")
    of.add("jobs", "/jobs", "[data-testid=jobs]")
    past = Mistake(fill={"Name": "late", "Until": "2001-01-01"}, press=("Make a key",), at="Until", said="must")
    less = Mistake(fill={"Limit: Systems": "-3"}, press=("Keep the limits",), at="Limit: Systems", said="must be >= 0")
    endless = Mistake(fill={"New workspace": "x" * 300}, press=("Make a workspace",), at="New workspace", said="200")
    of.add("access", "/access", "[data-testid=quotas]", past, less, endless)
    of.add("about", "/about", "[data-testid=checks]")
    of.add("reference", "/docs/api", ".opblock-tag-section")
    of.add("nowhere", "/nothing-here", "h1, h2")
    of.add("map", f"/jobs/{grid}", "[data-testid=optimum]", job=grid)
    of.add("front", f"/jobs/{front}", "[data-testid=front]", job=front)
    of.add("optimum", f"/jobs/{optimum}", "[data-testid=checked]", job=optimum)
    return of


def of_the_laboratory(client: httpx.Client, context: BrowserContext, folder: Path) -> Places:
    """Make recordings and what comes of them, schedules, a rig and a measurement on it."""
    lag = made(client, "/v1/systems", LAG)
    u, y = of_a_lag(1000)
    bench = send(client, "lag of the walk", {"u": ("", u), "y": ("", y)}, RATE)
    hammer = send(client, "hammer of the walk", struck(), 200.0)
    matched = {"system": lag, "dataset": bench, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    unknowns = [{"parameter": "k", "lower": 0.1, "upper": 10}, {"parameter": "tau", "lower": 0.01, "upper": 1}]
    verdict = made(client, "/v1/validations", matched)
    found = made(client, "/v1/identifications", {**matched, "parameters": unknowns})
    response = made(client, "/v1/frfs", {"dataset": hammer, "input": "force", "output": "x", "keep": True})
    kept = client.post("/v1/frfs", json={"dataset": hammer, "input": "force", "output": "x", "keep": True}).json()["id"]
    nightly = {"kind": "validation", "body": matched}
    schedule = made(client, "/v1/schedules", {"name": "nightly check", "cron": "30 2 * * mon-fri", "job": nightly})
    rig, acquisition = measured(client)
    described = imported(context, folder)
    given = f"system={lag}&dataset={bench}"
    of = Places(client=client)
    of.add("recordings", "/datasets", "tbody tr")
    of.add("recording", f"/datasets/{bench}", "[role=img] canvas")
    unit = "Unit of column 2"
    of.add(
        "import",
        described,
        "[data-testid=import] table",
        Mistake(fill={unit: "bogus"}, press=("Import",), at=unit, said="bogus"),
    )
    steps = quote(json.dumps([{"kind": "filter", "band": "low_pass", "frequency": {"value": 900, "unit": "Hz"}}]))
    sharp = Mistake(press=("Make the recording",), at="Edge *", said="must be <")
    of.add("process", f"/datasets/{hammer}/process?name=filtered&steps={steps}", "[data-testid=step]", sharp)
    long = Mistake(fill={"Segment": "5000"}, press=("Estimate",), at="Segment", said="must")
    of.add("frf", f"/datasets/{hammer}/frf?input=force&outputs=x&segment=16&modes=1", "[data-testid=modes]", long)
    of.add("kept", f"/results/{kept}", "[data-testid=frf] [role=img] svg")
    of.add("lineage", f"/lineage/{response}", "[data-testid=graph] .react-flow__node")
    tau = "At most, tau"
    heavy = Mistake(fill={tau: "1 kg"}, press=("Find the values",), at=tau, said="kg")
    of.add("identify", f"/identify?{given}&p=k,tau", "[data-testid=sought]", heavy)
    box = quote(json.dumps({"inputs": {"u": "u"}, "outputs": {"y": "y"}, "orders": [0]}))
    none = Mistake(press=("Find the values",), at="Orders", said="must")
    of.add(
        "identify-direct", f"/identify?dataset={bench}&method=transfer_function&f={box}", "button[type=submit]", none
    )
    whose = "Values of an identification"
    gone = Mistake(fill={whose: "job_gone"}, press=("Validate",), at=whose, said="job_gone")
    of.add("validate", f"/validate?{given}", "form button[type=submit]", gone)
    of.add("schedules", "/schedules", "tbody tr")
    of.add("schedule", f"/schedules/{schedule}", "[data-testid=next] li")
    zone = Mistake(fill={"Name": "nowhere", "Time zone": "Mars/Olympus"}, press=("Save",), at="Time zone", said="Mars")
    of.add("schedule-new", f"/schedules/new?kind=validation&body={quote(json.dumps(matched))}", "form", zone)
    of.add("schedule-change", f"/schedules/{schedule}/edit", "form")
    of.add("rigs", "/rigs", "tbody tr")
    of.add("rig", f"/rigs/{rig}", "[data-testid=inputs]")
    far = Mistake(fill={"Name": "far", "Amplitude": "400"}, press=("Start", "Start it"), at="Amplitude", said="must")
    of.add("measure", f"/rigs/{rig}/measure?output=valve", "form", far)
    of.add("measurement", f"/acquisitions/{acquisition}", "a[href^='/datasets/']")
    of.add("validated", f"/jobs/{verdict}", "[data-testid=diagnosis]", job=verdict)
    of.add("identified", f"/jobs/{found}", "[data-testid=identified]", job=found)
    return of


def measured(client: httpx.Client) -> tuple[str, str]:
    """Let an agent of the tests report a rig and measure on it; return both."""
    name = "bench of the walk"
    agent = made(client, "/v1/agents", AGENT | {"rig": name, "instance": "agent-of-the-walk", "document": RIG})
    rig = next(one["id"] for one in items(client, "/v1/rigs") if one["name"] == name)
    acquisition = made(client, "/v1/acquisitions", MEASUREMENT | {"rig": name, "name": "measured on the walk"})
    claim = client.post(f"/v1/agents/{agent}/claim").json()
    deliver(client, claim, agent, samples()).raise_for_status()
    return rig, acquisition


def struck(count: int = 20_000) -> dict[str, tuple[str, Any]]:
    """Return force and deflection of one mode of 60 rad/s, damped by 5 %, under a random force."""
    noise = np.random.default_rng(7)
    step, natural, damping = 1 / 200.0, 60.0, 0.05
    force = noise.standard_normal(count)
    x = np.zeros_like(force)
    # x'' + 2 zeta w x' + w^2 x = F by central differences.
    a, b = 1 / step**2 + damping * natural / step, 1 / step**2 - damping * natural / step
    for i in range(1, force.size - 1):
        x[i + 1] = (force[i] + (2 / step**2 - natural**2) * x[i] - b * x[i - 1]) / a
    return {"force": ("N", force), "x": ("m", x)}


def imported(context: BrowserContext, folder: Path, name: str = "run of the walk.csv") -> str:
    """Send a text file by its page; return the address of the page that maps its columns."""
    file = folder / name
    file.write_text(text_recording(4000))
    page = context.new_page()
    page.goto("/datasets")
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Send").click()
    page.wait_for_url("**/datasets/ds_*/import**")
    page.get_by_role("textbox", name="Unit of column 2").wait_for()
    address = page.url
    page.close()
    return address


def templates() -> dict[str, Any]:
    """Return the documents of the studies that a visitor may begin with."""
    return {t["id"]: t.get("document") for t in json.loads(_TEMPLATES.read_text(encoding="utf-8"))}


def made(client: httpx.Client, path: str, body: Any) -> str:
    """Make something; return its id."""
    reply = client.post(path, json=body, headers={"Prefer": "respond-async"})
    assert reply.status_code < 300, (path, reply.text)
    return str(reply.json()["id"])


def items(client: httpx.Client, path: str) -> list[dict[str, Any]]:
    """Return the first page of a list."""
    found: list[dict[str, Any]] = client.get(path).json()["items"]
    return found


def ended(client: httpx.Client, path: str) -> None:
    """Wait until a job has come to its end."""
    until(lambda: client.get(path).json()["status"] not in _UNDER_WAY)


def until(asked: Callable[[], Any]) -> Any:
    """Return what is asked for as soon as there is anything."""
    for _ in range(5 * PATIENCE):
        if found := asked():
            return found
        threading.Event().wait(0.2)
    raise AssertionError(f"what is waited for must come within {PATIENCE} s")
