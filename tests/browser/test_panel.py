"""The front panel: sliders, live curves, comparisons, the address; and how it gets over a restart."""

from __future__ import annotations

import json
import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, Route, WebSocketRoute, expect

import servotune
from tests.browser.driving import KEY, PAGES, faults
from tests.browser.places import until
from tests.browser.test_matching import LAG

#: Turns a slider by one step on every frame of the screen; collects, for each, when its picture was painted.
DRAG = """async ({count}) => {
  const slider = document.querySelector('input[type=range]');
  const plots = document.querySelector('[data-testid=plots]');
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  const painted = [];
  let asked = 0;
  const observer = new MutationObserver(() => {
    const at = asked;
    const channel = new MessageChannel();
    channel.port1.onmessage = () => painted.push([at, performance.now()]);
    channel.port2.postMessage(0);
  });
  observer.observe(plots, {attributes: true, attributeFilter: ['data-frame']});
  const begun = performance.now();
  const latencies = [];
  for (let i = 0; i < count; i++) {
    const before = plots.dataset.frame;
    const started = performance.now();
    set.call(slider, 0.3 + 0.4 * i / count);
    asked = started;
    slider.dispatchEvent(new Event('input', {bubbles: true}));
    while (plots.dataset.frame === before && performance.now() - started < 2000) await new Promise(requestAnimationFrame);
    await new Promise(done => { const c = new MessageChannel(); c.port1.onmessage = done; c.port2.postMessage(0); });
    latencies.push(performance.now() - started);
  }
  observer.disconnect();
  return {latencies, seconds: (performance.now() - begun) / 1000};
}"""


def study(client, name: str) -> str:
    templates = json.loads((PAGES.parents[1] / "web/src/features/systems/templates.json").read_text())
    document = next(t for t in templates if t["id"] == name)["document"]
    return str(client.post("/v1/systems", json=document).json()["id"])


@pytest.fixture(scope="module")
def motor(client) -> str:
    return study(client, "dc-motor")


@pytest.fixture(scope="module")
def hydraulic(client) -> str:
    return study(client, "hydraulic-velocity")


def opened(page: Page, system: str, query: str) -> None:
    page.goto(f"/systems/{system}/panel?{query}")
    page.locator("[data-testid=plots][data-frame]").wait_for()


def settled(page: Page) -> None:
    """Wait until what was set last is painted: its metrics come behind its curves, and these are drawn with the next frame of the screen."""
    expect(page.get_by_test_id("metrics")).to_have_attribute("data-stale", "false")
    page.evaluate("() => new Promise(requestAnimationFrame)")


def middle(grip: Locator) -> tuple[float, float]:
    """Return where a grip is now."""
    box = grip.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


COMPARED = "s=motor.resistance,motor.inertia&in=voltage&amp=24&path=voltage,speed&cmp=motor.resistance:0.33,0.5,0.8"


def test_a_study_opens_with_its_comparisons(page: Page) -> None:
    page.goto("/systems")
    page.get_by_role("button", name="Open the study DC motor, three resistances").click()
    expect(page.get_by_test_id("chip")).to_have_count(3)
    page.locator("[data-testid=plots][data-frame]").wait_for()
    # The rise time of the motor's step, from the exact path; 24 V at 0.5 ohm.
    expect(page.locator("[data-metric=rise_time]")).to_contain_text("49.87 ms")


def test_keys_move_a_slider_and_the_address_follows(page: Page, motor) -> None:
    opened(page, motor, COMPARED)
    slider = page.get_by_role("slider", name="motor.resistance", exact=True)
    slider.focus()
    page.keyboard.press("Shift+ArrowRight")
    # 0.1..2.5 ohm on a log scale, half way plus a tenth: 0.5 * 25^0.1.
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.6899"))
    expect(page.get_by_role("textbox", name="Value of motor.resistance")).to_have_value("0.6899")
    page.keyboard.press("Home")
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.1(&|$)"))
    page.reload()
    expect(page.get_by_role("textbox", name="Value of motor.resistance")).to_have_value("0.1")


