"""Documents that an earlier version has written, as this version writes them.

::

    document of version n -> step n -> document of version n + 1 -> ... -> document of version CURRENT

A row stays as it was written; it is brought up to date whenever it is read. A step gets a copy and may change it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy

from storage.errors import StateError
from storage.models.base import Document

Step = Callable[[Document], Document]
"""Returns a document of one version as one of the next."""

#: The version of the system documents that are written now. A change that cannot read stored ones raises it, and adds a step.
CURRENT = 1
#: The steps, by the version that they start from.
STEPS: Mapping[int, Step] = {}


def upcast(document: Document, version: int, *, steps: Mapping[int, Step] = STEPS, current: int = CURRENT) -> Document:
    """Return a stored document as one of the current version.

    Raises
    ------
    StateError
        When a later version of the software has written it.
    """
    if version > current:
        raise StateError(
            f"a stored document must have schema_version <= {current}, got {version}: a later version wrote it"
        )
    if version < current:
        document = deepcopy(document)
    for number in range(version, current):
        document = steps[number](document)
    return document
