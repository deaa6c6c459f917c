"""What must come out when the network, a process, the driver or the disk fails: no sample lost, nothing left moving."""

from __future__ import annotations

import hashlib
import math
import time
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from agent import process, service, uploading
from rig_simulator.bench import Bench, Task
from storage import open_database
from storage.models import AcquisitionAttempt, Agent
from storage.models.base import utc_now
from tests.integration.agent.lab import document

PROBLEM = "urn:servotune:problem:"


def _running(lab, asked: str, *, progress: float = 0.0) -> None:
    lab.wait(asked, "running")
    job = lab.get(asked)["job"]
    lab.until(lambda: lab.client.get(f"/v1/jobs/{job}").json()["progress"] >= progress)


@pytest.mark.parametrize(
    ("fault", "code"),
    [("unplug", "device_gone"), ("overrun", "overrun")],
)
def test_what_was_recorded_before_a_fault_arrives(lab, fault, code) -> None:
    with lab.agent():
        lab.registered()
        if fault == "unplug":
            lab.bench.unplug("cDAQ1Mod1", after=900)
        else:
            lab.bench.speed = 1.0
        asked = lab.ask(duration=2)
        if fault == "overrun":
            lab.wait(asked, "running")
            lab.until(lambda: lab.runs() != [] and len(list(lab.runs()[0].glob("*.f64"))) > 2)
            lab.bench.overrun()
        failed = lab.wait(asked)
    attempt = failed["attempts"][0]
    assert (failed["status"], attempt["error"]["type"]) == ("failed", PROBLEM + code)
    assert " - " in attempt["error"]["detail"]  # what to do
    assert lab.whole(asked).shape[0] < 3400
    assert attempt["facts"]["complete"] is False
    assert lab.level() == 0.0  # the output, on another module, is at rest
    assert lab.runs() == []


@pytest.mark.parametrize("duration", [60, 3000])  # written whole before the start, and as it goes
def test_an_output_that_is_pulled_out_ends_the_run_at_once(lab, duration) -> None:
    lab.bench.speed = 1.0
    settings = lab.settings()
    valve = replace(settings.outputs[0], duration=math.inf)
    with lab.agent(replace(settings, outputs=(valve,))):
        asked = lab.ask(duration=duration)
        _running(lab, asked)
        lab.bench.unplug("cDAQ1Mod2")
        lab.until(lambda: lab.get(asked)["attempts"][0]["error"] is not None)
        lab.bench.plug("cDAQ1Mod2")  # only then can it be brought to rest
        failed = lab.wait(asked)
        lab.until(lambda: lab.level() == 0.0)
    error = failed["attempts"][0]["error"]
    assert (failed["status"], error["type"]) == ("failed", PROBLEM + "device_gone")
    assert "cDAQ1Mod2" in error["detail"]
    assert failed["attempts"][0]["facts"]["complete"] is False


def test_a_wrong_device_is_not_measured_with(lab) -> None:
    with lab.agent():
        lab.tried()
        lab.bench.devices["cDAQ1Mod1"].serial += 1
        failed = lab.wait(lab.ask())
    assert failed["attempts"][0]["error"]["type"] == PROBLEM + "wrong_device"
    assert "must be 01A2B3C4, got 01A2B3C5" in failed["attempts"][0]["error"]["detail"]


def test_a_frozen_device_server_holds_nobody(lab) -> None:
    lab.bench.speed = 1.0
    with lab.agent(lab.settings(**{"daq.deadline": 1.0})):
        asked = lab.ask(duration=30)
        _running(lab, asked, progress=0.01)
        lab.bench.awake.clear()
        failed = lab.wait(asked)
        error = failed["attempts"][0]["error"]
        assert error["type"] == PROBLEM + "server_unreachable"
        assert "could not be brought to 0 V" in error["detail"]  # said, not hidden
        assert failed["attempts"][0]["facts"]["output_at_rest"] is False
        lab.whole(asked)
        # Nothing is measured before the output is at rest.
        lab.bench.awake.set()
        assert lab.wait(lab.ask(duration=0.2))["status"] == "done"
        assert lab.level() == 0.0


