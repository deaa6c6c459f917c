from __future__ import annotations

import hashlib
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import pytest

from servotune.bundles import Bundle, BundleError


def written(path: Path, content: dict[str, bytes], **manifest: Any) -> Path:
    """Write a bundle of these contents, its manifest as ``manifest`` has it."""
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in content.items()}
    said = {"format": "servotune-lineage", "version": 1, "nodes": [], "edges": [], "files": digests} | manifest
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("manifest.json", json.dumps(said))
        for name, data in content.items():
            archive.writestr(name, data)
    return path


def test_a_bundle_gives_back_what_was_put_in(tmp_path) -> None:
    files = {"a.json": b'{"x": 1}', "data": b"\x00" * 100, "0.f64": struct.pack("<3d", 1.0, -2.5, 3.0)}
    nodes = [{"id": "b", "created_at": "2026-01-02"}, {"id": "a", "created_at": "2026-01-01"}]
    with Bundle(written(tmp_path / "b.zip", files, nodes=nodes)) as bundle:
        assert bundle.document("a.json") == {"x": 1}
        bundle.copy("data", tmp_path / "data")
        assert (tmp_path / "data").read_bytes() == files["data"]
        assert list(bundle.numbers("0.f64")) == [1.0, -2.5, 3.0]
        assert bundle.has("data")
        assert not bundle.has("other")
        assert [node["id"] for node in bundle.nodes] == ["a", "b"]


@pytest.mark.parametrize(
    ("manifest", "words"),
    [
        ({"format": "something"}, "its manifest is of something else"),
        ({"version": 2}, "must be 1, got 2"),
        ({"nodes": None}, "nodes must be there"),
        ({"files": []}, "files must be there"),
    ],
)
def test_a_manifest_of_something_else_is_refused(tmp_path, manifest, words) -> None:
    with pytest.raises(BundleError, match=words):
        Bundle(written(tmp_path / "b.zip", {}, **manifest))


def test_what_is_no_bundle_is_refused(tmp_path) -> None:
    (tmp_path / "text").write_text("no zip")
    with pytest.raises(BundleError, match="must be an exported lineage"):
        Bundle(tmp_path / "text")
    with pytest.raises(BundleError, match="must be an exported lineage"):
        Bundle(tmp_path / "missing")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w"):
        pass
    with pytest.raises(BundleError, match=r"manifest\.json must be in the bundle"):
        Bundle(tmp_path / "empty.zip")


def test_a_changed_file_is_noticed(tmp_path) -> None:
    path = written(tmp_path / "b.zip", {"a.json": b"{}"}, files={"a.json": "0" * 64, "b.json": "0" * 64})
    with Bundle(path) as bundle:
        with pytest.raises(BundleError, match=r"a\.json must have the SHA-256 0000"):
            bundle.document("a.json")
        with pytest.raises(BundleError, match=r"b\.json must be in the bundle, it is not"):
            bundle.document("b.json")
        with pytest.raises(BundleError, match="ghost must be in the bundle"):
            bundle.document("ghost")


def test_a_truncated_file_is_noticed(tmp_path) -> None:
    path = written(tmp_path / "b.zip", {"a": bytes(range(256)) * 4000})
    whole = path.read_bytes()
    (tmp_path / "cut.zip").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BundleError, match="must be an exported lineage"):
        Bundle(tmp_path / "cut.zip")


def test_a_size_that_no_compression_explains_is_refused(tmp_path) -> None:
    """A bomb says of some bytes that they are gigabytes."""
    path = written(tmp_path / "b.zip", {"a.json": b" " * 20_000_000})
    data = bytearray(path.read_bytes())
    # the sizes in the central directory: 4 bytes at offset 24 of the entry of a.json
    entry = data.rindex(b"PK\x01\x02")
    data[entry + 24 : entry + 28] = struct.pack("<I", 0xFFFFFFF0)
    path.write_bytes(data)
    with Bundle(path) as bundle, pytest.raises(BundleError, match="must be at most"):
        bundle.document("a.json")
