"""Trees of YAML, and the classes of parameters that are made of them."""

import contextlib
import dataclasses
import functools
import itertools
import re
import types
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import (
    Any,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import yaml

from nadia_balance.parameters.bounds import KINDS, not_none, require

T = TypeVar("T")

MOST_CHARACTERS = 1_000_000  # in a file
MOST_NODES = 100_000  # in a file, with each alias expanded
DEEPEST = 50  # levels of a tree
_Loader = yaml.CSafeLoader


def load_typed(
    schema: type[T],
    source: str,
    *,
    filename: str | Path | None = None,
    data: str | None = None,
    child_name: str | None = None,
) -> T:
    """Returns a `schema` from the YAML in `filename`, or that in `data`.

    Args:
        schema: class of parameters, whose defaults fill what the YAML lacks.
        source: name of the YAML, with which an error begins.
        filename: file to read.
        data: YAML itself, in the place of a file.
        child_name: the only child that is read, if given.

    Returns:
        The parameters; bounds are not checked.

    Raises:
        ValueError: malformed YAML, an unknown field or a wrong type; one line
            that names it.
        OSError: the file cannot be read.
    """
    try:
        if filename is not None:
            data = Path(filename).read_text(encoding="utf-8")
        return typed(
            schema, load_tree(data or "", child_name), child_name or ""
        )
    except ValueError as error:
        raise ValueError(f"{source}: {one_line(error)}") from error


@contextlib.contextmanager
def naming(source: str) -> Iterator[None]:
    """Turns errors of its block into a ValueError that names their source.

    Args:
        source: what the message begins with.

    Yields:
        Nothing.

    Raises:
        ValueError: with the message of the error, on one line.
    """
    try:
        yield
    # SystemExit is how pydrake reports a condition of Drake's own code.
    except (RuntimeError, ValueError, SyntaxError, SystemExit) as error:
        raise ValueError(f"{source}: {one_line(error)}") from error


def one_line(error: BaseException) -> str:
    """Returns the message of an error in one line.

    Args:
        error: any.

    Returns:
        Its words, one space apart.
    """
    return " ".join(str(error).split())


def shortened(text: str) -> str:
    """Returns the begin of a long text, such as a mapping.

    Args:
        text: any.

    Returns:
        At most 60 characters.
    """
    return text if len(text) <= 60 else f"{text[:57]}..."


def error_text(error: Exception) -> str:
    """Returns an error of a simulation in one line.

    Args:
        error: any.

    Returns:
        Its words; of one that does not name what is wrong, such as a
        KeyError, also its class.
    """
    words = one_line(error)
    if words and isinstance(error, (RuntimeError, ValueError)):
        return words
    return f"{type(error).__name__}: {words}".removesuffix(": ")


def load_tree(text: str, child_name: str | None = None) -> Any:
    """Returns YAML, or its child of that name, as mappings and lists.

    Args:
        text: YAML; an empty one is {}.
        child_name: of the mapping at its top, or None for all of it.

    Returns:
        The tree.

    Raises:
        ValueError: malformed, misleading or too much YAML, or no such child.
    """
    try:
        _check_size(text)
        tree = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = str(error)
        if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark:
            mark = error.problem_mark
            reason = (
                f"line {mark.line + 1}, column {mark.column + 1}: "
                f"{error.problem}"
            )
        raise ValueError(f"malformed YAML: {reason}") from error
    _check_nodes(text)
    tree = {} if tree is None else tree
    if child_name is None:
        return tree
    require(
        isinstance(tree, dict), "malformed YAML: must be a mapping of names"
    )
    require(
        child_name in tree,
        f"{child_name!r}: must be one of "
        f"{', '.join(map(str, tree)) or 'its names, and has none'}",
    )
    return tree[child_name]


def _check_size(text: str) -> None:
    """Refuses YAML that would take long to read, before it is read.

    Raises ValueError: too many characters or nodes, or too deep a tree;
    YAMLError: it is malformed.
    """
    require(
        len(text) <= MOST_CHARACTERS,
        f"must have at most {MOST_CHARACTERS} characters",
    )
    depth = 0
    for number, event in enumerate(yaml.parse(text, Loader=_Loader)):
        require(number <= MOST_NODES, f"must have at most {MOST_NODES} values")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        require(depth <= DEEPEST, f"must be nested at most {DEEPEST} deep")


def _check_nodes(text: str) -> None:
    """Refuses valid but misleading YAML.

    Raises ValueError: a key twice in one mapping, of which the last would
    count; 1:30, which would be 90, or 010, which would be 8; or aliases that
    expand to too many nodes.
    """
    sizes: dict[int, int] = {}

    def size(node: yaml.Node | None) -> int:
        if id(node) in sizes:
            return sizes[id(node)]
        sizes[id(node)] = MOST_NODES  # of an alias within itself
        children: list[yaml.Node] = []
        if isinstance(node, yaml.MappingNode):
            _check_keys(node)
            children = list(itertools.chain.from_iterable(node.value))
        elif isinstance(node, yaml.SequenceNode):
            children = node.value
        elif isinstance(node, yaml.ScalarNode):
            _check_number(node)
        sizes[id(node)] = 1 + sum(map(size, children))
        require(
            sizes[id(node)] <= MOST_NODES,
            f"must have at most {MOST_NODES} values",
        )
        return sizes[id(node)]

    size(yaml.compose(text, Loader=_Loader))


def _check_keys(node: yaml.MappingNode) -> None:
    counts = Counter(
        key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)
    )
    for key, count in counts.items():
        require(count == 1, f"{key}: must be given only once")


