"""YAML into dataclasses, with errors that a user can read."""

from typing import TypeVar

from pydrake.common.yaml import yaml_load_typed

T = TypeVar("T")


def load_typed(schema: type[T], what: str, **source) -> T:
    """Returns a `schema` from YAML; `source` as for yaml_load_typed.

    Raises:
        ValueError: malformed YAML, an unknown field, or a value of the wrong
            type, on one line that starts with `what`.
    """
    source.setdefault("defaults", schema())
    try:
        return yaml_load_typed(schema=schema, **source)
    except Exception as error:
        # PyYAML's errors reach us through pydrake; it has no base for both.
        known = (AttributeError, KeyError, RuntimeError, TypeError, ValueError)
        from_yaml = type(error).__module__.partition(".")[0] == "yaml"
        if not (from_yaml or isinstance(error, known)):
            raise
        message = " ".join(str(error).split())
        raise ValueError(f"{what}: {message}") from error
