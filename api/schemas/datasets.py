"""The bodies of datasets: what a recording is, how a file is read, the manifest of its segments."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Field

from api.schemas.queue import QueueDocument
from api.schemas.values import Document, SampleRate

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
ChannelName = Annotated[str, Field(min_length=1, max_length=200)]


class StageOfChannel(Document):
    """What was between a sensor and its input; its gain is in the scale of the channel."""

    model: str = Field(default="", max_length=200)
    serial: str = Field(default="", max_length=200)
    gain: float = 1.0
    calibrated_on: str = Field(default="", max_length=40)
    certificate: str = Field(default="", max_length=200)


class SensorDocument(Document):
    """The instrument behind a channel."""

    model: str = Field(default="", max_length=200)
    serial: str = Field(default="", max_length=200)
    calibrated_on: str = Field(default="", max_length=40)
    certificate: str = Field(default="", max_length=200)
    uncertainty_percent: float | None = Field(
        default=None, ge=0.0, description="of sensor and chain together, where each certificate says its own"
    )
    chain: list[StageOfChannel] = Field(default_factory=list, max_length=20, description="from the sensor to the input")


class ChannelDocument(Document):
    """A channel of a raw recording: physical value = raw x scale + offset, in `unit`."""

    name: ChannelName
    quantity: str = Field(default="", max_length=100, examples=["displacement"])
    unit: str = Field(default="", max_length=64, examples=["mm"])
    scale: float = 1.0
    offset: float = 0.0
    sensor: SensorDocument | None = None


class ColumnDocument(ChannelDocument):
    """A column of a text table, or a channel of another file, that becomes a channel of the recording."""

    index: int | None = Field(default=None, ge=0, le=100_000, description="its place in the file, from 0")
    source: ChannelName | None = Field(default=None, description="its name in the file, instead of `index`")


class TimeDocument(Document):
    """The column or channel that holds the instants of the samples."""

    index: int | None = Field(default=None, ge=0, le=100_000)
    source: ChannelName | None = None
    unit: str | None = Field(default=None, min_length=1, max_length=64, description="of time; s unless the file says")
    order: Literal["ymd", "mdy", "dmy"] | None = Field(default=None, description="of year, month and day in dates")


class EvenDocument(Document):
    """An even axis for samples at uneven instants, by interpolation."""

    rate: SampleRate = Field(description="samples per second, at least the mean rate of the instants")
    method: Literal["linear", "cubic"] = "linear"


class ResampledDocument(Document):
    """Uneven instants that become even."""

    resample: EvenDocument


class ImportDocument(Document):
    """How a file is read; what is left out is found out from the file, and reported.

    A `txt` file whose columns are all given by `index` is read without finding out anything: "," between cells, "." for
    decimals and no header where nothing else is said.
    """

    delimiter: str | None = Field(
        default=None,
        min_length=1,
        max_length=4,
        description="text tables; a blank stands for any run of blanks and tabs",
    )
    decimal: Literal[".", ","] | None = Field(default=None, description="text tables")
    thousands: Literal["", ".", ",", "'", " "] | None = Field(
        default=None, description='text tables: what stands between groups of three digits; "" for nothing'
    )
    comment: str | None = Field(
        default=None, max_length=4, description='text tables: what lines begin with that are no rows; "" for none'
    )
    header_lines: int | None = Field(default=None, ge=0, le=10_000, description="text tables")
    missing: list[Annotated[str, Field(max_length=40)]] | None = Field(
        default=None,
        max_length=20,
        description='text tables: cells that stand for a missing sample; "", "NaN" and the usual words that are found',
    )
    allow_truncated: bool | None = Field(
        default=None,
        description="texts and universal files: whether a last row or point that is or may be cut is left out; otherwise a cut one is refused",
    )
    sample_rate: SampleRate | None = Field(
        default=None,
        description="samples per second; the instants of the samples are not looked at unless `time` says so",
    )
    time: TimeDocument | None = Field(default=None, description="where the instants of the samples are")
    gaps: Literal["fill", "close"] | None = Field(
        default=None, description="gaps in time are filled with missing samples (default), or closed"
    )
    uneven: Literal["keep"] | ResampledDocument | None = Field(
        default=None,
        description="instants off an even axis by more than their rounding are kept as a channel (default), or resampled",
    )
    time_zone: str | None = Field(
        default=None, max_length=80, description="of instants without one, such as Europe/Bucharest; UTC unless given"
    )
    group: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description="which of a file's groups of channels this recording holds; the first unless given",
    )
    columns: list[ColumnDocument] | None = Field(
        default=None, min_length=1, max_length=500, description="all that are numbers unless given"
    )


Format = Literal[
    "raw", "txt", "csv", "lvm", "tdms", "mat", "hdf5", "parquet", "uff", "mdf", "wav", "mcap", "touchstone", "frd"
]


class DatasetRequest(Document):
    """A recording: raw samples with their channels, or a file, whose description may be left to the service."""

    name: str = Field(min_length=1, max_length=200)
    format: Format | None = Field(
        default=None,
        description="told from the first bytes of the file, and the ending of `file` or `name`, where it is left out",
    )
    file: str | None = Field(default=None, max_length=255, description="name of the file, files only")
    start_time: AwareDatetime | None = Field(default=None, strict=False, description="RFC 3339 with a time zone")
    sample_rate: SampleRate | None = Field(default=None, description="samples per second; raw only")
    channels: list[ChannelDocument] | None = Field(default=None, min_length=1, max_length=500, description="raw only")
    import_: ImportDocument | None = Field(default=None, alias="import", description="files only")
    origin: dict[str, Any] | None = Field(default=None, description="where it comes from, kept as given")


class PreviewRequest(Document):
    """The segments of a file in order, and how it would be read."""

    segments: list[Sha256] = Field(min_length=1, max_length=15_000)
    import_: ImportDocument | None = Field(default=None, alias="import")
    queue: QueueDocument | None = Field(default=None, description="of the job, where a worker does it")


class CommitRequest(Document):
    """The segments in order, and the checksum of the whole; for a file also how it is read."""

    segments: list[Sha256] = Field(min_length=1, max_length=15_000)
    sha256: Sha256
    import_: ImportDocument | None = Field(
        default=None, alias="import", description="files only: replaces what was said when the recording was opened"
    )
    queue: QueueDocument | None = Field(default=None, description="of the job, where a worker does it")
