"""Secrets that must be read again, encrypted at rest.

Fernet (https://github.com/fernet/spec): AES-128-CBC with HMAC-SHA256, under keys that
are in the settings of the service and never in the database::

    kept = "fernet:" + token(key_1, secret)

Of several keys the first one encrypts and all of them decrypt, so that keys can be changed. Without any, secrets are kept as they are.
"""

from __future__ import annotations

from collections.abc import Sequence

from cryptography.fernet import Fernet, InvalidToken, MultiFernet

from storage.errors import VaultError

_SEALED = "fernet:"


class Vault:
    """Encrypts and decrypts secrets.

    Parameters
    ----------
    keys : sequence of str
        Each 32 bytes in URL-safe base64.

    Raises
    ------
    ValueError
        For a key that is none.
    """

    def __init__(self, keys: Sequence[str] = ()) -> None:
        own = [Fernet(key) for key in keys]
        self._first = own[0] if own else None
        self._all = MultiFernet(own) if own else None

    def seal(self, secret: str) -> str:
        """Return a secret as it is kept."""
        return secret if self._first is None else _SEALED + self._first.encrypt(secret.encode()).decode()

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
