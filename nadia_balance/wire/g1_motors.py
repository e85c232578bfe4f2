"""The motors of Unitree's G1, in the order of its messages."""

from collections.abc import Sequence

from nadia_balance.parameters.bounds import require

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = (
    *("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"),
    *("wrist_roll", "wrist_pitch", "wrist_yaw"),
)
# The joints of the motors, in Unitree's order.
JOINTS = (
    *(f"{side}_{name}_joint" for side in ("left", "right") for name in _LEG),
    *(f"waist_{name}_joint" for name in ("yaw", "roll", "pitch")),
    *(f"{side}_{name}_joint" for side in ("left", "right") for name in _ARM),
)


def motors_of(joints: Sequence[str], field: str) -> list[int]:
    """The motors of a robot's joints.

    Args:
        joints: names of the robot's joints (n), by their actuators.
        field: what is named in the error, with its value.

    Returns:
        The index of the motor of each joint (n,).

    Raises:
        ValueError: these are not the joints of a G1.
    """
    require(
        sorted(joints) == sorted(JOINTS),
        f"{field}: must be of a robot with the 29 joints of the G1",
    )
    return [JOINTS.index(joint) for joint in joints]
