"""The right to move the rig ends by this PC's own steady clock, before the service takes it away."""

from __future__ import annotations

import socket

import pytest

from agent import lease as lease_module
from agent.errors import AttemptError
from agent.lease import Lease
from agent.service import Service

CLAIM = {"acquisition": "acq_1", "attempt": 1, "lease_seconds": 30.0, "request": {}}


class Clock:
    """Time as the test sets it."""

    now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return self.now


def test_nobody_heard_of_for_four_fifths_of_a_lease_stops_the_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    """30 s of lease: after 24 s the rig begins to come to rest, six seconds before anybody else may have it."""
    clock = Clock()
    monkeypatch.setattr(lease_module, "time", clock)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        nobody = f"http://127.0.0.1:{probe.getsockname()[1]}"
    service = Service(nobody, key=lambda: "st_key", timeout=5.0)
    lease = Lease(service, "agt_1", CLAIM)
    assert lease.clock_uncertainty is None
    clock.now += 23.9
    lease.check()
    clock.now += 0.2
    for _ in range(2):
        with pytest.raises(AttemptError, match="the service must be heard of within 24 s, it was not") as lost:
            lease.check()
        assert lost.value.code == "lease_lost"
        clock.now -= 20.0  # once lost, it stays so
    service.close()