def _check_number(node: yaml.ScalarNode) -> None:
    require(
        not node.tag.endswith((":int", ":float"))
        or not re.search(r":|^[-+]?0\d", node.value),
        f"{node.value}: must be a number without ':' or a leading 0",
    )


def typed(schema: type[T], tree: object, name: str = "") -> T:
    """Returns a `schema` of a tree, as from YAML; bounds are not checked.

    Args:
        schema: class of parameters, or a type of one of its fields.
        tree: mappings, lists and leaves, which may be objects of their type.
        name: of the tree itself, for errors.

    Returns:
        The parameters.

    Raises:
        ValueError: names an unknown field, or one of a wrong type.
    """
    check_types(schema, tree, name)
    return cast(T, _made(schema, tree, None))


def _made(schema: Any, value: Any, default: Any) -> Any:
    """Makes the type `schema` of a tree, checked before.

    The tree of a class has the fields that differ from its `default`.
    """
    base, args = get_origin(schema), get_args(schema)
    if value is None or (base is None and isinstance(value, schema)):
        return value
    if base in (Union, types.UnionType):
        return _made(not_none(args), value, default)
    if base is list:
        return [_made(args[0], item, None) for item in value]
    if base is dict:
        return {key: _made(args[1], item, None) for key, item in value.items()}
    if dataclasses.is_dataclass(schema) and isinstance(schema, type):
        whole = default if isinstance(default, schema) else schema()
        fields = field_types(schema)
        return dataclasses.replace(
            whole,
            **{
                key: _made(fields[key], item, getattr(whole, key))
                for key, item in value.items()
            },
        )
    return int(float(value)) if schema is int else schema(value)


def check_types(schema: Any, value: object, name: str = "") -> None:
    """Checks the types of a tree, as from YAML.

    Args:
        schema: class of parameters, or a type of one of its fields.
        value: mappings, lists and leaves.
        name: of the value itself, for errors.

    Raises:
        ValueError: names an unknown field, or one of a wrong type.
    """
    base, args = get_origin(schema), get_args(schema)
    if schema in KINDS:
        _require(_is_scalar(schema, value), name, value, KINDS[schema])
    elif base in (Union, types.UnionType):
        if value is not None:
            check_types(not_none(args), value, name)
    elif base is list:
        _require(isinstance(value, list | tuple), name, value, "a list")
        for i, item in enumerate(cast(list[object], value)):
            check_types(args[0], item, f"{name}[{i}]")
    elif base is dict or not isinstance(value, schema):
        _require(
            isinstance(value, dict), name, value, "a mapping of fields, or {}"
        )
        tree = cast(dict[str, object], value)
        fields = (
            dict.fromkeys(tree, args[1])
            if base is dict
            else field_types(schema)
        )
        for key, item in tree.items():
            path = f"{name}.{key}" if name else str(key)
            if key not in fields:
                raise ValueError(
                    f"{path}: unknown field, must be one of {', '.join(fields)}"
                )
            check_types(fields[key], item, path)


@functools.cache
def field_types(schema: type) -> dict[str, Any]:
    """Returns the name and type of every field that a user may give.

    Args:
        schema: a dataclass.

    Returns:
        The types, by name.
    """
    hints = get_type_hints(schema)
    return {
        field.name: hints[field.name]
        for field in dataclasses.fields(schema)
        if not field.metadata.get("internal")
    }


def _is_scalar(schema: type, value: object) -> bool:
    """True if `value` is a `schema`, or a number that can be read as one."""
    if schema in (bool, str) or isinstance(value, bool):
        return type(value) is schema
    try:
        number = float(value)  # type: ignore[arg-type]  # 1e3 is text in YAML
    except (TypeError, ValueError, OverflowError):
        return False
    return schema is float or number.is_integer()


def _require(fits: bool, name: str, value: object, allowed: str) -> None:
    if not fits:
        shown = shortened(repr(value))
        raise ValueError(f"{name or 'file'} = {shown}: must be {allowed}")
