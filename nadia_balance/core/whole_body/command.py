"""Terms and command of the whole-body QP, for a walking state."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.body.model import JointDriveParams
from nadia_balance.core.math.arrays import Array, cross, read_only
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.mechanisms import USUAL, Mechanisms
from nadia_balance.core.walking.state import (
    ContactSchedule,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.core.whole_body.params import (
    CrossingTurnParams,
    WholeBodyQpParams,
)

# Rows of WholeBodyTerms; the joints' rows follow BASE.
SOLES = slice(0, 6), slice(6, 12)  # left, right
BASE = slice(12, 18)
TORSO = slice(-6, -3)
PELVIS = slice(-3, None)
_FORCES = slice(BASE.start, TORSO.start)
# Distance of the rolling axis from the sole's edge, in sole margins: inside the
# wrench cone, not on its boundary.
_ROLLING_MARGINS = 2.0


@dataclass(frozen=True, eq=False)
class WholeBodyModel:
    """Constants of a robot with nj joints, in the plant's order.

    Args:
        mass: of the robot [kg].
        sole_length: along the foot [m].
        sole_width: across it [m].
        ankles: last joint of the (left, right) leg (2, 3), in the frame of the
            sole [m].
        posture: nominal positions (nj,) [rad].
        position_lower: limits (nj,) [rad].
        position_upper: limits (nj,) [rad].
        max_torque: limits (nj,) [N m].
        max_speed: limits (nj,), which may be infinite [rad/s].
        corner_speed: shares (nj,) of them with the full torque [-].
        is_leg_joint: whether it is one (nj,).
        is_knee: whether it is one (nj,).
        inertia: apparent inertia of each in the air (nj,) [kg m^2].
        drives: without, torques have no speed or rate limits.
        given: joints that somebody else moves, their numbers.
    """

    mass: float
    sole_length: float
    sole_width: float
    ankles: Array
    posture: Array
    position_lower: Array
    position_upper: Array
    max_torque: Array
    max_speed: Array
    corner_speed: Array
    is_leg_joint: NDArray[np.bool_]
    is_knee: NDArray[np.bool_]
    inertia: Array
    drives: JointDriveParams | None = None
    given: tuple[int, ...] = ()

    @property
    def num_joints(self) -> int:
        """Number of joints, all actuated."""
        return self.posture.size


class Avoidance(NamedTuple):
    """Rows [A, a] (k, nv + 1) of link pairs, with A vdot + a [m/s^2].

    Args:
        limits: rows that are >= 0, as a hard limit.
        braking: rows that are to be 0, as a soft task, scaled by the root of
            its weight.
    """

    limits: Array
    braking: Array


class WholeBodyTerms(NamedTuple):
    """Kinematics and dynamics; nv = 6 + nj, v = [w_WB, v_WB, joints].

    The floating base B is the pelvis, its velocity expressed in W.  The rows
    [A, a] are of the quantities A vdot + a: the accelerations of the left and
    of the right sole ([w, v] at its centre), the generalised forces on base and
    joints, and the angular accelerations of torso and pelvis, all in W.  The
    forces, M vdot + bias with gravity and damping, are per unit of the robot's
    mass.

    Args:
        rows: [A, a] (24 + nj, nv + 1).
        velocities: A v (24 + nj,); those of soles, torso and momentum are at
            the time of v if q is ahead of it.
        rotations: R_W of left sole, right sole, torso, pelvis (4, 3, 3).
        sole_positions: centres (2, 3) in W [m].
        q: positions (7 + nj,), the joints last [rad].
        v: velocities (nv,) [rad/s, m/s].
        com_state: [p_WC, v_WC] (6,) of the centre of mass in W [m, m/s].
        avoidance: rows of near or braking links; None: self-collisions are
            ignored.
    """

    rows: Array
    velocities: Array
    rotations: Array
    sole_positions: Array
    q: Array
    v: Array
    com_state: Array
    avoidance: Avoidance | None = None

    @property
    def forces(self) -> Array:
        """[M, bias] (nv, nv + 1), per unit of mass."""
        return self.rows[_FORCES]

    def at_point(self, side: int, arm: Array) -> tuple[Array, Array]:
        """The rows of a sole at another point of the foot.

        Args:
            side: index of the sole, 0 left, 1 right.
            arm: from the centre of the sole to the point (3,) in W [m].

        Returns:
            [A, a] (6, nv + 1) of its acceleration [w, v], and A v (6,), in W.
        """
        rows = self.rows[SOLES[side]].copy()
        velocities = self.velocities[SOLES[side]].copy()
        w = velocities[:3]
        x, y, z = arm.tolist()
        across = np.array((0.0, z, -y, -z, 0.0, x, y, -x, 0.0)).reshape(3, 3)
        # dot() of small arrays takes half of the time of @.
        velocities[3:] += across.dot(w)  # w x arm
        rows[3:] += across.dot(rows[:3])
        wx, wy, wz = w.tolist()
        along, square = float(w.dot(arm)), float(w.dot(w))
        rows[3:, -1] += (  # w x (w x arm)
            wx * along - x * square,
            wy * along - y * square,
            wz * along - z * square,
        )
        return rows, velocities

    @property
    def angular_momentum(self) -> Array:
        """Angular momentum (3,) about the CoM in W, per unit of mass."""
        p_BC, v = self.com_state[:3] - self.q[4:7], self.com_state[3:]
        return self.velocities[BASE][:3] - cross(p_BC, v)


class WholeBodyCommand(NamedTuple):
    """Desired values of the whole-body QP.

    Args:
        momentum_rate: of the linear momentum (3,) in W [N].
        heading: yaw, yawdot, yawddot of the torso [rad, s].
        turn: yaw, yawdot, yawddot of the pelvis relative to it [rad, s].
        contacts: True for each (left, right) sole in contact, at least one is.
        max_normal_forces: of the (left, right) sole [N].
        swing: reference of the swing sole (12,) [p, v, a, yaw, yawdot, yawddot]
            in W [m, rad, s].
        normals: desired normals of the (left, right) sole (2, 3) in W.
        friction: coefficient assumed for both soles [-].
        edges: positions x of the axes about which the (left, right) sole may
            roll; 0: it stays flat [m].
        flatness: share in (0, 1] of the weight that the swing sole's
            orientation has by now [-].
        sinking: velocities at which the (left, right) sole is to meet its
            ground, against the normal; 0: it stands there [m/s].
        mechanisms: those that are on; set if there are tasks of the user's.
        icp_error: measured less planned ICP (2,) in W, likewise [m].
    """

    momentum_rate: Array
    heading: tuple[float, float, float]
    turn: tuple[float, float, float]
    contacts: tuple[bool, ...]
    max_normal_forces: tuple[float, ...]
    swing: Array
    normals: Array
    friction: float
    edges: tuple[float, ...] = (0.0, 0.0)
    flatness: float = 1.0
    sinking: tuple[float, ...] = (0.0, 0.0)
    mechanisms: Mechanisms = USUAL
    icp_error: Array = read_only([0.0, 0.0], 2)


def whole_body_command(
    state: WalkingState,
    momentum_rate: Array,
    swing: Array,
    friction: float,
    params: WholeBodyQpParams,
    model: WholeBodyModel,
) -> WholeBodyCommand:
    """The command of a tick: contacts, heading and force bounds of a state.

    Args:
        state: walking state.
        momentum_rate: desired rate of the linear momentum (3,) in W [N].
        swing: reference of the swing sole (12,) in W [m, rad, s].
        friction: coefficient to assume [-].
        params: force bounds, and the motions of soles and pelvis.
        model: mass and sole.

    Returns:
        The command.
    """
    schedule = state.schedule
    return WholeBodyCommand(
        momentum_rate=momentum_rate,
        heading=heading(state, swing),
        turn=crossing_turn(state, swing, params.crossing_turn),
        contacts=(
            schedule.in_contact(Side.LEFT),
            schedule.in_contact(Side.RIGHT),
        ),
        max_normal_forces=max_normal_forces(state, params, model),
        swing=swing,
        normals=sole_normals(state),
        friction=friction,
        edges=rolling_edges(state, params, model),
        flatness=flatness(state, params),
        sinking=sinking(state, params),
    )


def _by_side(
    schedule: ContactSchedule, support: float, other: float
) -> tuple[float, float]:
    """The numbers of the support foot and of the other one, (left, right)."""
    if schedule.support_side is Side.LEFT:
        return support, other
    return other, support


def sinking(
    state: WalkingState, params: WholeBodyQpParams
) -> tuple[float, float]:
    """The velocities at which the soles sink.

    One sinks which has landed in this transfer, while it measures no force: it
    has left the ground again.

    Args:
        state: walking state.
        params: `sinking_velocity` counts.

    Returns:
        The velocities of the (left, right) sole [m/s].
    """
    if (
        state.schedule.phase is not Phase.TRANSFER
        or state.steps_taken == 0
        or state.contact_time > 0.0
    ):
        return 0.0, 0.0
    return _by_side(state.schedule, params.sinking_velocity, 0.0)


def sole_normals(state: WalkingState) -> Array:
    """The desired normals of the soles.

    The normal of a swing foot turns from the ground at lift-off to that at the
    foothold, by a cubic in time.

    Args:
        state: walking state.

    Returns:
        Those of the (left, right) sole (2, 3) in W.
    """
    schedule = state.schedule
    feet = schedule.feet
    normals = [feet.left.normal.tolist(), feet.right.normal.tolist()]
    if schedule.phase is Phase.SWING:
        step = schedule.footsteps[0]
        i = step.side.index
        s = state.time_in_phase / schedule.duration
        share = s * s * (3.0 - 2.0 * s)
        n = [
            a + share * (b - a)
            for a, b in zip(normals[i], step.pose.normal.tolist(), strict=True)
        ]
        length = math.hypot(*n)
        normals[i] = [e / length for e in n]
    return np.array(normals)


def flatness(state: WalkingState, params: WholeBodyQpParams) -> float:
    """The share of its weight that the swing sole's orientation has.

        flatness = early + (1 - early) s^2 (3 - 2 s)

    rises from `swing_early_share` to 1 in the last `swing_flat_time` of the
    swing: only a landing sole has to be flat.  Before, the ankle of a trailing
    leg is at its limit, and a flat sole costs momentum.

    Args:
        state: walking state.
        params: share and time.

    Returns:
        The share in (0, 1] [-].
    """
    early = params.swing_early_share
    s = min(max(1.0 - state.remaining_time / params.swing_flat_time, 0.0), 1.0)
    return early + (1.0 - early) * s * s * (3.0 - 2.0 * s)


def rolling_edges(
    state: WalkingState, params: WholeBodyQpParams, model: WholeBodyModel
) -> tuple[float, float]:
    """The edges about which the soles may roll.

    The trailing foot rolls in the transfer of a long step, over the toes if the
    step is forward, over the heel if it is backward: its leg reaches its full
    length, and with a flat sole the knee would straighten at once.

    Args:
        state: walking state.
        params: `rolling_step` and `sole_margin`.
        model: length of the sole.

    Returns:
        The positions x of the edges in the frames of the (left, right) sole; 0
        if one may not roll [m].
    """
    schedule = state.schedule
    if (
        schedule.phase is not Phase.TRANSFER
        or not schedule.footsteps
        or state.steps_taken == 0
    ):
        return 0.0, 0.0
    leading = schedule.feet[schedule.support_side]
    trailing = schedule.feet[schedule.support_side.other]
    x, y, _ = (leading.p_WF - trailing.p_WF).tolist()
    ahead = math.cos(trailing.yaw) * x + math.sin(trailing.yaw) * y
    if abs(ahead) <= params.rolling_step:
        return 0.0, 0.0
    edge = 0.5 * model.sole_length - _ROLLING_MARGINS * params.sole_margin
    return _by_side(schedule, 0.0, math.copysign(edge, ahead))


def crossing_turn(
    state: WalkingState, swing: Array, params: CrossingTurnParams
) -> tuple[float, float, float]:
    """The turn of the pelvis when the feet come close, and cross.

        turn = +-max_turn tanh(gain c^2 x / max_turn),

    with + for the left support foot, where x is the distance of the other sole
    in front of the support sole, and their lateral distance is c less than
    `width`.  The turn is as smooth as the swing (see SwingFootPlanner).

    Args:
        state: walking state.
        swing: reference of the swing sole (12,) in W [m, rad, s].
        params: gain, width and largest turn.

    Returns:
        Yaw, yawdot, yawddot relative to the feet's [rad, s].
    """
    schedule = state.schedule
    side = schedule.support_side
    stance = schedule.feet[side]
    if schedule.phase is Phase.SWING:
        p_WF, (vx, vy, _, ax, ay, _) = swing[:3], swing[3:9].tolist()
    else:
        p_WF = schedule.feet[side.other].p_WF
        vx = vy = ax = ay = 0.0
    x, y, _ = (p_WF - stance.p_WF).tolist()
    cos, sin = math.cos(stance.yaw), math.sin(stance.yaw)
    c = side.sign * (cos * y - sin * x) + params.width
    if c <= 0.0:
        return 0.0, 0.0, 0.0
    dc = side.sign * (cos * vy - sin * vx)
    ddc = side.sign * (cos * ay - sin * ax)
    x = cos * x + sin * y
    dx, ddx = cos * vx + sin * vy, cos * ax + sin * ay
    max_turn = math.radians(params.max_turn_deg)
    gain = side.sign * params.gain / max_turn
    du = gain * c * (2.0 * dc * x + c * dx)
    ddu = gain * (
        2.0 * (dc * dc + c * ddc) * x + 4.0 * c * dc * dx + c * c * ddx
    )
    turn = math.tanh(gain * c * c * x)
    slope = max_turn * (1.0 - turn * turn)
    return max_turn * turn, slope * du, slope * (ddu - 2.0 * turn * du * du)


def heading(state: WalkingState, swing: Array) -> tuple[float, float, float]:
    """The mean yaw of both feet, which turns during a swing.

    Args:
        state: walking state.
        swing: reference of the swing sole (12,) in W [m, rad, s].

    Returns:
        Yaw, yawdot, yawddot in W [rad, s].
    """
    schedule = state.schedule
    stance = schedule.feet[schedule.support_side].yaw
    if schedule.phase is Phase.SWING:
        other, rate, acceleration = swing[9:].tolist()
    else:
        other = schedule.feet[schedule.support_side.other].yaw
        rate = acceleration = 0.0
    return (
        stance + 0.5 * math.remainder(other - stance, math.tau),
        0.5 * rate,
        0.5 * acceleration,
    )


def max_normal_forces(
    state: WalkingState, params: WholeBodyQpParams, model: WholeBodyModel
) -> tuple[float, float]:
    """The upper bounds of the normal forces, linear in time in a transfer.

    That of a landed foot rises to the weight in `loading_time` of contact.
    That of the trailing foot falls from the weight in the last part of a
    transfer before a step, unless the transfer waits for the ICP.

    Args:
        state: walking state.
        params: times, and the unloaded force.
        model: mass of the robot.

    Returns:
        The bounds of the (left, right) sole; infinity at all other times [N].
    """
    schedule, weight = state.schedule, model.mass * GRAVITY
    if schedule.phase is not Phase.TRANSFER:
        return math.inf, math.inf
    leading = trailing = math.inf
    if state.steps_taken > 0 and state.contact_time < params.loading_time:
        done = state.contact_time / params.loading_time
        leading = done * weight + (1.0 - done) * params.unloaded_force
    part = params.unloading_fraction * schedule.duration
    remaining = state.remaining_time
    if schedule.footsteps and not state.waiting and remaining < part:
        left = remaining / part
        trailing = left * weight + (1.0 - left) * params.unloaded_force
    return _by_side(schedule, leading, trailing)
