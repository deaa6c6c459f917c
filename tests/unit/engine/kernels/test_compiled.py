"""Compiled code is kept by what the sources say, not by where they lie."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from engine.batch.kernels import compiled


def test_copies_of_a_file_share_their_code_and_others_do_not(tmp_path: Path) -> None:
    source = Path(compiled.__file__).with_name("powers.py")
    place = compiled.ByContent.get_suitable_cache_subpath
    folder = tmp_path / "kernels"
    folder.mkdir()
    copy = Path(shutil.copy(source, folder))
    assert place(str(copy)) == place(str(source))
    os.utime(copy, (0, 0))
    assert place(str(copy)) == place(str(source))
    with copy.open("a") as changed:
        changed.write("# another\n")
    assert place(str(copy)) != place(str(source))
