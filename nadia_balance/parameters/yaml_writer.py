"""Parameters as YAML, which the reader takes again, to the last bit."""

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

import yaml

from nadia_balance.parameters.yaml_reader import field_types

_LINE = re.compile(r"( *)([\w.+-]+):(?: |$)")


class _Dumper(yaml.CSafeDumper):
    """Writes each text in one line, so that a comment may follow it."""


def _one_line(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    style = '"' if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _one_line)


def dump(
    parameters: object,
    child_name: str = "",
    comments: Mapping[str, str] | None = None,
) -> str:
    """Returns parameters as YAML.

    Args:
        parameters: a dataclass.
        child_name: name under which they stand; "": none.
        comments: by the path of a value, such as "gait.step.length"; what
            stands beside it.

    Returns:
        The text.
    """
    tree = as_tree(parameters)
    text: str = yaml.dump(
        {child_name: tree} if child_name else tree,
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=4096,
    )
    return _commented(text, bool(child_name), comments) if comments else text


def as_tree(value: Any) -> Any:
    """Returns parameters as mappings and lists.

    Args:
        value: a dataclass, or what its fields may have.

    Returns:
        The tree.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            name: as_tree(getattr(value, name))
            for name in field_types(type(value))
        }
    if isinstance(value, dict):
        return {key: as_tree(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_tree(item) for item in value]
    if isinstance(value, bool | str) or value is None:
        return value
    return int(value) if isinstance(value, int) else float(value)


def _commented(text: str, has_child: bool, comments: Mapping[str, str]) -> str:
    lines, path = [], [""]
    for line in text.splitlines():
        match = _LINE.match(line)
        if match:
            path = [*path[: len(match[1]) // 2], match[2]]
            name = ".".join(path[1:] if has_child else path)
            if name in comments:
                line = f"{line}  # {comments[name]}"
        lines.append(line)
    return "\n".join([*lines, ""])
