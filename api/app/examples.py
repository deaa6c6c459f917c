"""Examples for the API reference: what was sent to every operation of a running service, and what it answered."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any


def add_examples(document: Mapping[str, Any]) -> None:
    """Put the examples of ``examples.json`` into an OpenAPI document."""
    recorded = json.loads(files("api").joinpath("examples.json").read_text(encoding="utf-8"))
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            example = recorded.get(f"{method.upper()} {path}")
            if example is not None:
                _add(operation, example)


def _add(operation: dict[str, Any], example: Mapping[str, Any]) -> None:
    for parameter in operation.get("parameters", ()):
        if parameter["name"] in example["parameters"]:
            parameter["example"] = example["parameters"][parameter["name"]]
    if "request" in example:
        operation["requestBody"]["content"]["application/json"]["example"] = example["request"]
    if "reply" in example:
        content = operation["responses"][str(example["status"])]["content"]
        kind = "application/json" if isinstance(example["reply"], dict) else next(iter(content))
        content[kind]["example"] = example["reply"]