def test_a_key_that_follows_at_once_is_not_undone_by_the_address_of_the_one_before(page: Page, motor) -> None:
    opened(page, motor, COMPARED)
    # The address is written before the page is drawn for it: the next key goes down between the two.
    page.evaluate("""() => {
      const slider = document.querySelector('input[type=range]');
      const key = (kind, told) => slider.dispatchEvent(new KeyboardEvent(kind, {bubbles: true, cancelable: true, ...told}));
      const replace = history.replaceState;
      history.replaceState = (...told) => {
        replace.apply(history, told);
        if (!location.search.includes('0.6899')) return;
        history.replaceState = replace;
        key('keydown', {key: 'Home'});
        setTimeout(() => key('keyup', {key: 'Home'}), 500);
      };
      key('keydown', {key: 'ArrowRight', shiftKey: true});
      key('keyup', {key: 'ArrowRight', shiftKey: true});
    }""")
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.1(&|$)"))
    expect(page.get_by_role("textbox", name="Value of motor.resistance")).to_have_value("0.1")


def test_values_are_typed_with_prefixes_and_metrics_follow_exactly(page: Page, motor, client) -> None:
    opened(page, motor, COMPARED)
    entry = page.get_by_role("textbox", name="Value of motor.resistance")
    entry.fill("800 m")
    entry.press("Enter")
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.8"))
    body = {
        "system": motor,
        "input": {"port": "voltage", "signal": {"kind": "step", "amplitude": 24}},
        "metrics": ["rise_time"],
        "variants": [{"motor.resistance": 0.8}],
    }
    exact = client.post("/v1/simulations", json=body).json()["variants"][0]["metrics"]["speed"]["rise_time"]["value"]
    expect(page.locator("[data-metric=rise_time]")).to_contain_text(f"{1e3 * exact:.4g} ms")


def test_a_reference_is_pinned_and_told_apart(page: Page, motor) -> None:
    opened(page, motor, "s=motor.resistance&in=voltage&amp=24&path=voltage,speed")
    page.get_by_role("button", name="Pin as reference").click()
    expect(page.get_by_test_id("reference")).to_be_visible()
    page.get_by_role("slider", name="motor.resistance", exact=True).focus()
    page.keyboard.press("End")
    expect(page.get_by_test_id("metrics")).to_contain_text(re.compile("▲ [0-9]+"))
    expect(page).to_have_url(re.compile("ref=1"))


def test_new_comparisons_are_added_and_dropped(page: Page, motor) -> None:
    opened(page, motor, "s=motor.resistance&in=voltage&path=voltage,speed")
    entry = page.get_by_role("textbox", name="Values to compare")
    entry.fill("0.33; 500 m")
    entry.press("Enter")
    expect(page.get_by_test_id("chip")).to_have_count(2)
    expect(page).to_have_url(re.compile(r"cmp=motor\.resistance%3A0\.33%2C0\.5"))
    page.get_by_role("button", name="Drop 0.33").click()
    expect(page.get_by_test_id("chip")).to_have_count(1)


def test_a_refusal_is_forgotten_with_the_next_curves(page: Page, motor) -> None:
    spoiling = False

    def between(socket: WebSocketRoute) -> None:
        service = socket.connect_to_server()

        def told(text: str | bytes) -> None:
            message = json.loads(text)
            service.send(json.dumps(message | {"vectors": [[]]}) if spoiling and message["type"] == "set" else text)

        socket.on_message(told)

    page.route_web_socket("**/v1/live?*", between)
    opened(page, motor, COMPARED)
    refused = page.get_by_text("a vector must be 2 numbers, got 0")
    spoiling = True
    page.get_by_role("slider", name="motor.resistance", exact=True).press("End")
    expect(refused).to_be_visible()
    spoiling = False
    page.get_by_role("slider", name="motor.resistance", exact=True).press("Home")
    expect(refused).to_have_count(0)
    expect(page.get_by_test_id("metrics")).to_have_attribute("data-stale", "false")


def test_what_is_touched_at_once_counts_each_time(page: Page, motor) -> None:
    opened(page, motor, COMPARED)
    # No task of the page comes between the two, as where it has no time to draw between them.
    page.evaluate("""async () => {
      for (const name of ['Drop 0.33', 'Drop 0.8']) {
        document.querySelector(`[aria-label="${name}"]`).click();
        await null;
      }
    }""")
    expect(page.get_by_test_id("chip")).to_have_text("500 mΩ")
    expect(page).to_have_url(re.compile(r"cmp=motor\.resistance%3A0\.5(&|$)"))


