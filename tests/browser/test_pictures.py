"""What the panel's pictures show: margins where they are read, poles where they are, on axes that are alike."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.ndimage
from playwright.sync_api import Page, expect

from tests.browser.test_panel import opened

#: -1 +- 2i and -3 +- i.
POLES = [-3 - 1j, -3 + 1j, -1 - 2j, -1 + 2j]
#: Colours of an uPlot canvas: how far blue lies above red where the moving curve is drawn.
_BLUE = 60
_CANVAS = """title => {
  const canvas = document.querySelector(`section[aria-label="${title}"] canvas`);
  const {width, height} = canvas;
  return [width, height, [...canvas.getContext('2d').getImageData(0, 0, width, height).data]];
}"""


def blue(page: Page, title: str) -> np.ndarray:
    """Return where the moving curve is painted: one row of the canvas each."""
    width, height, data = page.evaluate(_CANVAS, title)
    pixels = np.array(data, dtype=np.int64).reshape(height, width, 4)
    # As much as is seen of it: a pixel that is nearly clear has few bits left for its colour, whatever was painted.
    found: np.ndarray = (pixels[..., 2] - pixels[..., 0]) * pixels[..., 3] > 255 * _BLUE
    return found


@pytest.fixture(scope="module")
def open_path(client) -> str:
    plant = {"kind": "transfer_function", "numerator": [50], "denominator": np.poly(POLES).real.tolist()}
    document = {
        "name": "four poles",
        "blocks": {"u": {"kind": "input"}, "k": {"kind": "gain", "gain": 1}, "plant": plant},
        "connections": [{"from": "u", "to": "k"}, {"from": "k", "to": "plant"}],
        "outputs": {"y": "plant"},
    }
    return str(client.post("/v1/systems", json=document).json()["id"])


@pytest.fixture(scope="module")
def loop(client) -> str:
    plant = {"kind": "transfer_function", "numerator": [8], "denominator": [1, 3, 3, 1]}
    document = {
        "name": "three lags closed",
        "blocks": {"u": {"kind": "input"}, "e": {"kind": "sum", "signs": "+-"}, "k": {"kind": "gain", "gain": 0.3125}, "plant": plant},
        "connections": [{"from": "u", "to": "e.in1"}, {"from": "plant", "to": "e.in2"}, {"from": "e", "to": "k"}, {"from": "k", "to": "plant"}],
        "outputs": {"y": "plant"},
    }  # fmt: skip
    return str(client.post("/v1/systems", json=document).json()["id"])


def test_poles_are_painted_where_the_service_says_with_both_axes_alike(page: Page, open_path, client) -> None:
    reply = client.post("/v1/frequency-responses", json={"system": open_path, "from": "u", "to": "y"}).json()
    told = sorted((p["real"], p["imag"]) for p in reply["variants"][0]["poles"])
    assert np.array(told) == pytest.approx(np.array([(p.real, p.imag) for p in POLES]))
    opened(page, open_path, "s=k.gain&v=poles")
    page.wait_for_function("() => document.querySelector('[data-testid=plots]').dataset.frame > 0")
    marks, count = scipy.ndimage.label(blue(page, "Poles"), structure=np.ones((3, 3)))
    assert count == len(told)
    # Rows of a canvas go down; left to right, and of each pair the lower one first.
    centres = sorted(
        ((x, -y) for y, x in scipy.ndimage.center_of_mass(marks > 0, marks, range(1, count + 1))),
        key=lambda c: (round(c[0], -1), c[1]),
    )
    (across, left), (up, below) = (np.polyfit([p[i] for p in told], [c[i] for c in centres], 1) for i in range(2))
    assert across == pytest.approx(up, rel=0.01)
    for (real, imag), (x, y) in zip(told, centres, strict=True):
        assert (x, y) == pytest.approx((left + across * real, below + up * imag), abs=1)


def test_margins_stand_where_they_are_read(page: Page, loop, client) -> None:
    body = {"system": loop, "open_at": "e", "metrics": ["phase_margin", "gain_margin"]}
    metrics = client.post("/v1/frequency-responses", json=body).json()["variants"][0]["metrics"]
    # L = 2.5/(s + 1)^3: |L| = 1 at w^2 = 2.5^(2/3) - 1, -180 deg at w = sqrt(3), where |L| = 2.5/8.
    crossover = (2.5 ** (2 / 3) - 1) ** 0.5
    assert metrics["phase_margin"]["value"] == pytest.approx(np.pi - 3 * np.arctan(crossover))
    assert metrics["gain_margin"]["value"] == pytest.approx(3.2)
    opened(page, loop, "s=k.gain&loop=e&v=bode,phase,nyquist")
    phase, gain = np.degrees(metrics["phase_margin"]["value"]), 20 * np.log10(metrics["gain_margin"]["value"])
    for title, wanted in (("Bode: phase", [phase]), ("Bode: magnitude", [gain]), ("Nyquist", [phase, gain])):
        picture = page.get_by_role("region", name=title).get_by_role("img")
        expect(picture).to_have_attribute("aria-description", re.compile("φm|gm"))
        told = [float(text) for text in re.findall(r"[\d.]+", picture.get_attribute("aria-description") or "")]
        assert told == pytest.approx(wanted, rel=5e-3)
