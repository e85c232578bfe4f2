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
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import support_polygon

LOST = -1  # no number of steps captures the robot

_MOST_STEPS = 4
# Tried delays of each landing after the earliest one, in 1 / omega.  With
# limited foot speed, a later landing allows a longer step.
_WAITS = (
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

Halfplanes = tuple[Array, Array]  # A p <= b
Swings = tuple[float, ...]  # durations [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class LipmLimit:
    """Steps and pushes at one instant, in `state`, with the `icp` (2,) [m].

    The swing foot is at `foot` (2,) [m] when the push begins; its mean speed on
    the straight line to its foothold is limited to model.detour.max_speed, as
    that of later feet.  The eCMP may leave the soles by `kappa` [m] along x and
    y, at any time and without cost.  If the CoM falls by `fall` [m/s] at each
    touchdown, the ICP is, to first order, that of a touchdown fall / (2 g)
    earlier (see ComHeight.sinking).  The feet stay parallel.  Without
    `on.step`, `on.swing` or `on.transfer`, footholds or durations are the
    planned ones.

    Raises ValueError: `kappa` or `fall` is negative.
    """

    state: walking.WalkingState
    icp: Array
    foot: Array
    model: PointMassModel
    timing: TimingAdapterParams
    on: Mechanisms
    kappa: float = 0.0
    fall: float = 0.0
    push_duration: float = 0.1  # [s]

    def __post_init__(self) -> None:
        if not self.kappa >= 0.0:
            raise ValueError(f"kappa = {self.kappa}: must be >= 0 m")
        if not self.fall >= 0.0:
            raise ValueError(f"fall = {self.fall}: must be >= 0 m/s")

    @cached_property
    def assumptions(self) -> str:
        """The assumptions of the limit, with numbers, as text."""
        m, (length, width) = self.model, np.ptp(self.model.sole, axis=0)
        swing, transfer = (min(times) for times in self._durations)
        speed = f"mean foot speed up to {m.detour.max_speed:g} m/s"
        if math.isinf(m.detour.max_speed):
            speed = "any foot speed"
        return (
            f"a point mass {m.com_height:g} m high; soles {length:g} m x "
            f"{width:g} m, eCMP up to {self.kappa:g} m outside; swings from "
            f"{swing:g} s, transfers from {transfer:g} s with linear weight "
            f"shift; {speed}; reach as in robot.yaml; up to {_MOST_STEPS} "
            f"steps, all known when a push of {self.push_duration:g} s begins"
        )

    def largest_push(self, direction_deg: float) -> float:
        """Returns the largest push [m/s] at an angle: 0 forward, 90 left [deg].

        With `on.step` all smaller step counts are tried, as the robot may stop.
        """
        angle = self._side * math.radians(direction_deg)
        way = np.array([math.cos(angle), math.sin(angle)])
        most = len(self._steps)
        return self._best(way, range(0 if self.on.step else most, most + 1))

    def least_steps(self) -> int:
        """Returns the least n such that n steps capture the ICP, or LOST.

        No push follows; n = 0 if the ICP is in the support polygon.
        """
        way = np.array([1.0, 0.0])
        for n in range(len(self._steps) + 1):
            if self._best(way, [n], most=0.0) >= -_BETTER:
                return n
        return LOST

    def _best(
        self, way: Array, step_counts: Iterable[int], most: float = math.inf
    ) -> float:
        """Returns the largest push [m/s] along `way` (2,), up to `most`.

        Each step count, timing and choice of regions is a linear program, and
        branched on only if that of the hull is better than the best so far.
        """
        best = -math.inf
        names = [name for name in self._regions if name != _HULL]
        for swings in (s for n in step_counts for s in self._swings(n)):
            undecided = [(_HULL,) * len(swings)]
            while undecided:
                regions = undecided.pop()
                found = self._solve(way, swings, regions, most)
                if found is None or found < best + _BETTER:
                    continue
                if _HULL not in regions:
                    best = found
                    continue
                k = regions.index(_HULL)
                before, after = regions[:k], regions[k + 1 :]
                undecided += [(*before, name, *after) for name in names]
        return best

    @property
    def _steps(self) -> tuple[walking.Footstep, ...]:
        return self.state.schedule.footsteps[:_MOST_STEPS]

    @property
    def _side(self) -> int:
        return self.state.schedule.support_side.other.sign

    @cached_property
    def _foot(self) -> Array:
        """Position (2,) [m] of the first swing foot, see `_local`."""
        schedule, foot = self.state.schedule, self.foot
        if schedule.phase is not walking.Phase.SWING:
            foot = schedule.feet[schedule.support_side.other].p_WF[:2]
        return self._local(foot)

    def _local(self, points: Array) -> Array:
        """Points (..., 2) of W in the stance sole's frame, y to the swing."""
        schedule = self.state.schedule
        stance = schedule.feet[schedule.support_side]
        return stance.to_sole(points) * [1.0, self._side]

    @cached_property
    def _regions(self) -> dict[str, Array]:
        """The reachability regions by name, and their hull."""
        known = self.model.reach, self.on.cross_over
        regions = reachability.step_regions(*known)
        return {**regions, _HULL: reachability.total_region(*known)}

    @cached_property
    def _reach(self) -> list[dict[str, Halfplanes]]:
        """Regions of each step by name, y to the first swing side."""
        if self.on.step:
            half, hull = polygon.halfspaces, polygon.convex_hull
            sides = [[1.0, (-1.0) ** k] for k in range(len(self._steps))]
            regions = self._regions.items()
            return [{n: half(hull(r * s)) for n, r in regions} for s in sides]
        schedule = self.state.schedule
        feet = [schedule.feet[schedule.support_side]]
        feet += [step.pose for step in self._steps]
        holds = [self._local(foot.p_WF[:2]) for foot in feet]
        return [
            dict.fromkeys(self._regions, (_BOX, _BOX @ (after - before)))
            for before, after in itertools.pairwise(holds)
        ]

    @cached_property
    def _ecmps(self) -> list[Halfplanes]:
        """Half-planes of the eCMP on the present contacts, and on a sole."""
        sole = self.model.cop_area
        present = self._local(support_polygon(self.state.schedule, sole))
        hulls = [polygon.convex_hull(corners) for corners in (present, sole)]
        if self.kappa:
            square = rectangle(2.0 * self.kappa, 2.0 * self.kappa)
            hulls = [polygon.minkowski_sum(hull, square) for hull in hulls]
        return [polygon.halfspaces(hull) for hull in hulls]

    @cached_property
    def _durations(self) -> tuple[list[float], list[float]]:
        """The least durations [s] of the swings, and of the transfers."""
        on, least, steps = self.on, self.timing, self._steps
        swing = least.min_swing_duration if on.swing else math.inf
        transfer = least.min_transfer_duration if on.transfer else math.inf
        swings = [min(step.swing_duration, swing) for step in steps]
        return swings, [min(s.transfer_duration, transfer) for s in steps]

    @cached_property
    def _rests(self) -> tuple[list[float], list[float]]:
        """Like `_durations` [s], but the first ones are the remaining times.

        The first transfer has passed in a swing; standing comes before it.
        """
        state, (swings, transfers) = self.state, self._durations
        if not self._steps:
            return [], []
        phase, left = state.schedule.phase, state.remaining_time
        match phase:
            case walking.Phase.STANDING:
                return swings, [left + transfers[0], *transfers[1:]]
            case walking.Phase.TRANSFER:
                if self.on.transfer:
                    least = self.timing.min_transfer_duration - state.elapsed
                    left = min(max(least, 0.0), left)
                return swings, [left, *transfers[1:]]
        if self.on.swing:
            now = state.schedule.duration, state.elapsed
            left = min(self.timing.least_rest_of_swing(*now), left)
        return [left, *swings[1:]], [0.0, *transfers[1:]]

    def _swings(self, n: int) -> Iterator[Swings]:
        """Yields those that are tried of `n` swings, fast ones first."""
        waits = _WAITS if self.on.swing else [[0.0]] * _MOST_STEPS
        rests, w = self._rests[0][:n], self.model.omega
        pairs = zip(rests, waits, strict=False)
        return itertools.product(*([s + t / w for t in ts] for s, ts in pairs))

    def _behind(self) -> float:
        """Weight [-] of the eCMP of the trailing foot before lift-off."""
        schedule = self.state.schedule
        if schedule.phase is not walking.Phase.TRANSFER:
            return 0.0
        share = self.state.remaining_time / schedule.duration
        decay = _mean_decay(self.model.omega * self._rests[1][0])
        return share * (1.0 - decay)

    def _solve(
        self, way: Array, swings: Swings, regions: Sequence[str], most: float
    ) -> float | None:
        """Returns the largest push along `way` (2,); None if infeasible.

        The variables are delta_v <= `most` [m/s] and the step vectors (n, 2),
        each from one foot to the other.
        """
        n, weights = len(swings), self._weights(swings)
        w, T, foot = self.model.omega, self.push_duration, self._foot
        per_speed = -math.expm1(-w * T) / (w * w * T)  # ICP shift / delta_v [s]
        ecmp, room = self._local(self.icp), self._ecmps[min(n, 1)]
        if n:
            ecmp = ecmp - self._behind() * foot
        of_ecmp = np.column_stack(
            [per_speed * way, *(-weight * np.eye(2) for weight in weights)]
        )
        of_step = [np.eye(2, 2 * n + 1, 1 + 2 * k) for k in range(n)]
        limits = [(of_ecmp, ecmp, room)]
        if math.isfinite(most):
            push, bound = np.eye(1, 2 * n + 1), (np.eye(1), np.array([most]))
            limits.append((push, np.zeros(1), bound))
        for k, (region, swing) in enumerate(zip(regions, swings, strict=True)):
            limits.append((of_step[k], _ZERO, self._reach[k][region]))
            if math.isfinite(speed := self.model.detour.max_speed):
                disc = _DIRECTIONS, np.full(len(_DIRECTIONS), speed * swing)
                moved = of_step[k] + of_step[k - 1] if k else of_step[0]
                limits.append((moved, _ZERO if k else -foot, disc))
        x = largest_first(
            np.vstack([A @ M for M, _, (A, _) in limits]),
            np.concatenate([b - A @ p for _, p, (A, b) in limits]),
        )
        return None if x is None else float(x[0])

    def _weights(self, swings: Swings) -> Array:
        """The weights (n,) [-] of the step vectors."""
        n, w, transfers = len(swings), self.model.omega, self._durations[1]
        landings = np.cumsum(swings) + np.cumsum(self._rests[1][:n])
        after = [*transfers[1:], *transfers[-1:]][:n]
        loading = [_mean_decay(w * t) for t in after]
        gained = self.fall / (2.0 * GRAVITY) * np.arange(1, n + 1)
        return np.asarray(np.exp(-w * (landings - gained)) * loading)


def _mean_decay(x: float) -> float:
    """Returns (1 - e^-x) / x, the weight of a linearly loaded foot."""
    return -math.expm1(-x) / x if x > 0.0 else 1.0
