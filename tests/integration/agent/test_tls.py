"""A device server with TLS: the right certificates let in, each wrong one is refused and named."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import grpc
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from agent.drivers.nidaqmx.driver import Nidaqmx
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.errors import AttemptError, SettingsError
from rig_simulator.grpc_server import Server
from tests.integration.agent.lab import make_bench


@dataclass(frozen=True)
class Identity:
    """A key with its certificate."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate

    @property
    def pem(self) -> bytes:
        return self.certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        form = serialization.PrivateFormat.PKCS8
        return self.key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())


def made(name: str, issuer: Identity | None = None, *, days: int = 30, address: bool = False) -> Identity:
    """Return an authority, or what one has signed; a negative number of days has run out."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    names: list[x509.GeneralName] = [x509.DNSName(name)]
    if address:
        names.append(x509.IPAddress(ipaddress.ip_address("127.0.0.1")))
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer.certificate.subject if issuer else subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=60))
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=issuer is None, path_length=None), critical=True)
    )
    return Identity(key, builder.sign(issuer.key if issuer else key, hashes.SHA256()))


@dataclass(frozen=True)
class Place:
    """The port of a device server, and a folder of files in PEM."""

    port: int
    folder: Path

    def connect(self, **files: str) -> Nidaqmx:
        named = {name: value if name == "server_name" else str(self.folder / value) for name, value in files.items()}
        settings = NidaqmxSettings(server=f"127.0.0.1:{self.port}", deadline=2.0, **named)
        settings.check()
        return Nidaqmx(settings, rig="bench")

    def devices(self, **files: str) -> list[str]:
        hardware = self.connect(**files)
        try:
            return [device["name"] for device in hardware.devices()]
        finally:
            hardware.close()


def server(folder: Path, *, days: int = 30, address: bool = True) -> Iterator[Place]:
    authority, stranger = made("lab"), made("stranger")
    daq, pc = made("daq", authority, days=days, address=address), made("pc", authority)
    other = made("pc", stranger)
    for name, content in {
        "ca.pem": authority.pem, "stranger.pem": stranger.pem, "pc.pem": pc.pem, "pc.key": pc.key_pem,
        "other.pem": other.pem, "other.key": other.key_pem,
    }.items():  # fmt: skip
        (folder / name).write_bytes(content)
    credentials = grpc.ssl_server_credentials([(daq.key_pem, daq.pem)], authority.pem, require_client_auth=True)
    running = Server(make_bench(), credentials=credentials)
    try:
        yield Place(running.port, folder)
    finally:
        running.close()


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    yield from server(tmp_path)


GOOD = {"ca": "ca.pem", "certificate": "pc.pem", "private_key": "pc.key"}


def test_who_has_the_right_certificates_is_let_in(place) -> None:
    assert place.devices(**GOOD)[0] == "cDAQ1Mod1"


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (GOOD | {"ca": "stranger.pem"}, "unable to get local issuer certificate"),
        ({"ca": "ca.pem"}, "certificate required|does not take a PC without"),
        (
            GOOD | {"certificate": "other.pem", "private_key": "other.key"},
            "unknown ca|does not take the certificate of this PC",
        ),
        (GOOD | {"private_key": "other.key"}, "key values mismatch"),
        (GOOD | {"server_name": "another.lab"}, "'another.lab'"),
        ({}, "speaks TLS alone, this PC spoke in the open - name .* as `ca`"),
    ],
    ids=[
        "stranger's server",
        "no certificate",
        "stranger's certificate",
        "another's key",
        "another name",
        "in the open",
    ],
)
def test_a_wrong_certificate_opens_nothing_and_is_named(place, files, says) -> None:
    with pytest.raises(AttemptError, match=says) as refused:
        place.devices(**files)
    assert refused.value.code == "server_not_trusted"


def test_a_certificate_for_another_name_is_taken_where_the_settings_say_so(tmp_path) -> None:
    for place in server(tmp_path, address=False):
        with pytest.raises(AttemptError, match=r"127\.0\.0\.1"):
            place.devices(**GOOD)
        assert place.devices(**GOOD, server_name="daq")


def test_a_certificate_that_has_run_out_is_refused(tmp_path) -> None:
    for place in server(tmp_path, days=-1):
        with pytest.raises(AttemptError, match="certificate has expired"):
            place.devices(**GOOD)


def test_a_server_that_is_not_there_is_not_called_a_stranger(place) -> None:
    gone = Place(9, place.folder)
    with pytest.raises(AttemptError) as refused:
        gone.devices(**GOOD)
    assert refused.value.code == "server_unreachable"


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({"ca": "ca.pem", "certificate": "pc.pem"}, "certificate and private_key must be given together"),
        ({"ca": "missing.pem"}, r"daq.ca must be readable, got .*missing.pem: No such file"),
        ({"ca": "no.pem"}, r"daq.ca must be a file in PEM, .*no.pem is none"),
    ],
)
def test_files_that_cannot_be_right_are_told_before_anybody_is_called(place, files, says) -> None:
    (place.folder / "no.pem").write_text("hello")
    with pytest.raises(SettingsError, match=says):
        place.connect(**files)
