"""A report written as HTML and as PDF, whatever is in it: what people wrote, thousands of rows, names without an end."""

from __future__ import annotations

import io
from html.parser import HTMLParser

import numpy as np
import pypdf
import pytest
from matplotlib.mathtext import MathTextParser

from api.services.reports import as_html, as_pdf
from api.services.reports.common import sentences
from api.services.reports.drawing import Line, Panel, bars, panels, thinned
from api.services.reports.matrices import matrix
from api.services.reports.model import MOST_ROWS, Report, Section, Sentence, table
from api.services.reports.responses import bode, nyquist, over_time
from api.services.reports.ticks import common, plain

HOSTILE = '<script>alert("1")</script> --> $x_{ & “Țăruș” </svg>'
LETTERS = "Țărușul şi îngheţul, µ ≤ 5 ° Ω ✓"
LONG = "a" * 5000


class Elements(HTMLParser):
    """The elements of a page, its texts, and where they point."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.names: list[str] = []
        self.texts: list[str] = []
        self.places: list[str] = []
        self.ids: list[str] = []
        self.feed(page.decode())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        for name, value in attrs:
            assert not name.startswith("on"), (tag, name)
            if name in {"src", "href", "xlink:href", "action", "data", "poster"}:
                self.places.append(str(value))
            if name == "id":
                self.ids.append(str(value))

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append(data)


def report(*sections: Section, title: str = "axis") -> Report:
    return Report(
        title=title, kind="Optimisation: report of a study", author="Ana", made_at="2026-01-02T03:04:05+00:00",
        facts=[("System", title)], sections=sections,
    )  # fmt: skip


def pages(content: bytes) -> list[str]:
    return [" ".join(page.extract_text().split()) for page in pypdf.PdfReader(io.BytesIO(content)).pages]


@pytest.fixture(scope="module")
def hostile() -> Report:
    time = np.linspace(0, 1, 50)
    figure = panels([Panel(HOSTILE, HOSTILE, HOSTILE, [Line(HOSTILE, time, time**2)])], HOSTILE)
    rows = table((HOSTILE, "value"), [(HOSTILE, LETTERS)], total=1)
    return report(Section(HOSTILE, [Sentence(HOSTILE, "bad"), rows, figure]), title=HOSTILE)


def test_what_people_wrote_is_text_and_nothing_else(hostile) -> None:
    found = Elements(as_html.write(hostile))
    assert "script" not in found.names
    # as title, heading, fact, heading of a section, paragraph, head of a column, cell, caption
    assert sum(HOSTILE in text for text in found.texts) >= 8
    assert found.names.count("svg") == 1
    # One SVG, closed once: what came after it is still of the page.
    assert found.names.index("figcaption") > found.names.index("svg")


def test_a_page_asks_nobody_for_anything(hostile) -> None:
    text = as_html.write(hostile)
    found = Elements(text)
    assert {"link", "img", "iframe", "object", "embed", "base", "form"}.isdisjoint(found.names)
    assert found.places
    assert all(place.startswith("#") for place in found.places)
    assert len(found.ids) == len(set(found.ids))
    assert {place[1:] for place in found.places} <= set(found.ids)
    assert b"@import" not in text
    assert b"url(#" in text
    assert text.count(b"url(") == text.count(b"url(#")


def test_a_pdf_has_the_letters_of_every_language_here(hostile) -> None:
    text = pages(as_pdf.write(hostile))[0]
    assert LETTERS in text
    assert '<script>alert("1")</script>' in text


def test_a_pdf_says_what_it_is() -> None:
    found = pypdf.PdfReader(io.BytesIO(as_pdf.write(report(Section("Goals", [Sentence("met")])))))
    assert found.metadata is not None
    assert (found.metadata.title, found.metadata.author) == ("axis · Optimisation: report of a study", "Ana")
    assert str(found.metadata.creation_date) == "2026-01-02 03:04:05+00:00"
    assert [entry.title for entry in found.outline] == ["Goals"]  # type: ignore[union-attr]


def test_the_same_report_is_the_same_file(hostile) -> None:
    assert as_html.write(hostile) == as_html.write(hostile)
    assert as_pdf.write(hostile) == as_pdf.write(hostile)


def test_a_table_of_thousands_of_rows_is_cut_and_says_so() -> None:
    made = table(("number", "name"), ((str(i), f"row {i}") for i in range(5000)), numeric=[0], total=5000)
    told = f"The first {MOST_ROWS} of 5000 rows"
    whole = report(Section("Rows", [made]))
    page = as_html.write(whole).decode()
    assert page.count("<tr>") == MOST_ROWS + 1
    assert told in page
    found = pages(as_pdf.write(whole))
    assert 3 <= len(found) <= 8
    assert told in found[-1]
    assert all("number name" in text for text in found[1:])  # its head again on every page


def test_names_without_an_end_wrap_and_are_cut() -> None:
    made = table(("name", "number", LONG), [(LONG, "1", LONG), ("b", "2", "c")], numeric=[1], total=2)
    whole = report(Section(LONG, [Sentence(LONG), made]), title="x" * 400)
    assert b"a" * 301 not in as_html.write(report(Section("t", [made])))
    for number, page in enumerate(pypdf.PdfReader(io.BytesIO(as_pdf.write(whole))).pages):
        width, places = float(page.mediabox.width), []
        page.extract_text(visitor_text=lambda text, _, matrix, *__, p=places: p.append((text, matrix[4])))
        assert all(0 <= x < width for text, x in places if text.strip()), number


def test_sentences_keep_the_names_that_they_begin_with_and_are_said_once() -> None:
    said = ["k would have to move", "", "  ", "k would have to move", "y follows"]
    assert sentences(said, "warning") == [Sentence("k would have to move", "warning"), Sentence("y follows", "warning")]
    *_, last = sentences(f"sentence {i}" for i in range(30))
    assert last == Sentence("10 more are left out; the result holds all of them.")


def test_columns_in_which_nothing_stands_are_left_out() -> None:
    made = table(("a", "", "n", "b"), [("1", "", "", "2"), ("3", "", "", "4")], numeric=[3], total=2)
    assert made.columns == ("a", "b")
    assert made.rows == (("1", "2"), ("3", "4"))
    assert made.numeric == {1}


def test_a_matrix_of_many_parameters_shows_the_strongest() -> None:
    row = {f"p{i}": float(i) for i in range(100)}
    parts = list(matrix({"Overshoot": row}, "Metric"))
    names = [name for part in parts[:-1] for name in part.columns[1:]]  # type: ignore[union-attr]
    assert names == [f"p{i}" for i in range(99, 75, -1)]
    assert parts[-1] == Sentence("The 24 strongest of 100 parameters; the result holds all of them.")


def test_figures_are_drawn_of_gaps_single_points_and_nothing() -> None:
    gaps = {"time": [0, 1, 2], "outputs": {"y": [None, 1.0, None], "dead": [None, None, None]}}
    parts = over_time({"a": gaps, "b": {"time": [0.5], "outputs": {"y": [2.0]}}}, {"y": "m"}, "outputs")
    assert len(parts) == 1
    assert over_time({"a": {"time": [], "outputs": {"y": []}}}, {}, "none") == []
    assert bode({"a": {"frequency": [], "magnitude": [], "phase": []}}, "none") is None
    assert bode({"a": {"frequency": [0.0, 1.0], "magnitude": [1.0, 0.0], "phase": [0.0, 0.0]}}, "none") is None
    assert nyquist({"a": {"real": [None], "imag": [None]}}, "none") is None
    as_pdf.write(report(Section("Figures", [*parts, bars([("a", 1.0), ("b", -2.0)], "elasticity", "bars")])))


def test_of_many_outputs_and_variants_the_rest_is_told() -> None:
    curves = {f"v{i}": {"time": [0, 1], "outputs": {f"y{k}": [0, i + k] for k in range(20)}} for i in range(30)}
    *_, last = over_time(curves, {}, "many")
    assert last == Sentence("12 more outputs and 18 more variants are not drawn; the result holds their curves.")


def test_a_figure_is_drawn_until_nothing_moves_any_more() -> None:
    time = np.linspace(0, 100, 1001)
    settled = {"a": {"time": time, "outputs": {"y": 1 - np.exp(-time)}}}
    moving = {"a": {"time": time, "outputs": {"y": np.sin(time)}}}
    short, long = (over_time(one, {}, "y")[0].svg for one in (settled, moving))  # type: ignore[union-attr]
    # Where the axis ends at 6 s it has no room for a mark at 80 s: both drawings differ in their marks.
    assert short.count("xtick_") != long.count("xtick_")


def test_a_long_curve_keeps_its_peaks_and_its_gaps() -> None:
    rng = np.random.default_rng(1)
    x, y = np.arange(100_000.0), rng.normal(size=100_000)
    y[70_123], y[40_001], y[10_000:20_000] = 9.0, -9.0, np.nan
    short_x, short_y = thinned(x, y)
    assert short_x.size <= 2000
    assert np.all(np.diff(short_x) > 0)
    assert (short_x[np.nanargmax(short_y)], short_x[np.nanargmin(short_y)]) == (70_123, 40_001)
    assert np.isnan(short_y[(short_x > 10_100) & (short_x < 19_900)]).all()
    assert thinned(x[:10], y[:10])[0].size == 10
    curves = {f"v{i}": {"time": x, "outputs": {"y": y}} for i in range(12)}
    (figure,) = over_time(curves, {}, "noise")
    assert len(figure.svg) < 1_500_000  # type: ignore[union-attr]


def test_figures_are_paths_without_texts_and_comments() -> None:
    figure = bars([(HOSTILE, 1.0), ("b", 2.0)], "elasticity", "bars")
    assert "<text" not in figure.svg
    assert "<!--" not in figure.svg
    assert "alert" not in figure.svg
    assert "metadata" not in figure.svg


@pytest.mark.parametrize(
    ("formula", "letters"),
    [
        (r"$\mathdefault{10^{2}}$", "10²"),
        (r"$\mathdefault{2\times10^{-13}}$", "2·10⁻¹³"),
        (r"$\mathdefault{-10^{0}}$", "−10⁰"),
        ("0.5", "0.5"),
        ("", ""),
    ],
)
def test_powers_of_ten_at_an_axis_are_letters(formula: str, letters: str) -> None:
    assert plain(formula) == letters


@pytest.mark.parametrize(
    ("offset", "letters"), [("1e−5", "10⁻⁵"), ("2.5e+12", "2.5·10¹²"), ("1e−6+3.2e1", "10⁻⁶+3.2·10¹"), ("", "")]
)
def test_the_common_factor_of_an_axis_is_letters(offset: str, letters: str) -> None:
    assert common(offset) == letters


def test_numbers_at_axes_are_no_formulas(monkeypatch) -> None:
    def formula(*_: object, **__: object) -> None:
        raise AssertionError("a formula was set")

    monkeypatch.setattr(MathTextParser, "parse", formula)
    wide, narrow = (
        Line("a", np.logspace(-3, 4, 50), np.logspace(-3, 4, 50)),
        Line("a", np.array([2.0, 7.0]), np.array([1e-9, 3e-9])),
    )
    drawn = panels([Panel("t", "ω", "y", [one], logarithmic=True) for one in (wide, narrow)], "axes").svg
    assert drawn.count("<path") > 10
