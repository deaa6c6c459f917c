"""What every page must be, whatever it is for: free of axe's faults in both themes, come to by keyboard, narrow enough, and still."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from playwright.sync_api import ConsoleMessage, Error, Page, Request, Response, expect

from tests.browser.driving import AXE, WCAG
from tests.browser.places import Mistake

Scheme = Literal["light", "dark"]

#: What of a page may jump while it comes, in parts of the window: below a tenth is called good (web.dev/cls).
MOST_SHIFT = 0.1
#: Rules of axe that look at colours: the others see the same page in both themes.
_OF_COLOURS = ["color-contrast", "link-in-text-block"]
_FIELDS = "input, select, textarea"
_WINDOWS = ((1024, 768), (820, 1180), (768, 1024))


@contextmanager
def quiet(page: Page, *, but: str = "") -> Iterator[list[str]]:
    """Collect what a page complains of: scripts that fail, what the policy refuses, requests that fail; `but` the address of one."""
    told: list[str] = []

    def said(message: ConsoleMessage) -> None:
        if message.type == "error" and not (but and message.location["url"].endswith(but)):
            told.append(f"console: {message.text[:300]}")

    def answered(reply: Response) -> None:
        if reply.status >= 400 and not (but and reply.url.endswith(but)):
            told.append(f"answered {reply.status}: {reply.request.method} {reply.url}")

    def failed(request: Request) -> None:
        # Whoever leaves a page gives up what it was still asking for.
        if request.failure != "net::ERR_ABORTED":
            told.append(f"failed: {request.url} {request.failure}")

    page.on("console", said)
    page.on("response", answered)
    page.on("requestfailed", failed)
    yield told
    page.remove_listener("console", said)
    page.remove_listener("response", answered)
    page.remove_listener("requestfailed", failed)


def unsound(page: Page, scheme: Scheme, *, patience: float | None = None) -> list[str]:
    """Return what is wrong with a page that shows one theme; it shows the other one afterwards, and its window keeps its size."""
    found = faults_of_both_themes(page, scheme)
    jumped = shifted(page)
    if jumped > MOST_SHIFT:
        found.append(f"what is there jumps by {jumped:.2f} of the window")
    return found + unreachable(page) + too_wide(page, patience)


def other(scheme: Scheme) -> Scheme:
    """Return the other theme."""
    return "dark" if scheme == "light" else "light"


def faults_of_both_themes(page: Page, scheme: Scheme) -> list[str]:
    """Return what axe finds against WCAG AA in the theme that is shown, and of colours in the other one."""
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = [
        f"{scheme}, {one}"
        for one in page.evaluate(_FAULTS, {"scheme": scheme, "rules": {"type": "tag", "values": WCAG}})
    ]
    scheme = other(scheme)
    page.emulate_media(color_scheme=scheme)
    rules = {"type": "rule", "values": _OF_COLOURS}
    return found + [f"{scheme}, {one}" for one in page.evaluate(_FAULTS, {"scheme": scheme, "rules": rules})]


def untold(page: Page, mistake: Mistake, *, patience: float | None = None) -> list[str]:
    """Make a mistake; return what is missing of the service's answer at the field it belongs to."""
    for label, text in mistake.fill.items():
        field = page.get_by_label(label, exact=True).and_(page.locator(_FIELDS)).first
        field.fill(text)
        field.press("Tab")
    for name in mistake.press:
        page.get_by_role("button", name=name, exact=True).click()
    field = page.get_by_label(mistake.at, exact=True).and_(page.locator(_FIELDS)).first
    try:
        expect(field).to_have_attribute("aria-invalid", "true", timeout=patience)
        expect(field).to_have_accessible_description(re.compile(re.escape(mistake.said)), timeout=patience)
    except AssertionError as error:
        return [f"not told at its field: {mistake.at}: {str(error)[:500]}"]
    return []


def shifted(page: Page) -> float:
    """Return by how much of the window what was there has jumped since the page was opened (cumulative layout shift)."""
    return float(page.evaluate(_SHIFT))


def unreachable(page: Page) -> list[str]:
    """Return what can be used with a mouse but is not come to with the tabulator key, and what does not show that it was come to."""
    count: int = page.evaluate(_BEGIN_TO_TAB)
    for _ in range(_ROUNDS):
        # Boxes that scroll are come to, too, and are not counted.
        for _ in range(count + 10):
            page.keyboard.down("Tab")  # held down: it repeats
        page.keyboard.up("Tab")
        if not page.evaluate(_LEFT):
            break
    found: list[str] = page.evaluate(_END_OF_TABS)
    return found


