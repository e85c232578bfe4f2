"""Blocks of the user's own, told by the names of their classes: `module:Class`.

A name can be sent to other processes, each of which makes a block of its own.
"""

import importlib
import inspect
import os
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import cast

from pydrake.systems.framework import System

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import load_robot

NONE = "none"  # in the place of a class: the block is left out
_CLASS = re.compile(r"[^\W\d][\w.]*:[^\W\d]\w*")


def names_class(text: str) -> bool:
    """Whether a text is `module:Class`, and no file.

    Args:
        text: of a flag.

    Returns:
        True if it is.
    """
    return _CLASS.fullmatch(text) is not None


def name_of(kind: type | str | None) -> str:
    """The name of a class, by which other processes find it.

    Args:
        kind: the class, or its name already; None leaves a block out.

    Returns:
        `module:Class`, or NONE.

    Raises:
        ValueError: it has no such name.
    """
    if kind is None:
        return NONE
    require(
        isinstance(kind, str | type), f"{kind!r}: must be a class, or its name"
    )
    name = (
        kind if isinstance(kind, str) else f"{kind.__module__}:{kind.__name__}"
    )
    require(
        names_class(name) and not name.startswith("__main__:"),
        f"{name!r}: must be module:Class, and the module a file that other "
        "processes import",
    )
    return name


def parsed_blocks(texts: Iterable[str]) -> dict[str, str]:
    """The blocks of a command line.

    Args:
        texts: each role=module:Class, or role=none.

    Returns:
        Names of classes by role.

    Raises:
        ValueError: a text is another, or a role comes twice.
    """
    blocks: dict[str, str] = {}
    for text in texts:
        role, _, name = text.partition("=")
        require(
            role.isidentifier()
            and (name == NONE or names_class(name))
            and role not in blocks,
            f"block = {text!r}: must be role=module:Class or role={NONE}, each "
            "role once",
        )
        blocks[role] = name
    return blocks


def class_of(name: str) -> type:
    """Imports a class; its module may also be in the present folder.

    Args:
        name: `module:Class`.

    Returns:
        The class.

    Raises:
        ValueError: there is no such module or class.
    """
    module, _, attribute = name.partition(":")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        imported = importlib.import_module(module)
    except (Exception, SystemExit) as error:  # whatever the module does
        raise ValueError(
            f"{name}: module {module}: must be importable "
            f"({type(error).__name__}: {error})"
        ) from None
    kind = getattr(imported, attribute, None)
    if not isinstance(kind, type):
        raise ValueError(f"{name}: must be a class of the module {module}")
    return kind


def file_of(name: str) -> Path:
    """The file in which a class is.

    Args:
        name: `module:Class`.

    Returns:
        Its path.

    Raises:
        ValueError: there is no such class, or none in a file.
    """
    file = getattr(sys.modules[class_of(name).__module__], "__file__", None)
    if file is None:
        raise ValueError(f"{name}: must be in a file")
    return Path(file)


def made(name: str, scenario: Scenario, period: float) -> System:
    """Makes a block.

    Args:
        name: `module:Class`.
        scenario: what is simulated.
        period: of the controller [s].

    Returns:
        The block.  Its class is called with those of these that its constructor
        has: `scenario`, `robot`, a RobotModel, `model`, its PointMassModel,
        `params`, the ControllerParams, and `period`.

    Raises:
        ValueError: the class is not there, needs more, or fails.
    """
    kind = class_of(name)
    robot = load_robot(scenario.robot, scenario.fidelity)
    offered = {
        "scenario": scenario,
        "robot": robot,
        "model": scenario.point_mass(robot),
        "params": scenario.controller,
        "period": period,
    }
    try:
        block = kind(
            **{key: offered[key] for key in _arguments(kind) if key in offered}
        )
    except (Exception, SystemExit) as error:  # whatever its constructor does
        raise ValueError(
            f"{name}: must be made with some of {', '.join(offered)} "
            f"({type(error).__name__}: {error})"
        ) from None
    require(isinstance(block, System), f"{name}: must be a System of Drake")
    return cast(System, block)


def _arguments(kind: type) -> list[str]:
    """The arguments of a class's constructor; Drake's own tell none."""
    try:
        return [*inspect.signature(kind).parameters]
    except ValueError:
        return []


def all_made(
    blocks: Mapping[str, str], scenario: Scenario, period: float
) -> dict[str, System | None]:
    """Makes blocks.

    Args:
        blocks: names of classes by role.
        scenario: what is simulated.
        period: of the controller [s].

    Returns:
        The blocks by role, None for those that are left out.

    Raises:
        ValueError: as `made`; it names the role.
    """
    systems: dict[str, System | None] = {}
    for role, name in blocks.items():
        try:
            systems[role] = (
                None if name == NONE else made(name, scenario, period)
            )
        except ValueError as error:
            raise ValueError(f"block {role} = {error}") from None
    return systems
