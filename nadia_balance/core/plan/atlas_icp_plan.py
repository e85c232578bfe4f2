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
from nadia_balance.core.walking.state import (
    ContactSchedule,
    Footstep,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.parameters.bounds import bounded, parameters

_SHORTEST = 1e-9  # shorter segments are omitted [s]


@parameters
class AtlasIcpPlanParams:
    """Positions and durations of the CMP in the soles."""

    heel_forward: float = bounded(
        -0.02,
        doc="CMP in the heel, forward from the sole's centroid",
        unit="m",
        of="sole_length",
    )
    heel_inside: float = bounded(
        0.0,
        doc="CMP in the heel, toward the other foot",
        unit="m",
        of="sole_width",
    )
    toe_forward: float = bounded(
        0.03,
        doc="CMP in the toe, forward from the sole's centroid",
        unit="m",
        of="sole_length",
    )
    toe_inside: float = bounded(
        0.02,
        doc="CMP in the toe, toward the other foot",
        unit="m",
        of="sole_width",
    )
    margin: float = bounded(
        0.01,
        doc="margin of both CMPs to the edge of the sole",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    toe_share: float = bounded(
        0.5,
        doc="alpha_TH: share of a step with the CMP on the toe; the shift from "
        "heel to toe is within the swing",
        above=0.0,
        below=1.0,
    )
    transfer_split: float = bounded(
        0.5,
        doc="alpha_iniDS: share of a transfer before the shift to the heel",
        above=0.0,
        below=1.0,
    )
    swing_shift: float = bounded(
        0.5,
        doc="share of a swing in which the CMP moves from heel to toe",
        above=0.0,
        most=1.0,
    )
    smooth: bool = bounded(
        True, doc="Fig. 2(b); else the CMP jumps, as in Fig. 2(a)"
    )
    num_previewed_steps: int = bounded(
        3, doc="number of footsteps in the plan", least=1
    )


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

    def moves_of(self, state: WalkingState) -> Array:
        """Gamma_i = d(ICP, eCMP) / d(foothold i) (Eq. 18).

        Args:
            state: walking state, of the schedule of this plan.

        Returns:
            Gamma (2, n) of ICP and eCMP: the derivatives of
            `reference_of(self, state)`, equal for x and y [-].
        """
        i, rows = self.rows(min(state.time_in_phase, self.duration))
        gammas = np.asarray(rows[1:] @ self.moves[i])
        held = state.waiting and state.schedule.phase is not Phase.SWING
        return gammas[[0, 0]] if held else gammas


def plan_atlas_icp(
    schedule: ContactSchedule, params: AtlasIcpPlanParams, model: PointMassModel
) -> AtlasIcpPlan:
    """The plan (Eqs. 4 to 6, 15) of the present phase and footsteps.

    It ends at rest between the feet; the CoM starts at that of schedule.start.
    A smooth transfer also starts with its ICP: the line from the last toe (Eq.
    5) differs from that after an early or late touchdown.

    Args:
        schedule: present phase, feet and footsteps.
        params: CMPs, and their shares of the phases.
        model: soles and natural frequency.

    Returns:
        The plan, with its derivatives by n previewed footholds.

    Raises:
        ValueError: a swing without a footstep, or a sole within the margin.
    """
    steps, _ = schedule.preview(params.num_previewed_steps)
    points, omega = cmps(schedule, steps, params, model), model.omega
    now, start = schedule.start, None
    no_moves = np.zeros(len(steps))
    if params.smooth and schedule.phase is not Phase.SWING:
        start = np.append(icp(now.com, now.com_velocity, omega), no_moves)
    durations, ecmp, ecmp_velocity = _segments(
        switches(schedule, params), points, start, omega
    )
    pieces = solve_segments(
        durations,
        ecmp,
        com_start=np.append(now.com, no_moves),
        icp_end=points[-1],
        omega=omega,
        ecmp_velocity=ecmp_velocity,
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
    schedule: ContactSchedule, params: AtlasIcpPlanParams
) -> list[Switch]:
    """The CMP switches in the present phase and in previewed steps.

    A step lasts from the corner point of its transfer to that of the next one,
    with the CMP on the toe for `toe_share` of it; the shift from heel to toe is
    clipped to the swing.

    Args:
        schedule: present phase, and the durations of the footsteps.
        params: shares of the phases.

    Returns:
        The switches in order; times since the phase began.

    Raises:
        ValueError: a swing without a footstep.
    """
    steps, last = schedule.preview(params.num_previewed_steps)
    transfers = [*(step.transfer_duration for step in steps), last]
    swings = [step.swing_duration for step in steps]
    if schedule.phase is Phase.SWING:
        swings[0] = schedule.duration
    elif schedule.phase is Phase.TRANSFER:
        transfers[0] = schedule.duration
    split, shifts = params.transfer_split, []
    t = -transfers[0] if schedule.phase is Phase.SWING else 0.0
    for swing, (transfer, after) in zip(
        swings, pairwise(transfers), strict=True
    ):
        shifts.append(Switch(t, t + split * transfer, t + transfer))
        whole = (1.0 - split) * transfer + swing + split * after
        half = 0.5 * params.swing_shift * swing
        corner = t + split * transfer + (1.0 - params.toe_share) * whole
        t += transfer
        corner = min(max(corner, t + half), t + swing - half)
        shifts.append(Switch(corner - half, corner, corner + half))
        t += swing
    shifts.append(Switch(t, t + split * last, t + last))
    if schedule.phase is Phase.SWING:
        del shifts[0]
    if params.smooth:
        return shifts
    return [Switch(corner, corner, corner) for _, corner, _ in shifts]


def cmps(
    schedule: ContactSchedule,
    steps: tuple[Footstep, ...],
    params: AtlasIcpPlanParams,
    model: PointMassModel,
) -> Array:
    """The CMPs in order, with their derivatives by the footholds (Eq. 15).

    In double support the CoP of schedule.start; heel and toe of each stance
    foot; the middle between the soles.

    Args:
        schedule: present phase, feet and start.
        steps: the n previewed footsteps.
        params: CMPs in the soles.
        model: soles.

    Returns:
        Rows [x, y, derivative by each of `steps`] (k, 2 + n) in W [m], [-].

    Raises:
        ValueError: a sole within the margin.
    """
    inner = shrink(model.cop_area, params.margin, "margin")
    centre = centroid(model.cop_area)
    feet = schedule.feet
    shares = dict.fromkeys(Side, [0.0] * len(steps))
    rows = []
    if schedule.phase is not Phase.SWING:
        rows.append([*schedule.start.cop, *shares[Side.LEFT]])
    for i, step in enumerate(steps):
        side = step.side.other
        for forward, inside in (
            (params.heel_forward, params.heel_inside),
            (params.toe_forward, params.toe_inside),
        ):
            offset = np.array([forward, -side.sign * inside])
            cmp = feet[side].to_world(project(centre + offset, inner))
            rows.append([*cmp, *shares[side]])
        feet = feet.with_foot(step.side, step.pose)
        shares[step.side] = [float(i == k) for k in range(len(steps))]
    centres = [[*feet[side].to_world(centre), *shares[side]] for side in Side]
    return np.array([*rows, np.mean(centres, axis=0).tolist()])


def corner_points(
    corners: list[float], points: Array, omega: float
) -> list[Array]:
    """The ICPs at which the CMP jumps from one point to the next (Eq. 4).

    At the last corner the ICP equals the last point; before, this is the
    recursion that Algorithm 1 writes as multipliers.

    Args:
        corners: increasing times (n,) of the jumps [s].
        points: CMPs (n + 1, k), columns as in `cmps`.
        omega: natural frequency [rad/s].

    Returns:
        The ICP (k,) at each of the corners.
    """
    icps = [points[-1]]
    for (t, t_next), cmp in zip(
        reversed(list(pairwise(corners))), points[-2:0:-1], strict=True
    ):
        icps.append(icp_after(icps[-1], cmp, omega, t - t_next))
    return icps[::-1]


def _segments(
    shifts: list[Switch], points: Array, start: Array | None, omega: float
) -> tuple[Array, Array, Array]:
    """Returns durations (N,) [s], CMPs (2, N, k) and their velocities.

    CMPs and velocities (2, N, k) are those at both ends of each segment, for
    `solve_segments`.  `start` (k,) is the ICP at the begin of the first shift;
    None: on the trajectory to its corner point.
    """
    still, t = np.zeros((2, points.shape[1])), 0.0
    segments = []
    icps = corner_points([shift.corner for shift in shifts], points, omega)
    for i, (shift, icp_c) in enumerate(zip(shifts, icps, strict=True)):
        before, after = points[i], points[i + 1]
        segments.append((shift.begin - t, [before, before], still))
        duration = shift.end - shift.begin
        if duration > _SHORTEST:
            first = icp_after(icp_c, before, omega, shift.begin - shift.corner)
            if i == 0 and start is not None:
                first = start
            last = icp_after(icp_c, after, omega, shift.end - shift.corner)
            rates = _spline_rates(first, before, last, after, duration, omega)
            segments.append((duration, [before, after], rates))
        t = shift.end
    segments.append((REST_DURATION, [points[-1], points[-1]], still))
    durations, ecmp, velocities = map(
        np.array, zip(*(s for s in segments if s[0] > _SHORTEST), strict=True)
    )
    return durations, ecmp.swapaxes(0, 1), velocities.swapaxes(0, 1)


def _spline_rates(
    first: Array, before: Array, last: Array, after: Array, T: float, w: float
) -> Array:
    """Returns the CMP's velocities (2, k) at the ends of a cubic ICP (Eq. 6).

    The ICP moves from `first` to `last` within `T` [s], with the CMP `before`
    at its start and `after` at its end, all (k,).
    """
    v0, v1 = w * (first - before), w * (last - after)
    slope = 6.0 * (last - first) / T
    a0 = (slope - 4.0 * v0 - 2.0 * v1) / T
    a1 = (2.0 * v0 + 4.0 * v1 - slope) / T
    return np.array([v0 - a0 / w, v1 - a1 / w])
