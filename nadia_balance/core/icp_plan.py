"""The ICP plan: what the ICP, CoM and CoP do until the robot is at rest."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from nadia_balance.core.com_trajectory import rows_at, solve_segments
from nadia_balance.core.cop_waypoints import (
    CopWaypointParams,
    CopWaypoints,
    cop_waypoints,
)
from nadia_balance.core.lipm import icp
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    Phase,
    ReferencePoint,
    WalkingState,
)


@dataclass(kw_only=True)
class IcpPlanParams:
    """Parameters of the ICP plan."""

    cop: CopWaypointParams = field(default_factory=CopWaypointParams)
    continuous: bool = True  # start with the ICP of schedule.start
    min_bend_time: float = 0.1  # earliest waypoint that is bent for that [s]

    def validate(self) -> None:
        """Raises ValueError naming the field, its value and what is allowed."""
        self.cop.validate()
        if not 0.0 <= self.min_bend_time < math.inf:
            raise ValueError(
                f"min_bend_time = {self.min_bend_time}: must be >= 0"
            )


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
class IcpPlan:
    """The reference motion from the start of the present phase on, in W.

    `duration` [s] is that of the present phase (infinite when standing) and
    `icp_end` (2,) [m] the ICP at its end.  N segments meet at the times `knots`
    (N + 1,) [s]; `cop_waypoints` (N + 1, 2) [m] is the CoP wanted there, and
    `coefficients` (N, 6, 2) are those of Eq. 4 (see com_trajectory.py).
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

    def __deepcopy__(self, memo: object) -> "IcpPlan":
        return self

    @cached_property
    def _knots(self) -> list[float]:
        return list(self.knots.tolist())  # to go through them faster

    def at(self, t: float) -> IcpReference:
        """Returns the reference at `t` [s]; held before and after the plan."""
        knots, w = self._knots, self.omega
        i = min(max(bisect_right(knots, t), 1), len(knots) - 1) - 1
        duration = knots[i + 1] - knots[i]
        t = min(max(t - knots[i], 0.0), duration)
        com, icp, ecmp = rows_at(t, duration, w) @ self.coefficients[i]
        return IcpReference(
            icp, w * (icp - ecmp), com, w * (icp - com), ecmp, ecmp
        )


def plan_icp(
    schedule: ContactSchedule, sole: Array, params: IcpPlanParams, omega: float
) -> IcpPlan:
    """Returns the plan of the present phase and of the footsteps after it.

    It starts with the CoM and CoP of schedule.start and, if
    params.continuous, with its CoM velocity.  It ends at rest between the
    feet.  `sole` (k, 2) [m] are the corners of either sole in its own frame;
    omega [rad/s].

    Raises:
        ValueError: a swing without a footstep, or a sole within the margin.
    """
    path = cop_waypoints(schedule, sole, params.cop)
    knots = np.concatenate([[0.0], np.cumsum(path.durations)])
    coefficients = _solve(path, knots, schedule.start, params, omega)
    last = path.num_present - 1
    duration = float(path.durations[last])
    _, icp_end, _ = rows_at(duration, duration, omega) @ coefficients[last]
    return IcpPlan(
        omega, schedule.duration, icp_end, knots, path.points, coefficients
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
