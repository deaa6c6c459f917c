"""A lineage in one file: opened, checked against its own checksums, read piece by piece.

What it says of itself is not believed: sizes are bounded, names come from its list alone, and nothing is unpacked to a name
of its own choice.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from array import array
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from servotune.errors import ServotuneError

FORMAT = "servotune-lineage"
VERSION = 1
_PIECE = 1 << 20
_LARGEST_DOCUMENT = 1 << 30
_LARGEST_CONTENT = 1 << 36
_LARGEST_RATIO = 5000
"""Of a file to its compressed size: deflate cannot do better than about 1000."""


class BundleError(ServotuneError):
    """A file that is no lineage, or was changed since it was exported."""


class Bundle:
    """An exported lineage.

    Parameters
    ----------
    path : pathlib.Path

    Raises
    ------
    BundleError
        When it is no exported lineage, or of a newer version.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._archive = zipfile.ZipFile(path)
        except (OSError, zipfile.BadZipFile) as error:
            raise BundleError(f"{path} must be an exported lineage, got: {error}") from error
        try:
            self.manifest = self._read_manifest()
        except BaseException:
            self._archive.close()
            raise

    def _read_manifest(self) -> Mapping[str, Any]:
        try:
            manifest = json.loads(b"".join(self._pieces("manifest.json", _LARGEST_DOCUMENT)))
        except ValueError as error:
            raise BundleError(f"manifest.json must be JSON, got: {error}") from error
        if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
            raise BundleError(f"{self._path} must be an exported lineage, its manifest is of something else")
        if manifest.get("version") != VERSION:
            raise BundleError(
                f"the version of an exported lineage must be {VERSION}, got {manifest.get('version')!r}: "
                "repeat it with the version of servotune that exported it"
            )
        for key, kind in (("nodes", list), ("edges", list), ("files", dict)):
            if not isinstance(manifest.get(key), kind):
                raise BundleError(f"{key} must be there in manifest.json, it is not")
        return manifest

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._archive.close()

    @property
    def nodes(self) -> list[Mapping[str, Any]]:
        """Everything in it, in the order in which it was made."""
        return sorted(self.manifest["nodes"], key=lambda node: str(node.get("created_at")))

    def has(self, name: str) -> bool:
        """Return whether it holds a file."""
        return name in self.manifest["files"]

    def document(self, name: str) -> Any:
        """Return a JSON document.

        Raises
        ------
        BundleError
            When it is not there, or is not what was exported.
        """
        try:
            return json.loads(b"".join(self._checked(name, _LARGEST_DOCUMENT)))
        except ValueError as error:
            raise BundleError(f"{name} must be JSON, got: {error}") from error

    def copy(self, name: str, target: Path) -> None:
        """Write a file to a path; raises as `document` does."""
        with target.open("wb") as file:
            for piece in self._checked(name, _LARGEST_CONTENT):
                file.write(piece)

    def numbers(self, name: str) -> array[float]:
        """Return little-endian float64 numbers; raises as `document` does."""
        data = b"".join(self._checked(name, _LARGEST_DOCUMENT))
        found = array("d")
        found.frombytes(data[: len(data) // 8 * 8])
        return found

    def _checked(self, name: str, limit: int) -> Iterator[bytes]:
        expected = self.manifest["files"].get(name)
        if expected is None:
            raise BundleError(f"{name} must be in the bundle, it is not")
        digest = hashlib.sha256()
        for piece in self._pieces(name, limit):
            digest.update(piece)
            yield piece
        if digest.hexdigest() != expected:
            raise BundleError(f"{name} must have the SHA-256 {expected}, got {digest.hexdigest()}")

    def _pieces(self, name: str, limit: int) -> Iterator[bytes]:
        try:
            info = self._archive.getinfo(name)
        except KeyError as error:
            raise BundleError(f"{name} must be in the bundle, it is not") from error
        if info.file_size > min(limit, max(_LARGEST_RATIO * info.compress_size, _PIECE)):
            raise BundleError(f"{name} must be at most {limit} bytes, compressed as deflate can, got {info.file_size}")
        try:
            with self._archive.open(info) as file:
                while piece := file.read(_PIECE):
                    yield piece
        except (zipfile.BadZipFile, OSError, EOFError) as error:
            raise BundleError(f"{name} must be readable, got: {error}") from error
