"""Reports of finished jobs, by a real service and a worker: what they say, of what there is none, and who may read them."""

from __future__ import annotations

import asyncio
import io
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pypdf
import pytest

import servotune
from api.services.reports.language import romanian
from api.services.reports.quantities import measured, metric_value, plain, quantity
from servotune import connect
from servotune.errors import ApiError
from servotune.replies import Simulation
from tests.integration.api.conftest import finished
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, upload

HOSTILE = '<img src=x onerror=alert(1)> & "țăruș" $k_p$'
STEP = {"port": "u", "signal": {"kind": "step", "amplitude": 2}}
GOALS = [
    {"metric": "rise_time", "experiment": "step", "output": "y", "sense": "minimize"},
    {"metric": "peak", "experiment": "step", "output": "y", "upper": 12},
    {"metric": "phase_margin", "open_at": "plant", "lower": {"value": 30, "unit": "deg"}},
]
#: A lag in a loop, with a name and a parameter that are what people write.
LOOP: dict[str, Any] = {
    "name": HOSTILE,
    "parameters": {
        "k": {"value": 1, "lower": 0.1, "upper": 10, "doc": f"gain {HOSTILE}"},
        "tau": {"value": 0.2, "unit": "s", "lower": 0.001, "upper": 1},
    },
    "blocks": {
        "u": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "plant": {"kind": "transfer_function", "numerator": ["=k"], "denominator": ["=tau", 1]},
    },
    "connections": [
        {"from": "u", "to": "error.in1"},
        {"from": "plant", "to": "error.in2"},
        {"from": "error", "to": "plant"},
    ],
    "outputs": {"y": "plant"},
}


