"""The browser client beside the API: pages for browsers that ask for one, problems for everybody else."""

from __future__ import annotations

import httpx
import pytest

from api.app import pages

HTML = {"Accept": "text/html,application/xhtml+xml"}


@pytest.fixture
def built(tmp_path, monkeypatch):
    """A client of one page and one script, so that this test needs no Node."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text('<meta name="csp-nonce" content="__NONCE__">')
    (tmp_path / "assets" / "index-1.js").write_bytes(b"1;")
    (tmp_path / "assets" / "index-1.js.gz").write_bytes(b"compressed")
    (tmp_path / "secret").write_text("not an asset")
    monkeypatch.setattr(pages, "STATIC", tmp_path)


@pytest.fixture
def anybody(sqlite_service, built):
    with httpx.Client(base_url=sqlite_service.url, trust_env=False) as client:
        yield client


def test_every_address_is_the_page_for_a_browser(anybody) -> None:
    first, second = (anybody.get("/systems/sys_1/panel?s=kp", headers=HTML) for _ in range(2))
    assert first.status_code == 200
    nonce = first.text.split('content="')[1].split('"')[0]
    policy = first.headers["Content-Security-Policy"]
    assert f"'nonce-{nonce}'" in policy
    assert "unsafe-eval" not in policy
    assert "http" not in policy  # no other host
    assert "script-src 'self';" in policy
    assert first.text != second.text
    assert first.headers["Cache-Control"] == "no-cache"


def test_what_computes_reports_is_loaded_as_soon_as_somebody_looks_at_pages(sqlite_service, anybody) -> None:
    assert anybody.get("/", headers=HTML).status_code == 200
    computing = sqlite_service.app.state.installation.computing
    assert computing._children.settled(60)
    assert computing._children.warm_up_seconds is not None


@pytest.mark.parametrize(
    ("method", "path", "status"), [("GET", "/systems", 404), ("POST", "/systems", 404), ("GET", "/v1/nothing", 401)]
)
def test_who_is_no_browser_learns_that_there_is_nothing(anybody, method, path, status) -> None:
    reply = anybody.request(method, path, headers={"Accept": "application/json"})
    assert reply.status_code == status
    assert reply.headers["Content-Type"] == "application/problem+json"


def test_scripts_are_kept_for_ever_and_sent_compressed(anybody) -> None:
    with anybody.stream("GET", "/assets/index-1.js", headers={"Accept-Encoding": "gzip"}) as reply:
        assert reply.headers["Content-Encoding"] == "gzip"
        assert "immutable" in reply.headers["Cache-Control"]
        assert "javascript" in reply.headers["Content-Type"]
        assert b"".join(reply.iter_raw()) == b"compressed"
    plain = anybody.get("/assets/index-1.js", headers={"Accept-Encoding": "identity"})
    assert plain.content == b"1;"
    assert "Content-Encoding" not in plain.headers


@pytest.mark.parametrize("name", ["nothing.js", "..%2Fsecret", "%2e%2e/secret"])
def test_nothing_else_is_served(anybody, name) -> None:
    assert anybody.get(f"/assets/{name}").status_code == 404
