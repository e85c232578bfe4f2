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
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    Mode,
    Phase,
    WalkingState,
)
from nadia_balance.parameters.bounds import bounded, parameters

XY, Z, YAW = slice(2), slice(2, 3), 3

STEP = 0.002  # spacing of the candidate times of a via point [s]

# Factor by which the remaining time is stretched, and the largest number of
# times, until the acceleration is at most PEAK times `max_acceleration` [-].
_STRETCH, _STRETCHES = 1.1, 8
_CHECKED = np.linspace(0.1, 1.0, 10)[:, None]  # shares of the time
_SHARES = _CHECKED[:, 0].tolist()  # the same

# Horizon of the way to the touchdown velocity, from each tick on: all but 5 %
# of it takes four times as long.  With half of it, feet landed while they still
# moved along the ground [s].
_SINKING = 0.04
_GENTLE = 2.0 / 3.0  # share of the largest deceleration in a planned descent
_TO_SPARE = 1.5  # ratio of the times to land and to sink that lifts a foot [-]
_SOON = 0.02  # via points closer in time than this are dropped [s]


@parameters
class SwingFootParams:
    """Shape of the swing."""

    height: float = bounded(
        0.10,
        doc="height of the apex above the higher of start and goal",
        above=0.0,
        most=0.5,
        unit="m",
    )
    clearance: float = bounded(
        0.03,
        doc="clearance above edges of uneven ground",
        least=0.0,
        most=0.2,
        unit="m",
    )
    uncrossing_height: float = bounded(
        0.06,
        doc="apex for uncrossing legs, lower so that the knee clears the "
        "other shin",
        above=0.0,
        most=0.5,
        unit="m",
    )
    fall_time: float = bounded(
        0.175,
        doc="remaining time below which the apex is lowered",
        above=0.0,
        unit="s",
    )
    descent_radius: float = bounded(
        0.01,
        doc="horizontal distance to the foothold within which the foot may "
        "descend",
        least=0.0,
        unit="m",
    )
    touchdown_velocity: float = bounded(
        0.2,
        doc="downward velocity at the end of the swing and after it",
        least=0.0,
        most=1.0,
        unit="m/s",
    )
    recovery_touchdown_velocity: float = bounded(
        0.35,
        doc="the same of a step that has to catch the robot, and must not be "
        "late",
        least=0.0,
        most=1.0,
        unit="m/s",
    )


def at_rest(pose: FootPose) -> Array:
    """The motion of a foot at rest.

    Args:
        pose: of the sole in W.

    Returns:
        Rows p, v, a of [x, y, z, yaw] in W (3, 4) [m, rad, s].
    """
    motion = np.zeros((3, 4))
    motion[0, :YAW], motion[0, YAW] = pose.p_WF, pose.yaw
    return motion


def as_reference(motion: Array, lead: float) -> Array:
    """The reference of the swing foot, as the whole-body QP reads it.

    The velocities are the present ones, as of the robot only positions are
    predicted (see StatePredictor).

    Args:
        motion: rows p, v, a of [x, y, z, yaw] in W (3, 4), `lead` ahead.
        lead: time of the prediction [s].

    Returns:
        [p(3), v(3), a(3), yaw, yawdot, yawddot] in W (12,) [m, rad, s].
    """
    now = motion.copy()
    now[1] -= lead * motion[2]
    reference = np.empty(12)
    reference[:9], reference[9:] = now[:, :YAW].ravel(), now[:, YAW]
    return reference


