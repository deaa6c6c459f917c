"""Identifiers that sort by time of creation and cannot be guessed: ``sys_01kb...``.

A prefix, then a ULID: 48 bits of Unix milliseconds and 80 random bits in Crockford's base 32
(https://github.com/ulid/spec), lower case.
"""

from __future__ import annotations

import os
import time

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"


def new_id(prefix: str) -> str:
    """Return a fresh identifier such as ``job_01kb6w0x3v8c6f3m1t9q2r5e7a``."""
    number = (time.time_ns() // 1_000_000) << 80 | int.from_bytes(os.urandom(10))
    return prefix + "_" + "".join(_ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))
