"""Every text of a report has its Romanian: the texts are found in the code, the words in the catalogues and in the contract."""

from __future__ import annotations

import ast
import json
import re
import string
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import api.services.reports as package
from api.services.reports.common import request_rows, written
from api.services.reports.kinds import identified
from api.services.reports.kinds import measured as spectra
from api.services.reports.kinds.naming import title
from api.services.reports.language import choice, label, romanian, say, speaking
from api.services.reports.quantities import measured
from api.services.reports.reports import _SECTIONS
from engine.metrics import catalogue as metrics
from engine.model.verdicts import Verdict
from optimizers import methods
from optimizers.search.result import Status

CODE = {path: ast.parse(path.read_text("utf-8")) for path in sorted(Path(package.__file__).parent.rglob("*.py"))}
CONTRACT = json.loads((Path(__file__).parents[3] / "openapi" / "openapi.json").read_text("utf-8"))
SCHEMAS: dict[str, Any] = CONTRACT["components"]["schemas"]
REPORTED = ("optimizations", "identifications", "validations", "influence", "simulations", "frequency-responses", "spectra", "frfs")  # fmt: skip
#: Fields of requests that no report repeats: they stand in tables of their own.
ELSEWHERE = {"system", "keep", "points", "queue"}
PROSE = re.compile(r"[A-Z][a-z]{2,}|[a-z]{3,} [a-z]{2,}")


def is_say(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "say"


def texts() -> set[str]:
    """Return what the code says: what is given to ``say`` in letters, and what the tables and catalogues hand to it."""
    told = {
        node.args[0].value
        for tree in CODE.values()
        for node in ast.walk(tree)
        if is_say(node) and isinstance(node.args[0], ast.Constant)  # type: ignore[attr-defined]
    }
    told |= {called for called, _ in _SECTIONS.values()}
    told |= {*identified._MEASURES.values(), *spectra._QUANTITIES.values(), "before", "after"}
    known = methods.catalogue().values()
    return told | {one.doc for one in known} | {option.doc for one in known for option in one.options}


def outside(node: ast.AST) -> Iterator[str]:
    """Yield the texts below a node that are neither said nor a docstring."""
    body = getattr(node, "body", None)
    for child in ast.iter_child_nodes(node):
        if is_say(child) or (isinstance(body, list) and isinstance(child, ast.Expr)):
            if not is_say(child) and not isinstance(child.value, ast.Constant):  # type: ignore[attr-defined]
                yield from outside(child)
            continue
        if isinstance(child, ast.Constant) and isinstance(child.value, str):
            yield child.value
        yield from outside(child)


def fields(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the fields of the body of a request, of each of its kinds."""
    if "$ref" in schema:
        yield from fields(SCHEMAS[schema["$ref"].rsplit("/", 1)[-1]])
    yield from schema.get("properties", {}).items()
    for part in [*schema.get("anyOf", []), *schema.get("oneOf", [])]:
        yield from fields(part)


def offered(schema: dict[str, Any]) -> Iterator[str]:
    """Yield the words that a field offers."""
    yield from (one for one in [*schema.get("enum", []), schema.get("const")] if isinstance(one, str))
    for part in schema.get("anyOf", []):
        yield from offered(part)


def asked() -> list[tuple[str, dict[str, Any]]]:
    bodies = (CONTRACT["paths"][f"/v1/{path}"]["post"]["requestBody"]["content"] for path in REPORTED)
    found = [one for body in bodies for one in fields(body["application/json"]["schema"])]
    assert len(found) > 100
    return [(name, schema) for name, schema in found if name not in ELSEWHERE]


def test_every_text_has_its_romanian_and_none_is_left_over() -> None:
    assert texts() == set(romanian()["texts"])


def test_every_text_has_the_same_gaps() -> None:
    def gaps(text: str) -> set[str]:
        return {name for _, name, *_ in string.Formatter().parse(text) if name}

    for text, translated in romanian()["texts"].items():
        assert gaps(text) == gaps(translated), text


def test_nothing_is_written_past_the_languages() -> None:
    tables = {
        *identified._MEASURES.values(),
        *spectra._QUANTITIES.values(),
        *(called for called, _ in _SECTIONS.values()),
    }
    drawn_with = {"as_html.py", "as_pdf.py", "drawing.py", "ticks.py", "origins.py", "language.py"}
    found = [
        (path.name, text)
        for path, tree in CODE.items()
        if path.name not in drawn_with
        for text in outside(tree)
        if PROSE.search(text) and text not in tables and not text.startswith(("center left", " must be"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "names",
    [
        metrics(),
        Verdict,
        Status,
        _SECTIONS,
        methods.catalogue(),
        {option.name for one in methods.catalogue().values() for option in one.options},
        {name for name, _ in asked()},
        # what measured data are compared with, grades, parts, and what a lineage is made of
        ["mean", "input", "static_gain", "best", "pass", "fail", "estimation", "validation", "dataset", "model", "acquisition"],
    ],
    ids=["metrics", "verdicts", "ends", "studies", "methods", "options", "fields", "others"],
)  # fmt: skip
def test_every_word_has_its_romanian(names: Any) -> None:
    assert {str(name) for name in names} - set(romanian()["words"]) == set()


def test_commands_and_their_fields_have_their_romanian() -> None:
    signals = [schema for name, schema in SCHEMAS.items() if name.endswith("Signal") and "kind" in schema["properties"]]
    assert len(signals) > 10
    names = {name for schema in signals for name in (schema["properties"]["kind"]["const"], *schema["properties"])}
    assert names - {"kind"} - set(romanian()["words"]) == set()


def test_what_fields_offer_has_its_romanian() -> None:
    choices = romanian()["choices"]
    missing = {(name, one) for name, schema in asked() for one in offered(schema) if one not in choices.get(name, {})}
    assert missing == set()


def test_a_report_speaks_its_language_and_leaves_names_alone() -> None:
    with speaking("ro"):
        assert say("{count} samples", count=3) == "eșantioane: 3"
        assert label("rise_time") == title("rise_time") == "Timp de creștere"
        assert measured("rise_time", {"value": None, "verdict": "never_crosses"}) == "nu traversează"
        assert written({"kind": "step", "amplitude": 2}) == "treaptă, amplitudine 2"
        # A channel may be called as a word of the contract is.
        assert written({"force": "mean"}) == "force: mean"
        assert choice("quantity", "density") == "densitate"
        assert request_rows({"channel": "density", "quantity": "density"}, ()) == [("Canal", "density"), ("Mărime", "densitate")]  # fmt: skip
    assert title("rise_time") == "Rise time"
