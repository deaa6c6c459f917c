"""Import of a TDMS file, and views of a long recording; run as `python -m bench.imports`.

The file is imported as a worker does it: read from the database, parsed, looked at, cut into blocks with their extremes,
compressed, and written back. Beside it stands the library's own reading of the same file into memory, which does none of
the rest. ``--samples`` and ``--megabytes`` give the full sizes.
"""

from __future__ import annotations

import argparse
import hashlib
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

from api.services.recordings import parsing
from bench.memory import peak_memory
from bench.table import Job, Row
from storage import Database, open_database
from storage.imports import Import
from storage.models import DEFAULT_WORKSPACE
from storage.repositories import DatasetRepository

CHANNELS = 4
SEGMENT = 8 << 20
PIECE = 1 << 17
POINTS = 2000


def jobs(*, runs: int, megabytes: float, samples: int) -> Iterator[Job]:
    """Measure imports and views."""
    with _database() as (database, folder):
        yield imports(database, folder, runs=runs, megabytes=megabytes)
        yield views(database, samples=samples, runs=runs)


def imports(database: Database, folder: Path, *, runs: int, megabytes: float) -> Job:
    """Measure the import of a TDMS file of noise, and the library's reading of it."""
    path = folder / "noise.tdms"
    expected = _write(path, round(megabytes * 1e6 / 8 / CHANNELS))
    times, busy, error = [], [], 0.0
    for _ in range(runs):
        identifier = send(database, path, "tdms")
        begin, used = time.perf_counter(), time.process_time()
        parsing.run({"dataset": identifier}, database=database, workspace=DEFAULT_WORKSPACE, progress=lambda *_: None)
        times.append(time.perf_counter() - begin)
        busy.append(time.process_time() - used)
        with database.session() as session:
            found = DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(identifier, "c0")
            error = max(error, float(np.max(np.abs(found - expected))))
    begin = time.perf_counter()
    for _ in range(runs):
        with TdmsFile.open(path) as file:
            for channel in file["g"].channels():
                channel[:]
    library = (time.perf_counter() - begin) / runs
    return Job(
        title=f"import of a TDMS file, {megabytes:g} MB",
        clock="wall",
        rows=[
            Row(
                who="this service",
                milliseconds=1e3 * statistics.median(times),
                error=error,
                remark=f"kept, with extremes; {1e3 * statistics.median(busy):.0f} ms of CPU",
            ),
            Row(who="npTDMS", milliseconds=1e3 * library, error=0.0, remark="read into memory alone"),
        ],
    )


