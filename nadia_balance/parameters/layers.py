"""One order of layers: which value of a parameter counts, and whose it is.

    default by size < robot.yaml < fidelity < scenario < scenario_text < flag

Each layer is a tree, as from YAML, of the values that it gives; a later layer
replaces single leaves and whole lists of those before.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from nadia_balance.parameters.bounds import check
from nadia_balance.parameters.scaling import Size, scaled
from nadia_balance.parameters.yaml_reader import check_types, typed

T = TypeVar("T")


class Layer(NamedTuple):
    """Values from one source."""

    source: str  # such as "robot.yaml"
    tree: Mapping[str, Any]
    for_nadia: bool = False  # values are scaled from Nadia's size


def merged(
    schema: type[T], size: Size, layers: Sequence[Layer]
) -> tuple[T, dict[str, str]]:
    """Merges the layers, the last one above all.

    Values that no layer gives are the defaults; these, and those of a layer
    `for_nadia`, are scaled to the robot.

    Args:
        schema: class of parameters.
        size: the robot's lengths [m].
        layers: in order of precedence.

    Returns:
        The parameters, checked, and the source of each value that is none of
        the defaults, by its path, such as "controller.balance.feedback_gain".

    Raises:
        ValueError: names an unknown field, or one of a wrong type or out of
            its bounds.
    """
    tree: Any = {}
    kept: Any = {}  # what is not scaled
    sources: dict[str, str] = {}
    for layer in layers:
        check_types(schema, layer.tree)
        tree = overlaid(tree, layer.tree)
        kept = (
            _without(kept, layer.tree)
            if layer.for_nadia
            else overlaid(kept, layer.tree)
        )
        for path in _paths(layer.tree):
            sources = {
                other: source
                for other, source in sources.items()
                if not _is_below(other, path)
            }
            sources[path] = layer.source
    made = typed(schema, tree)
    check(made)
    made = scaled(made, size, kept)
    check(made)
    return made, sources


def overlaid(tree: Any, over: Any) -> Any:
    """Returns a tree in which the leaves and lists of another one count.

    Args:
        tree: mappings and lists.
        over: the tree above it.

    Returns:
        The merged tree.
    """
    if not (isinstance(tree, Mapping) and isinstance(over, Mapping)):
        return over
    return {**tree, **{key: overlaid(tree.get(key), over[key]) for key in over}}


def _without(tree: Any, other: Any) -> Any:
    """The tree without the leaves that another one has."""
    if not (isinstance(tree, Mapping) and isinstance(other, Mapping)):
        return None
    return {
        key: _without(value, other[key]) if key in other else value
        for key, value in tree.items()
    }


def _paths(tree: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """The paths of all leaves and lists."""
    for key, value in tree.items():
        path = f"{above}{key}"
        if isinstance(value, Mapping) and value:
            yield from _paths(value, f"{path}.")
        else:
            yield path


def _is_below(path: str, top: str) -> bool:
    """True if one of the paths leads through the other."""
    path, top = f"{path}.", f"{top}."
    return path.startswith(top) or top.startswith(path)
