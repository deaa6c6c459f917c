"""A folder that another program writes, with that program played by the test: half a file, a lost one, one that comes twice."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from agent.drivers.file.driver import Files
from agent.drivers.file.settings import FileSettings
from agent.drivers.interface import Running
from agent.errors import AttemptError
from tests.integration.drivers.rigs import LOOPBACK, POSITION
from tests.integration.drivers.test_conformance import all_of, until

DEVICE = {"name": "logger", "model": "m", "serial": "1", "inputs": [{"name": LOOPBACK.channel, "range": 10}, {"name": POSITION.channel, "range": 10}]}  # fmt: skip
VALUES = np.arange(20.0).reshape(10, 2)


def answer(folder: Path, device: object, over: threading.Event) -> None:
    """Answer what is asked for as the other program does: each file is there at once."""
    replies = {"device": ("device.json", device), "run": ("ready.json", {"rate": 100.0})}
    while not over.wait(0.005):
        with contextlib.suppress(FileNotFoundError):  # whoever asked has gone
            answer_once(folder, replies)


def answer_once(folder: Path, replies: Mapping[str, tuple[str, object]]) -> None:
    for request in folder.glob("*/request.json"):
        name, reply = replies[json.loads(request.read_text())["what"]]
        request.unlink()
        (request.parent / "part").write_text(json.dumps(reply))
        (request.parent / "part").replace(request.parent / name)
    for name, reply in (("arm", "armed"), ("start", "started"), ("stop", "stopped")):
        for path in folder.glob(f"run-*/{name}.json"):
            (path.parent / "part").write_text('{"played": 0}')
            (path.parent / "part").replace(path.parent / f"{reply}.json")


@contextmanager
def logger(folder: Path, *, device: object = DEVICE, **settings: object) -> Iterator[Files]:
    over = threading.Event()
    thread = threading.Thread(target=answer, args=(folder, device, over))
    thread.start()
    given = {"folder": str(folder), "deadline": 60.0, "chunk": 0.05, **settings}
    try:
        yield Files(FileSettings(**given), rig="bench-1")  # type: ignore[arg-type] # those of a folder
    finally:
        over.set()
        thread.join()


@contextmanager
def running(driver: Files, samples: int = 10) -> Iterator[tuple[Running, Path]]:
    with driver.run((LOOPBACK, POSITION), 100.0, seconds=1.0) as made:
        made.prepare(samples, None)
        made.start()
        (place,) = Path(driver._folder).glob("run-*")
        yield made, place


def whole(path: Path, values: np.ndarray) -> None:
    if path.suffix == ".npy":
        np.save(path.with_suffix(".tmp.npy"), values)
        path.with_suffix(".tmp.npy").replace(path)
    else:
        path.write_text("".join(",".join(str(x) for x in row) + "\n" for row in values))


@pytest.mark.parametrize("suffix", ["npy", "csv"])
def test_half_a_file_is_waited_for(tmp_path, suffix) -> None:
    """Also where the other program writes under the last name: what is there at first is never taken for all of it."""
    with logger(tmp_path, format=suffix) as driver, running(driver) as (run, place):
        whole(place / f"whole.{suffix}", VALUES)
        data = (place / f"whole.{suffix}").read_bytes()
        (place / f"whole.{suffix}").unlink()
        target = place / f"000000000000.{suffix}"
        got: list[np.ndarray] = []
        reader = threading.Thread(target=lambda: got.append(all_of(run)))
        target.write_bytes(data[:-3])  # of the last number
        reader.start()
        until((place / "alive.json").exists)  # it has looked
        assert not got
        with target.open("ab") as file:
            file.write(data[-3:])
        reader.join()
        assert np.array_equal(got[0], VALUES.T)
        assert not target.exists()


def test_numbers_of_all_kinds_are_taken(tmp_path) -> None:
    with logger(tmp_path) as driver, running(driver) as (run, place):
        whole(place / "000000000000.npy", VALUES[:4].astype(np.int16))
        whole(place / "000000000004.npy", np.asfortranarray(VALUES[4:].astype(np.float32)))
        assert np.array_equal(all_of(run), VALUES.T)


def lost(place: Path) -> None:
    whole(place / "000000000007.npy", VALUES[7:])


def twice(place: Path) -> None:
    whole(place / "000000000002.npy", VALUES[2:5])


def too_many(place: Path) -> None:
    whole(place / "000000000005.npy", np.zeros((6, 2)))


def other_columns(place: Path) -> None:
    whole(place / "000000000005.npy", np.zeros((5, 3)))


def no_rows(place: Path) -> None:
    whole(place / "000000000005.npy", np.zeros((0, 2)))


def objects(place: Path) -> None:
    np.save(place / "000000000005.npy", np.array([[{"a": 1}, 2]], dtype=object), allow_pickle=True)


def text(place: Path) -> None:
    (place / "000000000005.npy").write_text("1,2\n3,4\n")


def complaint(place: Path) -> None:
    (place / "error.json").write_text('{"code": "device_gone", "detail": "the amplifier is off"}')


def broken_complaint(place: Path) -> None:
    (place / "error.json").write_text("[1]")


@pytest.mark.parametrize(
    ("trouble", "code", "says"),
    [
        (lost, "overrun", "samples are lost from 5 on: 000000000007.npy came instead"),
        (twice, "out_of_order", "000000000002.npy came after sample 4 had been read"),
        (too_many, "out_of_order", "must end with sample 9, it ends with 10"),
        (other_columns, "wrong_file", r"must have rows of 2 columns, .* got the shape \(5, 3\)"),
        (no_rows, "wrong_file", r"got the shape \(0, 2\)"),
        (objects, "wrong_file", "must hold numbers, got object"),
        (text, "wrong_file", "must be NPY"),
        (complaint, "device_gone", "the other program: the amplifier is off"),
        (broken_complaint, "wrong_file", "error.json must hold a JSON object, got list"),
    ],
)
def test_what_is_not_as_agreed_ends_the_run(tmp_path, trouble: Callable[[Path], None], code: str, says: str) -> None:
    with logger(tmp_path) as driver, running(driver) as (run, place):
        whole(place / "000000000000.npy", VALUES[:5])
        assert run.read().shape == (2, 5)
        trouble(place)
        with pytest.raises(AttemptError, match=says) as caught:
            run.read()
        assert caught.value.code == code


def test_csv_that_is_no_table_is_refused(tmp_path) -> None:
    with logger(tmp_path, format="csv") as driver, running(driver) as (run, place):
        (place / "000000000000.csv").write_text("1,2\n3;4\n")
        with pytest.raises(AttemptError, match="must be numbers with commas between them"):
            run.read()


@pytest.mark.parametrize(
    "device", [[], {"inputs": [{"name": "a"}]}, {"inputs": [{"name": "a", "range": "wide"}]}, {"inputs": 3}]
)
def test_a_description_that_is_none_is_refused(tmp_path, device) -> None:
    with logger(tmp_path, device=device) as driver, pytest.raises(AttemptError) as caught:
        driver.channels()
    assert caught.value.code == "wrong_file"


def test_nobody_at_the_other_side_is_told(tmp_path) -> None:
    driver = Files(FileSettings(folder=str(tmp_path), deadline=0.05), rig="bench-1")
    with pytest.raises(AttemptError, match=r"device.json must come within 0.05 s") as caught:
        driver.devices()
    assert caught.value.code == "server_unreachable"
    assert list(tmp_path.iterdir()) == []  # and nothing is left lying
    nowhere = Files(FileSettings(folder=str(tmp_path / "nowhere"), deadline=0.05), rig="bench-1")
    with pytest.raises(AttemptError, match=r"daq\.folder must be a writable folder"):
        nowhere.devices()