def views(database: Database, *, samples: int, runs: int) -> Job:
    """Measure plots of 2,000 points: of everything, and of ever shorter stretches at odd places."""
    identifier = _recorded(database, samples)
    rows = []
    stretches = [(0, samples), *((samples // 3 + 7, samples // 3 + 7 + n) for n in _shorter(samples))]
    for start, stop in stretches:
        times, busy = [], []
        for _ in range(max(runs, 3)):
            begin, used = time.perf_counter(), time.process_time()
            with database.session() as session:
                repository = DatasetRepository(session, DEFAULT_WORKSPACE)
                found = repository.read_decimated(identifier, "x", start, stop, points=POINTS)
            times.append(time.perf_counter() - begin)
            busy.append(time.process_time() - used)
            assert found.index.size <= POINTS
        remark = f"the slowest of {len(busy)} calls; {1e3 * statistics.median(times):.0f} ms on the wall clock, median"
        rows.append(Row(who=f"{stop - start:,} samples", milliseconds=1e3 * max(busy), remark=remark))
    return Job(title=f"plot of {POINTS:,} points, {samples:,} samples stored", rows=rows)


def _shorter(samples: int) -> Iterator[int]:
    count = samples // 2
    while count > POINTS:
        yield count
        count //= 8


def send(database: Database, path: Path, format_: str) -> str:
    """Upload a file into a dataset, which then waits to be parsed; return its id."""
    with database.session() as session:
        described: list[dict[str, object]] = [{"name": f"c{i}"} for i in range(CHANNELS)] if format_ == "raw" else []
        identifier = (
            DatasetRepository(session, DEFAULT_WORKSPACE)
            .create(name="bench", format=format_, channels=described, sample_rate=1e4 if described else None)
            .id
        )
    digests, whole = [], hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(SEGMENT):
            digests.append(hashlib.sha256(piece).hexdigest())
            whole.update(piece)
            with database.session() as session:
                DatasetRepository(session, DEFAULT_WORKSPACE).put_segment(identifier, digests[-1], piece)
    with database.session() as session:
        repository = DatasetRepository(session, DEFAULT_WORKSPACE)
        repository.commit(identifier, segments=digests, sha256=whole.hexdigest())
    return identifier


def peak(path: Path, format_: str) -> tuple[float, float]:
    """Import a file in a process of its own; return its seconds and its peak memory, MB."""
    with _database() as (database, _):
        identifier, url = send(database, path, format_), database.url
        database.dispose()
        # from scratch, not forked: a fork begins with the memory of its parent
        done = subprocess.run(  # noqa: S603 - this very file
            [sys.executable, "-m", "bench.imports", "--parse", url, identifier],
            check=True,
            capture_output=True,
            text=True,
        )
    seconds, used = map(float, done.stdout.split())
    return seconds, used


def _parse(url: str, identifier: str) -> None:
    """Import what was sent, and print the seconds and the peak memory, MB."""
    database = open_database(url)
    begin = time.perf_counter()
    parsing.run({"dataset": identifier}, database=database, workspace=DEFAULT_WORKSPACE, progress=lambda *_: None)
    print(time.perf_counter() - begin, peak_memory())


def _write(path: Path, count: int) -> np.ndarray:
    """Write a file of noise in one segment, and return its first channel."""
    rng = np.random.default_rng(0)
    data = [rng.normal(size=count) for _ in range(CHANNELS)]
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("g", f"c{i}", one, {"wf_increment": 1e-4}) for i, one in enumerate(data)])
    return data[0]


def _recorded(database: Database, samples: int) -> str:
    with database.session() as session:
        repository = DatasetRepository(session, DEFAULT_WORKSPACE)
        identifier = repository.create(name="long", format="csv").id
        repository.put_segment(identifier, hashlib.sha256(b"x").hexdigest(), b"x")
        digest = hashlib.sha256(b"x").hexdigest()
        repository.commit(identifier, segments=[digest], sha256=digest)
    rng = np.random.default_rng(0)
    with Import(database, DEFAULT_WORKSPACE, identifier) as writing:
        for start in range(0, samples, PIECE):
            writing.add(0, np.round(np.cumsum(rng.normal(size=min(PIECE, samples - start))), 3))
        writing.finish(channels=[{"name": "x"}], sample_rate=1e4, start_time=None, report={})
    return identifier


@contextmanager
def _database() -> Iterator[tuple[Database, Path]]:
    with tempfile.TemporaryDirectory() as folder:
        database = open_database(f"sqlite:///{folder}/bench.db")
        database.migrate()
        try:
            yield database, Path(folder)
        finally:
            database.dispose()


def main() -> None:
    """Print the times, or the memory that one file takes."""
    parser = argparse.ArgumentParser(prog="python -m bench.imports", description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--megabytes", type=float, default=51.2, help="of the TDMS file")
    parser.add_argument("--samples", type=int, default=100_000_000, help="of the recording that is plotted")
    parser.add_argument(
        "--peak", type=float, metavar="MB", help="only: peak memory of the import of a file of this size"
    )
    parser.add_argument("--parse", nargs=2, metavar=("URL", "ID"), help="only: import what was sent to a database")
    options = parser.parse_args()
    if options.parse:
        _parse(*options.parse)
        return
    if options.peak:
        with tempfile.TemporaryDirectory() as folder:
            for format_, make in (("tdms", _write), ("raw", _write_raw), ("csv", _write_text)):
                path = Path(folder) / f"noise.{format_}"
                make(path, round(options.peak * 1e6 / (51 if format_ == "csv" else 8 * CHANNELS)))
                seconds, used = peak(path, format_)
                print(
                    f"{format_}, {path.stat().st_size / 1e6:.0f} MB: {seconds:.1f} s, at most {used:.0f} MB of memory"
                )
                path.unlink()
        return
    from rich.console import Console  # noqa: PLC0415 - only where a table is printed

    from bench.table import render  # noqa: PLC0415 - as above

    table = render(jobs(runs=options.runs, megabytes=options.megabytes, samples=options.samples), title="imports")
    Console(width=150).print(table)


def _write_raw(path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    with path.open("wb") as file:
        for start in range(0, count, PIECE):
            file.write(rng.normal(size=(min(PIECE, count - start), CHANNELS)).astype("<f8").tobytes())


def _write_text(path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    with path.open("w") as file:
        file.write("t [s],a,b,c,d\n")
        for start in range(0, count, PIECE):
            rows = rng.normal(size=(min(PIECE, count - start), CHANNELS))
            time_ = (start + np.arange(len(rows))) / 1e4
            np.savetxt(file, np.column_stack([time_, rows]), fmt=["%.4f", *["%.6f"] * CHANNELS], delimiter=",")


if __name__ == "__main__":
    main()
