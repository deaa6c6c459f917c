"""The axis that is looked after every night: what has changed is noticed, identified and tuned again, and somebody is told."""

from __future__ import annotations

import re
from ipaddress import ip_network

import pytest

from examples import nightly
from tests.integration.api.conftest import serving, working


@pytest.fixture
def lively(sqlite_template, tmp_path):
    """A service that may call this machine, with a worker."""
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    url = f"sqlite:///{path}"
    with working(url), serving(url, webhook_networks=[ip_network("127.0.0.0/8")]) as running:
        yield running


def test_two_nights(lively, capsys) -> None:
    assert nightly.main(["--url", lively.url, "--key", lively.keys["admin"], "--tonight"]) == 0
    said = capsys.readouterr().out
    unchanged, slower = said.split("The axis is slower")
    assert "ALERT" not in unchanged
    # 0.10/(0.045 s + 1) against 0.12/(0.030 s + 1) under a chirp up to 25 Hz: far beyond 5 %
    assert re.search(r"ALERT: relative error must be at most 5 %, got velocity [\d.]+ %", slower)
    for part, gain, lag in ((unchanged, 0.12, 0.030), (slower, 0.10, 0.045)):
        found = re.search(r"identified: gain ([\d.]+) .*?lag ([\d.]+) s", part)
        assert found is not None, said
        assert float(found[1]) == pytest.approx(gain, rel=0.01)
        assert float(found[2]) == pytest.approx(lag, rel=0.02)
    tuned = [float(kp) for kp in re.findall(r"tuned: kp ([\d.]+) V/m", said)]
    # Second order with overshoot exp(-π ζ/√(1-ζ²)) = 2 %: ζ = 0.7797, and kp gain lag = 1/(4 ζ²).
    for kp, gain, lag in zip(tuned, (0.12, 0.10), (0.030, 0.045), strict=True):
        assert kp * gain * lag == pytest.approx(1 / (4 * 0.7797**2), rel=0.03)
    with lively.client() as client:
        revisions = {item["name"]: item["revision"] for item in client.get("/v1/systems").json()["items"]}
        assert revisions == {"axis 7: drive": 3, "axis 7: position loop": 5}
        assert client.get("/v1/schedules").json()["items"] == client.get("/v1/webhooks").json()["items"] == []
