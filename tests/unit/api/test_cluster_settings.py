"""A cluster is told by its address and, over TLS, three files: what does not fit together is refused by name."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from pydantic import ValidationError

from api.processes.cluster import Cluster, workers_of
from api.settings import Settings
from optimizers.evaluation.processes import Processes


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    made = {f"cluster_{name}": tmp_path / name for name in ("ca", "cert", "key")}
    for path in made.values():
        path.touch()
    return made


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
