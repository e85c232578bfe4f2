"""The ICP plan: what the ICP, CoM and CoP do until the robot is at rest."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.cop_waypoints import (
    CopWaypointParams,
    CopWaypoints,
    cop_waypoints,
)
from nadia_balance.core.lipm import icp
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    Immutable,
    Phase,
    ReferencePoint,
    WalkingState,
)


def rows_at(t: float, duration: float, omega: float) -> Array:
    """Returns what turns c0..c5 into CoM, ICP and eCMP at `t` [s]: (3, 6)."""
    u = 1.0 / omega
    grow, decay = math.exp(omega * (t - duration)), math.exp(-omega * t)
    t2, t3 = t * t, t * t * t
    return np.array(
        [
            [grow, decay, t3, t2, t, 1.0],
            [2.0 * grow, 0.0, t3 + 3.0 * u * t2, t2 + 2.0 * u * t, t + u, 1.0],
            [0.0, 0.0, t3 - 6.0 * u * u * t, t2 - 2.0 * u * u, t, 1.0],
        ]
    )


def solve_segments(
    durations: Array, ecmp: Array, com_start: Array, omega: float
) -> Array:
    """Returns the coefficients (N, 6, k) of N segments with a linear eCMP.

    They meet the 6N conditions below Eq. 4 of the Nadia paper: the eCMP and
    its velocity at both ends of each segment, the CoM and its velocity
    continuous between segments, the CoM at the start, and the ICP on the eCMP
    at the end.  The paper's 6N x 6N system need not be solved, though: c2 and
    c3 vanish, c4 and c5 are the eCMP's line, the ICP gives c0 from the last
    segment to the first, and then the CoM gives c1 from the first to the last.

    Args:
        durations: (N,) [s], positive.
        ecmp: (N + 1, k) [m], where the segments meet.
        com_start: (k,) [m].
        omega: natural frequency [rad/s].
    """
    start, end, T = ecmp[:-1], ecmp[1:], durations[:, None]
    slope, decay = (end - start) / T, np.exp(-omega * T)
    lead, zero = slope / omega, np.zeros_like(slope)
    icp = _chain(
        ecmp[-1], (start + lead - decay * (end + lead))[::-1], decay[::-1]
    )[-2::-1]
    c0 = 0.5 * (icp - end - lead)
    com = _chain(com_start, end - decay * start + c0 * (1.0 - decay**2), decay)
    c1 = com[:-1] - start - decay * c0
    return np.stack([c0, c1, zero, zero, slope, start], axis=1)


def _chain(first: Array, offsets: Array, factors: Array) -> Array:
    """Returns y (n + 1, k) with y_0 = first, y_i+1 = offset_i + factor_i y_i.

    In plain floats, since numpy takes longer for so few columns.
    """
    rates = factors[:, 0].tolist()
    columns = []
    for y, column in zip(first.tolist(), offsets.T.tolist(), strict=True):
        values = [y]
        for offset, rate in zip(column, rates, strict=True):
            y = offset + rate * y
            values.append(y)
        columns.append(values)
    return np.array(columns).T


@dataclass(kw_only=True)
class IcpPlanParams:
    """Parameters of the ICP plan."""

    cop: CopWaypointParams = field(default_factory=CopWaypointParams)
    continuous: bool = True  # start with the ICP of schedule.start
    # Earliest waypoint that is bent for that.
    min_bend_time: float = bounded(0.1, least=0.0, unit="s")


@dataclass(frozen=True, eq=False)
class IcpReference:
    """The reference motion at one time, each (2,) in W: [m], [m/s].

    `cop` and `ecmp` coincide: no angular momentum is planned.
    """

    icp: Array
    icp_velocity: Array
    com: Array
    com_velocity: Array
    cop: Array
    ecmp: Array

    def point(self) -> ReferencePoint:
        """Returns where a plan that takes over from here has to start."""
        return ReferencePoint(self.com, self.com_velocity, self.cop)


@dataclass(frozen=True, eq=False)
class IcpPlan(Immutable):
    """The reference motion from the start of the present phase on, in W.

    `duration` [s] is that of the present phase (infinite when standing) and
    `icp_end` (2,) [m] the ICP at its end.  N segments meet at the times `knots`
    (N + 1,) [s]; `cop_waypoints` (N + 1, 2) [m] is the CoP wanted there, and
    `coefficients` (N, 6, 2) are those of Eq. 4.
    """

    omega: float
    duration: float
    icp_end: Array
    knots: Array
    cop_waypoints: Array
    coefficients: Array

    def __post_init__(self) -> None:
        for name in ("icp_end", "knots", "cop_waypoints", "coefficients"):
            getattr(self, name).flags.writeable = False

    @cached_property
    def _knots(self) -> list[float]:
        return list(self.knots.tolist())  # to go through them faster

    def rows(self, t: float) -> tuple[int, Array]:
        """Returns the segment at `t` [s], and `rows_at` there."""
        knots = self._knots
        i = min(max(bisect_right(knots, t), 1), len(knots) - 1) - 1
        duration = knots[i + 1] - knots[i]
        t = min(max(t - knots[i], 0.0), duration)
        return i, rows_at(t, duration, self.omega)

    def at(self, t: float) -> IcpReference:
        """Returns the reference at `t` [s]; held before and after the plan."""
        (i, rows), w = self.rows(t), self.omega
        com, icp, ecmp = rows @ self.coefficients[i]
        return IcpReference(
            icp, w * (icp - ecmp), com, w * (icp - com), ecmp, ecmp
        )


def plan_icp(
    schedule: ContactSchedule, params: IcpPlanParams, model: PointMassModel
) -> IcpPlan:
    """Returns the plan of the present phase and of the footsteps after it.

    It starts with the CoM and CoP of schedule.start and, if
    params.continuous, with its CoM velocity.  It ends at rest between the
    feet.

    Raises:
        ValueError: a swing without a footstep, or a sole within the margin.
    """
    omega = model.omega
    path = cop_waypoints(schedule, params.cop, model.sole)
    knots = np.concatenate([[0.0], np.cumsum(path.durations)])
    coefficients = _solve(path, knots, schedule.start, params, omega)
    last = path.num_present - 1
    duration = float(path.durations[last])
    _, icp_end, _ = rows_at(duration, duration, omega) @ coefficients[last]
    return IcpPlan(
        omega=omega,
        duration=schedule.duration,
        icp_end=icp_end,
        knots=knots,
        cop_waypoints=path.points,
        coefficients=coefficients,
    )


def _solve(
    path: CopWaypoints,
    knots: Array,
    start: ReferencePoint,
    params: IcpPlanParams,
    omega: float,
) -> Array:
    """Returns the coefficients (N, 6, 2) of Eq. 4.

    Erratum: as printed, the system fixes the CoM at the start but not its
    velocity, so that the reference ICP would jump whenever a new plan takes
    over.  One eCMP waypoint is moved to where the ICP starts as it should.
    """
    # The third axis is the response to moving that waypoint by 1 m: the
    # system is linear, so that both solutions come from one factorisation.
    bent = int(np.searchsorted(knots, params.min_bend_time))
    bent = min(max(bent, 1), len(knots) - 3)
    ecmp = np.column_stack([path.points, np.arange(len(knots)) == bent])
    com = np.append(start.com, 0.0)
    solution = solve_segments(path.durations, ecmp, com, omega)
    coefficients, response = solution[:, :, :2], solution[:, :, 2:]
    if not params.continuous:
        return coefficients
    row = rows_at(0.0, float(path.durations[0]), omega)[1]
    error = icp(start.com, start.com_velocity, omega) - row @ coefficients[0]
    return np.asarray(coefficients + response * (error / (row @ response[0])))


def reference_of(plan: IcpPlan, state: WalkingState) -> IcpReference:
    """Returns the reference at the walking state's time in the phase.

    While the state is waiting, the ICP is held: in a swing with the eCMP of
    the plan's end, on two feet with the eCMP under it, at rest.  The CoM stays
    what it was, so that a plan that takes over from here has the same ICP.
    """
    reference = plan.at(min(state.time_in_phase, plan.duration))
    if not state.waiting:
        return reference
    ecmp = reference.icp
    if state.schedule.phase is Phase.SWING:
        ecmp = reference.ecmp
    return replace(reference, icp_velocity=np.zeros(2), cop=ecmp, ecmp=ecmp)
