"""Clients that each ask once a second, as people with a browser open do: how long reads take, and whether anything fails."""

from __future__ import annotations

import asyncio
import random
import time
from collections import Counter
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import Any

import httpx

SYSTEM = {
    "name": "lag",
    "blocks": {
        "u": {"kind": "input"},
        "lag": {"kind": "transfer_function", "numerator": [1], "denominator": [0.5, 1]},
    },
    "connections": [{"from": "u", "to": "lag"}],
    "outputs": {"y": "lag"},
}


@dataclass
class Outcome:
    """What came of a load: statuses, and the times (s) of reads and of writes."""

    statuses: Counter[int] = field(default_factory=Counter)
    reads: list[float] = field(default_factory=list)
    writes: list[float] = field(default_factory=list)
    failures: Counter[str] = field(default_factory=Counter)

    def percentile(self, share: float) -> float:
        """Return the time below which this share of the reads was."""
        ordered = sorted(self.reads)
        return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


async def load(url: str, key: str, *, clients: int, seconds: float, seed: int = 0) -> Outcome:
    """Let clients ask once a second each: nine reads for one system that is written."""
    outcome = Outcome()
    # each with a connection of its own, as in as many browsers: one pool of 200 would be searched at every request
    context = httpx.create_ssl_context()

    def connected() -> httpx.AsyncClient:
        headers = {"Authorization": f"Bearer {key}"}
        return httpx.AsyncClient(base_url=url, headers=headers, timeout=30, trust_env=False, verify=context)

    async with connected() as first:
        known = (await first.post("/v1/systems", json=SYSTEM)).json()["id"]
    async with AsyncExitStack() as open_:
        people = [await open_.enter_async_context(connected()) for _ in range(clients)]
        begun = time.perf_counter()
        await asyncio.gather(
            *(
                _client(
                    client,
                    outcome,
                    known=known,
                    begun=begun,
                    seconds=seconds,
                    chance=random.Random(seed + n),  # noqa: S311 - no secret
                )
                for n, client in enumerate(people)
            )
        )
    return outcome


async def _client(
    client: httpx.AsyncClient, outcome: Outcome, *, known: str, begun: float, seconds: float, chance: random.Random
) -> None:
    first = chance.random()
    for turn in range(int(seconds)):
        await asyncio.sleep(max(begun + first + turn - time.perf_counter(), 0.0))
        writes = chance.random() < 0.1
        asked: tuple[str, str, dict[str, Any]] = (
            ("POST", "/v1/systems", {"json": SYSTEM}) if writes
            else ("GET", chance.choice([f"/v1/systems/{known}", "/v1/systems?limit=20", "/v1/jobs?limit=20"]), {})
        )  # fmt: skip
        sent = time.perf_counter()
        try:
            reply = await client.request(asked[0], asked[1], **asked[2])
        except httpx.HTTPError as error:
            outcome.failures[type(error).__name__] += 1
            continue
        (outcome.writes if writes else outcome.reads).append(time.perf_counter() - sent)
        outcome.statuses[reply.status_code] += 1