def test_a_lost_lease_stops_the_rig_and_late_samples_are_kept(lab, service) -> None:
    lab.bench.speed = 1.0
    with lab.agent():
        asked = lab.ask(duration=30)
        _running(lab, asked, progress=0.01)
        database = open_database(service.database_url)
        with database.session() as session:
            attempt = session.query(AcquisitionAttempt).filter_by(acquisition_id=asked).one()
            attempt.lease_until = utc_now() - timedelta(seconds=1)
        database.dispose()
        lab.wait(asked, "lost")
        lab.until(lambda: lab.attempt(asked)["late"] and lab.runs() == [])
    assert lab.attempt(asked)["status"] == "lost"
    assert lab.level() == 0.0
    lab.whole(asked)
    assert lab.get(asked)["status"] == "lost"  # until a person retries


def test_a_second_agent_leaves_a_rig_alone_that_has_one(lab, service) -> None:
    lab.bench.speed = 1.0
    second = lab.settings(**{"spool.folder": str(lab.folder / "second")})
    with ExitStack() as first:
        first.enter_context(lab.agent())
        asked = lab.ask(duration=3)
        _running(lab, asked, progress=0.01)
        with lab.agent(second):
            assert lab.wait(asked)["status"] == "done"  # neither stopped nor brought to rest by the newcomer
            lab.whole(asked)
            first.close()  # it has ended before the next one is asked for, and so cannot take it
            waiting = lab.ask(duration=0.2)
            database = open_database(service.database_url)
            with database.session() as session:
                holder = session.get(Agent, lab.attempt(asked)["agent"])
                holder.seen_at = utc_now() - timedelta(seconds=60)
            database.dispose()
            done = lab.wait(waiting)
    assert done["status"] == "done"
    assert done["attempts"][0]["agent"] != lab.attempt(asked)["agent"]


def test_a_revoked_key_stops_the_rig_and_a_new_one_brings_the_samples(lab) -> None:
    lab.bench.speed = 1.0
    made = lab.client.post("/v1/keys", json={"name": "lab PC", "scopes": ["acquire"]}).json()
    key_file = lab.folder / "key"
    key_file.write_text(made["key"])
    settings = lab.settings(**{"service.key": "", "service.key_file": str(key_file)})
    with lab.agent(settings):
        asked = lab.ask(duration=30)
        _running(lab, asked, progress=0.01)
        lab.client.delete(f"/v1/keys/{made['id']}").raise_for_status()
        lab.until((lab.runs()[0] / "end.json").exists)
        assert document(lab.runs()[0] / "end.json")["error"]["code"] == "lease_lost"
        assert lab.level() == 0.0
        recorded = document(lab.runs()[0] / "end.json")["facts"]["samples"]
        key_file.write_text(lab.service.keys["acquire"])
        lab.until(lambda: lab.runs() == [])
    attempt = lab.attempt(asked)
    # Its lease had not ended yet, so its own agent ends it: failed; after that time it would be lost.
    assert attempt["status"] in {"failed", "lost"}
    assert lab.whole(asked).shape[0] == recorded


def test_without_a_service_the_samples_wait_on_the_disk(lab, monkeypatch) -> None:
    """The network goes away during the measurement and comes back days later, to another process of the agent."""
    real = service.Service._send
    cut = {"heartbeat", "dataset", "segments", "commit", "finish"}

    def send(self, method, path, **given):
        if path.rsplit("/", 1)[-1] in cut or "/segments/" in path:
            raise service.UnreachableError("no answer")
        return real(self, method, path, **given)

    monkeypatch.setattr(service.Service, "_send", send)
    monkeypatch.setattr(process, "_PATIENCE_AT_END", 0.1)
    with lab.agent():
        asked = lab.ask()
        lab.until(lambda: lab.runs() != [] and (lab.runs()[0] / "end.json").exists())
    (run,) = lab.runs()
    recorded = document(run / "end.json")["facts"]
    assert recorded["complete"] is True
    local = b"".join(path.read_bytes() for path in sorted(run.glob("*.f64")))
    monkeypatch.undo()
    with lab.agent():
        lab.until(lambda: lab.runs() == [])
    attempt = lab.attempt(asked)
    assert (attempt["status"], attempt["error"]) == ("done", None)  # its lease had not ended
    arrived = lab.client.get(f"/v1/datasets/{attempt['dataset']}").json()
    assert arrived["sha256"] == hashlib.sha256(local).hexdigest()
    assert arrived["size"] == len(local) == recorded["samples"] * 16


