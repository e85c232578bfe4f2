"""The ICP plan: ICP, CoM and CoP trajectories until the robot is at rest."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import icp
from nadia_balance.core.math.polygon import project
from nadia_balance.core.plan.cop_waypoints import (
    CopWaypoints,
    IcpPlanParams,
    cop_waypoints,
)
from nadia_balance.core.walking import state as walking

_SWEEPS = 10  # projection sweeps over the shifted waypoints
_LATER = 0.1  # weight of a waypoint's shift relative to the one before it [-]
_LITTLE = 1e-4  # ICP residual that is applied without projection [m]
_TINY = 1e-12  # least squared length of a divisor [m^2]
_SAMPLES = 65  # samples of the ICP in a phase


def rows_at(t: float, duration: float, omega: float) -> Array:
    """Returns the rows (3, 6) that map c0..c5 to CoM, ICP and eCMP at `t` [s].

    Nadia paper, Eq. 4.
    """
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
    durations: Array,
    ecmp: Array,
    com_start: Array,
    icp_end: Array,
    omega: float,
    ecmp_velocity: Array | None = None,
) -> Array:
    """Returns the coefficients (N, 6, k) of N segments with a cubic eCMP.

    They meet the 6N conditions below Eq. 4 of the Nadia paper: the eCMP and
    its velocity at both ends of each segment, the CoM and its velocity
    continuous between segments, the CoM at the start, and the ICP at the end.
    Two recursions replace the paper's 6N x 6N system: c2 to c5 are the
    eCMP's cubic, the ICP gives c0 from the last segment to the first, and then
    the CoM gives c1 from the first to the last.

    `durations` (N,) [s] are positive, `ecmp` and `ecmp_velocity` (2, N, k) [m],
    [m/s] those at the start and at the end of each segment (None: straight
    lines), `com_start` and `icp_end` (k,) [m]; `omega` [rad/s].
    """
    (start, end), T, u = ecmp, durations[:, None], 1.0 / omega
    decay, mean = np.exp(-omega * T), (end - start) / T
    v0, v1 = (mean, mean) if ecmp_velocity is None else ecmp_velocity
    more0, more1 = v0 - mean, v1 - mean
    c2, c3 = (more0 + more1) / T**2, -(2.0 * more0 + more1) / T
    c4, c5 = v0 + 6.0 * u * u * c2, start + 2.0 * u * u * c3
    # CoM and velocity without the exponentials, at the end of the segments.
    com_T = ((c2 * T + c3) * T + c4) * T + c5
    velocity_T = (3.0 * c2 * T + 2.0 * c3) * T + c4
    last = com_T + u * velocity_T
    offsets = c5 + u * c4 - decay * last
    icp = _chain(icp_end, offsets[::-1], decay[::-1])[-2::-1]
    c0 = 0.5 * (icp - last)
    offsets = com_T - decay * c5 + c0 * (1.0 - decay**2)
    com = _chain(com_start, offsets, decay)
    c1 = com[:-1] - c5 - decay * c0
    return np.stack([c0, c1, c2, c3, c4, c5], axis=1)


def _chain(first: Array, offsets: Array, factors: Array) -> Array:
    """Returns y (n + 1, k) with y_0 = first, y_i+1 = offset_i + factor_i y_i.

    Plain floats are faster than numpy for few columns.
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


def recursive_multipliers(knots: Array, t: float, omega: float) -> Array:
    """Returns the multipliers (N + 1,) of the eCMP waypoints at the `knots`.

    ICP(t) = sum of multiplier_i eCMP_i, for an eCMP that is piecewise linear
    between the waypoints and rests at the last one, where the ICP ends: Atlas
    paper, Eq. 14 and Algorithm 1, in which the CMP jumps between heel and toe
    instead.  Multipliers are >= 0, those of passed waypoints 0, and add up to
    1.  `knots` (N + 1,) [s] increase; t [s], `omega` [rad/s].
    """
    begin, end = np.maximum(knots[:-1], t), np.maximum(knots[1:], t)
    passed = np.clip((t - knots[:-1]) / np.diff(knots), 0.0, 1.0)
    # A segment from e0 to e1 that lasts T, with d = e^(-w T), has
    # icp(0) = d icp(T) + (1 - d - b) e0 + b e1.
    x = omega * (end - begin)  # 0 for passed segments
    d = np.exp(-x)
    b = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0.0) - d
    after = np.exp(-omega * (begin - t))  # decay from `t` to the segment
    first = after * (1.0 - d - b)
    multipliers = np.zeros(len(knots))
    multipliers[:-1] += (1.0 - passed) * first
    multipliers[1:] += passed * first + after * b
    multipliers[-1] += np.exp(-omega * (end[-1] - t))
    return multipliers


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

    def point(self) -> walking.ReferencePoint:
        """Returns the start point of a plan that continues from here."""
        return walking.ReferencePoint(self.com, self.com_velocity, self.cop)