def test_a_nichols_chart_has_the_phase_beside_the_magnitude(page: Page, client) -> None:
    system = client.post("/v1/systems", json=LAG).json()["id"]
    opened(page, system, "s=k&path=u,y&v=nichols")
    page.get_by_role("button", name="Export Nichols").click()
    with page.expect_download() as table:
        page.get_by_role("menuitem", name="Table").click()
    head, *lines = table.value.path().read_text().splitlines()
    assert head == '"now: phase [°]","now: magnitude [dB]"'
    phase, magnitude = np.array([line.split(",") for line in lines], dtype=float).T
    # Of k/(tau s + 1): |G| = k cos(arg G).
    assert magnitude == pytest.approx(20 * np.log10(1.5 * np.cos(np.radians(phase))), abs=1e-3)
    assert phase.min() < -80


#: 1 + k/(s (s + 2)) = 0: poles at -1 ± j sqrt(k - 1).
INTEGRATING = {
    "name": "root locus",
    "parameters": {"k": {"value": 5}},
    "blocks": {
        "u": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "plant": {"kind": "transfer_function", "numerator": ["=k"], "denominator": [1, 2, 0]},
    },
    "connections": [
        {"from": "u", "to": "error.in1"},
        {"from": "plant", "to": "error.in2"},
        {"from": "error", "to": "plant"},
    ],
    "outputs": {"y": "plant"},
}


def test_the_root_locus_of_a_parameter_is_drawn_and_taken_along(page: Page, client) -> None:
    system = client.post("/v1/systems", json=INTEGRATING).json()["id"]
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url) if "frequency-responses" in request.url else None)
    opened(page, system, "s=k&path=u,y&v=poles,step:y")
    page.get_by_role("button", name="More for k", exact=True).click()
    page.get_by_role("menuitem", name="Draw its root locus").click()
    grip = page.get_by_role("slider", name="root locus of k")
    expect(grip).to_have_attribute("aria-valuetext", "k = 5")
    page.get_by_role("button", name="Export Poles").click()
    with page.expect_download() as table:
        page.get_by_role("menuitem", name="Table").click()
    head, *lines = table.value.path().read_text().splitlines()
    assert head.endswith('"root locus of k: Re [1/s]","root locus of k: Im [rad/s]"')
    s = np.array([complex(float(re), float(im)) for re, im in (line.split(",")[2:] for line in lines) if re])
    gains = -(s * s + 2 * s)
    assert s.size == 2 * 121
    assert np.abs(gains.imag).max() < 1e-9
    # From a fifth of the value to five times it, on the real axis up to k = 1.
    assert sorted({round(gain, 6) for gain in gains.real})[::120] == [1, 25]
    page.get_by_role("slider", name="root locus of k").focus()
    page.keyboard.press("ArrowUp")
    expect(page).to_have_url(re.compile(r"p\.k=5\.\d+"))
    expect(grip).to_have_attribute("aria-valuetext", re.compile(r"k = 5\.\d+"))
    settled(page)
    x, y = middle(grip)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 20)
    page.mouse.up()
    # Down the line Re s = -1, on which k = 1 + (Im s)^2.
    expect(page).to_have_url(re.compile(r"p\.k=[1-4]\.\d+"))
    value = float(re.search(r"p\.k=([\d.]+)", page.url)[1])  # type: ignore[index] # it was waited for
    expect(grip).to_have_attribute("aria-valuetext", f"k = {value:.4g}")
    expect(page.get_by_role("textbox", name="Value of k")).to_have_value(f"{value:.6g}")
    assert faults(page) == []
    assert len(asked) == 1


