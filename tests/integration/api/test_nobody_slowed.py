"""Whoever asks for much waits for his own: others are answered, nothing holds a thread, and what nobody wants any more ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from tests.integration.api.conftest import Service, asked, serving
from tests.integration.api.documents import LAG, PNEUMATIC, STEP, chain
from tests.support.patience import PATIENCE

#: More than there are threads for requests.
MANY = 45
SMALL = {"system": LAG, "input": {"port": "u", "signal": {"kind": "step"}}}


LARGE = {"system": chain(90), "input": {"port": "u", "signal": {"kind": "step"}}}


def until(holds: Callable[[], bool]) -> None:
    """Wait for something that comes of itself."""
    limit = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < limit
        time.sleep(0.01)


@pytest.fixture(scope="module")
def busy(sqlite_template: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service of one slot that lets as many requests of one key wait as there are below."""
    path = tmp_path_factory.mktemp("service") / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", compute_slots=1, waiting_requests=MANY, request_seconds=600) as running:
        yield running


def test_beside_more_slow_requests_than_threads_everybody_else_is_answered_and_one_more_is_refused(busy) -> None:
    assert busy.app is not None
    computing = busy.app.state.installation.computing
    with ExitStack() as open_ones:
        for _ in range(1 + MANY):
            open_ones.enter_context(closing(asked(busy, LARGE)))
        until(lambda: computing.large.waiting == MANY)
        with busy.client("stranger") as other:
            assert other.get("/readyz").status_code == 200
            assert other.get("/v1/systems").status_code == 200
            assert other.post("/v1/simulations", json=SMALL).status_code == 200
        with busy.client("admin") as own:
            assert own.post("/v1/simulations", json=SMALL).status_code == 200  # also one's own small ones
            refused = own.post("/v1/simulations", json=LARGE)
        assert refused.status_code == 429
        assert refused.headers["Retry-After"] == "5"
        assert refused.json()["type"] == "urn:servotune:problem:too-many-waiting"
        assert computing.large.waiting == MANY
    # All of them have left: nothing waits, nothing computes.
    until(lambda: computing.large.waiting == 0)
    until(lambda: not computing._children._children)


INFLUENCE = {
    "system": PNEUMATIC, "input": "reference", "output": "position", "parameters": ["kp", "m"], "open_at": "controller",
    "metrics": ["overshoot", "phase_margin"], "predict": [{"kp": 120}],
}  # fmt: skip
REQUESTS: list[tuple[str, dict[str, Any]]] = [
    ("simulations", {"system": PNEUMATIC, "input": STEP, "variants": [{}, {"kp": 120}]}),
    ("simulations", {"system": PNEUMATIC, "input": STEP, "variants": [{}, {"kq": 120}]}),
    ("simulations", {"system": "sys_none", "input": STEP}),
    ("simulations", {"system": PNEUMATIC, "input": STEP, "samples": 10_000_000}),
    ("frequency-responses", {"system": PNEUMATIC, "open_at": "controller"}),
    ("influence", INFLUENCE),
    ("influence", INFLUENCE | {"parameters": ["kq"]}),
    ("spectra", {"system": PNEUMATIC, "input": STEP, "output": "velocity", "quantity": "transform"}),
    ("frfs", {"dataset": "ds_none", "input": "u", "output": "y"}),
    ("validations", {"system": PNEUMATIC, "dataset": "ds_none", "inputs": {"reference": "u"}, "outputs": {"position": "y"}}),
]  # fmt: skip


@pytest.fixture(scope="module")
def apart(sqlite_template: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service for which nothing is quick: everything is computed in a process of its own, in 512 MiB."""
    path = tmp_path_factory.mktemp("apart") / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", quick_seconds=1e-9, request_memory=1 << 29) as running:
        yield running


@pytest.mark.parametrize(("path", "body"), REQUESTS)
def test_a_process_of_its_own_answers_what_a_thread_answers(busy, apart, path, body) -> None:
    with busy.client() as here, apart.client() as there:
        one, other = here.post(f"/v1/{path}", json=body), there.post(f"/v1/{path}", json=body)
    assert (other.status_code, other.headers["Content-Type"]) == (one.status_code, one.headers["Content-Type"])
    assert other.json() == one.json()


def test_what_a_process_computed_is_kept_and_repeated(apart) -> None:
    body = {"system": LAG, "input": {"port": "u", "signal": {"kind": "step"}}, "keep": True}
    with apart.client() as client:
        first = client.post("/v1/simulations", json=body, headers={"Idempotency-Key": "once"})
        again = client.post("/v1/simulations", json=body, headers={"Idempotency-Key": "once"})
        kept = client.get(f"/v1/results/{first.json()['id']}").json()["result"]
    assert (first.status_code, again.headers["Idempotency-Replayed"]) == (200, "true")
    assert again.json() == first.json() == {"id": first.json()["id"], **kept}


def test_a_process_that_takes_too_much_memory_says_so(apart) -> None:
    with apart.client() as client:
        reply = client.post("/v1/simulations", json=SMALL | {"samples": 100_000, "variants": [{}] * 25})
    assert (reply.status_code, reply.json()["type"]) == (422, "urn:servotune:problem:too-large")
    assert reply.json()["detail"].startswith("a request must need at most 536870912 bytes of memory")


def test_a_process_that_takes_too_long_is_ended(sqlite_template, tmp_path) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", request_seconds=0.5) as service:
        with service.client() as client:
            reply = client.post("/v1/simulations", json=LARGE)
        assert service.app is not None
        children = service.app.state.installation.computing._children._children
        until(lambda: not children)
    assert (reply.status_code, reply.json()["type"]) == (422, "urn:servotune:problem:too-long")