@dataclass(frozen=True, eq=False)
class IcpPlan(walking.Immutable):
    """The reference motion from the start of the present phase on, in W.

    `duration` [s] is that of the present phase (infinite when standing).  N
    segments with linear eCMPs meet at the times `knots` (N + 1,) [s] since the
    phase began.  `cop_waypoints` (N + 1, 2) [m] are the desired CoPs there,
    `coefficients` (N, 6, 2) those of Eq. 4, and `cop` the parameters of the
    CoPs.  `offset` (2,) [m] is the part of the initial ICP that no eCMP within
    the support brings to the end of the plan: it fades by e^-wt.
    """

    omega: float
    duration: float
    knots: Array
    cop_waypoints: Array
    coefficients: Array
    offset: Array = field(default_factory=lambda: np.zeros(2))
    cop: IcpPlanParams = field(default_factory=IcpPlanParams)
    FOLLOWS_STEPS: ClassVar[bool] = False  # by itself, from the same start

    def __post_init__(self) -> None:
        for name in ("knots", "cop_waypoints", "coefficients", "offset"):
            getattr(self, name).flags.writeable = False

    @cached_property
    def _knots(self) -> list[float]:
        return list(self.knots.tolist())  # faster to search than an array

    @cached_property
    def path(self) -> tuple[Array, Array]:
        """Sampled times (n,) [s] and ICPs (n, 2) [m] of the present phase."""
        knots, w = self.knots, self.omega
        end = min(self.duration, self._knots[-1])
        times = np.linspace(knots[0], max(end, knots[0]), _SAMPLES)
        i = np.searchsorted(knots[1:-1], times, side="right")
        t = (times - knots[i])[:, None]
        c0, _, c2, c3, c4, c5 = self.coefficients[i].transpose(1, 0, 2)
        grown = np.exp(w * (times - knots[i + 1]))[:, None]
        fading = np.exp(-w * (times - knots[0]))[:, None]
        icp = 2.0 * grown * c0 + c4 * (t + 1.0 / w) + c5 + fading * self.offset
        icp += (c2 * (t + 3.0 / w) + c3) * t * t + 2.0 / w * c3 * t
        return times, icp

    def time_to(self, icp: Array, t: float) -> float:
        """Returns the time [s] from `t` until the plan is closest to `icp`.

        Nadia paper, Eq. 15, on chords of 1/64 of this phase; `icp` (2,) in W.
        """
        times, path = self.path
        after = int(np.searchsorted(times, t, side="right"))
        times = np.append(t, times[after:])
        path = np.vstack([self.at(t).icp, path[after:]])
        ways, offsets = np.diff(path, axis=0), icp - path
        lengths2 = np.einsum("ij,ij->i", ways, ways)
        along = np.einsum("ij,ij->i", offsets[:-1], ways)
        shares = np.clip(along / np.maximum(lengths2, _TINY), 0.0, 1.0)
        gaps = offsets[:-1] - shares[:, None] * ways
        if not len(gaps):
            return 0.0
        k = int(np.argmin(np.einsum("ij,ij->i", gaps, gaps)))
        later = times[k] + shares[k] * (times[k + 1] - times[k])
        return float(later - t)

    def rows(self, t: float) -> tuple[int, Array]:
        """Returns the segment at `t` [s], and `rows_at` there."""
        knots = self._knots
        i = min(max(bisect_right(knots, t), 1), len(knots) - 1) - 1
        duration = knots[i + 1] - knots[i]
        t = min(max(t - knots[i], 0.0), duration)
        return i, rows_at(t, duration, self.omega)

    def at(self, t: float) -> IcpReference:
        """Returns the reference at `t` [s]; held before and after the plan."""
        first, w = self._knots[0], self.omega
        t = min(max(t, first), self._knots[-1])
        i, rows = self.rows(t)
        com, icp, ecmp = rows @ self.coefficients[i]
        velocity, wt = w * (icp - ecmp), w * (t - first)
        fading = math.exp(-wt) * self.offset
        icp, com = icp + fading, com + wt * fading
        return IcpReference(
            icp, velocity - w * fading, com, w * (icp - com), ecmp, ecmp
        )

    def moved(
        self,
        schedule: walking.ContactSchedule,
        steps: tuple[walking.Footstep, ...],
        t: float,
        icp: Array,
        model: PointMassModel,
    ) -> walking.ContactSchedule:
        """Returns the `schedule` of this plan with other `steps`, from `t` on.

        The reference ICP moves by part of Gamma dr (Atlas paper, Eq. 18), its
        shift for a foothold shift dr: as far as it comes closer to the measured
        `icp` (2,) [m] in W.  From `t` [s] on, the eCMP waypoints are shifted
        for the rest, so that neither eCMP nor CoM jumps.  (Shifted from the
        start of the phase on, they would leave the soles by up to 0.3 m.)
        """
        new, now = replace(schedule, footsteps=steps), self.at(t)
        if self.FOLLOWS_STEPS:
            return new
        sole, w = model.cop_area, model.omega
        paths = [cop_waypoints(s, self.cop, sole) for s in (schedule, new)]
        before, after = (
            recursive_multipliers(p.knots, t, w) @ p.points for p in paths
        )
        way, error = after - before, icp - now.icp
        length2 = float(way @ way)
        part = min(max(float(error @ way), 0.0), length2) / max(length2, _TINY)
        velocity = now.com_velocity + w * part * way
        start = walking.ReferencePoint(now.com, velocity, now.cop)
        return replace(new, start=start, start_time=t)


