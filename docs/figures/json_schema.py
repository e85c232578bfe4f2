"""JSON schema of parameters, by which editors complete and check YAML."""

import dataclasses
import math
import types
import typing
from typing import Any

from nadia_balance.parameters.bounds import UNBOUNDED, Bounds, meaning, not_none
from nadia_balance.parameters.yaml_reader import field_types

_TYPES = {bool: "boolean", float: "number", int: "integer", str: "string"}


def json_schema(schema: type, title: str = "") -> dict[str, Any]:
    """Returns the JSON schema of a class of parameters.

    Args:
        schema: class of parameters.
        title: of the schema.

    Returns:
        The schema of a mapping with any of its fields; each has its meaning,
        its bounds and its default.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title or schema.__name__,
        **_of_class(schema),
    }


def named_schema(schema: type, title: str) -> dict[str, Any]:
    """Returns the JSON schema of a file with several of a class, by name.

    Args:
        schema: class of parameters.
        title: of the schema.

    Returns:
        The schema of a mapping from names to such mappings.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "type": "object",
        "additionalProperties": _of_class(schema),
    }


def complete(schema: Any) -> Any:
    """Returns the schema of a mapping that must have every field.

    Args:
        schema: as of json_schema, or a part of it.

    Returns:
        The same, with all properties of each object required.
    """
    if isinstance(schema, list):
        return [complete(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    parts = {name: complete(part) for name, part in schema.items()}
    if isinstance(parts.get("properties"), dict):
        parts["required"] = [*parts["properties"]]
    return parts


def _of_class(schema: type) -> dict[str, Any]:
    hints = field_types(schema)
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {
            field.name: _of_field(field, hints[field.name])
            for field in dataclasses.fields(schema)
            if field.name in hints
        },
    }


def _of_field(field: "dataclasses.Field[Any]", hint: Any) -> dict[str, Any]:
    described = _of_type(hint, field.metadata.get("bounds", UNBOUNDED))
    if text := meaning(field):
        described["description"] = text
    default = field.default
    if isinstance(default, bool | int | str) or (
        isinstance(default, float) and math.isfinite(default)
    ):
        described["default"] = default
    return described


def _of_type(hint: Any, bounds: Bounds) -> dict[str, Any]:
    base, args = typing.get_origin(hint), typing.get_args(hint)
    if base in (typing.Union, types.UnionType):
        return {"anyOf": [_of_type(not_none(args), bounds), {"type": "null"}]}
    if base is list:
        return {"type": "array", "items": _of_type(args[0], bounds)}
    if base is dict:
        return {
            "type": "object",
            "additionalProperties": _of_type(args[1], bounds),
        }
    if hint not in _TYPES:
        return _of_class(hint)
    limits = {
        "enum": list(bounds.one_of) or None,
        "minimum": bounds.least,
        "exclusiveMinimum": bounds.above,
        "maximum": bounds.most,
        "exclusiveMaximum": bounds.below,
    }
    return {
        "type": _TYPES[hint],
        **{name: limit for name, limit in limits.items() if limit is not None},
    }