def test_a_run_whose_samples_have_piled_up_is_not_lost_while_they_are_sent(lab, monkeypatch) -> None:
    """A slow network: the run is over long before its samples have left; that is told before the next piece of them."""
    lab.bench.speed = 1.0
    put, heartbeat = service.Service.put, service.Service.heartbeat
    told = []

    def slow(self, dataset, segment, data):
        if not told.count("segment"):
            told.append("segment")
            lab.until(lambda: len(list(lab.runs()[0].glob("*.f64"))) > 3)
            raise service.UnreachableError("no answer")
        lab.until((lab.runs()[0] / "end.json").exists)
        told.append("segment")
        put(self, dataset, segment, data)

    def beat(self, claim, document):
        told.append(document["status"])
        return heartbeat(self, claim, document)

    monkeypatch.setattr(service.Service, "put", slow)
    monkeypatch.setattr(service.Service, "heartbeat", beat)
    with lab.agent():
        done = lab.wait(lab.ask(duration=2))
    assert done["status"] == "done"
    assert told.count("segment") > 4
    # The first one broke off, the second one was on its way when the run ended.
    assert told[: told.index("uploading")].count("segment") <= 2
    lab.whole(done["id"])


def test_segments_that_are_torn_on_their_way_are_sent_again(lab, monkeypatch) -> None:
    torn = []
    real = service.Service.put

    def put(self, dataset, segment, data):
        if len(torn) < 2:
            torn.append(segment.sha256)
            data = data[:-8] + b"\0" * 7 + b"\1"
        real(self, dataset, segment, data)

    monkeypatch.setattr(service.Service, "put", put)
    with lab.agent():
        done = lab.wait(lab.ask())
    assert done["status"] == "done"
    assert len(torn) == 2
    lab.whole(done["id"])


def test_a_segment_that_the_disk_spoils_is_told_and_the_others_arrive(lab, monkeypatch) -> None:
    """Power comes back; a sector does not."""
    monkeypatch.setattr(uploading.Uploader, "_round", lambda self: False)
    monkeypatch.setattr(process, "_PATIENCE_AT_END", 0.0)
    with lab.agent():
        asked = lab.ask()
        lab.until(lambda: lab.runs() != [] and (lab.runs()[0] / "end.json").exists())
    (run,) = lab.runs()
    pieces = sorted(run.glob("*.f64"))
    good = [np.frombuffer(path.read_bytes(), "<f8").reshape(-1, 2) for path in pieces]
    spoilt = bytearray(pieces[3].read_bytes())
    spoilt[100] ^= 1
    pieces[3].write_bytes(spoilt)
    monkeypatch.undo()
    with lab.agent():
        lab.until(lambda: lab.runs() == [])
    attempt = lab.attempt(asked)
    assert (attempt["status"], attempt["error"]["type"]) == ("failed", PROBLEM + "spoilt_segment")
    assert attempt["facts"]["spoilt_segments"] == [{"number": 3, "samples": good[3].shape[0]}]
    good[3] = np.full_like(good[3], np.nan)
    # Every other sample is there, at its place in time.
    assert np.array_equal(lab.samples(attempt["dataset"]), np.concatenate(good), equal_nan=True)


@pytest.mark.parametrize("limit", ["limit", "reserve"])
def test_a_disk_without_room_refuses_before_anything_moves(lab, limit) -> None:
    with lab.agent(lab.settings(**{f"spool.{limit}": 1000.0 if limit == "limit" else 1e18})):
        failed = lab.wait(lab.ask())
    assert failed["attempts"][0]["error"]["type"] == PROBLEM + "disk_full"
    assert failed["dataset"] is None