@dataclass(frozen=True, eq=False)
class SwingFoot:
    """The swing foot, tick by tick.

    Args:
        params: shape of the swing.
        model: limits of the foot's motion, and its path past the stance leg.
        period: of a tick [s].
        lead: lag of the drives [s].
    """

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
        """The motion of the swing foot one `period` later.

        Outside of a swing, the next swing foot is at rest.  A foot that cannot
        reach its foothold in time lands later; after the end of the swing's
        clock it sinks with the touchdown velocity.

        Args:
            previous: motion of the last tick (3, 4): rows p, v, a of
                [x, y, z, yaw] in W [m, rad, s].
            state: walking state of this tick.
            edges: edges on the path, which the foot passes above.

        Returns:
            The motion (3, 4), and the motion another `lead` later.
        """
        schedule = state.schedule
        if schedule.phase is not Phase.SWING or state.time_in_phase <= 0.0:
            resting = at_rest(schedule.feet[schedule.support_side.other])
            return resting, resting
        columns = _quintics(previous, *self._course(previous, state, edges))
        return (
            _motion_at(columns, self.period),
            _motion_at(columns, self.period + self.lead),
        )

    def _course(
        self, start: Array, state: WalkingState, edges: SwingEdges | None
    ) -> tuple[Array, Array]:
        """Returns the end (3, 4) of the quintic from `start`, and times (4,).

        The times [s] are those from start to end of x, y, z and yaw.
        """
        detour, goal = self.model.detour, state.schedule.footsteps[0].pose
        turn = math.remainder(goal.yaw - start[0, YAW], math.tau)
        end = np.zeros((3, 4))
        end[0] = *goal.p_WF, start[0, YAW] + turn
        end[1, Z] = -self._landing_speed(state)
        left = state.remaining_time + (_SOON if state.waiting else self.period)
        # The horizontal motion ends before the vertical one.
        drop = edges.drop if edges else 0.0
        settling = max(detour.settling, drop / detour.max_descent)
        end[:, XY], over = self._over_ground(
            start[:, XY],
            schedule=state.schedule,
            left=max(left - settling, min(left, 2.0 * detour.settling)),
        )
        radius = self.params.descent_radius
        arrived = math.dist(start[0, XY], goal.p_WF[:2]) < radius
        landing, down, brakes = self._landing(
            start[:, Z],
            end=end[:, Z].copy(),
            left=max(left, over if arrived else over + settling),
        )
        # The clock may run out before the descent to a foothold down a step.
        low = arrived and (edges is None or start[0, 2] - goal.p_WF[2] < radius)
        held = edges is not None and edges.are_in_the_way(start[0, :3])
        if state.waiting and low and not brakes:  # sink until contact
            down = _SINKING
            speed = 0.5 * (end[1, Z] + start[1, Z])
            end[0, Z] = start[0, Z] + speed * down
        else:
            end[:, Z] = self._lifted(start, landing, down, state, edges)
            if edges and not held:
                end[:, Z] = _over_edges(
                    start=start,
                    end=end,
                    landing=landing,
                    over=over,
                    left=down,
                    edges=edges,
                )
        if held:
            end[:, XY] = start[0, XY], (0.0, 0.0), (0.0, 0.0)
        return end, np.array([over, over, down, over])

    def _landing(
        self, start: Array, end: Array, left: float
    ) -> tuple[Array, float, bool]:
        """Returns the end (3, 1) in z, its time [s], and whether it brakes.

        A foot that has to brake now does so with constant deceleration, but for
        the tick that lands; others come at the time `left` [s], or later if
        they cannot come then.
        """
        height = float(start[0, 0] - end[0, 0])
        descent, landing_speed = -float(start[1, 0]), -float(end[1, 0])
        braking = self._time_to_brake(height, descent, landing_speed)
        if braking > self.period + self.lead:
            end[2] = -(start[1] - end[1]) / braking
        soonest = max(
            height / self.model.detour.max_descent,
            self._time_to_descend(height, descent, landing_speed),
        )
        return end, braking or max(left, soonest), braking > 0.0

    def _landing_speed(self, state: WalkingState) -> float:
        """Returns the speed [m/s] at which the foot comes down."""
        if state.mode is Mode.RECOVERING:
            return self.params.recovery_touchdown_velocity
        return self.params.touchdown_velocity

    def _time_to_descend(
        self, height: float, descent: float, landing_speed: float
    ) -> float:
        """Returns the least time [s] to touchdown from a `height` [m].

        The foot, which descends at `descent` [m/s], accelerates and brakes to
        `landing_speed` [m/s], with `_GENTLE` of the largest deceleration: the
        quintic has a higher peak.  0 for a foot that rises.
        """
        if height <= 0.0 or descent <= 0.0:
            return 0.0
        a = _GENTLE * self.model.detour.max_braking
        fastest = math.sqrt(a * height + 0.5 * (descent**2 + landing_speed**2))
        if fastest <= max(descent, landing_speed):
            return 2.0 * height / (descent + landing_speed)
        return (2.0 * fastest - descent - landing_speed) / a

    def _time_to_brake(
        self, height: float, descent: float, landing_speed: float
    ) -> float:
        """Returns the time [s] to touchdown of a foot that has to brake now.

        The foot descends at `descent` [m/s] from a `height` [m] with a constant
        deceleration to `landing_speed` [m/s].  0 if it need not brake yet.
        """
        room = 2.0 * self.model.detour.max_braking * height
        if (
            height <= 0.0
            or descent <= landing_speed
            or descent**2 - landing_speed**2 < room
        ):
            return 0.0
        return 2.0 * height / (descent + landing_speed)

    def _over_ground(
        self, start: Array, schedule: ContactSchedule, left: float
    ) -> tuple[Array, float]:
        """Returns the end (3, 2) of the quintic, and its time >= `left` [s].

        The quintic passes the first corner of the way round the stance leg, if
        possible with at most PEAK times `max_acceleration` on the whole way.
        """
        path = self.model.detour.way_round(
            start=start[0],
            goal=schedule.footsteps[0].pose.p_WF[:2],
            stance=schedule.feet[schedule.support_side],
            swing=schedule.support_side.other,
        )
        end = np.zeros((3, 2))
        end[0] = path[-1]
        needed = self.model.detour.shortest_time(path, start[1])
        left = max(left, needed)
        for _ in range(_STRETCHES):
            aim, t = end, 0.0
            if len(path) > 2:
                aim, t = _past(start, end, left=left, via=path[1])
            if left > _STRETCH**_STRETCHES * needed:
                break
            largest = _largest_acceleration(start, aim, left, t=t, end=end)
            if largest <= PEAK * self.model.detour.max_acceleration:
                break
            left *= _STRETCH
        return aim, left

    def _lifted(
        self,
        start: Array,
        landing: Array,
        left: float,
        state: WalkingState,
        edges: SwingEdges | None,
    ) -> Array:
        """Returns the end (3, 1) of the quintic in z past the apex.

        It is `landing` (3, 1) if the foot is above the apex, or sinks.
        """
        if _sinks(start[:, Z], landing, left):
            return landing
        schedule = state.schedule
        height = self.params.height
        if schedule.legs_crossed:
            height = min(height, self.params.uncrossing_height)
        height *= min(1.0, (left / self.params.fall_time) ** 2)
        lift_off = schedule.feet[schedule.support_side.other].p_WF[2]
        ground = float(landing[0, 0]) if edges is None else edges.top
        via = np.array([max(lift_off, ground) + height])
        if start[0, 2] >= via[0]:
            return landing
        return _past(start[:, Z], landing, left=left, via=via)[0]


