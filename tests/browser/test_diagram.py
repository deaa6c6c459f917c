"""The diagram editor: a loop drawn by mouse and keyboard, problems on their blocks, undo, and two tabs at once."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.frames import measured
from tests.browser.places import until

LOOP = {
    "name": "two tabs",
    "parameters": {"k": {"value": 2}},
    "blocks": {
        "u": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "gain": {"kind": "gain", "gain": "=k"},
        "plant": {"kind": "transfer_function", "numerator": [1], "denominator": [0.5, 1, 0]},
    },
    "connections": [
        {"from": "u", "to": "error.in1"},
        {"from": "plant", "to": "error.in2"},
        {"from": "error", "to": "gain"},
        {"from": "gain", "to": "plant"},
    ],
    "outputs": {"y": "plant"},
}


@pytest.fixture
def system(client) -> str:
    return str(client.post("/v1/systems", json=LOOP).json()["id"])


def opened(page: Page, system: str) -> None:
    page.goto(f"/systems/{system}/diagram")
    page.locator(".react-flow__node").first.wait_for()
    expect(page.get_by_test_id("check")).to_have_attribute("data-pending", "false")


def node(page: Page, name: str):
    return page.locator(f'.react-flow__node[data-id="{name}"]')


def test_a_loop_is_drawn_by_mouse_and_keyboard_and_simulated(page: Page, client) -> None:
    page.goto("/systems")
    page.get_by_role("button", name="New system", exact=True).click()
    page.wait_for_url("**/diagram")
    system = re.search(r"sys_\w+", page.url)[0]  # type: ignore[index]
    node(page, "plant").wait_for()
    # An empty canvas: everything is selected and removed.
    page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})
    page.keyboard.press("Control+a")
    page.keyboard.press("Delete")
    expect(page.locator(".react-flow__node")).to_have_count(0)
    expect(page.get_by_test_id("check")).to_have_text("needs an input and an output")
    canvas = page.locator(".react-flow__pane").bounding_box()
    assert canvas is not None

    def put(kind: str, search: str, x: float, y: float) -> None:
        page.get_by_role("searchbox", name="Find a block").fill(search)
        page.locator(f'[data-kind="{kind}"]').drag_to(
            page.locator(".react-flow__pane"), target_position={"x": x, "y": y}
        )

    put("input", "input", 90, 150)
    put("sum", "sum", 240, 150)
    put("integrator", "integrator", 420, 150)
    expect(page.locator(".react-flow__node")).to_have_count(3)
    # By mouse, from port to port.
    node(page, "input").locator(".source").drag_to(node(page, "sum").locator('[data-handleid="in1"]'))
    expect(page.locator(".react-flow__edge")).to_have_count(1)
    node(page, "sum").locator(".source").drag_to(node(page, "integrator").locator(".target"))
    # By keyboard alone: the block is added from the palette by Enter, and connected in its properties.
    page.get_by_role("searchbox", name="Find a block").fill("transfer function")
    page.locator('[data-kind="transfer_function"]').focus()
    page.keyboard.press("Enter")
    page.get_by_label("in gets").select_option("integrator")
    page.get_by_label("denominator *").fill("0.1, 1")
    page.keyboard.press("Enter")
    page.get_by_label("numerator *").fill("4")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Make out an output").click()
    node(page, "sum").click()
    page.get_by_label("signs *").fill("+-")
    page.keyboard.press("Enter")
    page.get_by_label("in2 gets").select_option("transfer_function")
    page.get_by_role("button", name="Lay out").click()
    page.keyboard.press("Control+s")
    expect(page.get_by_test_id("check")).to_have_text("saved")
    document = client.get(f"/v1/systems/{system}").json()["document"]
    assert document["blocks"]["transfer_function"] == {
        "kind": "transfer_function", "numerator": [4], "denominator": [0.1, 1]
    }  # fmt: skip
    body = {"system": system, "input": {"port": "input", "signal": {"kind": "step"}}, "metrics": ["overshoot"]}
    reply = client.post("/v1/simulations", json=body).json()["variants"][0]["metrics"]["transfer_function"]
    # 4/(s (0.1 s + 1)) closed: w0^2 = 40, d = 10/(2 sqrt(40)); overshoot exp(-pi d/sqrt(1 - d^2)).
    d = 10 / (2 * 40**0.5)
    assert reply["overshoot"]["value"] == pytest.approx(
        2.718281828459045 ** (-3.141592653589793 * d / (1 - d**2) ** 0.5)
    )


def test_what_is_wrong_stands_on_its_block_and_at_its_field(page: Page, system) -> None:
    opened(page, system)
    node(page, "plant").click()
    page.get_by_label("denominator *").fill("0, 0")
    page.keyboard.press("Enter")
    expect(page.get_by_test_id("check")).to_have_text("something is wrong")
    expect(node(page, "plant").locator('[data-problem="true"]')).to_be_visible()
    page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})
    page.keyboard.press("Control+z")
    expect(page.get_by_test_id("check")).to_have_text("saved")
    page.keyboard.press("Control+Shift+z")
    expect(page.get_by_test_id("check")).to_have_text("something is wrong")


def test_a_block_stays_where_it_is_dropped_and_an_output_takes_another_name(page: Page, system) -> None:
    opened(page, system)
    pane = page.locator(".react-flow__pane")
    box = pane.bounding_box()
    assert box is not None
    x, y = box["width"] - 90, box["height"] - 60
    page.locator('[data-kind="gain"]').drag_to(pane, target_position={"x": x, "y": y})

    def dropped() -> bool:
        """Whether the block lies where it was let go."""
        found = node(page, "gain_2").bounding_box()
        assert found is not None
        across = found["x"] < box["x"] + x < found["x"] + found["width"]
        return across and found["y"] < box["y"] + y < found["y"] + found["height"]

    until(dropped)
    # What is told about it lies over the canvas: nothing moves.
    expect(page.get_by_test_id("check")).to_have_attribute("data-pending", "false")
    assert pane.bounding_box() == box
    expect(page.locator("[data-recent=gain]")).to_be_visible()
    pane.click(position={"x": 5, "y": 5})
    page.get_by_role("textbox", name="Output y").fill("angle")
    page.keyboard.press("Enter")
    expect(node(page, "out:angle")).to_be_visible()
    expect(node(page, "out:y")).to_have_count(0)


#: Pixels from the end of the wire to the middle of the port that it leads to.
_APART = """() => {
  const path = document.querySelector(".react-flow__edge[data-id='error.in2'] path.react-flow__edge-path");
  const port = document.querySelector(".react-flow__node[data-id=error] [data-handleid=in2]");
  if (!path || !port) return Infinity;
  const end = path.getPointAtLength(path.getTotalLength()).matrixTransform(path.getScreenCTM());
  const { x, y, width, height } = port.getBoundingClientRect();
  return Math.hypot(end.x - x - width / 2, end.y - y - height / 2);
}"""


def test_a_wire_follows_the_port_of_a_sum_at_once(page: Page, system) -> None:
    opened(page, system)
    node(page, "error").click()
    port = node(page, "error").locator("[data-handleid=in2]")
    expect(port).to_have_class(re.compile("react-flow__handle-bottom"))
    # What a loop brings back comes from below; without it the port is on the left, and with it below again.
    page.get_by_label("in2 gets").select_option("")
    expect(port).to_have_class(re.compile("react-flow__handle-left"))
    page.get_by_label("in2 gets").select_option("plant")
    expect(port).to_have_class(re.compile("react-flow__handle-bottom"))
    page.wait_for_function(f"() => ({_APART})() < 12")


def test_copies_renames_and_signals(page: Page, system) -> None:
    opened(page, system)
    node(page, "gain").click()
    page.keyboard.press("Control+c")
    page.keyboard.press("Control+v")
    expect(node(page, "gain_2")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill("booster")
    page.keyboard.press("Enter")
    expect(node(page, "booster")).to_be_visible()
    page.locator('.react-flow__edge[data-id="plant.in"] path').first.dispatch_event("click")
    expect(page.get_by_role("heading", name="Signal at gain")).to_be_visible()


def table(page: Page, title: str) -> list[list[str]]:
    """Return the table that a plot exports."""
    page.get_by_role("button", name=f"Export {title}").click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name="Table").click()
    return [line.split(",") for line in download.value.path().read_text().splitlines()]


def test_blocks_are_cut_and_dissolved_and_a_signal_of_an_expression_is_seen(page: Page, system, client) -> None:
    opened(page, system)
    node(page, "gain").click()
    # What is selected stands in the address; a link, a reload shows it again.
    expect(page).to_have_url(re.compile(r"[?&]at=gain(&|$)"))
    page.reload()
    expect(page.get_by_label("gain *")).to_have_value("=k")
    page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})
    expect(page).not_to_have_url(re.compile("at="))
    node(page, "gain").click()
    page.keyboard.press("Control+x")
    expect(node(page, "gain")).to_have_count(0)
    page.keyboard.press("Control+z")
    expect(node(page, "gain")).to_be_visible()
    node(page, "gain").click()
    node(page, "plant").click(modifiers=["Control"])
    page.keyboard.press("Control+g")
    expect(page.locator(".react-flow__node")).to_have_count(4)
    page.keyboard.press("Control+Shift+g")
    expect(node(page, "plant")).to_be_visible()
    enter(page, "k", "2")
    page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})  # both were selected
    node(page, "gain").click()
    enter(page, "gain *", "=3*k")
    expect(page.get_by_test_id("check")).to_have_attribute("data-pending", "false")
    # Touched, the signal behind the gain is drawn: a step of 1 is an error of 1 at first, and 3 k = 6 behind the gain.
    page.locator('.react-flow__edge[data-id="plant.in"] path').first.dispatch_event("click")
    page.get_by_role("heading", name="Signal at gain").wait_for()
    expect(page).to_have_url(re.compile("signal=plant.in"))
    assert float(table(page, "Signal at gain")[1][1]) == pytest.approx(6.0)
    page.keyboard.press("Control+s")
    expect(page.get_by_test_id("check")).to_have_text("saved")
    document = client.get(f"/v1/systems/{system}").json()["document"]
    assert document["blocks"]["gain"]["gain"] == "=3*k"
    assert {wire["to"]: wire["from"] for wire in document["connections"]} == {
        wire["to"]: wire["from"] for wire in LOOP["connections"]
    }


def test_a_selection_becomes_a_subsystem_and_travels_to_another_system(page: Page, system, client) -> None:
    opened(page, system)
    node(page, "gain").click()
    node(page, "plant").click(modifiers=["Control"])
    page.keyboard.press("Control+g")
    expect(page.locator(".react-flow__node")).to_have_count(4)
    page.keyboard.press("F2")
    page.keyboard.type("drive")
    page.keyboard.press("Enter")
    expect(node(page, "drive")).to_be_visible()
    page.keyboard.press("Escape")
    page.keyboard.press("Control+s")
    expect(page.get_by_test_id("check")).to_have_text("saved")
    document = client.get(f"/v1/systems/{system}").json()["document"]
    assert document["connections"] == [
        {"from": "u", "to": "error.in1"},
        {"from": "drive", "to": "error.in2"},
        {"from": "error", "to": "drive"},
    ]
    assert document["blocks"]["drive"]["system"]["parameters"] == {"k": {"value": 2}}
    # Open: inside, as a frame with everything in one picture, and by the clipboard in another system.
    page.keyboard.press("f")
    expect(page.locator(".react-flow__node-frame")).to_have_count(1)
    expect(node(page, "drive.plant")).to_be_visible()
    node(page, "drive.plant").click()
    expect(page.get_by_label("numerator *")).to_have_value("[1]")
    page.keyboard.press("f")
    node(page, "drive").click()
    page.keyboard.press("Control+c")
    other = client.post("/v1/systems", json=LOOP).json()["id"]
    opened(page, other)
    page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})
    page.keyboard.press("Control+v")
    node(page, "drive").dblclick()
    expect(page).to_have_url(re.compile(r"\?in=drive$"))
    expect(node(page, "plant")).to_be_visible()


@pytest.fixture
def two(page: Page, visitor, system) -> Iterator[tuple[Page, Page]]:
    """Two tabs with the same system."""
    other = visitor.new_page()
    opened(page, system)
    opened(other, system)
    yield page, other
    other.close()


def enter(page: Page, field: str, text: str) -> None:
    page.get_by_label(field, exact=True).fill(text)
    page.keyboard.press("Enter")


def test_the_second_of_two_tabs_is_told_and_merges(two, system, client) -> None:
    page, other = two
    enter(other, "≤", "9")
    node(other, "gain").click()
    enter(other, "gain *", "7")
    other.keyboard.press("Control+s")
    expect(other.get_by_test_id("check")).to_have_text("saved")
    enter(page, "k", "5")
    node(page, "gain").click()
    enter(page, "gain *", "8")
    node(page, "plant").click()
    enter(page, "numerator *", "3")
    page.get_by_role("button", name="Save").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("parameters.k.upper")
    expect(dialog).to_contain_text("blocks.plant.numerator")
    # Both changed one gain: nothing is merged before somebody has chosen.
    expect(dialog.get_by_role("button", name="1 choice left")).to_be_disabled()
    dialog.get_by_role("radio", name="theirs: 7").check()
    dialog.get_by_role("button", name="Merge").click()
    expect(page.get_by_test_id("check")).to_have_text("saved")
    document = client.get(f"/v1/systems/{system}").json()["document"]
    assert document["parameters"]["k"] == {"value": 5, "upper": 9}
    assert document["blocks"]["gain"]["gain"] == 7
    assert document["blocks"]["plant"]["numerator"] == [3]


def test_what_is_edited_while_it_is_being_saved_stays(page: Page, system, client) -> None:
    opened(page, system)
    enter(page, "k", "3")
    held: list[Route] = []
    page.route(
        "**/v1/systems/*", lambda route: held.append(route) if route.request.method == "PUT" else route.fallback()
    )
    with page.expect_request(lambda request: request.method == "PUT"):
        page.keyboard.press("Control+s")
    enter(page, "k", "4")
    with page.expect_response(lambda response: response.request.method == "PUT"):
        held.pop().continue_()
    page.unroute_all()
    expect(page.get_by_role("button", name="Save", exact=True)).not_to_have_attribute("data-loading", "true")
    expect(page.get_by_test_id("check")).to_have_text("not saved yet")
    expect(page.get_by_label("k", exact=True)).to_have_value("4")
    page.keyboard.press("Control+s")
    expect(page.get_by_test_id("check")).to_have_text("saved")
    saved = client.get(f"/v1/systems/{system}").json()
    assert (saved["revision"], saved["document"]["parameters"]["k"]["value"]) == (3, 4)


def test_a_save_that_is_put_off_or_whose_answer_is_lost_comes_through(page: Page, system, client) -> None:
    opened(page, system)
    enter(page, "k", "3")
    asked: list[int] = []

    def answer(route: Route) -> None:
        if route.request.method != "PUT":
            return route.fallback()
        asked.append(1)
        if len(asked) == 1:
            return route.fulfill(status=429, json={"status": 429, "title": "later", "detail": "too much waits"})
        if len(asked) == 2:
            assert route.fetch().status == 200
            return route.abort()
        return route.continue_()

    page.route("**/v1/systems/*", answer)
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_test_id("waiting")).to_be_visible()
    expect(page.get_by_test_id("check")).to_have_text("saved")
    expect(page.get_by_test_id("waiting")).to_have_count(0)
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.unroute_all()
    saved = client.get(f"/v1/systems/{system}").json()
    assert (saved["revision"], saved["document"]["parameters"]["k"]["value"], len(asked)) == (2, 3, 3)


def test_edits_outlive_a_restart_of_the_service_and_of_the_page(page: Page, system, service, client) -> None:
    opened(page, system)
    service.stop()
    try:
        enter(page, "k", "6")
        page.get_by_role("button", name="Save").click()
        expect(page.get_by_test_id("waiting")).to_be_visible()
    finally:
        service.start()
    # Saved by itself as soon as the service is back; a new one loads the engine first.
    expect(page.get_by_test_id("check")).to_have_text("saved")
    assert client.get(f"/v1/systems/{system}").json()["document"]["parameters"]["k"] == {"value": 6}
    enter(page, "k", "11")
    expect(page.get_by_role("button", name="Save")).to_be_enabled()
    page.reload()
    expect(page.get_by_label("k", exact=True)).to_have_value("11")
    expect(page.get_by_text("Changes that were not saved are here again")).to_be_visible()
    page.get_by_role("button", name="Discard them").click()
    expect(page.get_by_label("k", exact=True)).to_have_value("6")


def test_what_is_wrong_inside_stands_on_the_subsystem_and_leads_there(page: Page, client) -> None:
    inner = {"blocks": {"in": {"kind": "input"}, "lag": {"kind": "transfer_function", "numerator": [1], "denominator": [1, 1]}}, "connections": [{"from": "in", "to": "lag"}], "outputs": {"out": "lag"}}  # fmt: skip
    outer = {"name": "inside", "blocks": {"u": {"kind": "input"}, "drive": {"kind": "subsystem", "system": inner}}, "connections": [{"from": "u", "to": "drive"}], "outputs": {"y": "drive"}}  # fmt: skip
    opened(page, str(client.post("/v1/systems", json=outer).json()["id"]))
    node(page, "drive").dblclick()
    node(page, "lag").click()
    enter(page, "denominator *", "0, 0")
    expect(node(page, "lag").locator('[data-problem="true"]')).to_be_visible()
    page.keyboard.press("Escape")
    page.keyboard.press("Alt+ArrowUp")
    expect(node(page, "drive").locator('[data-problem="true"]')).to_be_visible()
    page.get_by_role("alert").get_by_role("button", name="drive.lag").click()
    expect(page.get_by_label("denominator *")).to_be_visible()
    expect(page).to_have_url(re.compile(r"in=drive"))


def test_on_a_slow_machine_the_way_in_and_out_is_not_taken_back(page: Page, client) -> None:
    """The address is written behind the picture, and so late here that a delayed write of the selection comes between."""
    chain = {f"b{i}": {"kind": "gain", "gain": 1} for i in range(150)}
    inner = {
        "blocks": {"in": {"kind": "input"}, **chain},
        "connections": [{"from": f"b{i - 1}" if i else "in", "to": f"b{i}"} for i in range(150)],
        "outputs": {"out": "b149"},
    }
    outer = {
        "name": "slow",
        "blocks": {"u": {"kind": "input"}, "drive": {"kind": "subsystem", "system": inner}},
        "connections": [{"from": "u", "to": "drive"}],
        "outputs": {"y": "drive"},
    }
    opened(page, str(client.post("/v1/systems", json=outer).json()["id"]))
    node(page, "drive").click()
    expect(page).to_have_url(re.compile(r"\?at=drive$"))
    here = page.get_by_label("Where in the system").locator("[aria-current]")
    page.context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", {"rate": 6})
    page.keyboard.press("Enter")
    node(page, "b149").wait_for(state="attached")
    page.wait_for_timeout(1000)
    expect(page).to_have_url(re.compile(r"\?in=drive$"))
    expect(here).to_have_text("drive")
    page.keyboard.press("Alt+ArrowUp")
    expect(here).to_have_text("slow")
    page.wait_for_timeout(1000)
    expect(page).to_have_url(re.compile(r"\?at=drive$"))
    expect(here).to_have_text("slow")


def test_a_tab_that_is_overtaken_is_told_and_takes_theirs_or_keeps_its_own(two, system, client) -> None:
    page, other = two
    enter(other, "k", "7")
    other.keyboard.press("Control+s")
    expect(other.get_by_test_id("check")).to_have_text("saved")
    # Whoever comes back to a tab is told, without having saved anything.
    page.evaluate("window.dispatchEvent(new Event('visibilitychange'))")
    expect(page.get_by_test_id("overtaken")).to_be_visible()
    enter(page, "k", "5")
    page.get_by_test_id("overtaken").get_by_role("button").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_role("radio", name="theirs: 7")).to_be_visible()
    dialog.get_by_role("button", name="Take theirs").click()
    expect(dialog).to_have_count(0)
    expect(page.get_by_label("k", exact=True)).to_have_value("7")
    expect(page.get_by_test_id("overtaken")).to_have_count(0)
    # The next time mine is kept as it stands, over all that the other side has saved.
    node(other, "gain").click()
    enter(other, "gain *", "9")
    other.keyboard.press("Control+s")
    expect(other.get_by_test_id("check")).to_have_text("saved")
    enter(page, "k", "3")
    page.keyboard.press("Control+s")
    dialog.get_by_role("button", name="Keep mine").click()
    expect(dialog).to_have_count(0)
    expect(page.get_by_test_id("check")).to_have_text("saved")
    document = client.get(f"/v1/systems/{system}").json()["document"]
    assert (document["parameters"]["k"], document["blocks"]["gain"]["gain"]) == ({"value": 3}, "=k")


def test_three_hundred_blocks_stay_fluid(page: Page, client) -> None:
    frames = measured(page, client, moves=10)
    # How fast they are, `make bench-web` says; here, that every movement was painted and the block is where it was taken.
    assert len(frames["dragging"]) >= 10
    assert len(frames["panning"]) >= 10
