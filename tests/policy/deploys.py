"""A deploy.yaml as unitree_rl_lab writes it for the G1, and its policy."""

import copy
from pathlib import Path

import numpy as np
import yaml

from tests.onnx_bytes import linear_policy

# The G1's motors by their numbers (G1JointIndex of Unitree's SDK), without
# "_joint".
MOTORS = [
    *(
        f"{side}_{joint}"
        for side in ("left", "right")
        for joint in (
            "hip_pitch",
            "hip_roll",
            "hip_yaw",
            "knee",
            "ankle_pitch",
            "ankle_roll",
        )
    ),
    "waist_yaw",
    "waist_roll",
    "waist_pitch",
    *(
        f"{side}_{joint}"
        for side in ("left", "right")
        for joint in (
            "shoulder_pitch",
            "shoulder_roll",
            "shoulder_yaw",
            "elbow",
            "wrist_roll",
            "wrist_pitch",
            "wrist_yaw",
        )
    ),
]
# unitree_rl_lab, deploy/robots/g1_29dof, velocity/v0: Isaac's order.
MAP = [0, 6, 12, 1, 7, 13, 2, 8, 14, 3, 9, 15, 22, 4, 10, 16, 23, 5, 11, 17, 24]
MAP += [18, 25, 19, 26, 20, 27, 21, 28]
N = 29


def _term(scale: list[float], history: int = 5) -> dict:
    return {
        "params": {},
        "clip": None,
        "scale": scale,
        "history_length": history,
    }


DEPLOY = {
    "joint_ids_map": MAP,
    "step_dt": 0.02,
    "stiffness": [100.0 + i for i in range(N)],
    "damping": [2.0 + 0.1 * i for i in range(N)],
    "default_joint_pos": [0.01 * i for i in range(N)],
    "commands": {
        "base_velocity": {
            "ranges": {
                "lin_vel_x": [-0.5, 1.0],
                "lin_vel_y": [-0.3, 0.3],
                "ang_vel_z": [-0.2, 0.2],
                "heading": None,
            }
        }
    },
    "actions": {
        "JointPositionAction": {
            "clip": None,
            "joint_names": [".*"],
            "scale": [0.25 + 0.001 * i for i in range(N)],
            "offset": [0.02 * i for i in range(N)],
            "joint_ids": None,
        }
    },
    "observations": {
        "base_ang_vel": _term([0.2, 0.3, 0.4]),
        "projected_gravity": _term([1.0] * 3),
        "velocity_commands": _term([1.0] * 3),
        "joint_pos_rel": _term([1.0] * N, history=3),
        "joint_vel_rel": _term([0.05] * N),
        "last_action": _term([1.0] * N, history=1),
    },
}
M = 5 * 9 + 3 * N + 5 * N + N  # entries of its observation


def changed(path: str, value: object) -> dict:
    """DEPLOY with another value at a path of names, such as "a.b"."""
    deploy = copy.deepcopy(DEPLOY)
    *above, name = path.split(".")
    tree = deploy
    for key in above:
        tree = tree[key]
    tree[name] = value
    return deploy


def write(
    folder: Path, deploy: dict | None = None, size: int = M, seed: int = 0
) -> tuple[Path, np.ndarray, np.ndarray]:
    """Writes exported/policy.onnx and params/deploy.yaml, as unitree_rl_lab.

    Returns the path of the network a = W o + b, and W, b.
    """
    rng = np.random.default_rng(seed)
    W, b = 0.1 * rng.normal(size=(N, size)), rng.normal(size=N)
    for name in ("exported", "params"):
        (folder / name).mkdir()
    path = folder / "exported" / "policy.onnx"
    path.write_bytes(linear_policy(W, b))
    text = yaml.dump(deploy or DEPLOY, sort_keys=False)
    # Isaac Lab writes some of its lists as Python's tuples.
    text = text.replace("lin_vel_x:\n", "lin_vel_x: !!python/tuple\n")
    (folder / "params" / "deploy.yaml").write_text(text)
    return path, W, b
