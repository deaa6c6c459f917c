"""What the service calls on somebody's behalf: public addresses only, whatever their names and spellings."""

from __future__ import annotations

from ipaddress import ip_address, ip_network

import pytest

from api.services.webhooks.ssrf_guard import ForbiddenUrlError, checked_url, is_public, judged, look_up

PUBLIC = ["1.1.1.1", "93.184.215.14", "2606:4700:4700::1111", "64:ff9b::101:101", "::ffff:1.1.1.1", "2002:101:101::"]
#: From the special-purpose registries of IANA (RFC 6890), and how IPv6 carries such addresses.
PRIVATE = [
    "127.0.0.1", "127.255.255.254", "0.0.0.0", "10.0.0.1", "172.16.0.1", "192.168.1.1", "169.254.169.254",
    "100.64.0.1", "192.0.2.1", "198.18.0.1", "224.0.0.1", "240.0.0.1", "255.255.255.255",
    "::1", "::", "fe80::1", "fec0::1", "feff::1", "fc00::1", "fd12::1", "ff02::1", "2001:db8::1",
    "::ffff:127.0.0.1", "::ffff:10.0.0.1", "64:ff9b::7f00:1", "64:ff9b:1::a00:1", "2002:7f00:1::", "2001:0:1::1",
]  # fmt: skip


@pytest.mark.parametrize("text", PUBLIC)
def test_addresses_of_the_open_internet_are_public(text) -> None:
    assert is_public(ip_address(text))


@pytest.mark.parametrize("text", PRIVATE)
def test_addresses_of_special_purpose_are_not(text) -> None:
    assert not is_public(ip_address(text))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("file:///etc/passwd", "must begin with https:// or http:// and a host"),
        ("gopher://example.com/", "must begin with"),
        ("example.com/hook", "must begin with"),
        ("https://", "must begin with"),
        ("https://user:secret@example.com/", "without a user and a password"),
        ("https://example.com/#part", "without a fragment"),
        ("https://example.com/a b", "without spaces"),
        ("https://example.com/\x00", "without spaces"),
        ("https://example.com:70000/", "port from 1 to 65535"),
        ("https://example.com:0/", "port from 1 to 65535"),
        ("https://[::1", "must be a URL"),
        ("https://example.com/" + "x" * 2000, "at most 2000 characters, got 2020"),
    ],
)
def test_a_url_that_cannot_be_called_is_refused(text, says) -> None:
    with pytest.raises(ForbiddenUrlError, match=says):
        checked_url(text)


def test_a_password_in_a_url_is_not_repeated() -> None:
    with pytest.raises(ForbiddenUrlError) as caught:
        checked_url("https://user:secret@example.com/")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "2130706433", "0x7f.1", "127.1", "[::1]", "localhost", "[::ffff:7f00:1]"]
)
def test_every_spelling_of_this_machine_is_refused(host) -> None:
    with pytest.raises(ForbiddenUrlError, match="must have a public address"):
        judged(checked_url(f"http://{host}:8000/"), allowed=())


def test_one_private_address_among_public_ones_is_enough() -> None:
    addresses = [ip_address("1.1.1.1"), ip_address("10.0.0.7")]
    with pytest.raises(ForbiddenUrlError, match=r"got trap\.example, which is 10\.0\.0\.7"):
        judged(checked_url("https://trap.example/"), allowed=(), lookup=lambda _host, _port: addresses)


def test_networks_of_the_operator_may_be_called() -> None:
    addresses = [ip_address("10.0.0.7")]
    url = checked_url("https://inside.example/")
    assert judged(url, allowed=[ip_network("10.0.0.0/24")], lookup=lambda _host, _port: addresses) == addresses
    with pytest.raises(ForbiddenUrlError):
        judged(url, allowed=[ip_network("10.0.1.0/24")], lookup=lambda _host, _port: addresses)


def test_the_port_is_part_of_the_question() -> None:
    asked: list[tuple[str, int]] = []

    def lookup(host: str, port: int) -> list:
        asked.append((host, port))
        return []

    for text in ("https://a.example/", "http://a.example/", "http://a.example:8080/"):
        assert judged(checked_url(text), allowed=(), lookup=lookup) == []
    assert asked == [("a.example", 443), ("a.example", 80), ("a.example", 8080)]


def test_a_name_that_is_none_has_no_address() -> None:
    assert look_up("a" * 64 + ".invalid", 80) == ()
