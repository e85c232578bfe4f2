"""Contracts of holosoma's walking policies (Amazon FAR).

Their ONNX files name joints, gains and ranges of commands in their metadata.
Pose and observation are those of holosoma_inference 0.1.3, by robot.

Source: holosoma_inference/config/config_values/robot.py and observation.py.
"""

import json
from collections.abc import Mapping
from typing import Any

from nadia_balance.core.walking.state import Side
from nadia_balance.parameters.bounds import require

_METADATA = {"joints": "dof_names", "stiffness": "kp", "damping": "kd"}
_RANGES = "lin_vel_x", "lin_vel_y", "ang_vel_yaw"


def is_holosoma(metadata: Mapping[str, str]) -> bool:
    """Whether an ONNX file is of holosoma.

    Args:
        metadata: texts in the file.

    Returns:
        True if it has some of holosoma's.
    """
    return any(key in metadata for key in _METADATA.values())


def metadata_tree(metadata: Mapping[str, str]) -> dict[str, Any]:
    """The fields of PolicyParams that the file has.

    Args:
        metadata: texts in the file, in JSON.

    Returns:
        A tree of them.

    Raises:
        ValueError: one is missing or malformed.
    """
    missing = [key for key in _METADATA.values() if key not in metadata]
    require(not missing, f"must have metadata: lacks {', '.join(missing)}")
    tree = {field: _parsed(metadata, key) for field, key in _METADATA.items()}
    ranges = _parsed(metadata, "command_ranges")
    if isinstance(ranges, dict):
        tree["command_limits"] = [ranges.get(name) for name in _RANGES]
    return tree


def _parsed(metadata: Mapping[str, str], key: str) -> Any:
    try:
        return json.loads(metadata.get(key, "null"))
    except ValueError:
        raise ValueError(
            f"{key} = {metadata[key][:40]!r}: must be JSON"
        ) from None


def default_tree(joints: object) -> tuple[str, dict[str, Any]]:
    """What is in holosoma's code, and not in the file.

    Args:
        joints: names in the file.

    Returns:
        The robot's name, "" if it is none of theirs, and a tree of PolicyParams
        without the pose then.
    """
    names = {*map(str, joints)} if isinstance(joints, list) else set()
    for robot, pose, turn, speed in (
        ("g1_29dof", _g1_pose(), 0.25, 0.05),
        ("t1_29dof", _t1_pose(), 1.0, 0.1),
    ):
        if {*pose} <= names:
            scales = {"base_ang_vel": turn, "joint_vel_rel": speed}
            return robot, {
                "default_angles": pose,
                "observation": _observation(scales),
            }
    return "", {}


def _observation(scales: dict[str, float]) -> list[dict[str, Any]]:
    """The terms, in the alphabetical order of holosoma's names."""
    names = (
        "last_action",  # actions
        "base_ang_vel",
        "command_ang_vel",
        "command_lin_vel",
        "cos_phase",
        "joint_pos_rel",  # dof_pos
        "joint_vel_rel",  # dof_vel
        "projected_gravity",
        "sin_phase",
    )
    return [{"name": n, "scale": [scales.get(n, 1.0)]} for n in names]


def _g1_pose() -> dict[str, float]:
    """Default angles [rad] of the G1."""
    pose: dict[str, float] = {}
    for side in Side:
        pose |= {
            f"{side.value}_hip_pitch_joint": -0.312,
            f"{side.value}_knee_joint": 0.669,
            f"{side.value}_ankle_pitch_joint": -0.363,
            f"{side.value}_shoulder_pitch_joint": 0.2,
            f"{side.value}_shoulder_roll_joint": 0.2 * side.sign,
            f"{side.value}_elbow_joint": 0.6,
        }
    return pose


def _t1_pose() -> dict[str, float]:
    """Default angles [rad] of Booster's T1."""
    pose: dict[str, float] = {}
    for side in Side:
        name = side.value.capitalize()
        pose |= {
            f"{name}_Shoulder_Pitch": 0.2,
            f"{name}_Shoulder_Roll": -1.35 * side.sign,
            f"{name}_Elbow_Yaw": -0.5 * side.sign,
            f"{name}_Hip_Pitch": -0.2,
            f"{name}_Knee_Pitch": 0.4,
            f"{name}_Ankle_Pitch": -0.25,
        }
    return pose
