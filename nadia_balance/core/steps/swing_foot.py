"""The swing foot's reference, continuous for any change of goal and clock.

Each tick continues from the previous reference with the quintic polynomial
that reaches the goal in the remaining time.  While goal and clock do not
change, it is the same polynomial as before; when they do, position, velocity
and acceleration are still continuous.  Via points, the apex and the corners of
the stance foot, are dropped shortly before they are passed.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.swing_detour import PEAK, SwingEdges
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import FootPose, Phase, WalkingState
from nadia_balance.parameters.bounds import bounded

XY, Z, YAW = slice(2), slice(2, 3), 3

STEP = 0.002  # spacing of the candidate times of a via point [s]

# Factor by which the remaining time is stretched, and the largest number of
# times, until the acceleration is at most PEAK times `max_acceleration` [-].
_STRETCH, _STRETCHES = 1.1, 8
_CHECKED = np.linspace(0.1, 1.0, 10)[:, None]  # shares of the time

_SINKING = 0.04  # horizon of the way to the touchdown velocity [s]
_GENTLE = 2.0 / 3.0  # share of the largest deceleration in a planned descent
_TO_SPARE = 1.5  # ratio of the times to land and to sink that lifts a foot [-]
_SOON = 0.02  # via points closer in time than this are dropped [s]


@dataclass(kw_only=True)
class SwingFootParams:
    """Shape of the swing."""

    # Height of the apex above the higher of start and goal.
    height: float = bounded(0.10, above=0.0, most=0.5, unit="m")
    # Clearance above edges of uneven ground.
    clearance: float = bounded(0.03, least=0.0, most=0.2, unit="m")
    # Apex for uncrossing legs, lower so that the knee clears the other shin.
    uncrossing_height: float = bounded(0.06, above=0.0, most=0.5, unit="m")
    # Remaining time below which the apex is lowered.
    fall_time: float = bounded(0.175, above=0.0, unit="s")
    # Horizontal distance to the foothold within which the foot may descend.
    descent_radius: float = bounded(0.01, least=0.0, unit="m")
    # Downward velocity at the end of the swing and after it.
    touchdown_velocity: float = bounded(0.20, least=0.0, most=1.0, unit="m/s")


def at_rest(pose: FootPose) -> Array:
    """Returns the motion (3, 4) of a foot at rest at `pose`.

    Rows p, v, a of [x, y, z, yaw] of the sole in W.
    """
    motion = np.zeros((3, 4))
    motion[0] = *pose.p_WF, pose.yaw
    return motion


def as_reference(motion: Array, lead: float) -> Array:
    """Returns [p(3), v(3), a(3), yaw, yawdot, yawddot] in W, shape (12,).

    The `motion` (3, 4) is `lead` [s] ahead; the velocities are the present
    ones, as of the robot only positions are predicted (see StatePredictor).
    """
    now = motion.copy()
    now[1] -= lead * motion[2]
    return np.append(now[:, :3], now[:, 3])


@dataclass(frozen=True, eq=False)
class SwingFoot:
    """The swing foot, each `period` [s], for drives with a lag `lead` [s]."""

    params: SwingFootParams
    model: PointMassModel
    period: float
    lead: float = 0.0

    def motion(
        self,
        previous: Array,
        state: WalkingState,
        edges: SwingEdges | None = None,
    ) -> tuple[Array, Array]:
        """Returns the motion (3, 4) of the swing foot one `period` [s] later.

        Motions are rows p, v, a of [x, y, z, yaw] in W.  The second result is
        the motion another `lead` [s] later.  `previous` is the motion of the
        last tick, `state` the walking state of this one.  Outside of a swing,
        the next swing foot is at rest.  A foot that cannot reach its foothold
        in time lands later; after the end of the swing's clock it sinks with
        the touchdown velocity.  It passes above any `edges` on its path.
        """
        schedule = state.schedule
        side = schedule.support_side.other
        if schedule.phase is not Phase.SWING or state.time_in_phase <= 0.0:
            return (at_rest(schedule.feet[side]),) * 2
        end, horizon = self._course(previous, state, edges)
        now, ahead = self.period, self.period + self.lead
        way = previous, end, horizon
        return quintic_at(*way, now), quintic_at(*way, ahead)

    def _course(
        self, start: Array, state: WalkingState, edges: SwingEdges | None
    ) -> tuple[Array, Array]:
        """Returns the end (3, 4) of the quintic from `start`, and times (4,).

        The times [s] are those from start to end of x, y, z and yaw.
        """
        schedule, detour = state.schedule, self.model.detour
        goal, stance = schedule.footsteps[0].pose, schedule.support_side
        end = np.zeros((3, 4))
        turn = math.remainder(goal.yaw - start[0, YAW], math.tau)
        end[0] = *goal.p_WF, start[0, YAW] + turn
        end[1, Z] = -self.params.touchdown_velocity
        height = float(start[0, 2] - end[0, 2])
        left = state.remaining_time + (_SOON if state.waiting else self.period)
        # The horizontal motion ends before the vertical one.
        drop = edges.drop if edges else 0.0
        settling = max(detour.settling, drop / detour.max_descent)
        over = max(left - settling, min(left, 2.0 * detour.settling))
        way = detour.way_round(
            start[0, XY], goal.p_WF[:2], schedule.feet[stance], stance.other
        )
        end[:, XY], over = self._within_limits(start[:, XY], way, over)
        radius = self.params.descent_radius
        arrived = math.dist(start[0, XY], goal.p_WF[:2]) < radius
        left = max(left, over if arrived else over + settling)
        descent = -float(start[1, 2])
        left = max(left, height / detour.max_descent)
        left = max(left, self._time_to_descend(height, descent))
        braking = self._time_to_brake(height, descent)
        left = braking or left
        # With constant deceleration, but for the tick that lands.
        if braking > self.period + self.lead:
            end[2, Z] = -(start[1, Z] - end[1, Z]) / braking
        ground = float(end[0, 2]) if edges is None else edges.top
        landing = end[:, Z].copy()
        apex = None
        if not self._sinks(height, descent, left):
            apex = self._apex(float(start[0, 2]), ground, left, state)
        if apex is not None:
            vertical = start[:, Z], landing, left, apex
            if t := _time_past(*vertical):
                end[:, Z] = end_beyond(*vertical, t)
        if edges and edges.are_in_the_way(start[0, :3]):
            end[:, XY] = start[0, XY], (0.0, 0.0), (0.0, 0.0)
        elif edges:
            end[:, Z] = _over_edges(start, end, landing, over, left, edges)
        # The clock may run out before the descent to a foothold down a step.
        low = arrived and (edges is None or height < radius)
        if state.waiting and low and not braking:  # sink until contact
            left, slow = _SINKING, self.params.touchdown_velocity
            mean = 0.5 * (float(start[1, 2]) - slow)
            end[:, 2] = start[0, 2] + mean * left, -slow, 0.0
        return end, np.array([over, over, left, over])

    def _time_to_descend(self, height: float, descent: float) -> float:
        """Returns the least time [s] to touchdown from a `height` [m].

        The foot, which descends at `descent` [m/s], accelerates and brakes to
        the touchdown velocity, with `_GENTLE` of the largest deceleration: the
        quintic has a higher peak.  0 for a foot that rises.
        """
        if height <= 0.0 or descent <= 0.0:
            return 0.0
        slow = self.params.touchdown_velocity
        a = _GENTLE * self.model.detour.max_braking
        fastest = math.sqrt(a * height + 0.5 * (descent**2 + slow**2))
        if fastest <= max(descent, slow):
            return 2.0 * height / (descent + slow)
        return (2.0 * fastest - descent - slow) / a

    def _time_to_brake(self, height: float, descent: float) -> float:
        """Returns the time [s] to touchdown of a foot that has to brake now.

        The foot descends at `descent` [m/s] from a `height` [m] with a constant
        deceleration to the touchdown velocity.  0 if it need not brake yet.
        """
        slow = self.params.touchdown_velocity
        if height <= 0.0 or descent <= slow:
            return 0.0
        braking = self.model.detour.max_braking
        brakes = descent**2 - slow**2 >= 2.0 * braking * height
        return 2.0 * height / (descent + slow) if brakes else 0.0

    def _within_limits(
        self, start: Array, way: Array, left: float
    ) -> tuple[Array, float]:
        """Returns the end (3, 2) of the quintic, and its time >= `left` [s].

        The quintic follows `way` (n, 2) past its first corner, if possible with
        at most PEAK times `max_acceleration` on the whole way.
        """
        end = np.zeros((3, 2))
        end[0] = way[-1]
        detour = self.model.detour
        needed = detour.shortest_time(way, start[1])
        left = max(left, needed)
        most = PEAK * detour.max_acceleration
        for _ in range(_STRETCHES):
            aim, t = end, 0.0
            if len(way) > 2 and (t := _time_past(start, end, left, way[1])):
                aim = end_beyond(start, end, left, way[1], t)
            if left > _STRETCH**_STRETCHES * needed:
                break
            times = left * _CHECKED
            a = quintic(start, aim, np.full(2, left), times)[2]
            # Behind the corner, the fifth derivative is another.
            late = np.maximum(times - t, 0.0)
            a -= 20.0 * (aim[0] - end[0]) * late**3 / (left - t) ** 5
            if np.max(np.hypot(*a.T)) <= most:
                break
            left *= _STRETCH
        return aim, left

    def _sinks(self, height: float, descent: float, left: float) -> bool:
        """True for a foot that descends to land in the time `left` [s].

        One that would be down from its `height` [m] long before is lifted.
        """
        mean = 0.5 * (descent + self.params.touchdown_velocity)
        return descent > 0.0 and left * mean < _TO_SPARE * height

    def _apex(
        self, z: float, ground: float, left: float, state: WalkingState
    ) -> Array | None:
        """Returns the apex (1,) [m]; None if a foot at `z` [m] is above it."""
        schedule, params = state.schedule, self.params
        lift_off = schedule.feet[schedule.support_side.other].p_WF[2]
        height = params.height
        if schedule.legs_crossed:
            height = min(height, params.uncrossing_height)
        height *= min(1.0, (left / params.fall_time) ** 2)
        apex = max(lift_off, ground) + height
        return np.array([apex]) if z < apex else None


def _time_past(start: Array, end: Array, left: float, via: Array) -> float:
    """Returns the time [s] to pass `via` (n,); 0 if too soon or too late."""
    if left < 2.0 * _SOON:
        return 0.0
    t = time_to_pass(start, end, left, via)
    return 0.0 if min(t, left - t) < _SOON else t


def _over_edges(
    start: Array,
    end: Array,
    landing: Array,
    over: float,
    left: float,
    edges: SwingEdges,
) -> Array:
    """Returns the end (3, 1) of the quintic in z that passes over the `edges`.

    It is that of `end` (3, 4) unless the sole would collide with an edge: then
    the quintic to `landing` (3, 1) clears the point of deepest penetration.
    """
    times = _CHECKED[:-1] * min(over, left)
    xy = quintic(start[:, XY], end[:, XY], np.full(2, over), times)[0]
    z = quintic(start[:, Z], end[:, Z], np.full(1, left), times)[0]
    short = edges.needed(xy) - z[:, 0]
    worst = int(short.argmax())
    t = float(times[worst, 0])
    if short[worst] <= 0.0 or min(t, left - t) < _SOON:
        return end[:, Z]
    via = z[worst] + short[worst]
    return end_beyond(start[:, Z], landing, left, via, t)


def quintic(start: Array, end: Array, horizon: Array, t: Array) -> Array:
    """Returns the quintic from `start` to `end` at the times `t` [s].

    `start`, `end`, result: rows p, v, a, shape (3, n); `horizon` (n,) [s] is
    the time from start to end of each column, >= t > 0.  The result is
    (3, k, n) for k times of shape (k, 1).
    """
    return np.array(_follow(start, end, horizon, t))


def quintic_at(start: Array, end: Array, horizon: Array, t: float) -> Array:
    """Returns `quintic` at one time, six times as fast for few columns.

    Columns whose horizon is before `t` are at their end.
    """
    parts = zip(start.T.tolist(), end.T.tolist(), horizon.tolist(), strict=True)
    return np.array([_follow(a, b, h, min(t, h)) for a, b, h in parts]).T


def _follow(start: Any, end: Any, h: Any, t: Any) -> tuple[Any, Any, Any]:
    """Returns p, v, a of the quintic, for numbers or arrays."""
    (p, v, a0), (p1, v1, a1) = start, end
    v, a0, v1, a1 = v * h, a0 * h * h, v1 * h, a1 * h * h
    a = 0.5 * a0
    gap, dv, da = p1 - p - v - a, v1 - v - a0, a1 - a0
    # p, v, a and c3 to c5 are the coefficients of the powers 0 to 5 of t / h.
    c3 = 10.0 * gap - 4.0 * dv + 0.5 * da
    c4 = -15.0 * gap + 7.0 * dv - da
    c5 = 6.0 * gap - 3.0 * dv + 0.5 * da
    s = t / h
    return (
        p + s * (v + s * (a + s * (c3 + s * (c4 + s * c5)))),
        (v + s * (2 * a + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
        (2 * a + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h),
    )


def end_beyond(
    start: Array, end: Array, horizon: float, via: Array, t: float
) -> Array:
    """Returns the end (3, n) of the quintic that passes `via` (n,) at `t`.

    Until `t` in (0, horizon) [s], it is the minimum jerk motion from `start` by
    via to `end`, both (3, n), whose fifth derivative jumps at `t`.
    """
    h = horizon - t
    kink = np.array([[1.0], [5.0 / h], [20.0 / (h * h)]])
    times = np.full(via.size, horizon)
    missed = via - quintic_at(start, end, times, t)[0]
    moved = quintic_at(np.zeros((3, 1)), kink, times[:1], t)[0]
    return np.asarray(end + kink * (missed / moved))


def time_to_pass(start: Array, end: Array, horizon: float, via: Array) -> float:
    """Returns the time [s] to pass `via` (n,) with the least jerk.

    Candidates are multiples of `STEP` before `horizon` [s] > STEP, the same in
    every tick.  The jerk cost of passing via at t is proportional to the
    squared distance of the quintic from via, over (t (horizon - t))^5.
    """
    before_end = np.arange(STEP, horizon - 1e-9, STEP)
    t = horizon - before_end
    missed = np.zeros_like(t)
    columns = zip(start.T.tolist(), end.T.tolist(), via.tolist(), strict=True)
    for begin, finish, point in columns:
        way, _, _ = _follow(begin, finish, horizon, t)
        missed += (point - way) * (point - way)
    flat = t * before_end
    cost = missed / (flat * flat * flat * flat * flat)
    return float(t[cost.argmin()])
