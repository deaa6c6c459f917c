"""What a reader makes of a file, as arrays by name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from api.formats import Recording
from api.formats.catalogue import open_file
from api.formats.text.guess import Known
from api.formats.text.tables import TableOptions

_OPEN = ExitStack()


@pytest.fixture(autouse=True)
def closed_files() -> Iterator[None]:
    """Close what a test has opened."""
    yield
    _OPEN.close()


def opened(format_: str, content: bytes | Path, folder: Path, **options: object) -> Recording:
    """Open a file of the operating system with some content."""
    if isinstance(content, bytes):
        path = folder / f"recording.{format_}"
        path.write_bytes(content)
    else:
        path = content
    file = _OPEN.enter_context(path.open("rb"))
    known = {name: options.pop(name) for name in list(options) if name in Known.__slots__}
    asked = TableOptions(known=Known(**known), **options)  # type: ignore[arg-type]  # of the caller's choice
    recording = open_file(format_, file, asked)
    _OPEN.callback(recording.close)
    return recording


def arrays(recording: Recording, names: list[str] | None = None) -> dict[str, np.ndarray]:
    """Read all channels of an open file, or some of them in an order."""
    places = [
        place
        for name in (names or [one.name for one in recording.series])
        for place, one in enumerate(recording.series)
        if one.name == name
    ]
    pieces: dict[int, list[np.ndarray]] = {position: [] for position in range(len(places))}
    for position, values in recording.read(places):
        assert values.dtype == np.float64
        pieces[position].append(values)
    return {recording.series[place].name: np.concatenate(pieces[i]) for i, place in enumerate(places)}
