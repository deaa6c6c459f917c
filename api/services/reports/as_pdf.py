"""A report as a PDF of A4 pages: text that can be searched, figures as paths, the letters of DejaVu Sans in it.

fpdf2 and the fonts, which come with matplotlib, are loaded here and by nobody else.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from api.services.reports.drawing import INK, QUIET, RULE
from api.services.reports.model import Figure, Report, Section, Sentence, Table, Tone

if TYPE_CHECKING:
    from fpdf import FPDF

MEDIA_TYPE = "application/pdf"
_MARGIN, _FOOT = 15.0, 16.0
"""mm."""
_FONT = "DejaVu"
_LINE = 1.35
"""Distance of lines over the size of letters."""
_MM = 25.4 / 72
"""mm in a point."""
_TONES: dict[Tone, str] = {"plain": INK, "good": "#1d7044", "warning": "#8a5200", "bad": "#a3231d"}


def write(report: Report) -> bytes:
    """Return the file."""
    pdf = _document(report)
    _head(pdf, report)
    for section in report.sections:
        _section(pdf, section)
    return bytes(pdf.output())


def _document(report: Report) -> FPDF:
    """Return an empty document with its fonts, its margins, and what it says of itself."""
    from fpdf import FPDF  # noqa: PLC0415 - only where a report is written

    # Every letter that is taken out of a font is worth a line to it.
    logging.getLogger("fontTools").setLevel(logging.WARNING)

    class Paged(FPDF):
        def footer(self) -> None:
            self.set_y(-_FOOT + 4)
            self.set_font(_FONT, size=7)
            self.set_text_color(QUIET)
            self.cell(self.epw - 22, 4, _fitting(self, report.title, self.epw - 24))
            self.cell(22, 4, f"{self.page_no()} / {{nb}}", align="R")

    pdf = Paged(format="A4")
    from matplotlib import get_data_path  # noqa: PLC0415 - as above

    fonts = Path(get_data_path()) / "fonts" / "ttf"
    pdf.add_font(_FONT, fname=fonts / "DejaVuSans.ttf")
    pdf.add_font(_FONT, "B", fonts / "DejaVuSans-Bold.ttf")
    pdf.set_margins(_MARGIN, _MARGIN)
    pdf.set_auto_page_break(auto=True, margin=_FOOT)
    pdf.set_title(f"{report.title} · {report.kind}")
    pdf.set_author(report.author)
    pdf.set_lang(report.language)
    made = datetime.fromisoformat(report.made_at)
    pdf.set_creation_date(made if made.tzinfo else made.replace(tzinfo=UTC))
    pdf.add_page()
    return pdf


def _fitting(pdf: FPDF, text: str, room: float) -> str:
    """Return as much of a text as goes on one line of this width (mm)."""
    if pdf.get_string_width(text) <= room:
        return text
    while text and pdf.get_string_width(text + "…") > room:
        text = text[:-1]
    return text + "…"


def _lines(pdf: FPDF, text: str, *, size: float, color: str = INK, bold: bool = False, indent: float = 0.0) -> None:
    """Write a paragraph across the page."""
    pdf.set_font(_FONT, "B" if bold else "", size)
    pdf.set_text_color(color)
    pdf.set_x(_MARGIN + indent)
    pdf.multi_cell(pdf.epw - indent, size * _MM * _LINE, text, align="L", new_x="LMARGIN", new_y="NEXT")


def _head(pdf: FPDF, report: Report) -> None:
    _lines(pdf, report.kind, size=9, color=QUIET)
    _lines(pdf, report.title, size=17, bold=True)
    pdf.ln(3)
    _rows(pdf, Table(("", ""), frozenset(), tuple(report.facts)), quiet_first=True)


def _section(pdf: FPDF, section: Section) -> None:
    # A heading stands on the page of what it is about, and so does the sentence before a figure.
    figure = next((part for part in section.parts[:2] if isinstance(part, Figure)), None)
    needed = 28 + (0 if figure is None else _height(pdf, figure))
    if pdf.get_y() + needed > pdf.h - _FOOT:
        pdf.add_page()
    pdf.ln(5)
    pdf.set_font(_FONT, "B", 11.5)
    pdf.set_text_color(INK)
    pdf.start_section(section.title)
    _lines(pdf, section.title, size=11.5, bold=True)
    pdf.ln(1)
    for part in section.parts:
        if isinstance(part, Sentence):
            _sentence(pdf, part)
        elif isinstance(part, Table):
            _rows(pdf, part)
            if part.note:
                _lines(pdf, part.note, size=7.5, color=QUIET)
        else:
            _figure(pdf, part)


def _sentence(pdf: FPDF, sentence: Sentence) -> None:
    plain = sentence.tone == "plain"
    page, top = pdf.page, pdf.get_y()
    _lines(pdf, sentence.text, size=8.5, indent=0.0 if plain else 3.0)
    if not plain and pdf.page == page:
        with pdf.local_context(fill_color=_TONES[sentence.tone]):
            pdf.rect(_MARGIN, top + 0.4, 0.8, pdf.get_y() - top - 0.8, style="F")
    pdf.ln(1)


def _height(pdf: FPDF, figure: Figure) -> float:
    return pdf.epw * figure.height / figure.width + 8


def _figure(pdf: FPDF, figure: Figure) -> None:
    if pdf.get_y() + _height(pdf, figure) > pdf.h - _FOOT:
        pdf.add_page()
    pdf.ln(1)
    pdf.image(io.BytesIO(figure.svg.encode()), x=_MARGIN, w=pdf.epw, alt_text=figure.caption)
    _lines(pdf, figure.caption, size=7.5, color=QUIET)
    pdf.ln(2)


def _rows(pdf: FPDF, table: Table, *, quiet_first: bool = False) -> None:
    """Write a table, its head again on every page."""
    if not table.rows:
        return
    from fpdf import FontFace  # noqa: PLC0415 - as above

    pdf.set_font(_FONT, size=7.5)
    pdf.set_text_color(INK)
    pdf.set_draw_color(RULE)
    has_head = any(table.columns)
    widths = _widths(pdf, table)
    aligns = tuple("RIGHT" if i in table.numeric else "LEFT" for i in range(len(table.columns)))
    with pdf.table(
        width=sum(widths),
        col_widths=widths,
        align="LEFT",
        text_align=aligns,
        v_align="TOP",
        borders_layout="NONE" if quiet_first else "HORIZONTAL_LINES",
        first_row_as_headings=has_head,
        num_heading_rows=1 if has_head else 0,
        headings_style=FontFace(emphasis="BOLD", color=QUIET),
        line_height=7.5 * _MM * _LINE,
        padding=(0.5 if quiet_first else 0.9, 1.6),
    ) as drawn:
        if has_head:
            drawn.row(table.columns)
        for row in table.rows:
            line = drawn.row()
            for i, cell in enumerate(row):
                line.cell(cell, style=FontFace(color=QUIET) if quiet_first and i == 0 else None)
    pdf.ln(1.5)


def _widths(pdf: FPDF, table: Table) -> list[float]:
    """Return the widths of columns, mm: as wide as their texts; where the page is too narrow the widest give way first."""
    natural = []
    for i, name in enumerate(table.columns):
        pdf.set_font(_FONT, "B", 7.5)
        head = pdf.get_string_width(name)
        pdf.set_font(_FONT, "", 7.5)
        natural.append(4.0 + max([head, *(pdf.get_string_width(row[i]) for row in table.rows)]))
    return fitted(natural, pdf.epw)


def fitted(natural: Sequence[float], room: float) -> list[float]:
    """Return widths whose sum is at most ``room``: each at most its natural one, none cut while a wider one could be.

    >>> fitted([10.0, 100.0, 80.0], 110.0)
    [10.0, 50.0, 50.0]
    """
    found = list(natural)
    left = room
    for place, i in enumerate(sorted(range(len(found)), key=found.__getitem__)):
        found[i] = min(found[i], left / (len(found) - place))
        left -= found[i]
    return found