def test_curves_over_frequency_are_pulled_and_the_gain_follows(page: Page, client) -> None:
    system = client.post("/v1/systems", json=INTEGRATING).json()["id"]
    fine: list[Route] = []

    def keep_fine(route: Route) -> None:
        if len(route.request.post_data_json["variants"]) > 5:
            fine.append(route)
        else:
            route.continue_()

    page.route("**/v1/frequency-responses", keep_fine)
    opened(page, system, "s=k&loop=error&v=bode,nyquist,nichols")
    page.get_by_role("button", name="More for k", exact=True).click()
    page.get_by_role("menuitem", name="Pull curves over frequency with it").click()
    expect(page).to_have_url(re.compile("pl=k"))
    entry = page.get_by_role("textbox", name="Value of k")

    def grip(plane: str) -> Locator:
        return page.locator(f"[data-zone='pull:{plane}']")

    # A few values are enough to take hold of a curve.
    for plane in ("bode", "nyquist", "nichols"):
        expect(grip(plane)).to_be_visible()
    until(lambda: fine)
    with page.expect_response("**/v1/frequency-responses"):
        fine[0].continue_()
    page.unroute("**/v1/frequency-responses")
    for plane in ("bode", "nyquist", "nichols"):
        expect(grip(plane)).to_have_attribute("aria-valuetext", "k = 5")
        expect(grip(plane)).to_have_attribute("aria-label", "curve by k")
        # The grip is at the crossover, which lies further out when the gain is larger.
        value = float(entry.input_value())
        grip(plane).focus()
        page.keyboard.press("ArrowDown" if plane == "nyquist" else "ArrowUp")
        expect(entry).not_to_have_value(f"{value:g}")
        assert float(entry.input_value()) > value, plane
        page.get_by_role("button", name="Reset k to the document's value").click()
        expect(entry).to_have_value("5")
    # To the right along 0 dB: there the curve has its crossover then, and there the grip is.
    expect(grip("bode")).to_have_attribute("aria-valuetext", "k = 5")
    settled(page)
    x, y = middle(grip("bode"))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y, steps=4)
    page.mouse.up()
    expect(page).to_have_url(re.compile(r"p\.k=\d"))
    value = float(re.search(r"p\.k=([\d.]+)", page.url)[1])  # type: ignore[index] # it was waited for
    expect(grip("bode")).to_have_attribute("aria-valuetext", f"k = {value:.4g}")
    # The axis of magnitudes has been fitted anew. The grip tells its value with the next picture, whichever curve that one shows.
    until(lambda: middle(grip("bode"))[0] == pytest.approx(x + 30, abs=1.5))
    assert value > 5
    # What is held follows the hand, in a Nichols chart straight up: the phase at a frequency does not depend on the gain.
    expect(grip("nichols")).to_have_attribute("aria-valuetext", f"k = {value:.4g}")
    settled(page)
    x, y = middle(grip("nichols"))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 15, steps=3)
    until(lambda: middle(grip("nichols")) == pytest.approx((x, y + 15), abs=2.5))
    page.mouse.up()
    expect(page).not_to_have_url(re.compile(rf"p\.k={value:g}(&|$)"))
    # The address is changed first, the entry when the page is drawn anew.
    expect(entry).not_to_have_value(f"{value:g}")
    assert float(entry.input_value()) < value
    assert faults(page) == []


def test_why_a_curve_cannot_be_pulled_is_told(page: Page, client) -> None:
    system = client.post("/v1/systems", json=INTEGRATING).json()["id"]
    problem = {"type": "about:blank", "title": "Too large", "status": 422, "detail": "ask for less at a time"}
    page.route(
        "**/v1/frequency-responses",
        lambda route: route.fulfill(status=422, json=problem, content_type="application/problem+json"),
    )
    opened(page, system, "s=k&loop=error&v=bode&pl=k")
    expect(page.get_by_role("alert")).to_contain_text("ask for less at a time")


def test_plots_leave_as_picture_and_table(page: Page, motor) -> None:
    opened(page, motor, "s=motor.resistance&in=voltage&amp=24&path=voltage,speed")
    page.get_by_role("button", name="Export speed").click()
    with page.expect_download() as picture:
        page.get_by_role("menuitem", name="Picture (PNG)").click()
    assert picture.value.path().read_bytes().startswith(b"\x89PNG")
    # As lines, with what stands at the axes; poles are marks in a plane.
    for title, axis in (("speed", "time [s]"), ("Poles", "Re [1/s]")):
        page.get_by_role("button", name=f"Export {title}").click()
        with page.expect_download() as drawing:
            page.get_by_role("menuitem", name="Picture (SVG)").click()
        svg = ET.fromstring(drawing.value.path().read_bytes())
        texts = {element.text for element in svg.iter("{http://www.w3.org/2000/svg}text")}
        assert {title, axis, "0"} <= texts
        ways = [element.get("d", "") for element in svg.iter("{http://www.w3.org/2000/svg}path")]
        assert max(way.count("L") for way in ways) > (20 if title == "speed" else 0)
        assert not any("NaN" in way for way in ways)
    page.get_by_role("button", name="Export speed").click()
    expect(page.get_by_role("menuitem", name="Table")).to_be_visible()
    assert faults(page) == []
    with page.expect_download() as table:
        page.get_by_role("menuitem", name="Table").click()
    lines = table.value.path().read_text().splitlines()
    assert "speed [rad/s]" in lines[0]
    # K = k/(R b + k^2) of the motor, times 24 V.
    assert float(lines[1000].split(",")[1]) == pytest.approx(24 * 0.2 / (0.5 * 1e-3 + 0.2**2), rel=1e-3)


