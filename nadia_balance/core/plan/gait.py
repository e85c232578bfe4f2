"""Footsteps from user commands: step vectors, or a list of footholds."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from nadia_balance.core.body import ground as terrain
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import ReachabilityParams as Reach
from nadia_balance.core.body.reachability import base_region, in_world
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import convex_hull, intersection, project
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import FootPose, FootPoses, Side
from nadia_balance.parameters.bounds import bounded, check

_SIDES = ("left", "right")
_DISPLACED = 0.2  # foothold error, over w_nom, larger only after pushes [-]
_INSTANT = 1e-5  # keeps rates finite; a phase lasts at least one tick [s]
_ROUNDING = 1e-9  # tolerance of a rise [m]
_NEXT = 3  # steps that are brought within reach
# Share of the way to the edge of the reach, along and outward, for steps back:
# at the gait's pace, the ankle of the other foot would else meet its limit [-].
_RETURN = np.array([0.5, 0.7])


@dataclass(kw_only=True)
class StepVector:
    """The displacement of the next step, in the frame between the feet."""

    length: float = bounded(0.0, unit="m")  # forward
    sideways: float = bounded(0.0, unit="m")  # to the left
    # Turn to the left [deg].
    yaw_deg: float = bounded(0.0, least=-90.0, most=90.0)


@dataclass(kw_only=True)
class Foothold:
    """A foothold in the frame between the feet at the start."""

    side: str = bounded("left", one_of=_SIDES)  # the foot that moves
    x: float = bounded(0.0, unit="m", of="tread")  # sole centre, forward
    y: float = bounded(0.0, unit="m")  # sole centre, to the left
    yaw_deg: float = bounded(0.0, least=-3600.0, most=3600.0)  # [deg]


@dataclass(kw_only=True)
class Gait:
    """A walking command.

    At most one of: `num_steps` times the same `step`, the list `steps`, or the
    list `footholds` with alternating sides.
    """

    num_steps: int = bounded(0, least=0, most=10000)  # repetitions of `step`
    step: StepVector = field(default_factory=StepVector)
    steps: list[StepVector] = field(default_factory=list)
    footholds: list[Foothold] = field(default_factory=list)
    # Distance of the sole centres; None: that of the standing robot.
    step_width: float | None = bounded(None, above=0.0, below=1.0, unit="m")
    first_swing: str = bounded("right", one_of=_SIDES)
    swing_duration: float = bounded(0.7, least=0.02, most=10.0, unit="s")
    transfer_duration: float = bounded(0.3, least=0.02, most=10.0, unit="s")
    # Standing before the first transfer.
    standing_duration: float = bounded(0.5, least=0.0, unit="s")
    # Durations of the transfers before the first and after the last step.
    initial_transfer_duration: float = bounded(
        0.8, least=0.02, most=10, unit="s"
    )
    final_transfer_duration: float = bounded(0.8, least=0.02, most=10, unit="s")

    @property
    def has_steps(self) -> bool:
        """True if it has any step."""
        return bool(self.num_steps or self.steps or self.footholds)

    def validate_more(self) -> None:
        """Raises ValueError if the steps contradict each other."""
        given = [self.num_steps > 0, bool(self.steps), bool(self.footholds)]
        if sum(given) > 1:
            raise ValueError(
                "num_steps, steps, footholds: must give only one of them"
            )
        for i, (last, hold) in enumerate(itertools.pairwise(self.footholds), 1):
            if hold.side == last.side:
                raise ValueError(
                    f"footholds[{i}].side = {hold.side!r}: must be "
                    f"{Side(hold.side).other.value}, as the feet take turns"
                )


def make_footsteps(
    gait: Gait,
    feet: FootPoses,
    reach: Reach,
    ground: terrain.Ground | None = None,
) -> tuple[walking.Footstep, ...]:
    """Returns the footsteps of `gait` for a robot that stands at `feet`.

    With a `ground`, step vectors end at the nearest foothold.

    Raises ValueError: a field of `gait` is out of range, or a footstep is not
    within `reach` of the stance foot, or not on the `ground`.
    """
    check(gait)
    transfer, swing = gait.initial_transfer_duration, gait.swing_duration
    wanted: list[walking.Footstep] = []
    for side, pose in _poses(gait, feet):
        wanted.append(walking.Footstep(side, pose, transfer, swing))
        transfer = gait.transfer_duration
    steps = tuple(wanted)
    if ground is not None:
        limit = None if gait.footholds else reach
        steps = terrain.steps_on(ground, steps, feet, limit)
    _check(steps, feet, reach)
    return steps


def walking_start(
    gait: Gait, model: PointMassModel, place: FootPose = walking.ORIGIN
) -> walking.WalkingState:
    """Returns the initial walking state of a standing robot.

    The feet are side by side about `place`, the gait's or else the robot's
    `step_width` apart; the first transfer begins after the gait's
    `standing_duration`, or a tick later.  Without steps, standing does not end.

    Raises ValueError: see `make_footsteps`.
    """
    width = model.step_width if gait.step_width is None else gait.step_width
    feet = FootPoses(
        *(place.displaced(0.0, 0.5 * side.sign * width) for side in Side)
    )
    if model.ground is not None:
        feet = terrain.standing_on(model.ground, feet)
    steps = make_footsteps(gait, feet, model.reach, model.ground)
    first = steps[0].side if steps else Side(gait.first_swing)
    centre = middle(feet).p_WF[:2]
    schedule = walking.ContactSchedule(
        phase=walking.Phase.STANDING,
        support_side=first.other,
        duration=max(gait.standing_duration, _INSTANT) if steps else math.inf,
        feet=feet,
        footsteps=steps,
        start=walking.ReferencePoint(centre, np.zeros(2), centre),
        final_transfer_duration=gait.final_transfer_duration,
    )
    return walking.WalkingState(schedule)


def middle(feet: FootPoses) -> FootPose:
    """Returns the frame half-way between the soles."""
    left, right = feet.left, feet.right
    turn = math.remainder(right.yaw - left.yaw, math.tau)
    return FootPose(0.5 * (left.p_WF + right.p_WF), left.yaw + 0.5 * turn)


def _poses(gait: Gait, feet: FootPoses) -> Iterator[tuple[Side, FootPose]]:
    frame = middle(feet)
    if gait.footholds:
        for hold in gait.footholds:
            yaw = math.radians(hold.yaw_deg)
            yield Side(hold.side), frame.displaced(hold.x, hold.y, yaw)
        return
    vectors = gait.steps or [gait.step] * gait.num_steps
    if vectors and vectors[-1] != StepVector():
        vectors = [*vectors, StepVector()]  # which brings the feet together
    width = gait.step_width
    if width is None:
        width = math.dist(feet.left.p_WF[:2], feet.right.p_WF[:2])
    side = Side(gait.first_swing)
    for v in vectors:
        yaw = math.radians(v.yaw_deg)
        frame = frame.displaced(v.length, v.sideways, yaw)
        yield side, frame.displaced(0.0, side.sign * 0.5 * width)
        side = side.other


def _check(
    steps: tuple[walking.Footstep, ...], feet: FootPoses, reach: Reach
) -> None:
    """Raises ValueError if a step is out of reach of the other foot."""
    for number, step in enumerate(steps, start=1):
        stance = feet[step.side.other]
        p_F = stance.to_sole(step.pose.p_WF[None, :2])[0]
        x, y = p_F[0], step.side.sign * p_F[1]
        what = f"step {number} ({step.side.value})"
        if not reach.in_base_region(x, y):
            raise ValueError(
                f"{what}: {x:.3f} m forward and {y:.3f} m out of the stance "
                f"foot: must be within {reach.describe()}"
            )
        rise = float(step.pose.p_WF[2] - stance.p_WF[2])
        if abs(rise) > reach.rise_max + _ROUNDING:
            raise ValueError(
                f"{what}: {rise:+.3f} m above the stance foot: must be within "
                f"rise_max = {reach.rise_max} m"
            )
        feet = feet.with_foot(step.side, step.pose)


def remaining_footsteps(
    plan: tuple[walking.Footstep, ...],
    state: walking.WalkingState,
    feet: FootPoses,
    model: PointMassModel,
    period: float,
) -> tuple[walking.Footstep, ...]:
    """Returns the footsteps of a fixed `plan` after the present phase.

    The next ones are within reach of the measured soles `feet`, with the foot
    in the air as if it landed now.  In the `state` before the first step,
    there are none until this tick of `period` [s] ends the time to stand.
    """
    taken, landed = state.steps_taken, None
    if state.schedule.phase is walking.Phase.SWING:
        landed = plan[taken]
        taken += 1
    if state.schedule.phase is walking.Phase.STANDING:
        if state.remaining_time > 1.5 * period:
            return ()
    return within_reach(plan[taken:], feet, model.reach, landed, model.ground)


def within_reach(
    commanded: tuple[walking.Footstep, ...],
    feet: FootPoses,
    reach: Reach,
    landed: walking.Footstep | None = None,
    ground: terrain.Ground | None = None,
) -> tuple[walking.Footstep, ...]:
    """Returns the footsteps, the first three within reach.

    After an adjusted step, the next commanded foothold may be out of reach, or
    on the wrong side of the stance foot: it is moved to the nearest foothold
    with uncrossed legs.  Each step is relative to the previous one, so that the
    feet return to the commanded footholds in a few steps, each at most
    `_RETURN` of the way from the step as commanded to the edge of the reach.
    `landed` is the command of the previous step, or None: if the foot landed
    there, the next step may use the full reach.  With a `ground`, the step is
    moved to the nearest foothold, if any.  An unchanged step is the same one.
    """
    back, last = False, landed
    if landed is not None:
        away = math.dist(feet[landed.side].p_WF[:2], landed.pose.p_WF[:2])
        back = away > _DISPLACED * reach.width_nominal
    steps = []
    for step in commanded[:_NEXT]:
        command, stance = step, feet[step.side.other]
        mirror = np.array([1.0, step.side.sign])
        p_F, meant = (
            mirror * foot.to_sole(step.pose.p_WF[None, :2])[0]
            for foot in (stance, last.pose if back and last else stance)
        )
        share = _RETURN if back else np.ones(2)
        rise = abs(step.pose.p_WF[2] - stance.p_WF[2]) if ground else 0.0
        within = p_F, _scaled(p_F, meant, 1.0 / share)
        back = rise > reach.rise_max + _ROUNDING or not all(
            reach.in_base_region(*p) for p in within
        )
        if back:
            region = _share_of_region(reach, meant, share)
            xy = stance.to_world((mirror * project(p_F, region))[None])[0]
            p_WF = np.append(xy, step.pose.p_WF[2])
            step = replace(step, pose=replace(step.pose, p_WF=p_WF))
            if ground is not None:
                both = region, base_region(reach)
                parts = [in_world(part, stance, step.side) for part in both]
                of = step, parts, float(stance.p_WF[2]), reach.rise_max
                step = terrain.moved_to(ground, *of) or step
        feet, last = feet.with_foot(step.side, step.pose), command
        steps.append(step)
    return (*steps, *commanded[_NEXT:])


def _share_of_region(reach: Reach, meant: Array, share: Array) -> Array:
    """Returns the scaled part (n, 2) [m] of the base region; if empty, all."""
    region = base_region(reach)
    part = intersection(convex_hull(_scaled(region, meant, share)), region)
    return part if len(part) else region


def _scaled(points: Array, meant: Array, share: Array) -> Array:
    """Returns footholds (..., 2); scales their way from `meant`, not inward."""
    way = points - meant
    scaled: Array = np.where(way < [-math.inf, 0.0], 1.0, share) * way
    return meant + scaled