def _sinks(start: Array, landing: Array, left: float) -> bool:
    """True for a foot that is not down long before the time `left` [s].

    At the mean of the speeds at its `start` (3, 1) and its `landing` (3, 1).
    """
    height = float(start[0, 0] - landing[0, 0])
    descent = -float(start[1, 0])
    distance = 0.5 * (descent - float(landing[1, 0])) * left
    return descent > 0.0 and distance < _TO_SPARE * height


def _past(
    start: Array, end: Array, left: float, via: Array
) -> tuple[Array, float]:
    """Returns the end (3, n) of the quintic past `via` (n,), and its time [s].

    It is `end`, and the time is 0, if that would be too soon or too late.
    """
    if left < 2.0 * _SOON:
        return end, 0.0
    t = time_to_pass(start, end, horizon=left, via=via)
    if min(t, left - t) < _SOON:
        return end, 0.0
    return end_beyond(start, end, horizon=left, via=via, t=t), t


def _largest_acceleration(
    start: Array, aim: Array, left: float, t: float, end: Array
) -> float:
    """Returns the largest acceleration [m/s^2] on the way from `start`.

    Until the time `t` [s] of a corner it is the quintic to `aim` (3, 2); after
    it, to `end` (3, 2), the fifth derivative is another.
    """
    x, y = _quintics(start, aim, np.full(2, left))
    jump_x, jump_y = (20.0 * (aim[0] - end[0]) / (left - t) ** 5).tolist()
    times = [share * left for share in _SHARES]
    return max(
        math.hypot(
            _follow(x, time)[2] - jump_x * max(time - t, 0.0) ** 3,
            _follow(y, time)[2] - jump_y * max(time - t, 0.0) ** 3,
        )
        for time in times
    )


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
    xy = quintic(start[:, XY], end[:, XY], horizon=np.full(2, over), t=times)[0]
    z = quintic(start[:, Z], end[:, Z], horizon=np.full(1, left), t=times)[0]
    short = edges.needed(xy) - z[:, 0]
    worst = int(short.argmax())
    t = float(times[worst, 0])
    if short[worst] <= 0.0 or min(t, left - t) < _SOON:
        return end[:, Z]
    return end_beyond(
        start[:, Z], landing, horizon=left, via=z[worst] + short[worst], t=t
    )


