"""Every operation in the reference has an example, and every example is one of its schema."""

from __future__ import annotations

import pytest
from fastapi.routing import APIRoute
from pydantic import TypeAdapter

from api.routers import HEALTH, ROUTERS
from tests.support import contract

ROUTES = {
    f"{method} {route.path_format}": route
    for router in (*ROUTERS, HEALTH)
    for route in router.routes
    if isinstance(route, APIRoute)
    for method in route.methods
}
OPERATIONS = list(contract.OPERATIONS.items())


@pytest.mark.parametrize(("name", "operation"), OPERATIONS, ids=[name for name, _ in OPERATIONS])
def test_an_operation_has_examples_of_its_schema(name, operation) -> None:
    how = "add it to tests/integration/api/story.py and record it anew: python -m tests.integration.api.story"
    for parameter in operation.get("parameters", ()):
        if parameter["in"] == "path":
            assert "example" in parameter, how
    body = operation.get("requestBody", {}).get("content", {}).get("application/json")
    if body is not None:
        (field,) = ROUTES[name].dependant.body_params
        TypeAdapter(field.field_info.annotation).validate_python(body["example"])
    shown = [
        content["example"]
        for status, response in operation["responses"].items()
        if status.startswith("2")
        for content in response.get("content", {}).values()
        if "example" in content
    ]
    # the bytes of a file, or of an archive
    nothing_to_show = "204" in operation["responses"] or name.endswith(("/original", "/bundle"))
    assert shown or nothing_to_show, how
    model = ROUTES[name].response_model
    for example in shown:
        if isinstance(example, dict) and model is not None:
            TypeAdapter(model).validate_python(example)
