"""Numbers at the axes of a figure, with powers of ten in raised letters: 2·10⁻³ and not a formula.

matplotlib sets a formula for each number of a logarithmic axis, which takes longer than drawing the curves.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import LogFormatterSciNotation, ScalarFormatter

if TYPE_CHECKING:
    from matplotlib.axis import Axis

_RAISED = str.maketrans("0123456789-−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")
_POWER = re.compile(r"(?:([\d.]*)\\times)?10\^\{([-−]?\d+)\}")
_FRAME = re.compile(r"\$\\mathdefault\{(.*)\}\$")
_EXPONENT = re.compile(r"(\d[\d.]*)?e([-−+]?\d+)")


def plain(formula: str) -> str:
    r"""Return what matplotlib writes at a logarithmic axis as letters.

    >>> plain(r"$\mathdefault{2\times10^{-3}}$")
    '2·10⁻³'
    """
    inner = _FRAME.sub(r"\1", formula)
    return _POWER.sub(lambda found: _power(found[1], found[2]), inner).replace("-", "−")


def common(offset: str) -> str:
    """Return the factor that an axis shares as letters.

    >>> common("1e−5")
    '10⁻⁵'
    """
    return _EXPONENT.sub(lambda found: _power(found[1], found[2].lstrip("+")), offset)


def _power(factor: str | None, exponent: str) -> str:
    return f"{'' if factor in {None, '1'} else f'{factor}·'}10{exponent.translate(_RAISED)}"


class _Scalar(ScalarFormatter):
    def get_offset(self) -> str:
        offset = common(super().get_offset())
        return f"·{offset}" if offset.startswith("10") else offset


class _Logarithmic(LogFormatterSciNotation):
    def __call__(self, x: Any, pos: int | None = None) -> str:
        return plain(super().__call__(x, pos))


def numbered(axis: Axis) -> None:
    """Let an axis write its numbers so; one whose marks have names keeps them."""
    if axis.get_scale() == "log":
        axis.set_major_formatter(_Logarithmic())
        axis.set_minor_formatter(_Logarithmic())
    elif isinstance(axis.get_major_formatter(), ScalarFormatter):
        axis.set_major_formatter(_Scalar())
