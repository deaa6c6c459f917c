"""Runs asammdf's own tests, and keeps the files that they write: `python written_by_asammdf.py its_tests folder`.

A process of its own, for these tests leave files open and folders behind.
"""

from __future__ import annotations

import importlib.util
import io
import sys
import tempfile
import unittest
from importlib import import_module
from pathlib import Path
from typing import Any

import asammdf

_PACKAGE = "tests_of_asammdf"


def main(sources: Path, folder: Path) -> None:
    """Write the files of tests that need no network, and those that the others begin with."""
    save = asammdf.MDF.save

    def kept(*given: Any, **options: Any) -> Any:
        path = Path(save(*given, **options))
        (folder / f"{len(list(folder.iterdir())):03d} {path.name}").write_bytes(path.read_bytes())
        return path

    asammdf.MDF.save = kept
    described = importlib.util.spec_from_file_location(
        _PACKAGE, sources / "__init__.py", submodule_search_locations=[str(sources)]
    )
    assert described is not None
    sys.modules[_PACKAGE] = importlib.util.module_from_spec(described)
    for module in ("test_endianess", "test_mdf23", "test_mdf4"):
        tests = unittest.defaultTestLoader.loadTestsFromModule(import_module(f"{_PACKAGE}.{module}"))
        assert unittest.TextTestRunner(stream=io.StringIO()).run(tests).wasSuccessful(), module
    utils = import_module(f"{_PACKAGE}.utils")
    for version in ("2.14", "3.30", "4.10", "4.11"):
        with tempfile.TemporaryDirectory() as made:
            utils.generate_test_file(made, version)
    with tempfile.TemporaryDirectory() as made:
        utils.generate_arrays_test_file(made)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
