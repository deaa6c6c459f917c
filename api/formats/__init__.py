"""How recordings in files become numbers: one module for each format, chunks of bytes in, blocks of samples out."""

from __future__ import annotations


class FormatError(ValueError):
    """A file that cannot be read as its description says.

    Parameters
    ----------
    message : str
        What is wrong, with the line and the column when they are known.
    line : int, optional
        Line of the file, from 1.
    column : int, optional
        Column of the file, from 0 as in the import description.
    """

    def __init__(self, message: str, *, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.line = line
        self.column = column
