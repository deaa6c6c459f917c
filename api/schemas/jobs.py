"""What requests about recordings share: windows of time, which channel belongs to which port, what an input does in between."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from api.schemas.values import Document, Path, Quantity

Window = Annotated[list[Quantity], Field(min_length=2, max_length=2, description="[t0, t1] in s")]
Between = Literal["auto", "hold", "linear", "band_limited"]


class RecordedInput(Document):
    """A channel that drives a port, and what it does between its samples."""

    channel: str
    between_samples: Between = Field(
        default="auto",
        description="hold: what a D/A converter puts out; linear; band_limited: smooth, as behind an anti-aliasing filter; "
        "auto: all are tried, alike for all such inputs, and the best fit counts",
    )


def _channel_or_document(value: Any) -> str:
    return "channel" if isinstance(value, str) else "document"


Channels = Annotated[
    dict[
        Path,
        Annotated[
            Annotated[str, Tag("channel")] | Annotated[RecordedInput, Tag("document")],
            Discriminator(_channel_or_document),
        ],
    ],
    Field(min_length=1, max_length=50),
]
