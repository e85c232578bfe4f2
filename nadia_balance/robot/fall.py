"""When a robot has fallen, by its pelvis."""

import math

from nadia_balance.core.math.arrays import Array

FALLEN_HEIGHT = 0.6  # pelvis height, as a fraction of that at the start
FALLEN_TILT = 1.0  # tilt of the pelvis against the vertical [rad]


def upright(quaternion: Array) -> float:
    """The cosine of the tilt of a pelvis against the vertical.

    Args:
        quaternion: its orientation in W (4,), w x y z, of any norm but 0.

    Returns:
        The cosine [-].
    """
    w, x, y, z = (quaternion**2).tolist()
    return float((w + z - x - y) / (w + x + y + z))


def fall_of(up: float, height: float, standing_height: float) -> str:
    """Why a robot counts as fallen.

    Args:
        up: cosine of the tilt of its pelvis [-].
        height: of the pelvis above the ground [m].
        standing_height: that when it stands [m].

    Returns:
        A few words; empty if it has not fallen.
    """
    if height < FALLEN_HEIGHT * standing_height:
        return "pelvis too low"
    return "pelvis tilted" if up < math.cos(FALLEN_TILT) else ""
