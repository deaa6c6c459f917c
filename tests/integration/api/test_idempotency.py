"""What is kept to be repeated, and what is computed anew."""

from __future__ import annotations

import pytest

from tests.integration.api.documents import LAG


# One number of a curve takes about 18 bytes; an answer is kept up to 1 MiB.
@pytest.mark.parametrize(("samples", "kept"), [(100, True), (50_000, False)])
def test_a_large_answer_that_creates_nothing_is_computed_again(client, samples, kept) -> None:
    body = {"system": LAG, "input": {"port": "u", "signal": {"kind": "step"}}, "samples": samples}
    headers = {"Idempotency-Key": f"simulation of {samples}"}
    first, second = (client.post("/v1/simulations", json=body, headers=headers) for _ in range(2))
    assert first.status_code == second.status_code == 200
    assert (len(first.content) <= 2**20) == kept
    assert first.content == second.content
    assert ("Idempotency-Replayed" in second.headers) == kept
