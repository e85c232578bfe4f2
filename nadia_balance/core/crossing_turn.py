"""The pelvis turns with a leg that crosses the other one.

Ours: the papers leave it to the whole-body controller.  With the hip of the
crossing leg ahead, the thighs keep clear of each other.
"""

import math
from dataclasses import dataclass

from nadia_balance.core.walking import Array, Phase, WalkingState


@dataclass(kw_only=True)
class CrossingTurnParams:
    """How far the pelvis turns when the feet come close, and cross."""

    width: float = 0.25  # it turns while the soles are closer, sideways [m]
    gain: float = 20.0  # turn per squared closeness and step length [rad/m^3]
    max_turn_deg: float = 30.0  # never reached [deg]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in ("width", "gain"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and >= 0")
        if not 0.0 < self.max_turn_deg <= 60.0:
            raise ValueError(
                f"max_turn_deg = {self.max_turn_deg}: must be in (0, 60] deg"
            )


def crossing_turn(
    state: WalkingState, swing: Array, params: CrossingTurnParams
) -> tuple[float, float, float]:
    """Returns the pelvis' yaw, yawdot, yawddot relative to the feet's [rad].

    With the other sole x in front of the support sole and c closer to it
    than `width`, sideways: gain c^2 x, bounded softly; positive to the left.
    `swing` (12,) is the reference of the swing sole (see SwingFootPlanner),
    which makes the turn as smooth as the swing.
    """
    schedule = state.schedule
    side = schedule.support_side
    stance = schedule.feet[side]
    if schedule.phase is Phase.SWING:
        p, v, a = swing[:9].reshape(3, 3)[:, :2].tolist()
    else:
        p = schedule.feet[side.other].p_WF[:2].tolist()
        v = a = (0.0, 0.0)
    p = p[0] - float(stance.p_WF[0]), p[1] - float(stance.p_WF[1])
    cos, sin = math.cos(stance.yaw), math.sin(stance.yaw)
    x, dx, ddx = (cos * e[0] + sin * e[1] for e in (p, v, a))
    c, dc, ddc = (side.sign * (cos * e[1] - sin * e[0]) for e in (p, v, a))
    c += params.width
    if c <= 0.0:
        return 0.0, 0.0, 0.0
    most = math.radians(params.max_turn_deg)
    gain = side.sign * params.gain / most
    u = gain * c * c * x
    du = gain * c * (2.0 * dc * x + c * dx)
    ddu = gain * (
        2.0 * (dc * dc + c * ddc) * x + 4.0 * c * dc * dx + c * c * ddx
    )
    turn = math.tanh(u)
    slope = 1.0 - turn * turn
    return (
        most * turn,
        most * slope * du,
        most * slope * (ddu - 2.0 * turn * du * du),
    )
