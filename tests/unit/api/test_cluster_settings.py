"""A cluster is told by its address and, over TLS, three files: what does not fit together is refused by name."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization
from pydantic import ValidationError

from api.commands.service import read_settings
from api.processes.cluster import Cluster, workers_of
from api.settings import Settings
from optimizers.evaluation.processes import Processes
from tests.integration.cluster.conftest import certificate


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    made = certificate(tmp_path)
    return {
        "cluster_ca": Path(made["tls_ca_file"]),
        "cluster_cert": Path(made["tls_client_cert"]),
        "cluster_key": Path(made["tls_client_key"]),
    }


def test_without_an_address_this_machine_computes() -> None:
    assert isinstance(workers_of(Settings(cluster="", cluster_key=""), processors=4), Processes)


def test_with_one_a_cluster_does(files) -> None:
    assert isinstance(workers_of(Settings(cluster="tls://there:8786", **files), processors=4), Cluster)
    assert isinstance(workers_of(Settings(cluster="tcp://127.0.0.1:8786"), processors=4), Cluster)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"cluster": "https://there:8786"}, "should match pattern"),
        ({"cluster": "tls://there"}, "should match pattern"),
        (
            {"cluster": "tls://there:8786"},
            "SERVOTUNE_CLUSTER_CA must be given with SERVOTUNE_CLUSTER=tls://..., got none",
        ),
        ({"cluster": "tls://there:8786", "cluster_ca": "/not/there"}, "does not point to a file"),
        ({"cluster_adaptive": -1}, "greater than or equal to 0"),
    ],
)
def test_what_does_not_fit_is_refused(given, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Settings(**given)


def test_files_without_tls_are_refused(files) -> None:
    for address in ("tcp://127.0.0.1:8786", None):
        with pytest.raises(
            ValidationError, match="SERVOTUNE_CLUSTER_CA must be left out without SERVOTUNE_CLUSTER=tls"
        ):
            Settings(cluster=address, **files)


def test_the_package_must_be_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(ValidationError, match=r"servotune-server\[cluster\]"):
        Settings(cluster="tcp://127.0.0.1:8786")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"cluster_ca": "/nope.pem"}, "SERVOTUNE_CLUSTER_CA"),
        ({"cluster_cert": "/nope.pem"}, "SERVOTUNE_CLUSTER_CERT"),
        ({"cluster_key": "/nope.pem"}, "SERVOTUNE_CLUSTER_KEY"),
        ({"cluster": "tls://there"}, "SERVOTUNE_CLUSTER "),
    ],
)
def test_what_is_wrong_is_told_once(files, given, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One wrong setting is no reason to say that another one is missing."""
    for name, value in ({"cluster": "tls://there:8786"} | files | given).items():
        monkeypatch.setenv(f"SERVOTUNE_{name.upper()}", str(value))
    with pytest.raises(SystemExit) as caught:
        read_settings()
    assert str(caught.value.code).startswith(says)
    assert str(caught.value.code).count("SERVOTUNE_") == 1


def test_a_wrong_name_for_signing_in_is_not_told_as_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SERVOTUNE_OIDC_ISSUER", "https://there")
    monkeypatch.setenv("SERVOTUNE_OIDC_CLIENT_ID", "servotune")
    monkeypatch.setenv("SERVOTUNE_PUBLIC_URL", "here")
    monkeypatch.setenv("SERVOTUNE_OIDC_ROLES", '{"all": {"scopes": ["read"]}}')
    with pytest.raises(SystemExit) as caught:
        read_settings()
    assert str(caught.value.code).count("SERVOTUNE_") == 1


def test_a_key_of_another_certificate_is_refused_at_the_start(files, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Path(certificate(tmp_path / "other")["tls_client_key"])
    rule = f"SERVOTUNE_CLUSTER_KEY must hold the key of the certificate in {files['cluster_cert']}, .*, got {other}"
    with pytest.raises(ValidationError, match=rule):
        Settings(cluster="tls://there:8786", **files | {"cluster_key": other})


def test_files_that_hold_something_else_are_refused_by_name(files, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no certificate")
    for name in ("ca", "cert", "key"):
        with pytest.raises(
            ValidationError, match=f"SERVOTUNE_CLUSTER_{name.upper()} must hold .*, got {tmp_path}/text"
        ):
            Settings(cluster="tls://there:8786", **files | {f"cluster_{name}": tmp_path / "text"})


def test_a_key_under_a_password_is_refused_and_nobody_is_asked_for_it(files, tmp_path: Path) -> None:
    key = serialization.load_pem_private_key(files["cluster_key"].read_bytes(), None)
    locked = serialization.BestAvailableEncryption(b"secret")
    form = serialization.PrivateFormat.PKCS8
    (tmp_path / "locked").write_bytes(key.private_bytes(serialization.Encoding.PEM, form, locked))
    with pytest.raises(ValidationError, match="without a password, got"):
        Settings(cluster="tls://there:8786", **files | {"cluster_key": tmp_path / "locked"})
