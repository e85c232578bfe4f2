"""The signals between blocks: a signal has the name of its ports."""

from typing import Any, cast

from pydrake.common import containers
from pydrake.systems.framework import Context, OutputPort

from nadia_balance.core.math.qp import QpResult
from nadia_balance.core.plan.icp_plan import IcpPlan
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking.mechanisms import NUM_SWITCHES
from nadia_balance.core.walking.state import (
    Adjustment,
    FootPoses,
    Mode,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.core.whole_body.command import WholeBodyTerms

PHASES = (Phase.STANDING, Phase.TRANSFER, Phase.SWING)
MODES = (Mode.STANDING, Mode.WALKING, Mode.RECOVERING)

namedview: Any = containers.namedview  # makes classes without types


def entries(first: int, last: int) -> property:
    """Some entries of a namedview, as one vector.

    Args:
        first: index of the first one.
        last: index behind the last one.

    Returns:
        The property that returns the vector (last - first,).
    """
    return property(lambda view: view[first:last])


def is_vector(kind: int | type) -> bool:
    """True for a vector, False for a Python value.

    Args:
        kind: size of a vector, its namedview, or the type of a Python value.

    Returns:
        Whether it is one of the first two.
    """
    return isinstance(kind, int) or hasattr(kind, "get_fields")


def size(kind: Any) -> int:
    """The number of entries of a vector.

    Args:
        kind: size of the vector, or its namedview.

    Returns:
        The size.
    """
    return kind if isinstance(kind, int) else len(kind.get_fields())


class ComState(
    namedview(  # type: ignore[misc]
        "ComState", ["x", "y", "z", "vx", "vy", "vz"]
    )
):
    """Position and velocity of the centre of mass, (3,) in W [m], [m/s]."""

    position, velocity = entries(0, 3), entries(3, 6)


class IcpReference(
    namedview(  # type: ignore[misc]
        "IcpReference",
        [
            "icp_x",
            "icp_y",
            "icp_velocity_x",
            "icp_velocity_y",
            "cop_x",
            "cop_y",
            "ecmp_x",
            "ecmp_y",
        ],
    )
):
    """The ICP plan at the present time, xy in W [m], [m/s]."""

    icp, icp_velocity = entries(0, 2), entries(2, 4)
    cop, ecmp = entries(4, 6), entries(6, 8)


class EcmpCommand(
    namedview(  # type: ignore[misc]
        "EcmpCommand", ["cop_x", "cop_y", "ecmp_x", "ecmp_y"]
    )
):
    """The commanded CoP and eCMP, xy in W [m]."""

    cop, ecmp = entries(0, 2), entries(2, 4)


class QpStatus(
    namedview(  # type: ignore[misc]
        "QpStatus", ["solved", "fallback", "solves", "violation", "failures"]
    )
):
    """Status of a QP in this tick, with the number of failures until now.

    `violation` is the largest constraint violation, in units of the QP's rows.
    """

    def after(self, qp: QpResult) -> tuple[float, ...]:
        """The status of the next tick.

        Args:
            qp: result of the QP in that tick.

        Returns:
            The entries of the status (5,).
        """
        return (
            qp.solved,
            qp.fallback,
            qp.solves,
            qp.violation,
            self.failures + (not qp.solved),
        )


class SwingFootReference(
    namedview(  # type: ignore[misc]
        "SwingFootReference",
        [
            "x",
            "y",
            "z",
            "vx",
            "vy",
            "vz",
            "ax",
            "ay",
            "az",
            "yaw",
            "yaw_rate",
            "yaw_acceleration",
        ],
    )
):
    """The motion of a sole in W (see `as_reference`): [m], [rad], [s]."""

    position, velocity = entries(0, 3), entries(3, 6)
    acceleration = entries(6, 9)


class WalkingSignal(
    namedview(  # type: ignore[misc]
        "WalkingSignal",
        [
            "phase",
            "support_side",
            "time_in_phase",
            "duration",
            "waiting",
            "steps_taken",
            "left_x",
            "left_y",
            "left_yaw",
            "right_x",
            "right_y",
            "right_yaw",
            "target_x",
            "target_y",
            "target_yaw",
            "target_side",
            "mode",
        ],
    )
):
    """The walking state as numbers, for logs.

    `phase` is an index of PHASES, `mode` of MODES; `support_side` and
    `target_side` are +1 for left, -1 for right; `time_in_phase` and `duration`
    [s]; `left` and `right` are the present or last stance poses, `target` is
    the next foothold (NaN, and side 0, without one), each (x, y, yaw) in W [m],
    [rad].
    """

    left, right = entries(6, 9), entries(9, 12)
    target = entries(12, 15)


class PushSignal(
    namedview(  # type: ignore[misc]
        "PushSignal",
        ["number", "delta_v", "force_x", "force_y", "force_z", "waiting"],
    )
):
    """The push that acts now: `delta_v` [m/s] and force in W [N].

    `number` counts from 1 on, live pushes after scripted ones; of several, the
    one that began last; 0: no push.  `waiting` scripted ones have not ended.
    """

    force = entries(2, 5)


class VelocityCommand(
    namedview(  # type: ignore[misc]
        "VelocityCommand", ["forward", "left", "turn"]
    )
):
    """In the level frame between the feet [m/s], [rad/s]; 0 is to stand."""


FootForces = namedview("FootForces", [side.value for side in Side])


class MeasuredFeet(
    namedview(  # type: ignore[misc]
        "MeasuredFeet",
        [f"{s.value}_{part}" for s in Side for part in ("x", "y", "z", "yaw")],
    )
):
    """The measured soles: their centres p_WF [m], and yaw [rad]."""

    left, right = entries(0, 3), entries(4, 7)


class Touchdown(
    namedview(  # type: ignore[misc]
        "Touchdown",
        [
            "time",
            "side",
            "speed_along",
            "speed_down",
            "tilt",
            "force",
            "mean_force",
            "slide",
        ],
    )
):
    """How a foot meets the ground: the motion of the lowest corner before.

    `side` is +1 for left, -1 for right; the speeds are level and down [m/s],
    also on a slope, `tilt` is the sole's against level [rad], `force` the
    largest one in a step of the plant, `mean_force` over 10 ms, both per weight
    [-]; `slide` is how far the sole moves in 0.1 s, seen from above [m].
    """


# Angles of torso and pelvis against the vertical [rad].
TrunkTilt = namedview("TrunkTilt", ["torso", "pelvis"])

# What blocks tell each other, by the names of the ports: the size of a vector,
# its namedview, or the type of a Python value.  Points and forces are in W, and
# left comes before right.  Those of the size of a robot are not here.
SIGNALS: dict[str, int | type] = {
    "adjustment": Adjustment,  # None while `step` is off
    "alip_icp": 2,  # the icp with the momentum about the contact [m]
    "capture_regions": CaptureRegions,
    "com_state": ComState,
    "ecmp_command": EcmpCommand,
    "foot_forces": 2,  # vertical forces on the feet [N]
    "footsteps": tuple,  # of Footstep, after the present phase; () to stand
    "foot_poses": FootPoses,  # measured
    "foot_wrenches": 12,  # [tau, f] on each sole, at its centre [N m, N]
    "friction": 1,  # coefficient of the friction pyramid [-]
    "icp": 2,  # measured [m]
    "icp_plan": IcpPlan,  # of the schedule of `walking_state`
    "icp_reference": IcpReference,
    "live_push": 4,  # count, delta_v [m/s], direction [deg], duration [s]
    "mechanisms": NUM_SWITCHES,  # see Mechanisms; all on if not connected
    "momentum_qp_status": QpStatus,  # its violation in [m]
    "momentum_rate": 3,  # of the linear momentum [N]
    "no_foothold": 1,  # 1: no ground in reach is in the capture region
    "push_force": 3,  # sum of all pushes [N]
    "push_signal": PushSignal,
    # Steps not landed, the one in the air too; None: as they are.
    "revised_footsteps": tuple,
    "swing_foot_reference": SwingFootReference,
    "time_adjustment": 2,  # see TimeAdjustment [s]; 0 if not connected
    # Forward, left [m/s], turn to the left [rad/s]; 0 if not connected.
    "velocity_command": 3,
    "walking_signal": WalkingSignal,
    "walking_state": WalkingState,
    "whole_body_qp_status": QpStatus,
    "whole_body_terms": WholeBodyTerms,
}


def read(port: OutputPort, root: Context) -> Any:
    """The value of a block's port.

    Args:
        port: output port of a block in a diagram.
        root: Context of the whole diagram.

    Returns:
        The vector, or the Python value.
    """
    return port.Eval(cast(Any, port.get_system()).GetMyContextFromRoot(root))
