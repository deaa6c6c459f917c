"""What a body costs by its keys, where the last one is there twice."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

from api.http.bodies import parse


def costs(*, repetitions: int = 5) -> Iterator[tuple[int, float, str]]:
    """Yield numbers of keys, the least processor time (s) that such a body takes, and what it is refused with."""
    for count in (10**3, 10**4, 10**5, 10**6):
        members = ",".join(f'"k{i}": {i}' for i in (*range(count - 1), count - 2))
        body = f"{{{members}}}".encode()
        taken = []
        for _ in range(repetitions):
            began = time.process_time()
            refused = _refusal(body)
            taken.append(time.process_time() - began)
        yield count, min(taken), refused


def _refusal(body: bytes) -> str:
    try:
        parse(body)
    except json.JSONDecodeError as error:
        return error.msg
    return "nothing"
