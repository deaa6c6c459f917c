"""Controllers with limits: `limits` and `anti_windup` in one piece each, beside the plain parameters that they stand for."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, Field, model_validator

from api.schemas.values import SCALAR_SCHEMA, Document, Scalar

KINDS = frozenset({"p", "pi", "pd", "pid"})

_TRACKED = ("back_calculation", "tracking")


class OutputLimits(Document):
    """The limits of an output; one that is left out is none."""

    lower: Scalar = None
    upper: Scalar = None


def _with_objects(schema: dict[str, Any]) -> None:
    """Declare the form of `anti_windup` that has its time with it."""
    plain = schema["properties"].get("anti_windup")
    if plain is not None:
        whole = {
            "type": "object",
            "required": ["kind"],
            "additionalProperties": False,
            "properties": {"kind": {"enum": list(_TRACKED)}, "tracking_time": SCALAR_SCHEMA},
        }
        told = {key: plain.pop(key) for key in ("description", "default") if key in plain}
        schema["properties"]["anti_windup"] = {**told, "anyOf": [plain, whole]}


class LimitedBlock(Document):
    """What the blocks of controllers may say besides; kept as the plain parameters `lower`, `upper` and `tracking_time`."""

    model_config = ConfigDict(json_schema_extra=_with_objects)

    limits: OutputLimits | None = Field(default=None, description="`lower` and `upper` in one", exclude=True)

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        plain = dict(given)
        for key in ("limits", "anti_windup"):
            whole = plain.get(key)
            if not isinstance(whole, dict):
                continue
            parts = (
                whole if key == "limits" else {key: whole.get("kind"), **{k: whole[k] for k in whole if k != "kind"}}
            )
            allowed = {"lower", "upper"} if key == "limits" else {key, "tracking_time"}
            del plain[key]
            for name, value in parts.items():
                if name not in allowed:
                    raise ValueError(f"{key} must be made of {', '.join(sorted(allowed - {key}))}, got {name!r}")
                if name in plain:
                    raise ValueError(f"{name} must be given once, got it in {key} and beside it")
                plain[name] = value
        return plain
