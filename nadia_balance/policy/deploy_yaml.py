"""Contracts as Isaac Lab's deployments have them: deploy.yaml.

Unitree's unitree_rl_lab writes one beside each policy that it exports.  Joints
are numbered as the motors of the robot; stiffness and damping are in the order
of the motors, everything else is in that of the policy.

Source: unitree_rl_lab, deploy/include/isaaclab.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, cast

from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import check_types, load_tree

_ACTION = "actions.JointPositionAction"
# What is read of it, and what Isaac Lab's class has beside.
_FIELDS = (
    "scale",
    "offset",
    "clip",
    "joint_names",
    "joint_ids",
    "class_type",
    "asset_name",
    "debug_vis",
    "preserve_order",
    "use_default_offset",
)
_RANGES = "lin_vel_x", "lin_vel_y", "ang_vel_z"
_TERM_FIELDS = "params", "clip", "scale", "history_length"
_TERM_PARAMS = "command_name", "period"
_SWITCHES = "use_gym_history", "scale_first"


def read_tree(text: str) -> dict[str, Any]:
    """Reads YAML that may have Python's tags.

    Args:
        text: of the file.

    Returns:
        Its tree.

    Raises:
        ValueError: malformed YAML.
    """
    tree = load_tree(re.sub(r"!!python/\S+", "", text))
    require(isinstance(tree, dict), "must be a mapping of fields")
    return dict(tree)


def is_deploy(tree: Mapping[str, Any]) -> bool:
    """Whether a tree is a deploy.yaml.

    Args:
        tree: of a YAML file.

    Returns:
        True if it has one of its fields.
    """
    return "joint_ids_map" in tree or "observations" in tree


def params_tree(
    deploy: Mapping[str, Any], motors: Sequence[str]
) -> dict[str, Any]:
    """The fields of PolicyParams in a deploy.yaml.

    Args:
        deploy: tree of the file.
        motors: names of the robot's joints, in the order of its motors.

    Returns:
        A tree of PolicyParams.

    Raises:
        ValueError: names field, value and what is allowed.
    """
    numbers = _numbers(deploy, motors)
    joints = [motors[i] for i in numbers]
    action = _child(deploy, _ACTION)
    for name in _child(deploy, "actions"):
        _require_one_of(f"actions.{name}", name, [_ACTION.split(".")[1]])
    for name in action:
        _require_one_of(f"{_ACTION}.{name}", name, _FIELDS)
    names = action.get("joint_names")
    require(
        names in (None, [".*"], joints),
        f"{_ACTION}.joint_names = {names}: must be ['.*'], or all joints in "
        "their order",
    )
    check_types(float, deploy.get("step_dt"), "step_dt")
    offset, limits = action.get("offset"), action.get("clip")
    require(
        action.get("joint_ids") in (None, [*range(len(joints))]),
        f"{_ACTION}.joint_ids: must be null, or all joints in their order",
    )
    tree = {
        "joints": joints,
        "default_angles": _by_joint(deploy, "default_joint_pos", joints),
        "action_offset": (
            None
            if offset is None
            else _by_joint(deploy, f"{_ACTION}.offset", joints)
        ),
        "action_scale": _as_list(action.get("scale")),
        "target_limits": [] if limits is None else limits,
        "period": deploy["step_dt"],
        **_observation(deploy),
    }
    for name in ("stiffness", "damping"):
        gains = _values(deploy, name, max(numbers) + 1, "one for each motor")
        tree[name] = [gains[i] for i in numbers]
    if "velocity_commands" in deploy["observations"]:
        ranges = "commands.base_velocity.ranges"
        tree["command_limits"] = [
            _values(deploy, f"{ranges}.{name}", 2, "the least and the most")
            for name in _RANGES
        ]
    return tree


def _numbers(deploy: Mapping[str, Any], motors: Sequence[str]) -> list[int]:
    """The motor of each joint of the policy."""
    check_types(list[int], deploy.get("joint_ids_map"), "joint_ids_map")
    numbers = [int(number) for number in deploy["joint_ids_map"]]
    allowed = range(len(motors))
    for i, number in enumerate(numbers):
        require(
            number in allowed,
            f"joint_ids_map[{i}] = {number}: must be a motor of the robot, 0 "
            f"to {len(motors) - 1}",
        )
        require(
            number not in numbers[:i],
            f"joint_ids_map[{i}] = {number}: must come only once",
        )
    require(bool(numbers), "joint_ids_map = []: must have motors")
    return numbers


def _child(deploy: Mapping[str, Any], path: str) -> Any:
    """The mapping at a path of names, such as "a.b"."""
    tree: Any = deploy
    for name in path.split("."):
        tree = tree.get(name) if isinstance(tree, dict) else None
    require(isinstance(tree, dict), f"{path} = {tree!r}: must be a mapping")
    return tree


def _values(
    tree: Mapping[str, Any], path: str, count: int, rule: str
) -> list[float]:
    """The list of `count` numbers at a path of names."""
    above, _, name = path.rpartition(".")
    values: Any = (_child(tree, above) if above else tree).get(name)
    check_types(list[float], values, path)
    require(
        len(values) == count,
        f"{path} = {len(values)} values: must be {count}, {rule}",
    )
    return [float(value) for value in values]


def _by_joint(
    deploy: Mapping[str, Any], path: str, joints: list[str]
) -> dict[str, float]:
    rule = "one for each joint of joint_ids_map"
    values = _values(deploy, path, len(joints), rule)
    return dict(zip(joints, values, strict=True))


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _observation(deploy: Mapping[str, Any]) -> dict[str, Any]:
    """Terms, history and phases."""
    terms = {
        name: _child(deploy, f"observations.{name}")
        for name in _child(deploy, "observations")
        if name not in _SWITCHES
    }
    switches = deploy["observations"]
    tree: dict[str, Any] = {
        "observation": [_term(name, term) for name, term in terms.items()],
        "by_tick": switches.get("use_gym_history", False),
    }
    clipped = [name for name, term in terms.items() if term.get("clip")]
    require(
        not (switches.get("scale_first") and clipped),
        f"observations.scale_first = true: must not come with a clip, as "
        f"{', '.join(clipped)} has",
    )
    if "gait_phase" in terms:
        stride = _params("gait_phase", terms["gait_phase"]).get("period")
        check_types(float, stride, "observations.gait_phase.params.period")
        tree["stride"] = stride
    return tree


def _params(name: str, term: Mapping[str, Any]) -> Mapping[str, Any]:
    """The params of a term, none if they are null."""
    params = term.get("params") or {}
    require(
        isinstance(params, Mapping),
        f"observations.{name}.params = {params!r}: must be a mapping",
    )
    return cast(Mapping[str, Any], params)


def _term(name: str, term: Mapping[str, Any]) -> dict[str, Any]:
    """A term as PolicyParams has it."""
    path = f"observations.{name}"
    for key in term:
        _require_one_of(f"{path}.{key}", key, _TERM_FIELDS)
    for key in _params(name, term):
        _require_one_of(f"{path}.params.{key}", key, _TERM_PARAMS)
    history = term.get("history_length", 1)
    check_types(int, history, f"{path}.history_length")
    history = int(float(history))
    require(history >= 1, f"{path}.history_length = {history}: must be >= 1")
    scale, clip = term.get("scale"), term.get("clip")
    return {
        "name": name,
        "scale": [1.0] if scale is None else _as_list(scale),
        "clip": [] if clip is None else clip,
        "history": history,
    }


def _require_one_of(path: str, key: str, allowed: Sequence[str]) -> None:
    require(
        key in allowed,
        f"{path}: unknown field, must be one of {', '.join(allowed)}",
    )
