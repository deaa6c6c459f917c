"""Profiles with a keyring, without one, and with one that refuses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import keyring
import keyring.backend
import keyring.errors
import pytest

import servotune
from servotune import profiles
from servotune.profiles import Profile

SERVICE = Profile(url="https://servotune.example", key="st_secret")


class Kept(keyring.backend.KeyringBackend):
    """A keyring in the memory of this test."""

    priority = 1.0

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.words: dict[tuple[str, str], str] = {}
        self.locked = False

    def set_password(self, service: str, username: str, password: str) -> None:
        if self.locked:
            raise keyring.errors.KeyringLocked("nobody is there to unlock it")
        self.words[service, username] = password

    def get_password(self, service: str, username: str) -> str | None:
        return self.words.get((service, username))

    def delete_password(self, service: str, username: str) -> None:
        if self.words.pop((service, username), None) is None:
            raise keyring.errors.PasswordDeleteError(username)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Kept]:
    for name in ("SERVOTUNE_URL", "SERVOTUNE_KEY", "SERVOTUNE_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    before, found = keyring.get_keyring(), Kept()
    keyring.set_keyring(found)
    yield found
    keyring.set_keyring(before)


def test_the_key_is_in_the_keyring_and_in_no_file(kept: Kept) -> None:
    assert profiles.save("default", SERVICE) == "the keyring of this computer"
    assert "st_secret" not in profiles.path().read_text()
    assert profiles.load("default") == SERVICE
    assert "st_secret" not in repr(SERVICE)
    assert profiles.remove("default")
    assert not kept.words
    assert not profiles.remove("default")


def test_a_locked_keyring_leaves_the_key_in_a_file_of_its_owner(kept: Kept) -> None:
    kept.locked = True
    assert profiles.save("default", SERVICE) == str(profiles.path())
    assert profiles.path().stat().st_mode & 0o777 == 0o600
    assert profiles.load("default") == SERVICE


def test_several_profiles_stand_beside_each_other(kept: Kept) -> None:
    other = Profile(url="http://127.0.0.1:9000", key="st_other")
    profiles.save("default", SERVICE)
    profiles.save("work", other)
    assert profiles.names() == ["default", "work"]
    assert (profiles.load("default"), profiles.load("work")) == (SERVICE, other)
    assert profiles.load("none") is None


@pytest.mark.parametrize(
    ("given", "environment", "whom"),
    [
        ({}, {}, ("https://servotune.example", "st_secret")),
        ({"url": "https://servotune.example/"}, {}, ("https://servotune.example", "st_secret")),
        ({"url": "http://elsewhere"}, {}, ("http://elsewhere", None)),
        ({}, {"SERVOTUNE_URL": "http://elsewhere"}, ("http://elsewhere", None)),
        ({}, {"SERVOTUNE_KEY": "st_mine"}, ("https://servotune.example", "st_mine")),
        ({}, {"SERVOTUNE_PROFILE": "work"}, ("http://127.0.0.1:9000", "st_other")),
        ({"profile": "work", "key": "st_mine"}, {}, ("http://127.0.0.1:9000", "st_mine")),
    ],
)
def test_a_key_goes_only_where_it_belongs(
    kept: Kept,
    monkeypatch: pytest.MonkeyPatch,
    given: dict[str, str],
    environment: dict[str, str],
    whom: tuple[str, str | None],
) -> None:
    profiles.save("default", SERVICE)
    profiles.save("work", Profile(url="http://127.0.0.1:9000", key="st_other"))
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with servotune.connect(**given) as client:  # type: ignore[arg-type]
        sent = client._transport._http.headers.get("Authorization")
        assert (client.url, sent and sent.removeprefix("Bearer ")) == whom


def test_a_profile_that_is_not_there_is_named_with_those_that_are(kept: Kept) -> None:
    profiles.save("work", SERVICE)
    with pytest.raises(ValueError, match="got 'home': there is work"):
        servotune.connect(profile="home")


def test_a_damaged_file_is_named(kept: Kept) -> None:
    profiles.save("default", SERVICE)
    profiles.path().write_text(json.dumps({"default": {}})[:-1])
    with pytest.raises(ValueError, match=r"profiles\.json must be the JSON .* log in again"):
        servotune.connect()
