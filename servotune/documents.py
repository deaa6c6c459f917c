"""What the methods of the client take, and how it becomes a request."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

Document = Mapping[str, Any]
"""A JSON object as the API documents it; quantities are SI numbers or `{"value": 65, "unit": "cm**2"}`.

Numbers and lists may be numpy's.
"""

SystemLike = str | Mapping[str, Any]
"""The id of a stored system, or a system document itself."""


def given(**fields: Any) -> dict[str, Any]:
    """Return the fields that the caller gave: the service has its own defaults. An instant without a time zone is local time."""
    told = {name: value for name, value in fields.items() if value is not None}
    return {
        name: value.astimezone().isoformat() if isinstance(value, datetime) else value for name, value in told.items()
    }
