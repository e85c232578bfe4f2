"""When a transfer that has taken its time may end, and the foot be lifted.

Ours: the papers say that the step is taken when the ICP is where it should be
(Atlas paper, Sec. II), but not what to do if it does not come.
"""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import Array, ContactSchedule


@dataclass(kw_only=True)
class LiftOffParams:
    """How near the ICP must be, and how long it is worth waiting for it."""

    # The foot is lifted when the ICP error is within this ellipse of the sole
    # frame.
    icp_error_forward: float = 0.035  # [m]
    icp_error_inward: float = 0.015  # toward the other foot [m]
    icp_error_outward: float = 0.012  # [m]
    ecmp_outside: float = 0.03  # the eCMP may be so far off the support [m]
    patience: float = 0.2  # waits no longer for the ICP than this [s]
    # But longer while the eCMP can be held so far beyond the ICP within the
    # support: it will come.  Not if the feet are far apart: on the way to one
    # foot, the ankle of the other meets its limit, and the pelvis tilts.
    held_patience: float = 1.0  # [s]
    held_room: float = 0.08  # [m]
    held_stance: float = 0.45  # largest distance of the feet [m]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in (
            "icp_error_forward",
            "icp_error_inward",
            "icp_error_outward",
        ):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and > 0")
        if not 0.0 <= self.ecmp_outside < math.inf:
            raise ValueError(
                f"ecmp_outside = {self.ecmp_outside}: must be finite and >= 0"
            )
        for name in (
            "patience",
            "held_patience",
            "held_room",
            "held_stance",
        ):
            value = getattr(self, name)
            if not value >= 0.0:
                raise ValueError(f"{name} = {value}: must be >= 0")


def may_lift(
    schedule: ContactSchedule,
    plan: IcpPlan,
    icp: Array,
    sole: Array,
    waited: float,
    params: LiftOffParams,
) -> bool:
    """True if the ICP is near its reference, or if no waiting brings it there.

    `icp` (2,) [m] in W, measured after a transfer has `waited` [s] past its
    end; `sole` (n, 2) [m] are the corners in the sole frame.  With both feet
    down, the eCMP can be held beyond the ICP on the support's far side.  If
    even that does not return the ICP within what is left of the patience,
    the next step had better come at once.  Crossed legs are always uncrossed
    at once: while the CoM moves on, the thigh behind nears the other shin.
    """
    if schedule.legs_crossed or not schedule.footsteps:
        return True
    error = icp - plan.at(schedule.duration).icp
    excess = 1.0 - 1.0 / max(_size(error, schedule, params), 1e-9)
    if excess < 0.0:
        return True
    length = math.hypot(*error)
    support = support_polygon(schedule, sole)
    room = float(np.max((support - icp) @ (error / length)))
    if _is_held(schedule, room, waited, params):
        return False
    room += params.ecmp_outside
    left = params.patience - waited
    # Eq. 3: the ICP moves back by room (e^wt - 1).
    return room <= 0.0 or room * _growth(plan.omega * left) < length * excess


def _is_held(
    schedule: ContactSchedule,
    room: float,
    waited: float,
    params: LiftOffParams,
) -> bool:
    """True if the ICP, with `room` [m] beyond it, can wait for longer."""
    left, right = schedule.feet.left.p_WF, schedule.feet.right.p_WF
    return (
        room >= params.held_room
        and waited < params.held_patience
        and math.dist(left[:2], right[:2]) <= params.held_stance
    )


def _size(
    error: Array, schedule: ContactSchedule, params: LiftOffParams
) -> float:
    """The ICP `error`, where 1 is the edge of the ellipse."""
    side = schedule.support_side
    x, y = schedule.feet[side].rotation.T @ error
    inward = -side.sign * y > 0.0
    width = params.icp_error_inward if inward else params.icp_error_outward
    return math.hypot(x / params.icp_error_forward, y / width)


def _growth(exponent: float) -> float:
    """e^x - 1; infinite where a float would overflow."""
    return math.expm1(exponent) if exponent < 700.0 else math.inf
