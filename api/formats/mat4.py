"""MATLAB files of version 4, which are not read: they are told by the header of their first variable, for they have no mark.

    type, rows, columns, imaginary (0 or 1), length of the name (int32 each), then the name with a zero behind it
    type = 1000 M + 10 P + T,   M 0 or 1 (order of bytes), P 0 ... 5 (kind of numbers), T 0 ... 2 (numbers, text, sparse)

Source: MathWorks, MAT-File Format, chapter 2, Level 4 MAT-File Format.
"""

from __future__ import annotations

import re
import struct

_HEADER = 20
_LONGEST_NAME = 64
_NAME = re.compile(rb"[A-Za-z]\w*\0")


def is_version_4(head: bytes) -> bool:
    """Say whether a file that begins so is one."""
    return any(_fits(head, order) for order in "<>")


def _fits(head: bytes, order: str) -> bool:
    if len(head) < _HEADER:
        return False
    kind, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", head)
    thousands, rest = divmod(kind, 1000)
    return (
        thousands == (0 if order == "<" else 1)
        and rest // 10 <= 5
        and rest % 10 <= 2
        and min(rows, columns) >= 0
        and imaginary in {0, 1}
        and 2 <= length <= _LONGEST_NAME
        and _NAME.fullmatch(head[_HEADER : _HEADER + length]) is not None
    )
