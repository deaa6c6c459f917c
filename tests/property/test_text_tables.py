"""Tables written in every layout that labs use are read as the numbers that were written, or refused."""

from __future__ import annotations

import tempfile

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from api.formats import catalogue
from api.formats.text.tables import TableOptions

COLUMNS = {"Kraft": "N", "Weg 1": "mm", "n_soll": "1/min", "Temp": "°C", "U": "V", "speed": "m/s"}
HEADERS = ("bare", "[]", "()", "none")
PREAMBLES = ([], ["Prüfstand 7; 12.3.2024"], ["# made by hand", "Bediener: Maier"])


@st.composite
def layouts(draw):
    """Return what a table looks like: delimiter, decimal mark, thousands, quotes, header, preamble, line end, encoding."""
    decimal = draw(st.sampled_from(".,"))
    thousands = draw(st.sampled_from(["", "", *({".", ",", "'", " "} - {decimal})]))
    delimiter = draw(st.sampled_from(";,\t|"))
    quoted = delimiter in {decimal, thousands} or draw(st.booleans())
    return {
        "decimal": decimal, "thousands": thousands, "delimiter": delimiter, "quoted": quoted,
        "header": draw(st.sampled_from(HEADERS)), "preamble": draw(st.sampled_from(PREAMBLES)),
        "end": draw(st.sampled_from(["\n", "\r\n"])), "encoding": draw(st.sampled_from(["utf-8-sig", "cp1252", "utf-16"])),
    }  # fmt: skip


def cell(value, digits, layout):
    if np.isnan(value):
        return ""
    marks = str.maketrans({",": layout["thousands"], ".": layout["decimal"]})
    text = f"{value:,.{digits}f}".translate(marks)
    return f'"{text}"' if layout["quoted"] else text


@given(layouts(), st.integers(0, 2**32 - 1), st.integers(12, 60), st.sampled_from([0.0, 0.1, 0.5]))
def test_a_table_is_read_as_it_was_written(layout, seed, rows, missing):
    rng = np.random.default_rng(seed)
    names = list(rng.permutation(list(COLUMNS))[: rng.integers(1, len(COLUMNS))])
    digits = [6, *rng.integers(0, 6, len(names))]
    step = 10.0 ** -rng.integers(0, 5)
    columns = [np.round(np.arange(rows) * step, 6)]
    for places in digits[1:]:
        column = np.round(rng.normal(scale=10.0 ** rng.integers(-1, 6), size=rows), places)
        column[rng.random(rows) < missing] = np.nan
        column[-1] = 1.0  # a column of nothing is none
        columns.append(column)
    between, units = layout["delimiter"], ["s", *(COLUMNS[name] for name in names)]
    form = {"[]": "{} [{}]", "()": "{} ({})"}.get(layout["header"], "{}")
    head = [between.join(form.format(*one) for one in zip(["Zeit", *names], units, strict=True))]
    if layout["header"] == "bare":
        head.append(between.join(units))
    body = [
        between.join(cell(x, places, layout) for x, places in zip(row, digits, strict=True))
        for row in zip(*columns, strict=True)
    ]
    text = layout["end"].join([*layout["preamble"], *head, *body, ""])
    with tempfile.TemporaryFile() as file:
        file.write(text.encode(layout["encoding"]))
        file.flush()
        found = catalogue.open_file("csv", file, TableOptions())
        told = units if layout["header"] != "none" else [""] * len(units)
        assert [(one.name, one.unit) for one in found.series] == list(zip(["Zeit", *names], told, strict=True))
        read = np.empty((len(columns), 0))
        for pieces in zip(*[found.read([place]) for place in range(len(columns))], strict=True):
            read = np.append(read, [values for _, values in pieces], axis=1)
    ambiguous = any("decimal mark; where it separates thousands" in remark for remark in found.remarks)
    assert ambiguous or np.array_equal(read, columns, equal_nan=True)
