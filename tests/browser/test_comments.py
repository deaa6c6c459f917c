"""Comments on the pages of a system, a recording and a job: written by one, read by another, and a report taken away beside them."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator

import pypdf
import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, expect

from tests.browser.driving import Running, signed_in
from tests.browser.soundness import faults_of_both_themes
from tests.browser.test_jobs_pages import _GAIN, _QUICK, _STEP
from tests.browser.test_panel import study
from tests.integration.api.documents import RAW, lag_recording, upload

HOSTILE = "<b>Rings</b> at 80 Hz\nwith the new coupling & more"


@pytest.fixture(scope="module")
def system(client) -> str:
    return study(client, "hydraulic-velocity")


@pytest.fixture(scope="module")
def job(client, system) -> str:
    body = {"system": system, "variables": [_GAIN], "experiments": [_STEP], "goals": [_QUICK], "method": {"kind": "grid", "points": 3}}  # fmt: skip
    return str(client.post("/v1/optimizations", json=body).json()["id"])


@pytest.fixture(scope="module")
def other(client, browser: Browser, service: Running) -> Iterator[BrowserContext]:
    """Somebody else in the same workspace, who may only read."""
    key = client.post("/v1/keys", json={"name": "guest", "scopes": ["read"]}).json()["key"]
    context = signed_in(browser, service.url, key=key)
    yield context
    context.close()


def comments(page: Page, count: int = 0) -> Locator:
    page.get_by_role("button", name=f"Comments ({count})" if count else "Comments", exact=True).click()
    found = page.get_by_role("dialog", name="Comments")
    expect(found).to_be_visible()
    return found


def test_a_comment_on_a_job_stays_and_another_reads_it(page: Page, other: BrowserContext, service, job) -> None:
    page.goto(f"/jobs/{job}")
    place = comments(page)
    expect(place.get_by_text("Nobody has written anything yet.")).to_be_visible()
    write = place.get_by_role("button", name="Comment", exact=True)
    expect(write).to_be_disabled()
    place.get_by_label("Your comment").fill(HOSTILE)
    write.click()
    expect(place.get_by_role("listitem")).to_have_count(1)
    expect(place.get_by_label("Your comment")).to_have_value("")
    place.get_by_label("Your comment").fill("The second one, by keyboard.")
    page.keyboard.press("Control+Enter")
    expect(place.get_by_role("listitem")).to_have_count(2)
    page.reload()
    listed = comments(page, 2).get_by_role("listitem")
    expect(listed).to_have_count(2)
    expect(listed.first).to_contain_text("The second one, by keyboard.")
    assert listed.nth(1).locator("p").last.inner_text() == HOSTILE
    guest = other.new_page()
    guest.goto(f"{service.url}/jobs/{job}")
    seen = comments(guest, 2)
    expect(seen.get_by_role("listitem")).to_have_count(2)
    expect(seen.get_by_role("button", name="Delete the comment")).to_have_count(0)
    # What may not be written is refused where it was written, and stays.
    seen.get_by_label("Your comment").fill("may I?")
    seen.get_by_role("button", name="Comment", exact=True).click()
    expect(seen.get_by_role("alert")).to_contain_text("write")
    expect(seen.get_by_label("Your comment")).to_have_value("may I?")
    guest.close()


def test_comments_on_a_system_lie_beside_it_and_are_deleted(page: Page, system) -> None:
    page.goto(f"/systems/{system}/panel")
    beside = comments(page)
    beside.get_by_label("Your comment").fill("Kept with this valve.")
    page.keyboard.press("Control+Enter")
    expect(beside.get_by_role("listitem")).to_have_count(1)
    assert faults_of_both_themes(page, "light") == []
    page.emulate_media(color_scheme="light")
    page.keyboard.press("Escape")
    expect(beside).to_be_hidden()
    page.goto(f"/systems/{system}/revisions")
    comments(page, 1)
    beside.get_by_role("button", name="Delete the comment").click()
    beside.get_by_role("button", name="Delete for good").click()
    expect(beside.get_by_role("listitem")).to_have_count(0)
    expect(beside.get_by_text("Nobody has written anything yet.")).to_be_visible()


def test_a_comment_on_a_recording_is_kept(page: Page, client) -> None:
    dataset = upload(client, RAW, lag_recording(samples=500)).json()["id"]
    page.goto(f"/datasets/{dataset}")
    place = comments(page)
    place.get_by_label("Your comment").fill("The sensor was loose from 2 s on.")
    page.keyboard.press("Control+Enter")
    expect(place.get_by_role("listitem")).to_contain_text("The sensor was loose from 2 s on.")
    (said,) = client.get("/v1/comments", params={"about": dataset}).json()["items"]
    assert said["text"] == "The sensor was loose from 2 s on."


def test_a_comment_is_found_by_its_words(page: Page, client, job) -> None:
    assert client.post("/v1/comments", json={"about": job, "text": "Coupling changed: serial 4711 is in"}).is_success
    page.goto("/about")
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    page.keyboard.press("Control+k")
    page.get_by_role("combobox", name="Search everything").fill("4711 coupling")
    found = page.get_by_test_id("found").locator("[data-kind=comments]")
    expect(found).to_have_count(1)
    expect(found).to_contain_text("Coupling changed: serial 4711 is in")
    found.click()
    expect(page).to_have_url(re.compile(rf"/jobs/{job}$"))


def test_a_report_of_a_job_is_taken_away(page: Page, job) -> None:
    page.goto(f"/jobs/{job}")
    with page.expect_download() as taken:
        page.get_by_role("link", name="Report, PDF").click()
    assert taken.value.suggested_filename == f"report_{job}.pdf"
    text = pypdf.PdfReader(io.BytesIO(taken.value.path().read_bytes())).pages[0].extract_text()
    assert job in text
    assert "law.kp" in text
    with page.expect_download() as taken:
        page.get_by_role("link", name="Report, HTML").click()
    assert taken.value.suggested_filename == f"report_{job}.html"
    # Looked at without the service, it is sound, and says what the PDF says.
    alone = page.context.browser
    assert alone is not None
    report = alone.new_page()
    report.route("**/*", lambda route: route.abort() if route.request.url.startswith("http") else route.continue_())
    report.set_content(taken.value.path().read_text(encoding="utf-8"))
    expect(report.get_by_role("heading", level=2, name="Certificate")).to_be_visible()
    expect(report.get_by_role("img", name="Responses under “step”, before and after.")).to_be_visible()
    assert report.evaluate("document.documentElement.scrollWidth <= innerWidth")
    report.close()
