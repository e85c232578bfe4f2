"""YAML into dataclasses, with errors that a user can read."""

import dataclasses
import types
import typing
from pathlib import Path

from pydrake.common.yaml import yaml_load_data, yaml_load_typed

T = typing.TypeVar("T")

# What yaml_load_typed raises for data that do not fit the schema, in the few
# cases that _check leaves to it (tags).
_MISFITS = (
    AssertionError,
    AttributeError,
    KeyError,
    RuntimeError,
    TypeError,
    ValueError,
)
_NAMES = {bool: "true or false", float: "a number", int: "an integer"}


def load_typed(
    schema: type[T],
    what: str,
    *,
    filename: str | Path | None = None,
    data: str | None = None,
    child_name: str | None = None,
    defaults: T | None = None,
) -> T:
    """Returns a `schema` from the YAML in `filename`, or that in `data`.

    Only the child `child_name` is read, if there is one.  Fields that are not
    named are those of `defaults`; these are not changed.

    Raises:
        ValueError: malformed YAML, an unknown field, or a value of the wrong
            type: one line, which starts with `what`, then names the field.
        OSError: the file cannot be read.
    """
    try:
        if filename is not None:
            data = Path(filename).read_text(encoding="utf-8")
        tree = _parse(data or "")
        if child_name is not None:
            tree = _child(tree, child_name)
        _check(schema, tree, child_name or "")
        return yaml_load_typed(
            schema=schema,
            data=data,
            child_name=child_name,
            defaults=schema() if defaults is None else defaults,
        )
    except _MISFITS as error:
        message = " ".join(str(error).split())
        raise ValueError(f"{what}: {message}") from error


def _parse(text: str) -> object:
    """Raises ValueError if `text` is no YAML."""
    try:
        return yaml_load_data(text)
    except Exception as error:
        # Any: PyYAML has errors of its own, and passes on those of Python,
        # for a date that does not exist as for a structure nested too deep.
        mark = getattr(error, "problem_mark", None)
        if mark is None:
            raise ValueError(f"malformed YAML: {error}") from error
        raise ValueError(
            f"malformed YAML: line {mark.line + 1}, column "
            f"{mark.column + 1}: {error.problem}"
        ) from error


def _child(tree: object, name: str) -> object:
    if not isinstance(tree, dict):
        raise ValueError("malformed YAML: must be a mapping of names")
    if name not in tree:
        known = ", ".join(map(str, tree))
        raise ValueError(f"{name!r}: must be one of {known}")
    return tree[name]


def _check(schema: type, value: object, name: str) -> None:
    """Raises ValueError naming the field of `value` that is no `schema`."""
    base, args = typing.get_origin(schema), typing.get_args(schema)
    if schema in (bool, float, int, str):
        if not _is_scalar(schema, value):
            raise _misfit(name, value, _NAMES.get(schema, "text (quote it)"))
    elif base in (typing.Union, types.UnionType):
        options = [arg for arg in args if arg is not types.NoneType]
        if len(options) == 1 and value is not None:
            _check(options[0], value, name)
    elif base is list:
        if not isinstance(value, list):
            raise _misfit(name, value, "a list")
        for i, item in enumerate(value):
            _check(args[0], item, f"{name}[{i}]")
    elif base is dict:
        for key, item in _mapping(value, name).items():
            _check(args[1], item, _join(name, key))
    elif fields := _fields(schema):
        for key, item in _mapping(value, name).items():
            if key in fields:
                _check(fields[key], item, _join(name, key))
            elif key != "_tag":
                raise ValueError(
                    f"{_join(name, key)}: unknown field, must be one of "
                    f"{', '.join(fields)}"
                )


def _is_scalar(schema: type, value: object) -> bool:
    """True if Drake takes `value` for a `schema`."""
    if type(value) is schema:
        return True
    if schema is bool:
        return value in ("true", "false")
    if schema is float and type(value) is int:
        return True
    if schema is int and type(value) is float:
        return value.is_integer()
    if schema is str or type(value) is not str:
        return False
    try:
        schema(value)  # such as 1e3, which is text in YAML 1.1
    except ValueError:
        return False
    return True


def _mapping(value: object, name: str) -> dict:
    if not isinstance(value, dict):
        raise _misfit(name, value, "a mapping of fields, or {}")
    return value


def _fields(schema: type) -> dict[str, type]:
    """Name and type of every field of a dataclass, or a struct of Drake's."""
    if dataclasses.is_dataclass(schema):
        return {f.name: f.type for f in dataclasses.fields(schema)}
    return {f.name: f.type for f in getattr(schema, "__fields__", ())}


def _join(name: str, key: object) -> str:
    return f"{name}.{key}" if name else str(key)


def _misfit(name: str, value: object, allowed: str) -> ValueError:
    # Only what the user wrote on one line: a whole mapping would be a page.
    shown = repr(value)
    if len(shown) > 60:
        shown = f"{shown[:57]}..."
    return ValueError(f"{name or 'file'} = {shown}: must be {allowed}")