def plan_icp(
    schedule: walking.ContactSchedule,
    params: IcpPlanParams,
    model: PointMassModel,
) -> IcpPlan:
    """Returns the plan of the present phase and of the footsteps after it.

    The plan solves Eq. 4 of the Nadia paper for linear CoP segments.  It starts
    with the CoM, CoP and ICP of schedule.start and ends at rest midway.
    Erratum: as printed, Eq. 4 fixes the CoM at the start but not its velocity,
    so that the reference ICP would jump whenever a new plan takes over.

    Raises ValueError: a swing without a footstep, or a sole within the margin.
    """
    omega, start = model.omega, schedule.start
    path = cop_waypoints(schedule, params, model.cop_area)
    icp_start = icp(start.com, start.com_velocity, omega)
    ecmp, offset = _bent(path, icp_start, omega)
    ends = np.stack([ecmp[:-1], ecmp[1:]])
    pieces = solve_segments(path.durations, ends, start.com, ecmp[-1], omega)
    waypoints = path.knots, path.points
    return IcpPlan(omega, schedule.duration, *waypoints, pieces, offset, params)


def _bent(
    path: CopWaypoints, icp_start: Array, omega: float
) -> tuple[Array, Array]:
    """Returns eCMP waypoints (N + 1, 2) whose ICP starts at `icp_start`.

    The waypoints with a support polygon are shifted, with the least weighted
    sum of squares, later ones less, and projected onto their supports.  The
    second result is the remaining ICP offset (2,) [m].
    """
    ecmp = path.points.copy()
    shares = recursive_multipliers(path.knots, path.start_time, omega)
    left = icp_start - shares @ ecmp
    bent = slice(1, len(path.supports) + 1)
    pulls = _LATER ** np.arange(len(path.supports)) * shares[bent]
    # Sums over each waypoint and all later ones.
    squares = np.cumsum((pulls * shares[bent])[::-1])[::-1]
    for _ in range(_SWEEPS):
        for i, support in enumerate(path.supports):
            bend = pulls[i] / squares[i] * left
            point = project(ecmp[i + 1] + bend, support)
            left = left - shares[i + 1] * (point - ecmp[i + 1])
            ecmp[i + 1] = point
        if math.hypot(*left) < _LITTLE:
            ecmp[bent] += np.outer(pulls / squares[0], left)
            return ecmp, np.zeros(2)
    return ecmp, left


def reference_of(plan: IcpPlan, state: walking.WalkingState) -> IcpReference:
    """Returns the reference at the walking state's time in the phase.

    Only a moved foothold makes the ICP jump (`IcpPlan.moved`).  While waiting,
    the ICP is held at zero velocity: in a swing with the eCMP at the end of the
    plan, on two feet with the eCMP at the ICP.  The CoM state is kept, so that
    the next plan starts with the same ICP.
    """
    reference = plan.at(min(state.time_in_phase, plan.duration))
    if not state.waiting:
        return reference
    swings = state.schedule.phase is walking.Phase.SWING
    ecmp = reference.ecmp if swings else reference.icp
    return replace(reference, icp_velocity=np.zeros(2), cop=ecmp, ecmp=ecmp)