class Page(HTMLParser):
    """The elements of a page, and its texts by the element that they stand in."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.setdefault(self.names[-1], []).append(data)


@pytest.fixture(scope="module")
def client(sqlite_service, sqlite_worker):
    with sqlite_service.client() as own:
        yield own


def done(client: httpx.Client, path: str, body: dict[str, Any]) -> str:
    reply = client.post(f"/v1/{path}", json=body, headers={"Prefer": "respond-async"})
    assert reply.status_code == 202, reply.text
    ended = finished(client, reply.json())
    assert ended["status"] == "succeeded", ended
    return str(ended["id"])


def place(identifier: str) -> str:
    return f"/v1/{'results' if identifier.startswith('res_') else 'jobs'}/{identifier}/report"


def page(client: httpx.Client, job: str) -> Page:
    reply = client.get(place(job), params={"format": "html"})
    assert reply.status_code == 200, reply.text
    assert reply.headers["Content-Type"] == "text/html; charset=utf-8"
    assert reply.headers["Content-Disposition"] == f'attachment; filename="report_{job}.html"'
    return Page(reply.text)


def pdf(client: httpx.Client, job: str) -> str:
    reply = client.get(place(job), params={"format": "pdf"})
    assert reply.status_code == 200, reply.text
    assert reply.headers["Content-Type"] == "application/pdf"
    assert reply.headers["Content-Disposition"] == f'attachment; filename="report_{job}.pdf"'
    return " ".join(" ".join(one.extract_text() for one in pypdf.PdfReader(io.BytesIO(reply.content)).pages).split())


@pytest.fixture(scope="module")
def system(client) -> str:
    return str(client.post("/v1/systems", json=LOOP).json()["id"])


@pytest.fixture(scope="module")
def optimum(client, system) -> str:
    asked = {
        "system": system,
        "variables": [{"parameter": "k", "lower": 0.5, "upper": 5}],
        "experiments": [{"name": "step", "input": STEP}],
        "goals": GOALS,
        "scenarios": [{"name": "slow", "parameters": {"tau": {"value": 400, "unit": "ms"}}}, {"name": "fast", "parameters": {}}],
        "method": {"kind": "gradient", "starts": 2, "seed": 7},
    }  # fmt: skip
    return done(client, "optimizations", asked)


@pytest.fixture(scope="module")
def dataset(client) -> str:
    reply = upload(client, RAW | {"name": "probe"}, lag_recording(samples=2000))
    return str(reply.json()["id"])


def test_a_report_of_an_optimisation_has_every_number_in_both_forms(client, system, optimum) -> None:
    result = client.get(f"/v1/jobs/{optimum}/result").json()
    html, text = page(client, optimum), pdf(client, optimum)
    cells = html.texts["td"]
    wanted = [
        quantity(result["best"]["k"], "1", 5),
        *(measured(g["metric"], g[when]) for g in result["goals"] for when in ("before", "after")),
        *(plain(proof["violation"]) for proof in result["certificate"]["goals"]),
        "minimised", "≤ 12", "≥ 30 °", "at its upper bound", "gradient".capitalize(), "slow", "tau 400 ms", "7",
        "u: step, amplitude 2", f"{system}@1",
    ]  # fmt: skip
    for number in wanted:
        assert number in cells, number
        assert number in text, number
    # best is the upper end: the gain that makes a lag fastest is the largest that the goals allow
    assert result["best"]["k"] == pytest.approx(5)
    facts = dict(zip(html.texts["dt"], html.texts["dd"], strict=True))
    assert facts["Asked for by"] == "admin"
    assert facts["Revision"] == f"1 of {system}"
    assert facts["Job"] == f"{optimum}, succeeded"
    assert "servotune 0.1.0" in facts["Software"]
    assert html.names.count("svg") == 4  # responses, Bode, Nyquist, convergence
    assert [*html.texts["h2"]][-1] == "Lineage"


def test_a_report_is_in_the_language_that_is_asked_for(client, optimum) -> None:
    texts = {}
    for language in ("en", "ro"):
        reply = client.get(place(optimum), params={"language": language})
        assert reply.headers["Content-Language"] == language
        assert f'<html lang="{language}">' in reply.text
        texts[language] = Page(reply.text).texts
    for heading in ("h2", "th", "dt", "figcaption"):
        assert len(texts["en"][heading]) == len(texts["ro"][heading])
        assert [text for text in texts["ro"][heading] if text in romanian()["texts"]] == [
            text for text in texts["en"][heading] if romanian()["texts"].get(text) == text
        ]
    assert {"Timp de creștere", "la limita superioară", "u: treaptă, amplitudine 2"} <= set(texts["ro"]["td"])
    assert texts["ro"]["h1"] == texts["en"]["h1"]
    reply = client.get(place(optimum), params={"format": "pdf", "language": "ro"})
    text = " ".join(one.extract_text() for one in pypdf.PdfReader(io.BytesIO(reply.content)).pages)
    assert "Cum s-a cerut" in text
    wrong = client.get(place(optimum), params={"language": "de"})
    assert wrong.status_code == 422
    assert "must be 'en' or 'ro', got 'de'" in wrong.json()["detail"]


def test_what_people_wrote_is_never_part_of_the_page(client, optimum) -> None:
    found = page(client, optimum)
    assert "img" not in found.names
    assert "script" not in found.names
    assert found.texts["h1"] == [HOSTILE]
    assert f"gain {HOSTILE}" in found.texts["td"]
    assert HOSTILE in pdf(client, optimum)


def test_the_same_job_has_the_same_report(client, optimum) -> None:
    for form in ("html", "pdf"):
        first, second = (client.get(f"/v1/jobs/{optimum}/report", params={"format": form}).content for _ in range(2))
        assert first == second
    assert client.get(f"/v1/jobs/{optimum}/report").headers["Content-Type"].startswith("text/html")


STUDIES: dict[str, tuple[dict[str, Any], str, Any]] = {
    "influence": (
        {"input": "u", "output": "y", "parameters": ["k", "tau"], "metrics": ["rise_time", "peak"]},
        "Elasticities",
        lambda result: plain(result["elasticities"]["rise_time"]["k"]["value"], 3),
    ),
    "simulations": (
        {"input": STEP, "variants": [{}, {"k": 4}], "samples": 100},
        "Metrics of y",
        lambda result: quantity(result["variants"][1]["metrics"]["y"]["rise_time"]["value"], "s"),
    ),
    "frequency-responses": (
        {"open_at": "plant", "variants": [{"k": 4}]},
        "Margins and poles",
        lambda result: metric_value("phase_margin", result["variants"][0]["margins"]["phase"][0]["value"], "rad"),
    ),
}


@pytest.mark.parametrize("path", STUDIES)
def test_a_report_of_a_study_has_its_numbers(client, system, path) -> None:
    body, heading, number = STUDIES[path]
    job = done(client, path, body | {"system": system})
    wanted = number(client.get(f"/v1/jobs/{job}/result").json())
    found = page(client, job)
    assert heading in found.texts["h2"]
    assert wanted in found.texts["td"]
    assert "svg" in found.names
    assert wanted in pdf(client, job)


@pytest.mark.parametrize("path", STUDIES)
def test_a_kept_study_has_the_report_of_a_job_of_the_same(client, system, path) -> None:
    body, heading, number = STUDIES[path]
    kept = client.post(f"/v1/{path}", json=body | {"system": system, "keep": True}).json()
    found = page(client, kept["id"])
    assert heading in found.texts["h2"]
    assert number(kept) in found.texts["td"]
    assert number(kept) in pdf(client, kept["id"])
    facts = dict(zip(found.texts["dt"], found.texts["dd"], strict=True))
    assert facts["Kept as"] == kept["id"]
    assert facts["Asked for by"] == "admin"
    assert facts["Revision"] == f"1 of {system}"
    assert f"{system}@1" in found.texts["td"]
    assert page(client, done(client, path, body | {"system": system})).texts["h2"] == found.texts["h2"]


@pytest.fixture(scope="module")
def struck(client) -> str:
    """A force and the deflection x of one mode of 60 rad/s, damped by 5 %: x'' + 6 x' + 3600 x = F, by central differences."""
    force, step = np.random.default_rng(7).standard_normal(20_000), 1 / 200
    x = np.zeros_like(force)
    for i in range(1, force.size - 1):
        x[i + 1] = (force[i] + (2 / step**2 - 3600) * x[i] - (1 / step**2 - 3 / step) * x[i - 1]) / (
            1 / step**2 + 3 / step
        )
    channels = [{"name": "force", "unit": "N"}, {"name": "x", "unit": "m"}]
    description = {"name": "hammer", "format": "raw", "sample_rate": 1 / step, "channels": channels}
    return str(upload(client, description, np.column_stack([force, x]).tobytes()).json()["id"])


