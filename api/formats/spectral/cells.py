"""Complex numbers in the cells of text tables: 1.5-2i, (1.5 + j2), 1,5-2j with decimal commas."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from api.formats import FormatError
from api.formats.text.cells import is_word_for_missing

_COMPLEX = re.compile(
    r"\(?\s*[+-]?[\d.]+(?:e[+-]?\d+)?\s*[+-]\s*(?:[ij]\s*\*?\s*)?[\d.]*(?:e[+-]?\d+)?\s*\*?\s*[ij]?\s*\)?",
    re.IGNORECASE,
)
_LEADING = re.compile(
    r"(?P<real>.*[\d.])\s*(?P<sign>[+-])\s*[ij]\s*\*?\s*(?P<imaginary>[\d.]+(?:e[+-]?\d+)?)", re.IGNORECASE
)


def is_complex(cells: Sequence[str], decimal: str) -> bool:
    """Whether texts are complex numbers, such as 1.5-2i or (1.5 + j2)."""
    there = [cell for cell in cells if not is_word_for_missing(cell)]
    return bool(there) and all(_parsed(cell, decimal) is not None for cell in there)


def number_of(cell: str, decimal: str) -> complex:
    """Return the complex number in a cell.

    Raises
    ------
    FormatError
        For any other text.
    """
    value = complex(math.nan, math.nan) if is_word_for_missing(cell.strip()) else _parsed(cell, decimal)
    if value is None:
        raise FormatError(
            f"a cell must be a complex number such as 1.5-2i, got {cell[:40]!r}: write it so, or leave the cell empty"
        )
    return value


def _parsed(cell: str, decimal: str) -> complex | None:
    plain = cell.strip().replace(decimal, ".") if decimal != "." else cell.strip()
    if _COMPLEX.fullmatch(plain) is None or not re.search("[ij]", plain, re.IGNORECASE):
        return None
    if match := _LEADING.fullmatch(plain.strip("() ")):
        plain = f"{match['real']}{match['sign']}{match['imaginary']}j"
    try:
        return complex(plain.strip("() ").replace(" ", "").replace("*", "").lower().replace("i", "j"))
    except ValueError:
        return None