def too_wide(page: Page, patience: float | None) -> list[str]:
    """Return the windows in which a page must be scrolled sideways after some milliseconds; its own size comes back."""
    before = page.viewport_size
    assert before is not None
    found = []
    for width, height in ((before["width"], before["height"]), *_WINDOWS):
        page.set_viewport_size({"width": width, "height": height})
        try:
            page.wait_for_function("() => document.documentElement.scrollWidth <= innerWidth", timeout=patience)
        except Error:
            found.append(f"wider than a window of {width} x {height}: {page.evaluate(_WIDEST)}")
    page.set_viewport_size(before)
    return found


#: Colours that are on their way to others are not judged (a button that becomes usable, numbers that are being renewed): what is
#: found is looked at again before it is told.
_FAULTS = """async ({scheme, rules}) => {
  const pause = time => new Promise(resolve => setTimeout(resolve, time));
  const moves = () => document.getAnimations().some(one => one.playState === 'running' && one.effect.getTiming().iterations !== Infinity);
  const themed = () => (document.documentElement.dataset.mantineColorScheme ?? scheme) === scheme;
  let violations = [];
  for (const time of [0, 500, 2000]) {
    await pause(time);
    for (let i = 0; i < 3000 && (moves() || !themed()); i++) await pause(10);
    if (!themed()) return ['does not take the theme'];
    ({violations} = await axe.run(document, {runOnly: rules, resultTypes: ['violations'], preload: false, iframes: false}));
    if (violations.length === 0) return [];
  }
  return violations.flatMap(one => one.nodes.map(node => `${one.id}: ${node.target} ${node.failureSummary.slice(0, 300)}`));
}"""
_WIDEST = """() => [...document.querySelectorAll('body *')].filter(one => one.getBoundingClientRect().right > innerWidth)
  .slice(0, 3).map(one => one.outerHTML.slice(0, 120)).join(' ')"""
_SHIFT = """() => new Promise(resolve => {
  let sum = 0;
  const count = list => { for (const one of list) if (!one.hadRecentInput) sum += one.value; };
  const observer = new PerformanceObserver(list => count(list.getEntries()));
  observer.observe({type: 'layout-shift', buffered: true});
  setTimeout(() => { count(observer.takeRecords()); observer.disconnect(); resolve(sum); }, 0);
})"""
#: What appeared after the count, as blocks do when they have their places, lies between: what cannot be come to is not in any round.
_ROUNDS = 3
_LEFT = "() => [...window.tabbed.usable].some(one => one.isConnected)"
_BEGIN_TO_TAB = """() => {
  const all = document.querySelectorAll('a[href], button, input, select, textarea, [tabindex]');
  const one = element => element.checkVisibility({visibilityProperty: true}) && !element.disabled && element.tabIndex >= 0;
  // Of radio buttons that belong together the arrow keys reach the others.
  const usable = new Set([...all].filter(element => one(element) && !(element.type === 'radio' && !element.checked)));
  // The focus is shown on the element, on what it is in, or on what is drawn in its place.
  const near = element => [element, element.parentElement, element.parentElement?.parentElement, element.nextElementSibling, element.closest('label')];
  const looks = element => near(element).map(part => {
    if (!part) return '';
    const style = getComputedStyle(part);
    return [style.outlineStyle, style.outlineColor, style.boxShadow, style.borderColor, style.backgroundColor, style.left].join();
  }).join(';');
  const unseen = new Set(), shown = new Map();
  document.addEventListener('focusin', ({target}) => {
    usable.delete(target);
    shown.set(target, looks(target));
    target.scrollIntoView({block: 'nearest', inline: 'nearest', behavior: 'instant'});
    const {left, right, top, bottom} = target.getBoundingClientRect();
    if (right <= 0 || left >= innerWidth || bottom <= 0 || top >= innerHeight) unseen.add(target);
  });
  document.addEventListener('focusout', ({target}) => {
    if (target.isConnected && target.matches('a, button, input, select, textarea') && shown.get(target) === looks(target)) unseen.add(target);
  });
  window.tabbed = {usable, unseen};
  document.activeElement?.blur();
  unseen.clear();
  return usable.size;
}"""
_END_OF_TABS = """() => {
  document.activeElement?.blur();
  const told = (what, set) => [...set].filter(one => one.isConnected).map(one => `${what}: ${one.outerHTML.slice(0, 200)}`);
  return [...told('not reached by keyboard', window.tabbed.usable), ...told('does not show that it has the focus', window.tabbed.unseen)];
}"""
