"""The documentation site: it builds without a warning, leads nowhere wrong, asks no other host, and is served at /docs."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

from api.app import documentation

ROOT = Path(__file__).parents[3]
#: Addresses of the service beside the site.
SERVED = {"/docs/api", "/openapi.json"}
LOADING = {
    ("script", "src"),
    ("img", "src"),
    ("link", "href"),
    ("iframe", "src"),
    ("source", "src"),
    ("object", "data"),
}
#: What the theme would fetch a program from another host for.
FETCHED = {"mermaid", "glightbox", "asciinema-player"}


class Page(HTMLParser):
    """What a page loads, where it leads, what can be led to in it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.classes: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if (tag, name) in LOADING:
                self.loaded.append(value)
            elif (tag, name) == ("a", "href"):
                self.links.append(value)
            elif name == "id":
                self.anchors.add(value)
            elif name == "class":
                self.classes |= set(value.split())


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("documentation")
    for name in ("docs", "servotune"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "zensical.toml", folder)
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "api" / "site"


@pytest.fixture(scope="module")
def pages(site) -> dict[Path, Page]:
    found = {path: Page(path) for path in site.rglob("*.html")}
    assert len(found) >= len(list((ROOT / "docs").rglob("*.md")))
    return found


def test_nothing_is_loaded_from_another_host(site, pages) -> None:
    for page in pages.values():
        for address in page.loaded:
            assert not re.match(r"[a-z]+:|//", address), (page.path, address)
        assert page.classes & FETCHED == set(), page.path
    for style in site.rglob("*.css"):
        for address in re.findall(r"url\(([^)]*)\)|@import\s+([^;]+);", style.read_text()):
            assert not re.match(r"['\"]?([a-z]+:)?//", "".join(address)), (style, address)


def test_every_link_leads_to_a_place_that_exists(site, pages) -> None:
    for page in pages.values():
        if page.path.name == "404.html":
            continue
        for link in page.links + page.loaded:
            if re.match(r"https?:|mailto:", link) or link in SERVED:
                continue
            address, anchor = urldefrag(unquote(link))
            target = (page.path.parent / address).resolve() if address else page.path
            if target.is_dir():
                target /= "index.html"
            assert target.is_relative_to(site.resolve()), (page.path, link)
            assert target.is_file(), (page.path, link)
            if anchor and target.suffix == ".html":
                assert anchor in pages[site / target.relative_to(site.resolve())].anchors, (page.path, link)


def test_every_page_can_be_reached_from_the_first(site, pages) -> None:
    seen, left = set(), [site / "index.html"]
    while left:
        page = left.pop()
        if page in seen:
            continue
        seen.add(page)
        for link in pages[page].links:
            address = urldefrag(unquote(link)).url
            target = (page.parent / address).resolve() if address else page.resolve()
            target = target / "index.html" if target.is_dir() else target
            if target.suffix == ".html" and target.is_relative_to(site.resolve()):
                left.append(site / target.relative_to(site.resolve()))
    assert {page.relative_to(site) for page in set(pages) - seen} == {Path("404.html")}


def test_the_search_knows_theory_names_and_commands(site) -> None:
    index = json.loads((site / "search.json").read_text())
    text = json.dumps(index, ensure_ascii=False)
    for words in ("method of steps", "disk margin", "servotune optimize", "AsyncClient", "SERVOTUNE_DATABASE_URL"):
        assert words in text, words


def test_formulas_are_formulas(site) -> None:
    for page in (site / "theory").glob("*.html"):
        text = page.read_text()
        if page.name != "index.html":
            assert text.count("<math") >= 5, page
        assert "$$" not in text, page
        for formula in re.findall(r"<math.*?</math>", text, flags=re.DOTALL):
            assert "\\" not in re.sub(r"<[^>]+>", "", formula), formula


def test_the_reference_has_every_name_of_the_library(site) -> None:
    import servotune

    page = (site / "reference" / "python.html").read_text()
    for name in servotune.__all__:
        places = (f"servotune.{name}", f"servotune.errors.{name}") if name != "local" else ("servotune.local.local",)
        assert any(f'id="{place}"' in page for place in places), name


def test_the_service_serves_the_site_and_the_reference_beside_it(client, site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documentation, "SITE", site)
    moved = client.get("/docs", follow_redirects=False)
    assert (moved.status_code, moved.headers["Location"]) == (307, "docs/")
    for path in ("", "index.html", "theory/delays.html", "theory/", "reference/python.html"):
        reply = client.get(f"/docs/{path}")
        assert reply.status_code == 200, path
        policy = reply.headers["Content-Security-Policy"]
        assert "http" not in policy
        assert "unsafe-inline" not in policy.partition("script-src")[2].partition(";")[0]
        for script in re.findall(r"<script>(.*?)</script>", reply.text, flags=re.DOTALL):
            assert f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'" in policy
    asset = next(site.glob("assets/javascripts/*.js"))
    first = client.get(f"/docs/assets/javascripts/{asset.name}")
    assert first.headers["Content-Type"].startswith("text/javascript")
    again = client.get(f"/docs/assets/javascripts/{asset.name}", headers={"If-None-Match": first.headers["ETag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    "path",
    [
        "nothing.html",
        "../../pyproject.toml",
        "%2e%2e/%2e%2e/pyproject.toml",
        "..%2f..%2fmain.py",
        "%00",
        "x" * 400,
        "//etc/passwd",
    ],
)
def test_nothing_but_the_site_is_served(client, site, monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    monkeypatch.setattr(documentation, "SITE", site)
    reply = client.get(f"/docs/{path}")
    assert reply.status_code == 404
    assert "dependency-groups" not in reply.text
    assert "root:" not in reply.text


def test_without_a_built_site_the_reply_says_what_to_do(client, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documentation, "SITE", tmp_path)
    reply = client.get("/docs/")
    assert reply.status_code == 404
    assert "make docs" in reply.json()["detail"]
    assert client.post("/docs/").status_code in {404, 405}
