"""Some of the channels, in a chosen order."""

from __future__ import annotations

from dataclasses import dataclass, replace

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Select:
    """Keep only these channels."""

    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.channels:
            raise ProcessingError("channels must be at least one, got none", at=("channels",))

    def apply(self, record: Record) -> Record:
        """Return the record with only these channels."""
        names = record.chosen(self.channels)
        return replace(record, channels={name: record.channels[name] for name in names})
