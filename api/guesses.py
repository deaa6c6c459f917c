"""How often an address may show a key that does not open: nobody tries many."""

from __future__ import annotations

import hashlib

from api.problems import Problem
from api.rates import Allowance, Rates

#: Secrets that have opened, of which the hash is remembered in this process.
_MOST_KNOWN = 10_000


class Guesses:
    """The wrong keys of every address; who has shown a right one is not kept out by a neighbour's wrong ones.

    Parameters
    ----------
    rates : Rates
        How many wrong keys an address has in a minute.
    """

    def __init__(self, rates: Rates) -> None:
        self._rates = rates
        self._known: dict[bytes, None] = {}

    def check(self, address: str, secret: str) -> None:
        """Let a request go on to be looked up.

        Raises
        ------
        Problem
            429 for a new secret from an address with too many wrong ones.
        """
        allowance = self._rates.look(address)
        if allowance is not None and allowance.wait > 0.0 and secret and _hash(secret) not in self._known:
            raise _too_many(allowance)

    def failed(self, address: str) -> None:
        """Count a wrong key."""
        self._rates.take(address)

    def opened(self, secret: str) -> None:
        """Remember a right one."""
        key = _hash(secret)
        self._known.pop(key, None)
        self._known[key] = None
        if len(self._known) > _MOST_KNOWN:
            del self._known[next(iter(self._known))]


def _hash(secret: str) -> bytes:
    return hashlib.sha256(secret.encode(errors="surrogatepass")).digest()


def _too_many(allowance: Allowance) -> Problem:
    detail = f"an address must show at most {allowance.quota} wrong keys in a minute, got more"
    return Problem(429, "too-many-wrong-keys", detail, headers={"Retry-After": allowance.headers()["Retry-After"]})