def test_a_disk_that_fills_up_stops_the_rig_and_what_is_on_it_arrives(lab, monkeypatch) -> None:
    from agent import spool

    pieces = []
    real = spool.os.fsync

    def fsync(file) -> None:
        # Samples only: where the uploader's notes find no room, it waits.
        if ".f64" in Path(f"/proc/self/fd/{file}").readlink().name:
            pieces.append(file)
            if len(pieces) >= 5:
                raise OSError(28, "No space left on device")
        real(file)

    monkeypatch.setattr(spool.os, "fsync", fsync)
    with lab.agent():
        failed = lab.wait(lab.ask(duration=3))
    attempt = failed["attempts"][0]
    assert attempt["error"]["type"] == PROBLEM + "disk_full"
    assert attempt["facts"]["complete"] is False
    assert lab.level() == 0.0
    lab.whole(failed["id"])


def test_a_disk_without_a_byte_left_does_not_hide_how_a_run_ended(lab, monkeypatch) -> None:
    """Another program fills the disk: there is no room for a note either, but for what the attempt has kept."""
    from agent import spool

    real, most = spool.os.fsync, []

    def lying() -> int:
        return sum(path.stat().st_size for path in lab.spool.rglob("*") if path.is_file())

    def fsync(file) -> None:
        if not most and len(list(lab.spool.glob("runs/*/*.f64"))) >= 3:
            most.append(lying())
        if most and lying() > most[0]:
            raise OSError(28, "No space left on device")
        real(file)

    monkeypatch.setattr(spool.os, "fsync", fsync)
    with lab.agent():
        failed = lab.wait(lab.ask(duration=3))
        lab.until(lambda: lab.runs() == [])
        assert most
        most[0] = 1 << 40
        assert lab.wait(lab.ask())["status"] == "done"
    attempt = failed["attempts"][0]
    assert (attempt["status"], attempt["error"]["type"]) == ("failed", PROBLEM + "disk_full")
    lab.whole(failed["id"])


def test_a_wrong_clock_does_not_show_in_the_recording(lab, monkeypatch) -> None:
    """The lab PC believes that it is nine years ago; leases run by a steady clock, recordings by the service's."""
    from agent import lease

    wrong = timedelta(days=-9 * 365).total_seconds()

    class Clock:
        monotonic = staticmethod(time.monotonic)

        @staticmethod
        def time() -> float:
            return time.time() + wrong

    class Calendar(lease.datetime):
        @classmethod
        def now(cls, tz=None):
            return super().now(tz) + timedelta(seconds=wrong)

    monkeypatch.setattr(lease, "time", Clock)
    monkeypatch.setattr(lease, "datetime", Calendar)
    before = utc_now()
    with lab.agent():
        done = lab.wait(lab.ask())
    assert done["status"] == "done"
    facts = done["attempts"][0]["facts"]
    assert facts["clock_offset"] == pytest.approx(-wrong, abs=2)
    started = lease.datetime.fromisoformat(lab.client.get(f"/v1/datasets/{done['dataset']}").json()["start_time"])
    assert before - timedelta(seconds=1) < started < utc_now() + timedelta(seconds=1)


@pytest.mark.parametrize(("before", "after"), [(0.4, 0.0), (0.0, 0.4)])
def test_a_recording_is_dated_by_its_first_sample_within_its_uncertainty(lab, monkeypatch, before, after) -> None:
    """Hardware that takes 0.4 s to begin, once before its first sample and once after it."""
    real, taken = Bench.start, []

    def start(bench: Bench, task: Task) -> None:
        if task.kind != "AI":
            return real(bench, task)
        time.sleep(before)
        taken.append(utc_now())
        real(bench, task)
        return time.sleep(after)

    monkeypatch.setattr(Bench, "start", start)
    with lab.agent():
        done = lab.wait(lab.ask())
    assert done["status"] == "done"
    facts = done["attempts"][0]["facts"]
    (first,) = taken
    told = datetime.fromisoformat(lab.client.get(f"/v1/datasets/{done['dataset']}").json()["start_time"])
    assert abs((told - first).total_seconds()) <= facts["start_time_uncertainty"]
    assert 0.2 + facts["clock_uncertainty"] <= facts["start_time_uncertainty"]