def test_a_goal_is_dragged_as_a_zone_and_searched_for(page: Page, hydraulic) -> None:
    opened(page, hydraulic, "s=law.kp&in=reference&loop=error&amp=0.1&v=step:velocity,nyquist")
    page.get_by_label("Add a goal").select_option("overshoot")
    bound = page.get_by_role("textbox", name="Bound of overshoot")
    expect(bound).to_have_value("10")
    # The study overshoots by 55 %: the goal is missed, in the strip and at the goal.
    expect(page.get_by_test_id("goal")).to_have_attribute("data-met", "false")
    grip = page.locator("[data-zone=overshoot]")
    settled(page)
    x, y = middle(grip)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 28, steps=3)
    page.mouse.up()
    # The address hears of it once, when the edge is let go.
    expect(page).to_have_url(re.compile(r"g=overshoot%3C0\.[1-9]"))
    dragged = 100 * float(re.search(r"g=overshoot%3C([\d.]+)", page.url)[1])  # type: ignore[index] # it was waited for
    assert dragged > 10
    expect(bound).to_have_value(f"{dragged:.3g}")
    grip.focus()
    page.keyboard.press("ArrowUp")
    expect(bound).not_to_have_value(f"{dragged:.3g}")
    bound.fill("90")
    bound.press("Enter")
    expect(page.get_by_test_id("goal")).to_have_attribute("data-met", "true")
    assert faults(page) == []
    page.get_by_role("link", name="Optimise for these").click()
    expect(page.get_by_role("textbox", name="At most, goal 1")).to_have_value("0.9")


def test_snapshots_are_kept_compared_and_taken_back(page: Page, motor) -> None:
    opened(page, motor, "s=motor.resistance&in=voltage&amp=24&path=voltage,speed")
    page.get_by_role("button", name="Keep a snapshot").click()
    expect(page.get_by_test_id("snapshot")).to_contain_text("snapshot 1")
    entry = page.get_by_role("textbox", name="Value of motor.resistance")
    entry.fill("0.8")
    entry.press("Enter")
    page.get_by_role("button", name="Compare in a table").click()
    row = page.get_by_test_id("compared").get_by_role("row").filter(has_text="motor.resistance")
    expect(row).to_contain_text("800 mΩ")
    expect(row).to_contain_text("500 mΩ")
    # At 0.5 ohm, from the exact path, as in the study.
    expect(page.get_by_test_id("compared").get_by_role("row").filter(has_text="rise time")).to_contain_text("49.87 ms")
    page.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Take back snapshot 1").click()
    expect(entry).to_have_value("0.5")


def test_a_knob_is_turned_and_its_travel_made_linear(page: Page, motor) -> None:
    opened(page, motor, "s=motor.resistance&in=voltage&amp=24&path=voltage,speed&k=motor.resistance")
    knob = page.get_by_role("slider", name="motor.resistance", exact=True)
    box = knob.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 24, box["y"] + 24)
    page.mouse.down()
    page.mouse.move(box["x"] + 24, box["y"] - 20, steps=2)
    page.mouse.up()
    # 44 of 220 pixels are a fifth of the way from 0.1 to 2.5 ohm, a factor of 25^0.2.
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.9518"))
    page.get_by_role("button", name="More for motor.resistance").click()
    page.get_by_role("menuitem", name="Linear travel").click()
    expect(page).to_have_url(re.compile(r"lin=motor\.resistance"))
    expect(knob).to_have_attribute("aria-valuenow", "0.3549")  # (0.9518 - 0.1)/2.4
    knob.focus()
    page.keyboard.press("End")
    page.keyboard.press("Shift+ArrowLeft")
    # A tenth of 2.4 ohm below the end.
    expect(page.get_by_role("textbox", name="Value of motor.resistance")).to_have_value("2.26")