def test_measured_responses_are_reported_with_their_modes_and_bounds(client, struck) -> None:
    asked = {
        "dataset": struck,
        "input": "force",
        "output": "x",
        "segment": 16,
        "modes": {"band": [40, 90]},
        "keep": True,
    }
    reply = client.post("/v1/frfs", json=asked).json()
    (mode,) = reply["modes"]["modes"]
    assert mode["frequency"] == pytest.approx(60, rel=0.02)
    found, text = page(client, reply["id"]), pdf(client, reply["id"])
    for wanted in (
        plain(mode["frequency"], 5),
        plain(mode["damping_ratio"]),
        f"{plain(mode['frequency_lower'])} … {plain(mode['frequency_upper'])}",
        str(reply["averages"]),
        "hammer",
    ):
        assert wanted in found.texts["td"]
        assert wanted in text
    assert found.texts["h1"] == ["Frequency response function"]
    assert found.texts["figcaption"] == ["x over force."]
    for doubt in reply["outputs"]["x"]["doubts"]:
        assert f"x: {doubt['detail']}" in found.texts["p"]


def test_a_spectrum_is_reported_with_its_harmonics(client, system, struck) -> None:
    recorded = {"dataset": struck, "channel": "x", "quantity": "density", "segment": 16, "band": [50, 70], "keep": True}
    reply = client.post("/v1/spectra", json=recorded).json()
    found, text = page(client, reply["id"]), pdf(client, reply["id"])
    band = reply["variants"][0]["band"]
    assert f"{plain(band['value'], 5)} m²" in found.texts["td"]
    assert f"{plain(band['value'], 5)} m²" in text
    assert found.texts["figcaption"] == ["Spectral density over frequency."]
    sine = {"port": "u", "signal": {"kind": "sine", "amplitude": 3, "frequency": 4}}
    simulated = {"system": system, "input": sine, "output": "y", "fundamental": 4, "orders": 2, "variants": [{}, {"k": 4}]}  # fmt: skip
    job = done(client, "spectra", simulated)
    variants = client.get(f"/v1/jobs/{job}/result").json()["variants"]
    found = page(client, job)
    # |G(4j)| of k / (tau s + 1 + k), k = 1 and 4, tau = 0.2: the loop is linear, so that the first order has all of it
    for k, variant in zip((1, 4), variants, strict=True):
        assert variant["harmonics"]["amplitude"][0] == pytest.approx(3 * k / abs(1 + k + 0.8j), rel=1e-6)
        assert plain(variant["harmonics"]["amplitude"][0]) in found.texts["td"]
    assert "Harmonics" in found.texts["h2"]


