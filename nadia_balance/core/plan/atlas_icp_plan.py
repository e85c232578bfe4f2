"""The ICP plan of the Atlas paper: the CMP rests in heel and toe (Sec. II-A).

Between these rests it moves during splines of the ICP.  The plan is linear in
the footholds (Eq. 18): points and their derivatives with respect to the
footholds are columns of the same matrix.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import icp, icp_after
from nadia_balance.core.math.polygon import centroid, project, shrink
from nadia_balance.core.plan.cop_waypoints import REST_DURATION
from nadia_balance.core.plan.icp_plan import IcpPlan, solve_segments
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.parameters.bounds import bounded

_SHORTEST = 1e-9  # shorter segments are omitted [s]


@dataclass(kw_only=True)
class AtlasIcpPlanParams:
    """Positions and durations of the CMP in the soles."""

    # CMPs from the sole's centroid: forward, and toward the other foot [m].
    heel_forward: float = bounded(-0.02, unit="m", of="sole_length")
    heel_inside: float = bounded(0.0, unit="m", of="sole_width")
    toe_forward: float = bounded(0.03, unit="m", of="sole_length")
    toe_inside: float = bounded(0.02, unit="m", of="sole_width")
    # Margin of both CMPs to the edge of the sole.
    margin: float = bounded(0.01, least=0.0, unit="m", of="sole_width")
    # Share of a step with the CMP on the toe: alpha_TH.  The shift from heel to
    # toe is within the swing.
    toe_share: float = bounded(0.5, above=0.0, below=1.0)
    # Share of a transfer before the shift to the heel: alpha_iniDS.
    transfer_split: float = bounded(0.5, above=0.0, below=1.0)
    # Share of a swing in which the CMP moves from heel to toe.
    swing_shift: float = bounded(0.5, above=0.0, most=1.0)
    smooth: bool = True  # Fig. 2(b); else the CMP jumps, as in Fig. 2(a)
    num_previewed_steps: int = bounded(3, least=1)


class Switch(NamedTuple):
    """The times [s] at which the CMP changes to its next point."""

    begin: float  # of a smooth change
    corner: float  # at which it jumps otherwise
    end: float


@dataclass(frozen=True, eq=False)
class AtlasIcpPlan(IcpPlan):
    """An IcpPlan with its derivatives with respect to previewed footholds.

    `moves` (N, 6, n) are the derivatives of `coefficients` with respect to each
    foothold, equal for x and y.  The `cop_waypoints` are the CMPs, in order.
    """

    moves: Array = field(kw_only=True)
    FOLLOWS_STEPS = True

    def moves_of(self, state: walking.WalkingState) -> Array:
        """Returns Gamma (2, n) of ICP and eCMP (Eq. 18).

        These are the derivatives of the result of `reference_of(self, state)`.
        """
        i, rows = self.rows(min(state.time_in_phase, self.duration))
        gammas = np.asarray(rows[1:] @ self.moves[i])
        held = state.waiting and state.schedule.phase is not Phase.SWING
        return gammas[[0, 0]] if held else gammas


def plan_atlas_icp(
    schedule: walking.ContactSchedule,
    params: AtlasIcpPlanParams,
    model: PointMassModel,
) -> AtlasIcpPlan:
    """Returns the plan (Eqs. 4 to 6, 15) of the present phase and footsteps.

    It ends at rest between the feet; the CoM starts at that of schedule.start.
    A smooth transfer also starts with its ICP: the line from the last toe (Eq.
    5) differs from that after an early or late touchdown.

    Raises ValueError: a swing without a footstep, or a sole within the margin.
    """
    steps, _ = schedule.preview(params.num_previewed_steps)
    points, omega = cmps(schedule, steps, params, model), model.omega
    now, start = schedule.start, None
    no_moves = np.zeros(len(steps))
    if params.smooth and schedule.phase is not Phase.SWING:
        icp_start = icp(now.com, now.com_velocity, omega)
        start = np.concatenate([icp_start, no_moves])
    durations, ecmp, ecmp_velocity = _segments(
        switches(schedule, params), points, start, omega
    )
    com_start = np.concatenate([now.com, no_moves])
    pieces = solve_segments(
        durations, ecmp, com_start, points[-1], omega, ecmp_velocity
    )
    return AtlasIcpPlan(
        omega=omega,
        duration=schedule.duration,
        knots=np.append(0.0, np.cumsum(durations)),
        cop_waypoints=points[:, :2].copy(),
        coefficients=pieces[:, :, :2].copy(),
        moves=pieces[:, :, 2:].copy(),
    )


def switches(
    schedule: walking.ContactSchedule, params: AtlasIcpPlanParams
) -> list[Switch]:
    """Returns the CMP switches in the present phase and in previewed steps.

    A step lasts from the corner point of its transfer to that of the next one,
    with the CMP on the toe for `toe_share` of it; the shift from heel to toe is
    clipped to the swing.
    """
    steps, last = schedule.preview(params.num_previewed_steps)
    transfers = [*(step.transfer_duration for step in steps), last]
    swings = [step.swing_duration for step in steps]
    if schedule.phase is Phase.SWING:
        swings[0] = schedule.duration
    elif schedule.phase is Phase.TRANSFER:
        transfers[0] = schedule.duration
    split, found = params.transfer_split, []
    t = -transfers[0] if schedule.phase is Phase.SWING else 0.0
    for swing, (transfer, after) in zip(
        swings, pairwise(transfers), strict=True
    ):
        found.append(Switch(t, t + split * transfer, t + transfer))
        whole = (1.0 - split) * transfer + swing + split * after
        half = 0.5 * params.swing_shift * swing
        corner = t + split * transfer + (1.0 - params.toe_share) * whole
        t += transfer
        corner = min(max(corner, t + half), t + swing - half)
        found.append(Switch(corner - half, corner, corner + half))
        t += swing
    found.append(Switch(t, t + split * last, t + last))
    if schedule.phase is Phase.SWING:
        del found[0]
    if params.smooth:
        return found
    return [Switch(corner, corner, corner) for _, corner, _ in found]


def cmps(
    schedule: walking.ContactSchedule,
    steps: tuple[walking.Footstep, ...],
    params: AtlasIcpPlanParams,
    model: PointMassModel,
) -> Array:
    """Returns the CMPs in order, with their derivatives by the footholds.

    Rows are [x, y, derivative by each of `steps`]: in double support the CoP of
    schedule.start; heel and toe of each stance foot (Eq. 15); mid of the soles.
    """
    inner = shrink(model.cop_area, params.margin, "margin")
    centre = centroid(model.cop_area)
    feet = schedule.feet
    shares = dict.fromkeys(Side, [0.0] * len(steps))
    found = []
    if schedule.phase is not Phase.SWING:
        found.append([*schedule.start.cop, *shares[Side.LEFT]])
    for i, step in enumerate(steps):
        side = step.side.other
        for forward, inside in (
            (params.heel_forward, params.heel_inside),
            (params.toe_forward, params.toe_inside),
        ):
            offset = np.array([forward, -side.sign * inside])
            place = project(centre + offset, inner)
            found.append([*feet[side].to_world(place), *shares[side]])
        feet = feet.with_foot(step.side, step.pose)
        shares[step.side] = [float(i == k) for k in range(len(steps))]
    centres = [[*feet[side].to_world(centre), *shares[side]] for side in Side]
    found.append(np.mean(centres, axis=0).tolist())
    return np.array(found)


def corner_points(
    corners: list[float], points: Array, omega: float
) -> list[Array]:
    """Returns the ICP (k,) at each of the times `corners` (n,) [s].

    There the CMP jumps from one of the `points` (n + 1, k) to the next, and at
    the last corner the ICP equals the last point: the recursion of Eq. 4, which
    Algorithm 1 writes as multipliers.
    """
    found = [points[-1]]
    for (t, t_next), cmp in zip(
        reversed(list(pairwise(corners))), points[-2:0:-1], strict=True
    ):
        found.append(icp_after(found[-1], cmp, omega, t - t_next))
    return found[::-1]


def _segments(
    shifts: list[Switch], points: Array, start: Array | None, omega: float
) -> tuple[Array, Array, Array]:
    """Returns durations (N,) [s], CMPs (2, N, k) and their velocities.

    CMPs and velocities (2, N, k) are those at both ends of each segment, for
    `solve_segments`.  `start` (k,) is the ICP at the begin of the first shift;
    None: on the trajectory to its corner point.
    """
    icps = corner_points([shift.corner for shift in shifts], points, omega)
    still, t = np.zeros((2, points.shape[1])), 0.0
    found = []
    for i, (shift, icp_c) in enumerate(zip(shifts, icps, strict=True)):
        before, after = points[i], points[i + 1]
        found.append((shift.begin - t, [before, before], still))
        if (duration := shift.end - shift.begin) > _SHORTEST:
            first = icp_after(icp_c, before, omega, shift.begin - shift.corner)
            if i == 0 and start is not None:
                first = start
            last = icp_after(icp_c, after, omega, shift.end - shift.corner)
            rates = _spline_rates(first, before, last, after, duration, omega)
            found.append((duration, [before, after], rates))
        t = shift.end
    found.append((REST_DURATION, [points[-1], points[-1]], still))
    found = [segment for segment in found if segment[0] > _SHORTEST]
    durations, cmps, velocities = map(np.array, zip(*found, strict=True))
    return durations, cmps.swapaxes(0, 1), velocities.swapaxes(0, 1)


def _spline_rates(
    first: Array, before: Array, last: Array, after: Array, T: float, w: float
) -> Array:
    """Returns the CMP's velocities (2, k) at the ends of a cubic ICP (Eq. 6).

    The ICP moves from `first` to `last` within `T` [s], with the CMP `before`
    at its start and `after` at its end, all (k,).
    """
    v0, v1 = w * (first - before), w * (last - after)
    way = 6.0 * (last - first) / T
    a0, a1 = (way - 4.0 * v0 - 2.0 * v1) / T, (2.0 * v0 + 4.0 * v1 - way) / T
    return np.array([v0 - a0 / w, v1 - a1 / w])
