"""A visitor who has no mouse: goes on by the tabulator key alone, and looks at every stop whether it shows where the focus is."""

from __future__ import annotations

from playwright.sync_api import Page

#: Stops after which a page has been gone through.
_MOST = 200
#: What stands at the focus, and whether it is seen there: by an outline, a shadow, or a border in the first colour.
_STOP = """async () => {
  const at = document.activeElement;
  if (!at || at === document.body) return null;
  // What is out of the window is brought into it, in a later frame where the page has just grown.
  for (let i = 0; i < 100; i++) {
    const {left, right, top, bottom} = at.getBoundingClientRect();
    if (right > 0 && left < innerWidth && bottom > 0 && top < innerHeight) break;
    await new Promise(resolve => setTimeout(resolve, 20));
  }
  const box = at.getBoundingClientRect();
  const first = document.createElement('i');
  first.style.color = 'var(--mantine-primary-color-filled)';
  document.body.append(first);
  const colour = getComputedStyle(first).color;
  first.remove();
  // What is drawn in place of the input itself: a box that it is in, the mark that follows it.
  const near = [at, at.parentElement, at.parentElement.parentElement, at.parentElement.parentElement?.parentElement, at.nextElementSibling].filter(Boolean).map(one => getComputedStyle(one));
  const marked = near.some(one => (one.outlineStyle !== 'none' && parseFloat(one.outlineWidth) > 0) || one.boxShadow !== 'none' || one.borderColor === colour);
  const inside = box.right > 0 && box.left < innerWidth && box.bottom > 0 && box.top < innerHeight;
  const name = at.getAttribute('aria-label') ?? at.labels?.[0]?.innerText ?? at.innerText ?? '';
  return {name: name.replace(/\\s*\\*$/, '').trim(), kind: at.getAttribute('role') ?? (at.type === 'range' ? 'slider' : at.localName), marked, inside, html: at.outerHTML.slice(0, 200)};
}"""


def step(page: Page, *, back: bool = False) -> tuple[str, str]:
    """Press the tabulator key; return kind and name of what it leads to, which must be in sight and marked."""
    page.keyboard.press("Shift+Tab" if back else "Tab")
    stop = page.evaluate(_STOP)
    if stop is None:
        return "", ""
    assert stop["inside"], f"what has the focus must be in the window, got {stop['html']}"
    assert stop["marked"], f"what has the focus must be marked, got {stop['html']}"
    return stop["kind"], stop["name"]


def go_to(page: Page, kind: str, name: str, *, back: bool = False) -> None:
    """Go on until something of this kind and name has the focus; an empty name is any."""
    seen = []
    for _ in range(_MOST):
        found = step(page, back=back)
        if found[0] == kind and name in ("", found[1]):
            return
        seen.append(found)
    raise AssertionError(f"{kind} {name!r} must be come to by the tabulator key, got {seen}")