def test_an_identification_and_a_validation_are_reported_also_when_the_recording_is_gone(client, dataset) -> None:
    about = {"system": LAG, "dataset": dataset, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    identified = done(client, "identifications", about | {"parameters": ["k", "tau"], "offsets": "estimate"})
    validated = done(client, "validations", about | {"parameters": {"k": 2, "tau": 0.05}})
    signal = {"kind": "sampled", "dataset": dataset, "channel": "u"}
    recorded = [{"name": "as recorded", "input": {"port": "u", "signal": signal}, "duration": 1}]
    goal = {"metric": "peak", "output": "y", "sense": "minimize"}
    method = {"kind": "grid", "points": 3}
    searched = done(
        client, "optimizations",
        {"system": LAG, "variables": [{"parameter": "k"}], "experiments": recorded, "goals": [goal], "method": method},
    )  # fmt: skip
    before = {job: page(client, job) for job in (identified, validated, searched)}
    assert all("probe" in found.texts["td"] for found in before.values())
    assert client.delete(f"/v1/datasets/{dataset}", params={"force": True}, headers={"If-Match": "*"}).is_success
    result = client.get(f"/v1/jobs/{identified}/result").json()
    tau = plain(result["parameters"]["tau"]["value"], 5)
    for job, number in ((identified, tau), (validated, "fail"), (searched, "0.1")):
        found, text = page(client, job), pdf(client, job)
        assert "deleted since" in found.texts["td"]
        assert "deleted since" in text
        assert number in text
        assert before[job].texts["h2"] == found.texts["h2"]


def test_an_identification_without_a_system_is_reported(client) -> None:
    source = str(upload(client, RAW, lag_recording(samples=1000)).json()["id"])
    body = {"method": "transfer_function", "dataset": source, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    job = done(client, "identifications", body)
    found = page(client, job)
    assert found.texts["h1"] == ["Identification"]
    assert "Agreement with the recordings" in found.texts["h2"]
    assert "transfer function" in pdf(client, job)


def test_several_structures_are_told_with_the_one_that_was_chosen(client) -> None:
    others = [{"name": "as it is"}, {"name": "faster", "add": {"parameters": {"tau": {"value": 0.02, "unit": "s"}}}}]
    job = done(client, "optimizations", OPTIMIZATION | {"system": LAG, "alternatives": others})
    found = page(client, job)
    assert "Of 2 structures, faster was chosen; what follows is about it." in found.texts["p"]
    assert {"as it is", "faster"} <= set(found.texts["td"])


def test_a_front_is_drawn_and_listed_with_its_knee(client) -> None:
    goals = [
        {"metric": "rise_time", "output": "y", "sense": "minimize"},
        {"metric": "peak", "output": "y", "sense": "minimize"},
    ]
    body = OPTIMIZATION | {
        "system": LOOP, "goals": goals,
        "variables": [{"parameter": "k"}, {"parameter": "tau", "lower": 0.01}],
        "method": {"kind": "pareto", "points": 4, "population": 16, "generations": 2},
    }  # fmt: skip
    job = done(client, "optimizations", body)
    result = client.get(f"/v1/jobs/{job}/result").json()
    found = page(client, job)
    assert "Front" in found.texts["h2"]
    assert f"{result['knee'] + 1} (knee)" in found.texts["td"]
    assert {measured("peak", point["goals"][1]) for point in result["front"]} <= set(found.texts["td"])
    assert "The front over two objectives, the knee in a circle." in found.texts["figcaption"]


def test_without_a_result_there_is_no_report(client) -> None:
    long = OPTIMIZATION | {"system": LAG, "method": {"kind": "grid", "points": {"k": 1_000_000}}}
    job = client.post("/v1/optimizations", json=long).json()["id"]
    reply = client.get(f"/v1/jobs/{job}/report")
    assert (reply.status_code, reply.json()["type"]) == (409, "urn:servotune:problem:no-result")
    assert job in reply.json()["detail"]
    assert client.post(f"/v1/jobs/{job}/cancel").is_success


def test_of_what_is_no_study_there_is_no_report(client) -> None:
    job = upload(client, {"name": "table", "format": "csv"}, b"t [s];y [N]\n0;1\n1;2\n2;3\n").json()["job"]
    assert finished(client, job)["status"] == "succeeded"
    reply = client.get(f"/v1/jobs/{job['id']}/report", params={"format": "pdf"})
    assert (reply.status_code, reply.json()["type"]) == (409, "urn:servotune:problem:no-report")
    assert f"{job['id']!r} must be one of optimization, identification" in reply.json()["detail"]
    assert reply.json()["detail"].endswith(f"it is {job['kind']}")


def test_who_may_read_a_report(sqlite_service, client, optimum) -> None:
    with sqlite_service.client("read") as reader, sqlite_service.client("stranger") as stranger:
        assert reader.get(f"/v1/jobs/{optimum}/report").status_code == 200
        assert stranger.get(f"/v1/jobs/{optimum}/report").status_code == 404
    wrong = client.get(f"/v1/jobs/{optimum}/report", params={"format": "docx"})
    assert wrong.status_code == 422
    assert "must be 'html' or 'pdf', got 'docx'" in wrong.json()["detail"]


def test_a_script_writes_a_report(sqlite_service, optimum, tmp_path: Path) -> None:
    with connect(sqlite_service.url, key=sqlite_service.keys["read"]) as script:
        job = script.jobs.get(optimum)
        content = job.report("pdf", tmp_path / "report.pdf")
        assert content.startswith(b"%PDF-")
        assert (tmp_path / "report.pdf").read_bytes() == content
        assert job.report(language="ro").startswith(b'<!doctype html>\n<html lang="ro">')
        long = OPTIMIZATION | {"system": LAG, "method": {"kind": "grid", "points": {"k": 1_000_000}}}
        with connect(sqlite_service.url, key=sqlite_service.keys["run"]) as starter:
            running = starter.jobs.start("optimization", long)
            with pytest.raises(ApiError, match="must have succeeded to have a result"):
                script.jobs.get(running.id).report("pdf", tmp_path / "none.pdf")
            running.cancel()
        assert not (tmp_path / "none.pdf").exists()


@pytest.mark.parametrize(
    "wrong",
    [
        (".", "got the folder"),
        ("none/report.pdf", "in a folder that is not there"),
        ("locked.pdf", "which this user may not"),
    ],
)
def test_where_no_report_can_be_written_none_is_made(
    sqlite_service, optimum, tmp_path: Path, monkeypatch, wrong: tuple[str, str]
) -> None:
    place, says = wrong
    (tmp_path / "locked.pdf").touch()
    # root may write anywhere, whatever the mode of the file says
    monkeypatch.setattr("servotune.targets.os.access", lambda path, _: path.name != "locked.pdf")
    with connect(sqlite_service.url, key=sqlite_service.keys["read"]) as script:
        sent: list[str] = []
        script._transport._http.event_hooks["request"].append(lambda request: sent.append(request.url.path))
        job = script.jobs.get(optimum)
        with pytest.raises(ValueError, match=f"path must be a file that can be written, .*{says}"):
            job.report("pdf", tmp_path / place)
        with pytest.raises(ValueError, match=f"output must be .*{says}"):
            script.lineage.export(optimum, tmp_path / place)
        with pytest.raises(ValueError, match=f"target must be .*{says}"):
            script.datasets.export("ds_any", tmp_path / place, format="csv")
    assert not [path for path in sent if "report" in path or "bundle" in path or "export" in path]


def test_a_script_finds_what_it_has_kept_and_reports_it(sqlite_service, system, tmp_path: Path) -> None:
    with connect(sqlite_service.url, key=sqlite_service.keys["run"]) as script:
        kept = script.simulate(system, input=STEP, keep=True)
        newest = next(script.results.list(kind="simulation"))
        assert (newest.id, newest.kind) == (kept.id, "simulation")
        with pytest.raises(ValueError, match=r"must be fetched by client\.results\.get to have a reply"):
            newest.reply()
        again = script.results.get(newest.id).reply()
        assert isinstance(again, Simulation)
        assert again.metrics["y"]["peak"].value == kept.metrics["y"]["peak"].value
        content = script.results.report(newest.id, "pdf", tmp_path / "kept.pdf")
        assert content.startswith(b"%PDF-")
        assert (tmp_path / "kept.pdf").read_bytes() == content


def test_a_report_is_awaited(sqlite_service, optimum) -> None:
    async def work() -> bytes:
        async with servotune.AsyncClient(sqlite_service.url, key=sqlite_service.keys["read"]) as client:
            return await (await client.jobs.get(optimum)).report("html")

    assert asyncio.run(work()).startswith(b"<!doctype html>")
