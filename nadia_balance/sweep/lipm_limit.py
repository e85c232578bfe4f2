"""N-step capturability of the linear inverted pendulum under a push.

The limits use the robot's parameters and hold for any controller: one that
knows the push at its start, and chooses CoP, footholds and touchdown times.  To
come to rest, the ICP must be the mean of all future eCMPs with the weights
w e^-wt (the ICP dynamics, Nadia paper, Eq. 3, integrated): for given step
times, the largest push is a linear program.  The regions C_N of the paper's
Sec. IV are its feasible next footholds.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nadia_balance.core.body import reachability
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array, rectangle
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.math.qp import largest_first
from nadia_balance.core.plan.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import (
    Footstep,
    Phase,
    WalkingState,
    support_polygon,
)
from nadia_balance.parameters.bounds import require

LOST = -1  # no number of steps captures the robot

_MAX_STEPS = 4
# Tried delays of each landing after the earliest one, in 1 / omega.  With
# limited foot speed, a later landing allows a longer step.
_DELAYS = (
    (0.0, 0.17, 0.33, 0.5, 0.83, 1.2, 1.7),
    (0.0, 0.33, 0.83, 1.8),
    (0.0, 0.33, 0.83),
    (0.0, 0.33),
)
_HULL = "hull"  # name of the hull of all regions
_BETTER = 1e-6  # least improvement of a push [m/s]
_ZERO = np.zeros(2)
_BOX = np.vstack([np.eye(2), -np.eye(2)])
# Normals of a disc's outer polygon, which is 0.5 % too large.
_DIRECTIONS = reachability.circle(1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class LipmLimit:
    """The largest push that N steps capture, by a linear program.

        maximise delta_v, over the vectors of all steps, subject to
            the ICP after the push = the weighted mean of all future eCMPs,
            every eCMP in the soles, every step within reach and foot speed,

    for given durations and regions, of which all combinations are tried.  The
    eCMP may leave the soles by `kappa` along x and y, at any time and without
    cost.  The feet stay parallel.  Without `on.step`, `on.swing` or
    `on.transfer`, footholds or durations are the planned ones.

    Args:
        state: walking state at the instant of the push.
        icp: ICP (2,) in W [m].
        foot: position of the swing foot (2,) in W when the push begins; its
            mean speed on the straight line to its foothold is limited to
            model.detour.max_speed, as that of later feet [m].
        model: pendulum, soles and reach.
        timing: least durations.
        on: mechanisms.
        kappa: excursion of the eCMP [m].
        fall: velocity v by which the CoM falls at each touchdown [m/s].  It
            falls freely, is caught with twice its weight and is back at its
            height before it falls again.  At touchdown k = 1, 2, ... the ICP
            is, to first order, that of a touchdown earlier by

                (v - (2 k - 11/6) (omega v)^2 v / g^2) / (2 g)

            (ComHeight.sinking, integrated).
        push_duration: of the push [s].

    Raises:
        ValueError: `kappa` or `fall` is negative.
    """

    state: WalkingState
    icp: Array
    foot: Array
    model: PointMassModel
    timing: TimingAdapterParams
    on: Mechanisms
    kappa: float = 0.0
    fall: float = 0.0
    push_duration: float = 0.1

    def __post_init__(self) -> None:
        require(self.kappa >= 0.0, f"kappa = {self.kappa}: must be >= 0 m")
        require(self.fall >= 0.0, f"fall = {self.fall}: must be >= 0 m/s")

    @cached_property
    def assumptions(self) -> str:
        """The assumptions of the limit, with numbers, as text."""
        length, width = np.ptp(self.model.sole, axis=0)
        swing, transfer = (min(times) for times in self._durations)
        max_speed = self.model.detour.max_speed
        speed = (
            "any foot speed"
            if math.isinf(max_speed)
            else f"mean foot speed up to {max_speed:g} m/s"
        )
        return (
            f"a point mass {self.model.com_height:g} m high; "
            f"soles {length:g} m x {width:g} m, "
            f"eCMP up to {self.kappa:g} m outside; swings from "
            f"{swing:g} s, transfers from {transfer:g} s with linear weight "
            f"shift; {speed}; reach as in robot.yaml; up to {_MAX_STEPS} "
            f"steps, all known when a push of {self.push_duration:g} s begins"
        )

    def largest_push(self, direction_deg: float) -> float:
        """The largest push in a direction.

        With `on.step` all smaller step counts are tried, as the robot may stop.

        Args:
            direction_deg: 0 forward, 90 left [deg].

        Returns:
            The change of the CoM's velocity [m/s].
        """
        angle = self._side * math.radians(direction_deg)
        direction = np.array([math.cos(angle), math.sin(angle)])
        last = len(self._steps)
        return self._best(
            direction, range(0 if self.on.step else last, last + 1)
        )

    def least_steps(self) -> int:
        """The least number of steps that capture the ICP, without a push.

        Returns:
            The number n; 0 if the ICP is in the support polygon, LOST if none
            does.
        """
        forward = np.array([1.0, 0.0])
        return next(
            (
                n
                for n in range(len(self._steps) + 1)
                if self._best(forward, [n], upper_bound=0.0) >= -_BETTER
            ),
            LOST,
        )

    def _best(
        self,
        direction: Array,
        step_counts: Iterable[int],
        upper_bound: float = math.inf,
    ) -> float:
        """Returns the largest push [m/s] along `direction` (2,).

        Each step count, timing and choice of regions is a linear program, and
        branched on only if that of the hull is better than the best so far.
        """
        best = -math.inf
        for swings in itertools.chain.from_iterable(
            map(self._swings, step_counts)
        ):
            undecided = [(_HULL,) * len(swings)]
            while undecided:
                regions = undecided.pop()
                push = self._solve(
                    direction, swings, regions=regions, upper_bound=upper_bound
                )
                if push is None or push < best + _BETTER:
                    continue
                if _HULL not in regions:
                    best = push
                else:
                    k = regions.index(_HULL)
                    undecided += [
                        (*regions[:k], name, *regions[k + 1 :])
                        for name in self._regions
                        if name != _HULL
                    ]
        return best

    @property
    def _steps(self) -> tuple[Footstep, ...]:
        return self.state.schedule.footsteps[:_MAX_STEPS]

    @property
    def _side(self) -> int:
        return self.state.schedule.support_side.other.sign

    @cached_property
    def _foot(self) -> Array:
        """Position (2,) [m] of the first swing foot, see `_local`."""
        schedule = self.state.schedule
        standing = schedule.feet[schedule.support_side.other].p_WF[:2]
        return self._local(
            self.foot if schedule.phase is Phase.SWING else standing
        )

    def _local(self, points: Array) -> Array:
        """Points (..., 2) of W in the stance sole's frame, y to the swing."""
        stance = self.state.schedule.feet[self.state.schedule.support_side]
        return stance.to_sole(points) * [1.0, self._side]

    @cached_property
    def _regions(self) -> dict[str, Array]:
        """The reachability regions by name, and their hull."""
        return {
            **reachability.step_regions(self.model.reach, self.on.cross_over),
            _HULL: reachability.total_region(
                self.model.reach, self.on.cross_over
            ),
        }

    @cached_property
    def _reach(self) -> list[dict[str, polygon.Halfspaces]]:
        """Regions of each step by name, y to the first swing side."""
        if self.on.step:
            return [
                {
                    name: polygon.halfspaces(
                        polygon.convex_hull(region * [1.0, (-1.0) ** k])
                    )
                    for name, region in self._regions.items()
                }
                for k in range(len(self._steps))
            ]
        stance = self.state.schedule.feet[self.state.schedule.support_side]
        feet = [stance, *(step.pose for step in self._steps)]
        holds = [self._local(foot.p_WF[:2]) for foot in feet]
        return [
            dict.fromkeys(self._regions, (_BOX, _BOX @ (after - before)))
            for before, after in itertools.pairwise(holds)
        ]

    @cached_property
    def _ecmps(self) -> list[polygon.Halfspaces]:
        """Half-planes of the eCMP on the present contacts, and on a sole."""
        present = support_polygon(self.state.schedule, self.model.cop_area)
        hulls = [
            polygon.convex_hull(self._local(present)),
            polygon.convex_hull(self.model.cop_area),
        ]
        if self.kappa:
            square = rectangle(2.0 * self.kappa, 2.0 * self.kappa)
            hulls = [polygon.minkowski_sum(hull, square) for hull in hulls]
        return [polygon.halfspaces(hull) for hull in hulls]

    @cached_property
    def _durations(self) -> tuple[list[float], list[float]]:
        """The least durations [s] of the swings, and of the transfers."""
        swing = self.timing.min_swing_duration if self.on.swing else math.inf
        transfer = (
            self.timing.min_transfer_duration if self.on.transfer else math.inf
        )
        return (
            [min(step.swing_duration, swing) for step in self._steps],
            [min(step.transfer_duration, transfer) for step in self._steps],
        )

    @cached_property
    def _rests(self) -> tuple[list[float], list[float]]:
        """Like `_durations` [s], but the first ones are the remaining times.

        The first transfer has passed in a swing; standing comes before it.
        """
        if not self._steps:
            return [], []
        swings, transfers = self._durations
        schedule, left = self.state.schedule, self.state.remaining_time
        if schedule.phase is Phase.STANDING:
            return swings, [left + transfers[0], *transfers[1:]]
        if schedule.phase is Phase.TRANSFER:
            if self.on.transfer:
                rest = self.timing.min_transfer_duration - self.state.elapsed
                left = min(max(rest, 0.0), left)
            return swings, [left, *transfers[1:]]
        if self.on.swing:
            left = min(
                self.timing.least_rest_of_swing(
                    schedule.duration, self.state.elapsed
                ),
                left,
            )
        return [left, *swings[1:]], [0.0, *transfers[1:]]

    def _swings(self, n: int) -> Iterator[tuple[float, ...]]:
        """Yields those that are tried of `n` swings, fast ones first."""
        delays = _DELAYS if self.on.swing else ((0.0,),) * _MAX_STEPS
        return itertools.product(
            *(
                [rest + delay / self.model.omega for delay in options]
                for rest, options in zip(
                    self._rests[0][:n], delays, strict=False
                )
            )
        )

    def _behind(self) -> float:
        """Weight [-] of the eCMP of the trailing foot before lift-off."""
        if self.state.schedule.phase is not Phase.TRANSFER:
            return 0.0
        share = self.state.remaining_time / self.state.schedule.duration
        return share * (1.0 - _mean_decay(self.model.omega * self._rests[1][0]))

    def _solve(
        self,
        direction: Array,
        swings: tuple[float, ...],
        regions: Sequence[str],
        upper_bound: float,
    ) -> float | None:
        """Returns the largest push along `direction` (2,); None if infeasible.

        The variables are delta_v <= `upper_bound` [m/s] and the step vectors
        (n, 2), each from one foot to the other.  The limits (M, p, (A, b)) are
        A (M x + p) <= b.
        """
        n = len(swings)
        w, T = self.model.omega, self.push_duration
        per_speed = -math.expm1(-w * T) / (w * w * T)  # ICP shift / delta_v [s]
        ecmp = self._local(self.icp)
        if n:
            ecmp = ecmp - self._behind() * self._foot
        to_ecmp = np.column_stack(
            [
                per_speed * direction,
                *(-weight * np.eye(2) for weight in self._weights(swings)),
            ]
        )
        to_step = [np.eye(2, 2 * n + 1, 1 + 2 * k) for k in range(n)]
        limits = [(to_ecmp, ecmp, self._ecmps[min(n, 1)])]
        if math.isfinite(upper_bound):
            bound = np.eye(1), np.array([upper_bound])
            limits.append((np.eye(1, 2 * n + 1), np.zeros(1), bound))
        speed = self.model.detour.max_speed
        for k, (region, swing) in enumerate(zip(regions, swings, strict=True)):
            limits.append((to_step[k], _ZERO, self._reach[k][region]))
            if math.isfinite(speed):
                disc = _DIRECTIONS, np.full(len(_DIRECTIONS), speed * swing)
                moved = to_step[k] + to_step[k - 1] if k else to_step[0]
                limits.append((moved, _ZERO if k else -self._foot, disc))
        x = largest_first(
            np.vstack([A @ M for M, _, (A, _) in limits]),
            np.concatenate([b - A @ p for _, p, (A, b) in limits]),
        )
        return None if x is None else float(x[0])

    def _weights(self, swings: tuple[float, ...]) -> Array:
        """The weights (n,) [-] of the step vectors."""
        n, w = len(swings), self.model.omega
        _, transfers = self._durations
        landings = np.cumsum(swings) + np.cumsum(self._rests[1][:n])
        loading = [
            _mean_decay(w * transfer)
            for transfer in [*transfers[1:], *transfers[-1:]][:n]
        ]
        # Not once more at each landing: it depends on the fall of that time.
        # Once more is lost, since a lower pendulum diverges faster.
        lost = (w * self.fall / GRAVITY) ** 2 * (2.0 * np.arange(n) + 1.0 / 6.0)
        gained = self.fall / (2.0 * GRAVITY) * (1.0 - lost)
        return np.asarray(np.exp(-w * (landings - gained)) * loading)


def _mean_decay(x: float) -> float:
    """Returns (1 - e^-x) / x, the weight of a linearly loaded foot."""
    return -math.expm1(-x) / x if x > 0.0 else 1.0
