"""Every refusal of a file says what is to be done: the reader of such a sentence has the file and no debugger."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
READERS = sorted((ROOT / "api" / "formats").rglob("*.py"))
REMEDY = (": ", "?", ". Set allow_truncated", "(allow_truncated", "(cells that stand", "ANOTHER", "remedy", "{what}")
"""What a remedy follows, or where it is kept; the sentences of `DamagedFileError` have theirs from that class."""


def refusals(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and sentence of each refusal; its quoted values cannot hold what marks a remedy."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "FormatError":
            sentence = node.args[0]
            parts = sentence.values if isinstance(sentence, ast.JoinedStr) else [sentence]
            yield (
                node.lineno,
                "".join(
                    one.value
                    if isinstance(one, ast.Constant) and isinstance(one.value, str)
                    else f"{{{ast.unparse(one)}}}"
                    for one in parts
                ),
            )


@pytest.mark.parametrize("path", READERS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_refusal_tells_its_remedy(path: Path) -> None:
    bare = [f"line {line}: {said}" for line, said in refusals(path) if not any(mark in said for mark in REMEDY)]
    assert not bare


def test_refusals_are_found() -> None:
    assert sum(1 for path in READERS for _ in refusals(path)) > 40
