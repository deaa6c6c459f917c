"""CSV: a header line of names with units, the time in s, then a row for each sample; 17 digits, so that nothing is lost."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from api.formats.writing import Outgoing


def write(recording: Outgoing) -> Iterator[bytes]:
    """Yield the file."""
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(["time [s]", *map(_as_text, recording.labels())])
    yield head.getvalue().encode()
    for start, stop in recording.rows():
        time = recording.instants(start, stop)
        columns = [time, *(recording.read(channel, start, stop) for channel in range(len(recording.columns)))]
        # repr is the shortest text that is read back as the same number
        cells = [[repr(value) for value in column.tolist()] for column in columns]
        yield ("\n".join(map(",".join, zip(*cells, strict=True))) + "\n").encode()


def _as_text(label: str) -> str:
    """Return a label that a spreadsheet does not take for a formula: an apostrophe in front says that it is a text."""
    return f"'{label}" if label.startswith(("=", "+", "-", "@", "\t", "\r")) else label
