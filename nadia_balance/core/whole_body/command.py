"""Terms and command of the whole-body QP, for a walking state."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.body.model import JointDriveParams
from nadia_balance.core.math.arrays import Array, cross
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Phase, Side, WalkingState
from nadia_balance.core.whole_body.params import CrossingTurnParams
from nadia_balance.core.whole_body.params import WholeBodyQpParams as Params

# Rows of WholeBodyTerms; the joints' rows follow BASE.
SOLES = slice(0, 6), slice(6, 12)  # left, right
BASE = slice(12, 18)
TORSO = slice(-6, -3)
PELVIS = slice(-3, None)
# Distance of the rolling axis from the sole's edge, in sole margins: inside the
# wrench cone, not on its boundary.
_ROLLING_MARGINS = 2.0


@dataclass(frozen=True, eq=False)
class WholeBodyModel:
    """Constants of a robot with nj joints, in the plant's order.

    `mass` [kg]; `posture`, `position_lower`, `position_upper` (nj,) [rad];
    `max_torque` (nj,) [N m]; `max_speed` (nj,) [rad/s]; `is_leg_joint` (nj,);
    sole size [m].  Without `drives`, torques have no speed or rate limits; a
    `max_speed` may be infinite.  `ankles` (2, 3) [m]: the last joint of the
    (left, right) leg, in the frame of the sole.
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
    is_leg_joint: NDArray[np.bool_]
    drives: JointDriveParams | None = None

    @property
    def num_joints(self) -> int:
        """Number of joints, all actuated."""
        return self.posture.size


class Avoidance(NamedTuple):
    """Rows [A, a] (k, nv + 1) of link pairs, with A vdot + a [m/s^2].

    It is >= 0 for `limits`, as a hard limit, and 0 for `braking`, as a soft
    task whose rows are scaled by the root of its weight.
    """

    limits: Array
    braking: Array


class WholeBodyTerms(NamedTuple):
    """Kinematics and dynamics; nv = 6 + nj, v = [w_WB, v_WB, joints].

    The floating base B is the pelvis, its velocity expressed in W.

    `rows` (24 + nj, nv + 1) are [A, a] of the quantities A vdot + a: the
    accelerations of the left and of the right sole ([w, v] at its centre), the
    generalised forces on base and joints, and the angular accelerations of
    torso and pelvis, all in W.  `velocities` (24 + nj,) are A v, those of
    soles, torso and momentum at the time of v if q is ahead of it.  The forces,
    M vdot + bias with gravity and damping, are per unit of the robot's mass.

    `rotations` (4, 3, 3): R_W of left sole, right sole, torso, pelvis.
    `sole_positions` (2, 3) [m] in W; `q` (7 + nj,), the joints last [rad];
    `com_state` (6,) = [p_WC, v_WC] [m, m/s] of the centre of mass.  `avoidance`
    has the rows of near or braking links; None: self-collisions are ignored.
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
        return self.rows[BASE.start : TORSO.start]

    def at_point(self, side: int, arm: Array) -> tuple[Array, Array]:
        """Rows (6, nv + 1) and velocities (6,) of a sole at another point.

        `arm` (3,) [m] in W is from its centre to the point of the foot.
        """
        sole = SOLES[side]
        rows, velocities = self.rows[sole].copy(), self.velocities[sole].copy()
        w, (x, y, z) = velocities[:3].copy(), arm.tolist()
        across = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
        velocities[3:] += across @ w  # w x arm
        rows[3:] += across @ rows[:3]
        rows[3:, -1] += w * (w @ arm) - arm * (w @ w)
        return rows, velocities

    @property
    def angular_momentum(self) -> Array:
        """Angular momentum (3,) about the CoM in W, per unit of mass."""
        p_BC, v = self.com_state[:3] - self.q[4:7], self.com_state[3:]
        return self.velocities[BASE][:3] - cross(p_BC, v)


class WholeBodyCommand(NamedTuple):
    """Desired values of the whole-body QP.

    `momentum_rate` (3,) [N] of the linear momentum in W; `heading` = (yaw,
    yawdot, yawddot) of the torso, and `turn` that of the pelvis relative to it;
    `contacts`: True for each (left, right) sole in contact, at least one is;
    `max_normal_forces` [N] of the soles; `swing` is the reference (12,) [p, v,
    a, yaw, yawdot, yawddot] of the swing sole.  `normals` (2, 3) in W are the
    desired normals of the (left, right) sole; `friction` is the coefficient
    assumed for both.  `edges` [m] are the positions x of the axes about which
    the (left, right) sole may roll; 0: it stays flat.  `flatness` in (0, 1] is
    the share of the weight that the swing sole's orientation has by now.
    `sinking` [m/s] are the velocities at which the (left, right) sole is to
    meet its ground, against the normal; 0: it stands there.
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


def whole_body_command(
    state: WalkingState,
    momentum_rate: Array,
    swing: Array,
    friction: float,
    params: Params,
    model: WholeBodyModel,
) -> WholeBodyCommand:
    """Returns contacts, heading and force bounds of a walking state.

    `momentum_rate` (3,) [N]; `swing` (12,) reference of the swing sole;
    `friction` coefficient to assume.
    """
    of = params, model
    return WholeBodyCommand(
        momentum_rate=momentum_rate,
        heading=heading(state, swing),
        turn=crossing_turn(state, swing, params.crossing_turn),
        contacts=tuple(map(state.schedule.in_contact, Side)),
        max_normal_forces=tuple(max_normal_force(state, s, *of) for s in Side),
        swing=swing,
        normals=sole_normals(state),
        friction=friction,
        edges=tuple(rolling_edge(state, s, *of) for s in Side),
        flatness=flatness(state, params),
        sinking=sinking(state, params),
    )


