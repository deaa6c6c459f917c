"""`make bench-web`: a recording of ten million samples, looked at and zoomed into, in a real Chromium against a real service."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import CDPSession, Page, sync_playwright

import servotune
from tests.browser.driving import KEY, Running, launched, running, signed_in

SAMPLES = 10_000_000
RATE = 10_000.0
ZOOMS = 8
"""Each shows a third: the last one a stretch of 1500 samples."""


def main() -> None:
    """Print the time of the first picture and of each zoom, and the memory of both sides."""
    with tempfile.TemporaryDirectory() as folder, running(Path(folder)) as service, sync_playwright() as playwright:
        dataset = sent(service)
        before = peak_memory(service)
        browser = launched(playwright)
        page = signed_in(browser, service.url).new_page()
        begun = time.perf_counter()
        page.goto(f"/datasets/{dataset}")
        page.locator("[role=img] canvas").first.wait_for()
        first = time.perf_counter() - begun
        times = [zoomed(page) for _ in range(ZOOMS)]
        heap = heap_of(page.context.new_cdp_session(page))
        browser.close()
        print(f"a recording of {SAMPLES:.0e} samples in the browser")
        print(f"  a canvas is there, page included            {first:8.2f} s")
        print(f"  zooms, each into a third: median and worst  {np.median(times):8.2f} s {max(times):8.2f} s")
        print(f"  scripts' memory of the page                 {heap / 1e6:8.1f} MB")
        print(
            f"  service: peak memory, more than before      {peak_memory(service):8.1f} MB {peak_memory(service) - before:8.1f} MB"
        )


def sent(service: Running) -> str:
    """Keep a long recording; return its id."""
    instants = np.arange(SAMPLES) / RATE
    noise = np.random.default_rng(1)
    values = np.sin(2 * np.pi * 0.01 * instants) + 0.1 * noise.standard_normal(SAMPLES)
    document = {"name": "long", "format": "raw", "sample_rate": RATE, "channels": [{"name": "x", "unit": "m"}]}
    with servotune.connect(service.url, key=KEY) as client:
        return str(client.datasets.upload(document, values.astype("<f8").tobytes())["id"])


def zoomed(page: Page) -> float:
    """Show the middle third; return the time from the click until it has been painted, s."""
    begun = time.perf_counter()
    with page.expect_response(lambda reply: "/channels/" in reply.url) as reply:
        page.get_by_role("button", name="Zoom in").click()
    reply.value.finished()
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return time.perf_counter() - begun


def heap_of(session: CDPSession) -> float:
    """Return the bytes that the page's scripts hold."""
    session.send("Performance.enable")
    found = session.send("Performance.getMetrics")["metrics"]
    return float(next(one["value"] for one in found if one["name"] == "JSHeapUsedSize"))


def peak_memory(service: Running) -> float:
    """Return the most memory that the service has had resident, MB."""
    assert service.process is not None
    status = Path(f"/proc/{service.process.pid}/status").read_text(encoding="ascii")
    return float(status.split("VmHWM:")[1].split()[0]) / 1e3


if __name__ == "__main__":
    main()
