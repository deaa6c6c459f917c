"""The public contract as a file: what `openapi/openapi.json` is held against."""

from __future__ import annotations

import json

from api.app.main import create_app
from api.settings import Settings


def render() -> str:
    """Return the OpenAPI document of the application with default settings."""
    document = create_app(Settings.model_construct()).openapi()
    return json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False) + "\n"