def sinking(state: WalkingState, params: Params) -> tuple[float, float]:
    """Returns the velocities [m/s] at which the (left, right) sole sinks.

    That is the one which has landed in this transfer, while it measures no
    force: it has left the ground again.
    """
    schedule = state.schedule
    if (
        schedule.phase is not Phase.TRANSFER
        or state.steps_taken == 0
        or state.contact_time > 0.0
    ):
        return 0.0, 0.0
    speed = params.sinking_velocity
    if schedule.support_side is Side.LEFT:
        return speed, 0.0
    return 0.0, speed


def sole_normals(state: WalkingState) -> Array:
    """Returns the desired normals (2, 3) of the (left, right) sole in W.

    The normal of a swing foot turns from the ground at lift-off to that at the
    foothold, by a cubic in time.
    """
    schedule = state.schedule
    normals = [schedule.feet[side].normal for side in Side]
    if schedule.phase is Phase.SWING:
        step = schedule.footsteps[0]
        i = list(Side).index(step.side)
        s = state.time_in_phase / schedule.duration
        n = normals[i] + s * s * (3.0 - 2.0 * s) * (
            step.pose.normal - normals[i]
        )
        normals[i] = n / math.hypot(*n.tolist())
    return np.array(normals)


def flatness(state: WalkingState, params: Params) -> float:
    """Returns the share of its weight that the swing sole's orientation has.

    It rises by a cubic from `swing_early_share` to 1 in the last
    `swing_flat_time` of the swing: only a landing sole has to be flat.  Before,
    the ankle of a trailing leg is at its limit, and a flat sole costs momentum.
    """
    s = 1.0 - state.remaining_time / params.swing_flat_time
    s, early = min(max(s, 0.0), 1.0), params.swing_early_share
    return early + (1.0 - early) * s * s * (3.0 - 2.0 * s)


def rolling_edge(
    state: WalkingState, side: Side, params: Params, model: WholeBodyModel
) -> float:
    """Returns x [m] of the edge about which the sole may roll; 0 if none.

    The trailing foot rolls in the transfer of a long step, over the toes if the
    step is forward, over the heel if it is backward: its leg reaches its full
    length, and with a flat sole the knee would straighten at once.
    """
    schedule = state.schedule
    if (
        schedule.phase is not Phase.TRANSFER
        or side is schedule.support_side
        or not schedule.footsteps
        or state.steps_taken == 0
    ):
        return 0.0
    foot, other = schedule.feet[side], schedule.feet[side.other]
    ahead = float(foot.to_sole(other.p_WF[None, :2])[0, 0])
    if abs(ahead) <= params.rolling_step:
        return 0.0
    edge = 0.5 * model.sole_length - _ROLLING_MARGINS * params.sole_margin
    return math.copysign(edge, ahead)


def crossing_turn(
    state: WalkingState, swing: Array, params: CrossingTurnParams
) -> tuple[float, float, float]:
    """Returns the pelvis' yaw, yawdot, yawddot relative to the feet's [rad].

    turn = +-max tanh(gain c^2 x / max), + for the left support foot, where x
    is the distance of the other sole in front of the support sole, and their
    lateral distance is c less than `width`.  `swing` (12,) is the reference of
    the swing sole (see SwingFootPlanner): the turn is as smooth as the swing.
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
    slope = most * (1.0 - turn * turn)
    return most * turn, slope * du, slope * (ddu - 2.0 * turn * du * du)


def heading(state: WalkingState, swing: Array) -> tuple[float, float, float]:
    """Mean yaw, yawdot, yawddot of both feet [rad]; turns during a swing."""
    schedule = state.schedule
    stance = schedule.feet[schedule.support_side].yaw
    if schedule.phase is Phase.SWING:
        other, rate, acceleration = swing[9:].tolist()
    else:
        other = schedule.feet[schedule.support_side.other].yaw
        rate = acceleration = 0.0
    difference = math.remainder(other - stance, math.tau)
    return stance + 0.5 * difference, 0.5 * rate, 0.5 * acceleration


def max_normal_force(
    state: WalkingState, side: Side, params: Params, model: WholeBodyModel
) -> float:
    """Upper bound [N] of a sole's normal force, linear in time in a transfer.

    That of a landed foot rises to the weight in `loading_time` of contact.
    That of the trailing foot falls from the weight in the last part of a
    transfer before a step, unless the transfer waits for the ICP.
    """
    schedule, weight = state.schedule, model.mass * GRAVITY
    if (
        schedule.phase is Phase.TRANSFER
        and side is schedule.support_side
        and state.steps_taken > 0
        and state.contact_time < params.loading_time
    ):
        done = state.contact_time / params.loading_time
        return done * weight + (1.0 - done) * params.unloaded_force
    unloads = (
        schedule.phase is Phase.TRANSFER
        and side is not schedule.support_side
        and bool(schedule.footsteps)
        and not state.waiting
    )
    part = params.unloading_fraction * schedule.duration
    if not unloads or state.remaining_time >= part:
        return math.inf
    left = state.remaining_time / part
    return left * weight + (1.0 - left) * params.unloaded_force
