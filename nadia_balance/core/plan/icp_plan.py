"""The ICP plan: ICP, CoM and CoP trajectories until the robot is at rest."""

import functools
import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import icp
from nadia_balance.core.math.polygon import project
from nadia_balance.core.plan.cop_waypoints import (
    CopPoints,
    CopWaypoints,
    IcpPlanParams,
    cop_waypoints,
)
from nadia_balance.core.walking.state import (
    ContactSchedule,
    Footstep,
    Immutable,
    Phase,
    ReferencePoint,
    WalkingState,
)

_SWEEPS = 10  # projection sweeps over the shifted waypoints
# Weights of the waypoints' shifts, each relative to the one before it [-].
_WEIGHTS = (0.1 ** np.arange(5)).tolist()
_LITTLE = 1e-4  # ICP residual that is applied without projection [m]
_TINY = 1e-12  # least squared length of a divisor [m^2]
_SAMPLES = 65  # samples of the ICP in a phase
_KEPT = 8  # references of the last times


def rows_at(t: float, duration: float, omega: float) -> Array:
    """(CoM, ICP, eCMP) = rows c, with c = (c0, ..., c5) (Nadia paper, Eq. 4).

    Here c0 multiplies e^(omega (t - T)), T the duration: it is e^(omega T)
    times the paper's, and does not overflow.

    Args:
        t: time since the segment began [s].
        duration: duration of the segment [s].
        omega: natural frequency [rad/s].

    Returns:
        The rows (3, 6).
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
    """The coefficients of N segments with a cubic eCMP (Nadia paper, Eq. 4).

    They meet the 6N conditions below Eq. 4 of the Nadia paper: the eCMP and
    its velocity at both ends of each segment, the CoM and its velocity
    continuous between segments, the CoM at the start, and the ICP at the end.
    Two recursions replace the paper's 6N x 6N system: c2 to c5 are the
    eCMP's cubic, the ICP gives c0 from the last segment to the first, and then
    the CoM gives c1 from the first to the last.

    Args:
        durations: positive durations (N,) [s].
        ecmp: eCMPs (2, N, k) at the start and the end of each segment [m].
        com_start: CoM (k,) at the start of the first segment [m].
        icp_end: ICP (k,) at the end of the last segment [m].
        omega: natural frequency [rad/s].
        ecmp_velocity: velocities (2, N, k) of `ecmp` [m/s]; None: straight
            lines.

    Returns:
        The coefficients c0 to c5 (N, 6, k).
    """
    start, end = ecmp
    T, u = durations[:, None], 1.0 / omega
    decay, mean = np.exp(-omega * T), (end - start) / T
    v0, v1 = (mean, mean) if ecmp_velocity is None else ecmp_velocity
    excess0, excess1 = v0 - mean, v1 - mean
    c2 = (excess0 + excess1) / T**2
    c3 = -(2.0 * excess0 + excess1) / T
    c4 = v0 + 6.0 * u * u * c2
    c5 = start + 2.0 * u * u * c3
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
    """ICP(t) = sum of multiplier_i eCMP_i (Atlas paper, Eq. 14, Algorithm 1).

    The eCMP is piecewise linear between the waypoints and rests at the last
    one, where the ICP ends; in Algorithm 1 the CMP jumps between heel and toe
    instead.

    Args:
        knots: increasing times (N + 1,) of the waypoints eCMP_i [s].
        t: time of the ICP [s].
        omega: natural frequency [rad/s].

    Returns:
        The multipliers (N + 1,): they are >= 0, those of passed waypoints 0,
        and add up to 1.
    """
    first, last = knots[:-1], knots[1:]
    begin, end = np.maximum(first, t), np.maximum(last, t)
    passed = np.minimum(np.maximum((t - first) / (last - first), 0.0), 1.0)
    # A segment from e0 to e1 that lasts T, with d = e^(-w T), has
    # icp(0) = d icp(T) + (1 - d - b) e0 + b e1.
    x = omega * (end - begin)  # 0 for passed segments
    d = np.exp(-x)
    b = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0.0) - d
    after = np.exp(-omega * (begin - t))  # decay from `t` to the segment
    of_first = after * (1.0 - d - b)
    multipliers = np.zeros(len(knots))
    multipliers[:-1] += (1.0 - passed) * of_first
    multipliers[1:] += passed * of_first + after * b
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

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.flags.writeable = False

    def point(self) -> ReferencePoint:
        """Converts to the start of a plan that continues from here.

        Returns:
            CoM, its velocity and CoP, in W.
        """
        return ReferencePoint(self.com, self.com_velocity, self.cop)


@dataclass(frozen=True, eq=False)
class IcpPlan(Immutable):
    """The reference motion from the start of the present phase on, in W.

    `duration` [s] is that of the present phase (infinite when standing).  N
    segments, whose eCMPs are cubic at most, meet at the times `knots` (N + 1,)
    [s] since the phase began.  `cop_waypoints` (N + 1, 2) [m] are the desired
    CoPs there, `coefficients` (N, 6, 2) those of `rows_at`.  `offset` (2,) [m]
    is the part of the initial ICP that no eCMP within the support brings to the
    end of the plan: it fades by e^-wt.  `cop_points` places the CoPs; None: the
    start of the plan stays, whatever its steps.
    """

    omega: float
    duration: float
    knots: Array
    cop_waypoints: Array
    coefficients: Array
    offset: Array = field(default_factory=lambda: np.zeros(2))
    cop_points: CopPoints | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for array in (
            self.knots,
            self.cop_waypoints,
            self.coefficients,
            self.offset,
        ):
            array.flags.writeable = False

    @cached_property
    def _knots(self) -> list[float]:
        return list(self.knots.tolist())  # faster to search than an array

    @cached_property
    def path(self) -> tuple[Array, Array]:
        """Sampled times (n,) [s] and ICPs (n, 2) [m] of the present phase."""
        knots, w = self.knots, self.omega
        end = max(min(self.duration, self._knots[-1]), knots[0])
        times = np.linspace(knots[0], end, _SAMPLES)
        i = np.searchsorted(knots[1:-1], times, side="right")
        t = (times - knots[i])[:, None]
        c0, _, c2, c3, c4, c5 = self.coefficients[i].transpose(1, 0, 2)
        grown = np.exp(w * (times - knots[i + 1]))[:, None]
        fading = np.exp(-w * (times - knots[0]))[:, None]
        icp = 2.0 * grown * c0 + c4 * (t + 1.0 / w) + c5 + fading * self.offset
        icp += (c2 * (t + 3.0 / w) + c3) * t * t + 2.0 / w * c3 * t
        return times, icp

    def time_to(self, icp: Array, t: float) -> float:
        """Minimise |icp_r(t + dt) - icp| over dt >= 0 (Nadia paper, Eq. 15).

        The plan is taken as chords of 1/64 of this phase.

        Args:
            icp: measured ICP (2,) in W [m].
            t: time since the phase began [s].

        Returns:
            The time dt until the plan is closest to `icp` [s].
        """
        # From the chord of now on, which begins with the ICP of now.
        passed = int(np.searchsorted(self.path[0], t, side="right")) - 1
        times, path = (samples[passed:].copy() for samples in self.path)
        times[0], path[0] = t, self.at(t).icp
        chords, offsets = path[1:] - path[:-1], icp - path[:-1]
        lengths2 = np.einsum("ij,ij->i", chords, chords)
        along = np.einsum("ij,ij->i", offsets, chords)
        shares = np.clip(along / np.maximum(lengths2, _TINY), 0.0, 1.0)
        gaps = offsets - shares[:, None] * chords
        if not len(gaps):
            return 0.0
        k = int(np.argmin(np.einsum("ij,ij->i", gaps, gaps)))
        return float(times[k] + shares[k] * (times[k + 1] - times[k]) - t)

    def rows(self, t: float) -> tuple[int, Array]:
        """Finds the segment at a time.

        Args:
            t: time since the phase began [s].

        Returns:
            The number of the segment, and `rows_at` there (3, 6).
        """
        knots = self._knots
        i = min(max(bisect_right(knots, t), 1), len(knots) - 1) - 1
        duration = knots[i + 1] - knots[i]
        t = min(max(t - knots[i], 0.0), duration)
        return i, rows_at(t, duration, self.omega)

    def at(self, t: float) -> IcpReference:
        """The solution of Eq. 4 at a time; held before and after the plan.

        Args:
            t: time since the phase began [s].

        Returns:
            The reference in W.
        """
        return _solution(self, min(max(t, self._knots[0]), self._knots[-1]))

    def moved(
        self,
        schedule: ContactSchedule,
        steps: tuple[Footstep, ...],
        t: float,
        icp: Array,
    ) -> ContactSchedule:
        """The reference ICP moves by part of Gamma dr (Atlas paper, Eq. 18).

        Gamma dr is its shift for a foothold shift dr; the part is as far as it
        comes closer to the measured ICP.  From `t` on, the eCMP waypoints are
        shifted for the rest, so that neither eCMP nor CoM jumps.  (Shifted from
        the start of the phase on, they would leave the soles by up to 0.3 m.)

        Args:
            schedule: schedule of this plan.
            steps: footsteps in the place of its own.
            t: time since the phase began [s].
            icp: measured ICP (2,) in W [m].

        Returns:
            The schedule with other `steps`, which starts at `t`; without a
            `cop_points`, at its own start.
        """
        new, now = replace(schedule, footsteps=steps), self.at(t)
        if self.cop_points is None:
            return new
        path = cop_waypoints(schedule, self.cop_points)
        new_path = cop_waypoints(new, self.cop_points)
        Gamma = recursive_multipliers(path.knots, t, self.omega)
        before = Gamma @ path.points
        if not np.array_equal(new_path.knots, path.knots):
            Gamma = recursive_multipliers(new_path.knots, t, self.omega)
        shift = Gamma @ new_path.points - before
        length2 = float(shift @ shift)
        along = float((icp - now.icp) @ shift)
        part = min(max(along, 0.0), length2) / max(length2, _TINY)
        velocity = now.com_velocity + self.omega * part * shift
        return replace(
            new, start=ReferencePoint(now.com, velocity, now.cop), start_time=t
        )


@functools.lru_cache(_KEPT)
def _solution(plan: IcpPlan, t: float) -> IcpReference:
    """Returns the solution of Eq. 4 at a time within the `plan`.

    The last ones are kept: several blocks ask for that of this tick.
    """
    i, rows = plan.rows(t)
    com, icp, ecmp = rows @ plan.coefficients[i]
    w = plan.omega
    velocity = w * (icp - ecmp)
    if plan.offset.any():
        wt = w * (t - float(plan.knots[0]))
        fading = math.exp(-wt) * plan.offset
        icp, com = icp + fading, com + wt * fading
        velocity -= w * fading
    return IcpReference(
        icp,
        icp_velocity=velocity,
        com=com,
        com_velocity=w * (icp - com),
        cop=ecmp,
        ecmp=ecmp,
    )


def plan_icp(
    schedule: ContactSchedule,
    params: IcpPlanParams,
    model: PointMassModel,
    cop_points: CopPoints | None = None,
) -> IcpPlan:
    """Solves Eq. 4 of the Nadia paper for linear CoP segments.

    The plan of the present phase and of the footsteps after it starts with the
    CoM, CoP and ICP of schedule.start and ends at rest midway.
    Erratum: as printed, the conditions below Eq. 4 fix the CoM at the start but
    not its velocity, so that the reference ICP would jump whenever a new plan
    takes over.

    Args:
        schedule: present phase, feet and footsteps.
        params: CoP points, and their shares of the phases.
        model: soles and natural frequency.
        cop_points: of these parameters and soles, kept from plan to plan; None:
            it is made.

    Returns:
        The plan, in W.

    Raises:
        ValueError: a swing without a footstep, or a sole within the margin.
    """
    omega, start = model.omega, schedule.start
    cop_points = cop_points or CopPoints(params, model.cop_area)
    path = cop_waypoints(schedule, cop_points)
    ecmp, offset = _bent(path, icp(start.com, start.com_velocity, omega), omega)
    return IcpPlan(
        omega=omega,
        duration=schedule.duration,
        knots=path.knots,
        cop_waypoints=path.points,
        coefficients=solve_segments(
            path.durations,
            ecmp=np.stack([ecmp[:-1], ecmp[1:]]),
            com_start=start.com,
            icp_end=ecmp[-1],
            omega=omega,
        ),
        offset=offset,
        cop_points=cop_points,
    )


def _bent(
    path: CopWaypoints, icp_start: Array, omega: float
) -> tuple[Array, Array]:
    """Returns eCMP waypoints (N + 1, 2) whose ICP starts at `icp_start`.

    The waypoints with a support polygon are shifted, with the least weighted
    sum of squares, later ones less, and projected onto their supports.  The
    second result is the remaining ICP offset (2,) [m].
    """
    multipliers = recursive_multipliers(path.knots, float(path.knots[0]), omega)
    left_x, left_y = (icp_start - multipliers @ path.points).tolist()
    supports = path.supports
    if not supports:
        return path.points, np.array((left_x, left_y))
    bent = slice(1, len(supports) + 1)
    shares = multipliers[bent].tolist()
    pulls = [
        weight * share for weight, share in zip(_WEIGHTS, shares, strict=False)
    ]
    products = [pull * share for pull, share in zip(pulls, shares, strict=True)]
    # Sums over each waypoint and all later ones.
    squares = list(accumulate(reversed(products)))[::-1]
    ecmp = path.points.copy()
    points = ecmp[bent].tolist()
    for _ in range(_SWEEPS):
        for i, support in enumerate(supports):
            (x, y), ratio = points[i], pulls[i] / squares[i]
            bend = np.array((x + ratio * left_x, y + ratio * left_y))
            points[i] = project(bend, support).tolist()
            left_x -= shares[i] * (points[i][0] - x)
            left_y -= shares[i] * (points[i][1] - y)
        if math.hypot(left_x, left_y) < _LITTLE:
            ratios = [pull / squares[0] for pull in pulls]
            ecmp[bent] = [
                (x + ratio * left_x, y + ratio * left_y)
                for (x, y), ratio in zip(points, ratios, strict=True)
            ]
            return ecmp, np.zeros(2)
    ecmp[bent] = points
    return ecmp, np.array((left_x, left_y))


def reference_of(plan: IcpPlan, state: WalkingState) -> IcpReference:
    """The plan at the walking state's time in the phase.

    Only a moved foothold makes the ICP jump (`IcpPlan.moved`).  While waiting,
    the ICP is held at zero velocity: in a swing with the eCMP at the end of the
    plan, on two feet with the eCMP at the ICP.  The CoM state is kept, so that
    the next plan starts with the same ICP.

    Args:
        plan: ICP plan of the schedule of `state`.
        state: walking state.

    Returns:
        The reference in W.
    """
    reference = plan.at(min(state.time_in_phase, plan.duration))
    if not state.waiting:
        return reference
    swings = state.schedule.phase is Phase.SWING
    ecmp = reference.ecmp if swings else reference.icp
    return replace(reference, icp_velocity=np.zeros(2), cop=ecmp, ecmp=ecmp)
