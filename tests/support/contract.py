"""The OpenAPI document of the service, as it is kept: `tests/contract/test_openapi.py` holds it to what the code makes.

To make it takes a second and a half, which every process that collects tests would pay for every module that asks.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

SNAPSHOT = Path(__file__).parents[2] / "openapi" / "openapi.json"
DOCUMENT: dict[str, Any] = json.loads(SNAPSHOT.read_text(encoding="utf-8"))
#: Method and path of every operation -> what is said of it.
OPERATIONS: dict[str, dict[str, Any]] = {
    f"{method.upper()} {path}": described
    for path, methods in DOCUMENT["paths"].items()
    for method, described in methods.items()
}