def test_a_recording_lies_over_its_curve_with_its_noise(page: Page, motor, service, record_property) -> None:
    noise = np.random.default_rng(1).normal(0.0, 3.0, 2000)
    time = np.arange(2000) * 1e-3
    speed = 118.5 * (1 - np.exp(-np.maximum(time - 0.1, 0.0) / 0.023)) + noise
    document = {"name": "a step", "format": "raw", "sample_rate": 1000, "channels": [{"name": "tacho", "unit": "rpm"}]}
    with servotune.connect(service.url, key=KEY) as client:
        client.datasets.upload(document, (speed * 30 / np.pi).astype("<f8").tobytes())
    opened(page, motor, "s=motor.resistance&in=voltage&amp=24&path=voltage,speed&T=0.2&v=step:speed,spectrum:speed")
    page.get_by_role("button", name="Overlay a recording").click()
    page.get_by_label("Recording", exact=True).select_option("a step")
    page.get_by_label("Channel", exact=True).select_option("tacho")
    page.get_by_label("Begins in the recording at").fill("100 m")
    page.get_by_label("Begins in the recording at").press("Enter")
    page.get_by_role("button", name="Overlay a recording").last.click()
    expect(page.get_by_test_id("recording")).to_contain_text("tacho → speed")
    # The scatter of the samples, 3 rad/s, is found again in the noise of the recording.
    expect(page.get_by_text(re.compile(r"tacho, measured \(σ (2\.[6-9]|3|3\.[0-4]) rad/s\)")).first).to_be_visible()
    page.get_by_role("button", name="Export speed").click()
    with page.expect_download() as table:
        page.get_by_role("menuitem", name="Table").click()
    lines = table.value.path().read_text().splitlines()
    measured = np.array([float(line.split(",")[-1]) for line in lines[501:1001]])
    assert np.mean(measured) == pytest.approx(118.5, abs=1.5)
    assert faults(page) == []


def steady_speed(resistance: float) -> float:
    """Return the motor's speed at 24 V, rad/s: K = k/(R b + k^2)."""
    return 24 * 0.2 / (resistance * 1e-3 + 0.2**2)


def test_earlier_settings_stay_behind_as_shadows_and_influences_lie_behind_the_labels(page: Page, motor) -> None:
    opened(page, motor, "s=motor.resistance,motor.inertia&in=voltage&amp=24&path=voltage,speed&v=step:speed&T=3")
    entry = page.get_by_role("textbox", name="Value of motor.resistance")
    entry.fill("2400 mohm")
    entry.press("Enter")
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=2\.4"))
    settled(page)
    page.get_by_role("button", name="Export speed").click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name="Table").click()
    header, *rows = [line.split(",") for line in download.value.path().read_text().splitlines()]
    now, before = (
        next(i for i, text in enumerate(header) if name in text and "rad/s" in text)
        for name in ("now", "earlier setting 1")
    )
    assert float(rows[-1][now]) == pytest.approx(steady_speed(2.4), rel=1e-2)
    assert float(rows[-1][before]) == pytest.approx(steady_speed(0.5), rel=1e-2)
    # The chosen metric colours the labels and stands in the address. A heavier rotor is slower: T = J R/(R b + k^2).
    page.get_by_test_id("metrics").get_by_role("button", name="rise time").click()
    expect(page).to_have_url(re.compile("[?&]m=rise_time"))
    slider = page.get_by_role("slider", name="motor.inertia", exact=True).locator("xpath=../..")
    expect(slider.locator("[data-sign=plus]")).to_have_attribute("style", "width: 100%;")
    page.get_by_role("button", name="Reset motor.resistance to the document's value").click()
    expect(entry).to_have_value("0.5")
    page.reload()
    expect(page.get_by_text("Bars: influence on rise time")).to_be_visible()


