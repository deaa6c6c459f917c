"""Services that somebody has logged in to: address and key by a name, so that scripts and commands need neither.

The key lies in the keyring of the operating system where the package keyring (the extra `keyring`) finds one, else beside the address in
a file that its owner alone may read.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

DEFAULT = "default"
_SERVICE = "servotune"


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """A service, and who one is there."""

    url: str
    key: str | None = field(default=None, repr=False)


def path() -> Path:
    """Return the file of all profiles, where programs of this operating system keep such things."""
    return Path(click.get_app_dir("servotune", force_posix=False)) / "profiles.json"


def names() -> list[str]:
    """Return the names of all profiles."""
    return sorted(_read())


def load(name: str) -> Profile | None:
    """Return a profile, None where there is none of this name."""
    found = _read().get(name)
    if found is None:
        return None
    return Profile(url=str(found["url"]), key=found.get("key") or _from_keyring(name))


def save(name: str, profile: Profile) -> str:
    """Keep a profile under a name, in place of another one; return where its key is."""
    stored = _read()
    in_keyring = profile.key is not None and _to_keyring(name, profile.key)
    stored[name] = {"url": profile.url} | ({} if in_keyring or profile.key is None else {"key": profile.key})
    _write(stored)
    return "the keyring of this computer" if in_keyring else str(path())


def remove(name: str) -> bool:
    """Forget a profile; return whether there was one."""
    stored = _read()
    if stored.pop(name, None) is None:
        return False
    keyring = _keyring()
    if keyring is not None:
        with suppress(keyring.errors.KeyringError):
            keyring.delete_password(_SERVICE, name)
    _write(stored)
    return True


def _read() -> dict[str, dict[str, Any]]:
    try:
        found: dict[str, dict[str, Any]] = json.loads(path().read_bytes())
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise ValueError(
            f"{path()} must be the JSON that `servotune login` wrote, got {error}: remove it, log in again"
        ) from error
    return found


def _write(profiles: dict[str, dict[str, Any]]) -> None:
    """Write the file whole, for its owner alone."""
    target = path()
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(f"{target.name}.part")
    part.unlink(missing_ok=True)
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        json.dump(profiles, file, indent=2)
    part.replace(target)


def _keyring() -> Any:
    """Return the package, None where it is not installed."""
    try:
        import keyring  # noqa: PLC0415 - an extra
        import keyring.errors  # noqa: PLC0415 - as above
    except ModuleNotFoundError:
        return None
    return keyring


def _to_keyring(name: str, key: str) -> bool:
    """Put a key into the keyring; return whether there is one that takes it."""
    keyring = _keyring()
    if keyring is None:
        return False
    try:
        keyring.set_password(_SERVICE, name, key)
    except keyring.errors.KeyringError:
        return False
    return _from_keyring(name) == key  # there are keyrings that keep nothing


def _from_keyring(name: str) -> str | None:
    keyring = _keyring()
    if keyring is None:
        return None
    try:
        found: str | None = keyring.get_password(_SERVICE, name)
    except keyring.errors.KeyringError:
        return None
    return found
