"""Secrets that must be read again, encrypted at rest.

Fernet (https://github.com/fernet/spec): AES-128-CBC with HMAC-SHA256, under keys that
are in the settings of the service and never in the database::

    kept = "fernet:" + token(key_1, secret)

Of several keys the first one encrypts and all of them decrypt, so that keys can be changed. Without any, no secret is kept, unless
it may be kept as it is. What a browser keeps for the service is sealed under the same keys, for a time.
"""

from __future__ import annotations

from collections.abc import Sequence

from cryptography.fernet import Fernet, InvalidToken, MultiFernet

from storage.errors import VaultError

_SEALED = "fernet:"
#: What is wrong, and what helps.
NO_KEY = (
    "there must be a key for secrets: set SERVOTUNE_SECRET_KEY (openssl rand -base64 32), "
    "or SERVOTUNE_PLAIN_SECRETS=true to keep those of webhooks as they are, got neither"
)


class Vault:
    """Encrypts and decrypts secrets.

    Parameters
    ----------
    keys : sequence of str
        Each 32 bytes in URL-safe base64.
    plain : bool
        Whether a secret may be kept as it is where there is no key.

    Raises
    ------
    VaultError
        For a key that is none.
    """

    def __init__(self, keys: Sequence[str] = (), *, plain: bool = False) -> None:
        try:
            own = [Fernet(key) for key in keys]
        except ValueError as error:  # what was got is a secret
            raise VaultError("the key of secrets must be 32 bytes in base64, got others") from error
        self._plain = plain
        self._first = own[0] if own else None
        self._all = MultiFernet(own) if own else None

    def seal(self, secret: str) -> str:
        """Return a secret as it is kept.

        Raises
        ------
        VaultError
            When there is no key, and it may not be kept as it is.
        """
        if self._first is None and self._plain:
            return secret
        return _SEALED + self.lend(secret)

    def lend(self, text: str) -> str:
        """Return what somebody else may keep for the service, who can neither read nor change it; raises `VaultError` without a key."""
        if self._first is None:
            raise VaultError(NO_KEY)
        return self._first.encrypt(text.encode()).decode()

    def take_back(self, lent: str, *, seconds: int) -> str | None:
        """Return what was lent at most so long ago, None for anything else."""
        try:
            return None if self._all is None else self._all.decrypt(lent, ttl=seconds).decode()
        except InvalidToken:
            return None

    def open(self, kept: str) -> str:
        """Return the secret that is kept so.

        Raises
        ------
        VaultError
            When it was encrypted under another key.
        """
        if not kept.startswith(_SEALED):
            return kept
        if self._all is None:
            raise VaultError("the key must be given under which the secrets of webhooks were encrypted, got none")
        try:
            return self._all.decrypt(kept.removeprefix(_SEALED)).decode()
        except InvalidToken as error:
            raise VaultError(
                "the key must be the one under which the secrets of webhooks were encrypted, got another"
            ) from error

    def renewed(self, kept: str) -> str:
        """Return what is kept, encrypted under the first key; the same where it is already. Raises as `open` does."""
        if self._first is None:
            self.open(kept)
            return kept
        return kept if self._is_current(kept) else self.seal(self.open(kept))

    def _is_current(self, kept: str) -> bool:
        if self._first is None or not kept.startswith(_SEALED):
            return False
        try:
            self._first.decrypt(kept.removeprefix(_SEALED))
        except InvalidToken:
            return False
        return True
