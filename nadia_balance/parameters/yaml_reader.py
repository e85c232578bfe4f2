"""Reader of YAML into dataclasses, with readable error messages."""

import dataclasses
import itertools
import re
import types
import typing
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_load_data, yaml_load_typed

T = typing.TypeVar("T")

_MOST_NODES = 100_000  # in a file, with each alias expanded
_NAMES = {bool: "true or false", float: "a number", int: "an integer"}
_NAMES[str] = "text (quote it)"


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

    Only the child `child_name` is read, if given.  Fields that the YAML lacks
    are copied from `defaults`.

    Raises ValueError: malformed YAML, an unknown field or a wrong type: a line,
    which starts with `what`, then names the field; OSError: it cannot be read.
    """
    try:
        if filename is not None:
            data = Path(filename).read_text(encoding="utf-8")
        tree = load_tree(data or "", child_name)
        _check(schema, tree, child_name or "")
        given = {"schema": schema, "data": data, "child_name": child_name}
        defaults = schema() if defaults is None else defaults
        return yaml_load_typed(**given, defaults=defaults)
    except OSError:
        raise
    except Exception as error:  # Drake's errors about tags have any class
        raise ValueError(f"{what}: {' '.join(str(error).split())}") from error


def load_tree(text: str, child_name: str | None = None) -> typing.Any:
    """Returns YAML, or its child of that name, as mappings and lists.

    Raises ValueError: malformed or misleading YAML, or no such child.
    """
    try:
        tree = yaml_load_data(text)
    except Exception as error:
        # The error has any class, as for a date or a structure nested too deep.
        reason, mark = error, getattr(error, "problem_mark", None)
        if mark is not None:
            place = f"line {mark.line + 1}, column {mark.column + 1}"
            reason = f"{place}: {error.problem}"
        raise ValueError(f"malformed YAML: {reason}") from error
    _check_nodes(text)
    if child_name is None:
        return tree
    if not isinstance(tree, dict):
        raise ValueError("malformed YAML: must be a mapping of names")
    if child_name not in tree:
        known = ", ".join(map(str, tree))
        raise ValueError(f"{child_name!r}: must be one of {known}")
    return tree[child_name]


def _check_nodes(text: str) -> None:
    """Refuses valid but misleading YAML.

    Raises ValueError: a key twice in one mapping, of which the last would
    count; 1:30, which would be 90, or 010, which would be 8; or aliases that
    expand to too many nodes.
    """
    root, sizes = yaml.compose(text, Loader=yaml.CSafeLoader), {}

    def size(node: yaml.Node | None) -> int:
        if id(node) in sizes:
            return sizes[id(node)]
        children = []
        if isinstance(node, yaml.MappingNode):
            keys = [k.value for k, _ in node.value if k.id == "scalar"]
            for name in keys:
                if keys.count(name) > 1:
                    raise ValueError(f"{name}: must be given only once")
            children = list(itertools.chain.from_iterable(node.value))
        elif isinstance(node, yaml.SequenceNode):
            children = node.value
        elif node is not None and node.tag.endswith((":int", ":float")):
            if re.search(r":|^[-+]?0\d", node.value):
                why = "must be a number without ':' or a leading 0"
                raise ValueError(f"{node.value}: {why}")
        sizes[id(node)] = 1 + sum(map(size, children))
        if sizes[id(node)] > _MOST_NODES:
            raise ValueError(f"must have at most {_MOST_NODES} values")
        return sizes[id(node)]

    size(root)


def _check(schema: type, value: object, name: str) -> None:
    """Raises ValueError that names a field of `value` not of its type."""
    base, args = typing.get_origin(schema), typing.get_args(schema)
    if schema in _NAMES:
        _require(_is_scalar(schema, value), name, value, _NAMES[schema])
    elif base in (typing.Union, types.UnionType):
        options = [arg for arg in args if arg is not types.NoneType]
        if len(options) == 1 and value is not None:
            _check(options[0], value, name)
    elif base is list:
        _require(isinstance(value, list), name, value, "a list")
        for i, item in enumerate(value):
            _check(args[0], item, f"{name}[{i}]")
    else:
        mapping = "a mapping of fields, or {}"
        _require(isinstance(value, dict), name, value, mapping)
        fields = None if base is dict else _fields(schema)
        for key, item in value.items():
            path = f"{name}.{key}" if name else str(key)
            if fields is None or key in fields:
                _check(fields[key] if fields else args[1], item, path)
            elif key != "_tag":
                known = f"must be one of {', '.join(fields)}"
                raise ValueError(f"{path}: unknown field, {known}")


def _fields(schema: type) -> dict[str, type]:
    """Name and type of every field of a dataclass, or of a Drake struct."""
    fields = getattr(schema, "__fields__", None) or dataclasses.fields(schema)
    return {field.name: field.type for field in fields}


def _is_scalar(schema: type, value: object) -> bool:
    """True if `value` is a `schema`, or a number that can be read as one."""
    if schema in (bool, str) or isinstance(value, bool):
        return type(value) is schema
    try:
        number = float(value)  # also of text: 1e3 is text in YAML 1.1
    except (TypeError, ValueError):
        return False
    return schema is float or number.is_integer()


def _require(fits: bool, name: str, value: object, allowed: str) -> None:
    if not fits:
        shown = repr(value)
        if len(shown) > 60:  # such as a mapping
            shown = f"{shown[:57]}..."
        raise ValueError(f"{name or 'file'} = {shown}: must be {allowed}")
