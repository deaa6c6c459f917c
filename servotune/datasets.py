"""Measured data: sent in segments that the service verifies one by one, so that a broken upload goes on where it stopped."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote, urlencode

from servotune.documents import given
from servotune.errors import ConflictError, DocumentError
from servotune.jobs import Jobs
from servotune.progress import Observer
from servotune.replies import ChannelData, Dataset
from servotune.targets import room_at, target_of
from servotune.transport import Transport, pause

SEGMENT_BYTES = 8 * 1024 * 1024
"""Largest segment that the service takes."""

_FLOAT64_BYTES = 8
_LONGEST_SILENCE = 600.0
"""s before a file that is exported must have begun: HDF5 is written as a whole first."""
_COMMIT_ROUNDS = 3


class Datasets:
    """Recordings kept by the service."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(self, document: Mapping[str, Any]) -> Dataset:
        """Announce a recording (name, format, channels or import description) and return it, still empty."""
        return Dataset(self._transport.post("/v1/datasets", document, creates=True))

    def send(
        self,
        dataset: str,
        content: Path | bytes,
        *,
        document: Mapping[str, Any] | None = None,
        progress: Observer | None = None,
    ) -> Dataset:
        """Send the content of a dataset: only what the service does not have yet, then commit it and wait until it is read.

        Call it again after a failure, even from another process: the segments that have arrived are not sent twice.

        Parameters
        ----------
        dataset : str
            Id of the dataset, from `create`.
        content : pathlib.Path or bytes
            The file; or raw samples, little-endian float64, all channels of a sample together.
        document : mapping, optional
            How a file is read, in place of what `create` was told.
        progress : callable, optional
            Told the fraction sent and a message.

        Raises
        ------
        JobFailedError
            The file could not be read as its import description says.
        DocumentError
            There are no bytes in it; nothing was asked of the service then.
        """
        _check_filled(content)
        segment_bytes = _segment_bytes(self.get(dataset))
        digests, whole = list[str](), hashlib.sha256()
        for piece in _pieces(content, segment_bytes):
            digests.append(hashlib.sha256(piece).hexdigest())
            whole.update(piece)
        manifest: dict[str, Any] = {"segments": digests, "sha256": whole.hexdigest()}
        if document is not None:
            manifest["import"] = document
        for round_ in range(1, _COMMIT_ROUNDS + 1):
            self._send_missing(dataset, content, digests, segment_bytes, progress)
            try:
                response = self._transport.send("POST", f"/v1/datasets/{dataset}/commit", json=manifest)
            except ConflictError:
                # The service lacks a segment that it had: sent again in the next round.
                if round_ == _COMMIT_ROUNDS:
                    raise
                continue
            if "Location" in response.headers:
                job = response.headers["Location"].rpartition("/")[2]
                Jobs(self._transport).get(job).wait(progress=progress or False)
            break
        return self._when_read(dataset)

    def upload(
        self, document: Mapping[str, Any], content: Path | bytes, *, progress: Observer | None = None
    ) -> Dataset:
        """Create a dataset and send its content.

        Raises
        ------
        DocumentError
            There are no bytes in it; no dataset was opened then.
        """
        _check_filled(content)
        return self.send(self.create(document)["id"], content, progress=progress)

    def get(self, dataset: str) -> Dataset:
        """Return what is known about a dataset."""
        return Dataset(self._transport.get(f"/v1/datasets/{dataset}"))

    def list(
        self,
        *,
        name: str | None = None,
        format: str | None = None,  # noqa: A002 - the contract's word
        status: str | None = None,
        after: datetime | None = None,
        before: datetime | None = None,
    ) -> Iterator[Dataset]:
        """Yield the datasets of the service, newest first.

        Parameters
        ----------
        name : str, optional
            A part of the name, in capital or small letters, or the whole id.
        format, status : str, optional
            Only these ("csv", "raw" ...; "open", "parsing", "ready" or "failed").
        after, before : datetime.datetime, optional
            Only those that were made at this instant or later, and earlier than this one; without a time zone it is local time.
        """
        params = given(name=name, format=format, status=status, after=after, before=before)
        return self._transport.items("/v1/datasets", Dataset, params=params)

    def delete(self, dataset: str, *, force: bool = False) -> None:
        """Delete a dataset with its samples.

        Raises
        ------
        ConflictError
            Others depend on it (`problem["dependents"]`), and it is not forced.
        """
        params = {"force": True} if force else None
        self._transport.send("DELETE", f"/v1/datasets/{dataset}", params=params, headers={"If-Match": "*"})

    def channel(
        self,
        dataset: str,
        name: str,
        *,
        start: float | None = None,
        end: float | None = None,
        points: int | None = None,
    ) -> ChannelData:
        """Return a channel's physical values between two times (s); for plots `min` and `max` of at most `points` stretches, where samples are more."""
        asked = {"start": start, "end": end, "points": points}
        params = {key: value for key, value in asked.items() if value is not None}
        return ChannelData(
            self._transport.get(f"/v1/datasets/{dataset}/channels/{quote(name, safe='')}", params=params)
        )

    def preview(
        self, dataset: str, content: Path | bytes, *, document: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """Send the content of a file and return how the service would read it, with the first samples of each channel.

        Parameters
        ----------
        dataset : str
            Id of the dataset, from `create`.
        content : pathlib.Path or bytes
            The file; what has arrived is not sent again.
        document : mapping, optional
            An import description to try, in place of the one from `create`.

        Returns
        -------
        dict
            ``import`` is the proposal: change what is wrong, and hand it to `send`. ``remarks`` are to be read first.

        Raises
        ------
        DocumentError
            There are no bytes in it; nothing was asked of the service then.
        """
        _check_filled(content)
        digests = [hashlib.sha256(piece).hexdigest() for piece in _pieces(content, SEGMENT_BYTES)]
        self._send_missing(dataset, content, digests, SEGMENT_BYTES, None)
        body = {"segments": digests, **({} if document is None else {"import": document})}
        response = self._transport.send("POST", f"/v1/datasets/{dataset}/preview", json=body)
        job = response.headers["Location"].rpartition("/")[2]
        return cast("dict[str, Any]", Jobs(self._transport).get(job).wait(progress=False))

    def export(
        self,
        dataset: str,
        target: Path,
        *,
        format: str | None = None,  # noqa: A002 - the contract's word
        channels: Sequence[str] = (),
        start: float | None = None,
        end: float | None = None,
    ) -> Path:
        """Write a recording, calibrated, into a file that other programs read, and return its path.

        Parameters
        ----------
        dataset : str
        target : pathlib.Path
            Written as a whole or not at all.
        format : str, optional
            "csv", "mat", "parquet" or "hdf5"; told from the name of ``target`` unless given.
        channels : sequence of str, optional
            Those to write; all unless given.
        start, end : float, optional
            Between two times, s.

        Raises
        ------
        ValueError
            Nothing can be written at ``target``, or no format is told.
        """
        target = target_of(target, "target")
        endings = {".csv": "csv", ".mat": "mat", ".parquet": "parquet", ".h5": "hdf5", ".hdf5": "hdf5"}
        chosen = format or endings.get(target.suffix.lower())
        if chosen is None:
            raise ValueError(
                f"target must end in one of {', '.join(endings)} where no format is given, got {target.name!r}"
            )
        asked = {"format": chosen, "channel": list(channels) or None, "start": start, "end": end}
        query = urlencode({key: value for key, value in asked.items() if value is not None}, doseq=True)
        part = target.with_name(f"{target.name}.part")
        try:
            path = f"/v1/datasets/{dataset}/export?{query}"
            opened = self._transport.stream(path, headers={"Accept": "*/*"}, silence=_LONGEST_SILENCE)
            with room_at(target), opened as response, part.open("wb") as file:
                for piece in response.iter_bytes():
                    file.write(piece)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
        return target

    def original(self, dataset: str) -> bytes:
        """Return the bytes as they were sent."""
        return self._transport.send("GET", f"/v1/datasets/{dataset}/original").content

    def _when_read(self, dataset: str) -> Dataset:
        """Return the dataset when nobody is reading its file any more: another process may have committed it."""
        attempt = 0
        while (known := self.get(dataset))["status"] == "parsing":
            attempt += 1
            time.sleep(pause(attempt))
        return known

    def _send_missing(
        self, dataset: str, content: Path | bytes, digests: Sequence[str], segment_bytes: int, progress: Observer | None
    ) -> None:
        path = f"/v1/datasets/{dataset}/segments"
        present = {segment["sha256"] for segment in self._transport.items(path)}
        for number, piece in enumerate(_pieces(content, segment_bytes)):
            digest = digests[number]
            if digest not in present:
                headers = {"Content-Type": "application/octet-stream"}
                self._transport.send("PUT", f"{path}/{digest}", content=piece, headers=headers)
                present.add(digest)
            if progress is not None:
                progress((number + 1) / len(digests), f"segment {number + 1} of {len(digests)}")


def _segment_bytes(dataset: Dataset) -> int:
    """Return the largest segment that holds whole samples; a file may be cut anywhere."""
    if dataset.get("format") != "raw":
        return SEGMENT_BYTES
    sample = _FLOAT64_BYTES * len(dataset.get("channels", ())) or _FLOAT64_BYTES
    return SEGMENT_BYTES // sample * sample


def _check_filled(content: Path | bytes) -> None:
    """Refuse what has no bytes before anything is opened for it."""
    size = content.stat().st_size if isinstance(content, Path) else len(content)
    if not size:
        name = f"file {content.name!r}" if isinstance(content, Path) else "content"
        raise DocumentError(
            f"{name} must hold at least one byte, it is empty: was the recording begun, and is it written to its end?"
        )


def _pieces(content: Path | bytes, size: int) -> Iterator[bytes]:
    if isinstance(content, Path):
        with content.open("rb") as file:
            while piece := file.read(size):
                yield piece
    else:
        for start in range(0, len(content), size):
            yield content[start : start + size]