def test_settings_are_saved_as_a_revision(page: Page, client) -> None:
    own = study(client, "dc-motor")
    opened(page, own, "s=motor.resistance&in=voltage&amp=24&path=voltage,speed&p.motor.resistance=0.8")
    page.get_by_role("button", name="Save as revision").click()
    expect(page).not_to_have_url(re.compile(r"p\.motor\.resistance"))
    expect(page.get_by_role("textbox", name="Value of motor.resistance")).to_have_value("0.8")
    saved = client.get(f"/v1/systems/{own}").json()
    assert saved["revision"] == 2
    assert saved["document"]["blocks"]["motor"]["resistance"] in (0.8, {"value": 0.8, "unit": "ohm"})


def test_what_is_moved_while_the_rest_is_being_saved_stays(page: Page, client) -> None:
    own = study(client, "dc-motor")
    opened(page, own, "s=motor.resistance,motor.inertia&in=voltage&amp=24&path=voltage,speed&p.motor.resistance=0.8")
    held: list[Route] = []
    page.route(
        "**/v1/systems/*", lambda route: held.append(route) if route.request.method == "PUT" else route.fallback()
    )
    with page.expect_request(lambda request: request.method == "PUT"):
        page.get_by_role("button", name="Save as revision").click()
    inertia = page.get_by_role("textbox", name="Value of motor.inertia")
    inertia.fill("0.004")
    inertia.press("Enter")
    resistance = page.get_by_role("textbox", name="Value of motor.resistance")
    resistance.fill("0.9")
    resistance.press("Enter")
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.9"))
    with page.expect_response(lambda response: response.request.method == "PUT"):
        held.pop().continue_()
    expect(page.get_by_role("button", name="Save as revision")).not_to_have_attribute("data-loading", "true")
    assert client.get(f"/v1/systems/{own}").json()["revision"] == 2
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=0\.9&p\.motor\.inertia=0\.004"))
    expect(inertia).to_have_value("0.004")
    expect(resistance).to_have_value("0.9")


def test_dragging_paints_in_time(page: Page, motor, record_property) -> None:
    opened(page, motor, COMPARED + ",1.1&v=step:speed,bode,phase")
    page.evaluate(DRAG, {"count": 10})  # the first ones load and compile
    found = page.evaluate(DRAG, {"count": 60})
    latencies = sorted(found["latencies"])
    p50, p95 = latencies[30], latencies[56]
    record_property("drag", f"p50 {p50:.0f} ms, p95 {p95:.0f} ms, {60 / found['seconds']:.0f} updates/s")
    # A machine that builds and tests other things at the same time is several times slower than a free one.
    assert p50 < 250


def test_the_panel_goes_on_after_a_restart(page: Page, motor, service, client) -> None:
    opened(page, motor, COMPARED + "&p.motor.inertia=0.004&g=rise_time%3C0.08&sn=kept~1~motor.resistance%3D0.7")
    service.stop()
    expect(page.get_by_text("The service does not answer")).to_be_visible()
    slider = page.get_by_role("slider", name="motor.resistance", exact=True)
    slider.focus()
    page.keyboard.press("End")
    service.start()
    expect(page.get_by_text("The service does not answer")).to_have_count(0)
    before = page.get_by_test_id("plots").get_attribute("data-frame")
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("n => document.querySelector('[data-testid=plots]').dataset.frame !== n", arg=before)
    expect(page).to_have_url(re.compile(r"p\.motor\.resistance=2\.4"))
    # Nothing that was set is lost: what is measured now is of the values from before and during the restart.
    entry = page.get_by_role("textbox", name="Value of motor.resistance")
    expect(entry).to_have_value(re.compile(r"^2\.4"))
    kept = float(entry.input_value())
    body = {
        "system": motor,
        "input": {"port": "voltage", "signal": {"kind": "step", "amplitude": 24}},
        "metrics": ["rise_time"],
        "variants": [{"motor.resistance": kept, "motor.inertia": 0.004}],
    }
    exact = client.post("/v1/simulations", json=body).json()["variants"][0]["metrics"]["speed"]["rise_time"]["value"]
    expect(page.locator("[data-metric=rise_time]")).to_contain_text(f"{1e3 * exact:.4g} ms")
    expect(page.get_by_test_id("chip")).to_have_count(3)
    expect(page.get_by_test_id("snapshot")).to_have_count(1)
    expect(page.get_by_test_id("goal")).to_have_count(1)
