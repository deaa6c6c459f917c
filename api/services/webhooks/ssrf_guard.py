"""Which addresses outside a caller may have the service call: public ones, and those of networks that the operator names.

A request that the service makes comes from inside its network, and a name may mean another address a moment later. So
the addresses of a name are looked up here, all of them are judged, and the connection is made to the address that was
judged (OWASP's cheat sheet on server-side request forgery).
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network

import httpx

Address = IPv4Address | IPv6Address
Network = IPv4Network | IPv6Network
Lookup = Callable[[str, int], Sequence[Address]]
"""The addresses of a host's name at a port; empty for a name that has none now."""

LONGEST_URL = 2000

#: IPv6 addresses in which an IPv4 address stands that a gateway calls (RFC 6052, RFC 8215).
_TRANSLATED = (ip_network("64:ff9b::/96"), ip_network("64:ff9b:1::/48"))


class ForbiddenUrlError(ValueError):
    """A URL that the service does not call; the message continues a sentence that begins with its name."""


def checked_url(text: str) -> httpx.URL:
    """Return a URL in a form that may be called, whatever its host means.

    Raises
    ------
    ForbiddenUrlError
        Saying why not.
    """
    if len(text) > LONGEST_URL:
        raise ForbiddenUrlError(f"must be at most {LONGEST_URL} characters, got {len(text)}")
    if not text.isprintable() or " " in text:
        raise ForbiddenUrlError("must be without spaces and control characters, got some")
    try:
        url = httpx.URL(text)
    except httpx.InvalidURL as error:
        raise ForbiddenUrlError(f"must be a URL, got {text!r}: {error}") from error
    if url.scheme not in {"http", "https"} or not url.host:
        raise ForbiddenUrlError(f"must begin with https:// or http:// and a host, got {text!r}")
    if url.userinfo:
        raise ForbiddenUrlError("must be without a user and a password: the signature tells who sends, got some")
    if url.fragment:
        raise ForbiddenUrlError(f"must be without a fragment, got #{url.fragment}")
    if not 0 < port_of(url) < 1 << 16:
        raise ForbiddenUrlError(f"must have a port from 1 to 65535, got {port_of(url)}")
    return url


def port_of(url: httpx.URL) -> int:
    """Return the port that a URL names or means."""
    return url.port if url.port is not None else {"https": 443, "http": 80}[url.scheme]


def look_up(host: str, port: int) -> Sequence[Address]:
    """Ask the system for the addresses of a name."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return ()
    return tuple(dict.fromkeys(ip_address(str(entry[4][0]).partition("%")[0]) for entry in found))


def judged(url: httpx.URL, *, allowed: Sequence[Network], lookup: Lookup = look_up) -> Sequence[Address]:
    """Return the addresses of a URL's host, none of which is private; empty for a name that has none now.

    Raises
    ------
    ForbiddenUrlError
        When one of them is.
    """
    addresses = lookup(url.host, port_of(url))
    for address in addresses:
        if not (is_public(address) or any(address in network for network in allowed)):
            raise ForbiddenUrlError(f"must have a public address, got {url.host}, which is {address}")
    return addresses


def is_public(address: Address) -> bool:
    """Return whether an address is one of the open internet, also inside of what stands for it in IPv6."""
    if isinstance(address, IPv6Address):
        inner = address.ipv4_mapped or address.sixtofour
        if inner is None and any(address in network for network in _TRANSLATED):
            inner = IPv4Address(int(address) & 0xFFFFFFFF)
        if inner is not None:
            return is_public(inner)
        if address.teredo is not None or address.is_site_local:  # fec0::/10, which was for sites (RFC 3879)
            return False
    return address.is_global and not (address.is_multicast or address.is_reserved or address.is_unspecified)
