"""The bodies of datasets: what a recording is, how a file is read, the manifest of its segments."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Field

from api.schemas.values import Document

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
ChannelName = Annotated[str, Field(min_length=1, max_length=200)]


class SensorDocument(Document):
    """The instrument behind a channel."""

    model: str = Field(default="", max_length=200)
    serial: str = Field(default="", max_length=200)
    calibrated_on: str = Field(default="", max_length=40)
    certificate: str = Field(default="", max_length=200)


class ChannelDocument(Document):
    """A channel of a raw recording: physical value = raw x scale + offset, in `unit`."""

    name: ChannelName
    quantity: str = Field(default="", max_length=100, examples=["displacement"])
    unit: str = Field(default="", max_length=64, examples=["mm"])
    scale: float = 1.0
    offset: float = 0.0
    sensor: SensorDocument | None = None


class ColumnDocument(ChannelDocument):
    """A column of a text file, counted from 0."""

    index: int = Field(ge=0, le=10_000)


class ImportDocument(Document):
    """How a text file is read."""

    delimiter: str = Field(default=",", min_length=1, max_length=4)
    decimal: Literal[".", ","] = "."
    header_lines: int = Field(default=0, ge=0, le=10_000)
    sample_rate: float = Field(gt=0.0, description="samples per second")
    columns: list[ColumnDocument] = Field(min_length=1, max_length=500)


class DatasetRequest(Document):
    """A recording: raw samples with their channels, or a file with its description."""

    name: str = Field(min_length=1, max_length=200)
    format: Literal["raw", "txt"]
    start_time: AwareDatetime | None = Field(default=None, strict=False, description="RFC 3339 with a time zone")
    sample_rate: float | None = Field(default=None, gt=0.0, description="samples per second; raw only")
    channels: list[ChannelDocument] | None = Field(default=None, min_length=1, max_length=500, description="raw only")
    import_: ImportDocument | None = Field(default=None, alias="import", description="files only")
    origin: dict[str, Any] | None = Field(default=None, description="where it comes from, kept as given")


class CommitRequest(Document):
    """The segments in order, and the checksum of the whole."""

    segments: list[Sha256] = Field(min_length=1, max_length=15_000)
    sha256: Sha256