def quintic(start: Array, end: Array, horizon: Array, t: Array) -> Array:
    """The quintic polynomial between two motions, at times `t`.

    Args:
        start: rows p, v, a at time 0 (3, n) [m, s].
        end: rows p, v, a at the `horizon` (3, n) [m, s].
        horizon: time from start to end of each column (n,) [s].
        t: times in (0, horizon], one or (k, 1) [s].

    Returns:
        Rows p, v, a (3, n), or (3, k, n) for k times [m, s].
    """
    return np.array(_follow(_quintic(start, end, horizon), t))


# Horizon h and coefficients of p + v s + a s^2 + c3 s^3 + c4 s^4 + c5 s^5 with
# s = t / h, as numbers or arrays.
_Quintic = tuple[Any, Any, Any, Any, Any, Any, Any]


def _quintic(start: Any, end: Any, h: Any) -> _Quintic:
    """Returns the quintic of p, v, a at both ends, for numbers or arrays."""
    (p, v, a0), (p1, v1, a1) = start, end
    v, a0, v1, a1 = v * h, a0 * h * h, v1 * h, a1 * h * h
    a = 0.5 * a0
    gap, dv, da = p1 - p - v - a, v1 - v - a0, a1 - a0
    c3 = 10.0 * gap - 4.0 * dv + 0.5 * da
    c4 = -15.0 * gap + 7.0 * dv - da
    c5 = 6.0 * gap - 3.0 * dv + 0.5 * da
    return h, p, v, a, c3, c4, c5


def _quintics(start: Array, end: Array, horizon: Array) -> list[_Quintic]:
    """Returns the quintics of n columns (3, n), as numbers."""
    return [
        _quintic(begin, finish, h)
        for begin, finish, h in zip(
            start.T.tolist(), end.T.tolist(), horizon.tolist(), strict=True
        )
    ]


def _motion_at(columns: list[_Quintic], t: float) -> Array:
    """Returns rows p, v, a (3, n), or those at the end of a shorter horizon."""
    return np.array(
        [_follow(column, min(t, column[0])) for column in columns]
    ).T


def _position(quintic: _Quintic, t: Any) -> Any:
    """Returns p of the quintic at the time, or times, `t`."""
    h, p, v, a, c3, c4, c5 = quintic
    s = t / h
    return p + s * (v + s * (a + s * (c3 + s * (c4 + s * c5))))


def _follow(quintic: _Quintic, t: Any) -> tuple[Any, Any, Any]:
    """Returns p, v, a of the quintic at the time, or times, `t`."""
    h, _, v, a, c3, c4, c5 = quintic
    s = t / h
    return (
        _position(quintic, t),
        (v + s * (2 * a + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
        (2 * a + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h),
    )


def end_beyond(
    start: Array, end: Array, horizon: float, via: Array, t: float
) -> Array:
    """The end of the quintic from `start` that passes `via` at time `t`.

    Until `t`, it is the minimum jerk motion from `start` by `via` to `end`,
    whose fifth derivative jumps at `t`.

    Args:
        start: rows p, v, a at time 0 (3, n) [m, s].
        end: rows p, v, a at the `horizon` (3, n) [m, s].
        horizon: time from start to end [s].
        via: point to pass (n,) [m].
        t: time of passing in (0, horizon) [s].

    Returns:
        Rows p, v, a at the `horizon` (3, n) [m, s].
    """
    h = horizon - t
    kink = np.array([[1.0], [5.0 / h], [20.0 / (h * h)]])
    columns = _quintics(start, end, np.full(via.size, horizon))
    missed = via - [_position(column, t) for column in columns]
    of_kink = _quintic((0.0, 0.0, 0.0), kink[:, 0].tolist(), horizon)
    return np.asarray(end + kink * (missed / _position(of_kink, t)))


def time_to_pass(start: Array, end: Array, horizon: float, via: Array) -> float:
    """The time to pass `via` with the least jerk.

        minimise |via - quintic(t)|^2 / (t (horizon - t))^5 over t,

    to which the jerk cost of passing via at t is proportional.  Candidates are
    multiples of `STEP` before the horizon, the same in every tick.

    Args:
        start: rows p, v, a at time 0 (3, n) [m, s].
        end: rows p, v, a at the `horizon` (3, n) [m, s].
        horizon: time from start to end > `STEP` [s].
        via: point to pass (n,) [m].

    Returns:
        The time [s].
    """
    before_end = np.arange(STEP, horizon - 1e-9, STEP)
    t = horizon - before_end
    missed = np.zeros_like(t)
    columns = _quintics(start, end, np.full(via.size, horizon))
    for column, point in zip(columns, via.tolist(), strict=True):
        gap = point - _position(column, t)
        missed += gap * gap
    flat = t * before_end
    return float(t[(missed / (flat * flat * flat * flat * flat)).argmin()])
