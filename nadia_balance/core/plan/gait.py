"""Footsteps from user commands: step vectors, or a list of footholds."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from nadia_balance.core.body.ground import (
    Ground,
    moved_to,
    standing_on,
    steps_on,
)
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import (
    ReachabilityParams,
    base_region,
    in_world,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import convex_hull, intersection, project
from nadia_balance.core.walking.state import (
    ORIGIN,
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.parameters.bounds import (
    bounded,
    check,
    check_type,
    parameters,
    require,
)

_SIDES = ("left", "right")
_DISPLACED = 0.2  # foothold error, over w_nom, larger only after pushes [-]
_INSTANT = 1e-5  # keeps rates finite; a phase lasts at least one tick [s]
_ROUNDING = 1e-9  # tolerance of a rise [m]
_NEXT = 3  # steps that are brought within reach
# Share of the distance to the edge of the reach, along and outward, for steps
# back: at the gait's pace, the ankle of the other foot would else meet its
# limit [-].
_RETURN = np.array([0.5, 0.7])


@parameters
class StepVector:
    """The displacement of the next step, in the frame between the feet."""

    length: float = bounded(0.0, doc="displacement forward", unit="m")
    sideways: float = bounded(0.0, doc="displacement to the left", unit="m")
    yaw_deg: float = bounded(
        0.0, doc="turn to the left in degrees", least=-90.0, most=90.0
    )


@parameters
class Foothold:
    """A foothold in the frame between the feet at the start."""

    side: str = bounded("left", doc="foot that moves", one_of=_SIDES)
    x: float = bounded(0.0, doc="sole centre, forward", unit="m", of="tread")
    y: float = bounded(0.0, doc="sole centre, to the left", unit="m")
    yaw_deg: float = bounded(
        0.0, doc="turn to the left in degrees", least=-3600.0, most=3600.0
    )


@parameters
class Gait:
    """A walking command.

    At most one of: `num_steps` times the same `step`, the list `steps`, or the
    list `footholds` with alternating sides.
    """

    num_steps: int = bounded(
        0, doc="number of repetitions of `step`", least=0, most=10000
    )
    step: StepVector = bounded(StepVector, doc="step that is repeated")
    steps: list[StepVector] = bounded(list, doc="one step after the other")
    footholds: list[Foothold] = bounded(
        list, doc="one foothold after the other"
    )
    step_width: float | None = bounded(
        None,
        doc="distance of the sole centres; none: that of the standing robot",
        above=0.0,
        below=1.0,
        unit="m",
    )
    first_swing: str = bounded(
        "right", doc="foot that moves first", one_of=_SIDES
    )
    swing_duration: float = bounded(
        0.7, doc="duration of a swing", least=0.02, most=10.0, unit="s"
    )
    transfer_duration: float = bounded(
        0.3, doc="duration of a transfer", least=0.02, most=10.0, unit="s"
    )
    standing_duration: float = bounded(
        0.5,
        doc="duration of standing before the first transfer",
        least=0.0,
        unit="s",
    )
    initial_transfer_duration: float = bounded(
        0.8,
        doc="duration of the transfer before the first step",
        least=0.02,
        most=10,
        unit="s",
    )
    final_transfer_duration: float = bounded(
        0.8,
        doc="duration of the transfer after the last step",
        least=0.02,
        most=10,
        unit="s",
    )

    @property
    def has_steps(self) -> bool:
        """True if it has any step."""
        return bool(self.num_steps or self.steps or self.footholds)

    def validate_more(self) -> None:
        """Checks that the steps do not contradict each other.

        Raises:
            ValueError: steps in more than one form, or a foot moves twice.
        """
        given = [self.num_steps > 0, bool(self.steps), bool(self.footholds)]
        require(
            sum(given) <= 1,
            "num_steps, steps, footholds: must give only one of them",
        )
        for i, (last, hold) in enumerate(itertools.pairwise(self.footholds), 1):
            require(
                hold.side != last.side,
                f"footholds[{i}].side = {hold.side!r}: must be "
                f"{Side(hold.side).other.value}, as the feet take turns",
            )


def make_footsteps(
    gait: Gait,
    feet: FootPoses,
    reach: ReachabilityParams,
    ground: Ground | None = None,
) -> tuple[Footstep, ...]:
    """The footsteps of a gait.

    Args:
        gait: walking command.
        feet: soles of the standing robot in W.
        reach: reach of each foot from the other one.
        ground: regions with footholds, at the nearest of which step vectors
            end; None: flat ground.

    Returns:
        The footsteps; the feet take turns.

    Raises:
        ValueError: a field of `gait` is out of range, or a footstep is not
            within `reach` of the stance foot, or not on the `ground`.
    """
    check(gait)
    transfer = gait.initial_transfer_duration
    steps: tuple[Footstep, ...] = ()
    for side, pose in _poses(gait, feet):
        steps += (Footstep(side, pose, transfer, gait.swing_duration),)
        transfer = gait.transfer_duration
    if ground is not None:
        steps = steps_on(ground, steps, feet, None if gait.footholds else reach)
    _check(steps, feet, reach)
    return steps


def walking_start(
    gait: Gait, model: PointMassModel, place: FootPose = ORIGIN
) -> WalkingState:
    """The initial walking state of a standing robot.

    The feet are side by side, the gait's or else the robot's `step_width`
    apart; the first transfer begins after the gait's `standing_duration`, or a
    tick later.  Without steps, standing does not end.

    Args:
        gait: walking command.
        model: step width, reach and ground.
        place: frame between the feet in W.

    Returns:
        The walking state, with all footsteps of the gait.

    Raises:
        ValueError: see `make_footsteps`; `model` is none, or does not stand as
            wide.
    """
    check_type("model", model, PointMassModel)
    width, reach = model.step_width, model.reach
    if gait.step_width is not None:
        width = gait.step_width
        require(
            reach.width_min <= width <= reach.width_max,
            f"gait.step_width = {width}: must be in [{reach.width_min:.3g}, "
            f"{reach.width_max:.3g}] m, as the steps of the robot",
        )
    feet = FootPoses(
        left=place.displaced(0.0, 0.5 * width),
        right=place.displaced(0.0, -0.5 * width),
    )
    if model.ground is not None:
        feet = standing_on(model.ground, feet)
    steps = make_footsteps(gait, feet, reach=reach, ground=model.ground)
    first = steps[0].side if steps else Side(gait.first_swing)
    centre = middle(feet).p_WF[:2]
    return WalkingState(
        ContactSchedule(
            phase=Phase.STANDING,
            support_side=first.other,
            duration=(
                max(gait.standing_duration, _INSTANT) if steps else math.inf
            ),
            feet=feet,
            footsteps=steps,
            start=ReferencePoint(centre, np.zeros(2), centre),
            final_transfer_duration=gait.final_transfer_duration,
        )
    )


def middle(feet: FootPoses) -> FootPose:
    """The frame half-way between the soles.

    Args:
        feet: soles in W.

    Returns:
        The level frame, in W.
    """
    left, right = feet.left, feet.right
    turn = math.remainder(right.yaw - left.yaw, math.tau)
    return FootPose(0.5 * (left.p_WF + right.p_WF), left.yaw + 0.5 * turn)


def _poses(gait: Gait, feet: FootPoses) -> Iterator[tuple[Side, FootPose]]:
    frame = middle(feet)
    if gait.footholds:
        for hold in gait.footholds:
            yield (
                Side(hold.side),
                frame.displaced(hold.x, hold.y, math.radians(hold.yaw_deg)),
            )
        return
    vectors = gait.steps or [gait.step] * gait.num_steps
    if vectors and vectors[-1] != StepVector():
        vectors = [*vectors, StepVector()]  # which brings the feet together
    width = gait.step_width
    if width is None:
        width = math.dist(feet.left.p_WF[:2], feet.right.p_WF[:2])
    side = Side(gait.first_swing)
    for vector in vectors:
        frame = frame.displaced(
            vector.length, vector.sideways, math.radians(vector.yaw_deg)
        )
        yield side, frame.displaced(0.0, side.sign * 0.5 * width)
        side = side.other


def _check(
    steps: tuple[Footstep, ...], feet: FootPoses, reach: ReachabilityParams
) -> None:
    """Raises ValueError if a step is out of reach of the other foot."""
    for number, step in enumerate(steps, start=1):
        stance = feet[step.side.other]
        x, left = stance.to_sole(step.pose.p_WF[None, :2])[0]
        y = step.side.sign * left
        require(
            reach.in_base_region(x, y),
            f"step {number} ({step.side.value}): {x:.3f} m forward and "
            f"{y:.3f} m out of the stance foot: must be within "
            f"{reach.describe()}",
        )
        rise = float(step.pose.p_WF[2] - stance.p_WF[2])
        require(
            abs(rise) <= reach.rise_max + _ROUNDING,
            f"step {number} ({step.side.value}): {rise:+.3f} m above the "
            f"stance foot: must be within rise_max = {reach.rise_max} m",
        )
        feet = feet.with_foot(step.side, step.pose)


def remaining_footsteps(
    plan: tuple[Footstep, ...],
    state: WalkingState,
    feet: FootPoses,
    model: PointMassModel,
    period: float,
) -> tuple[Footstep, ...]:
    """The footsteps of a fixed plan after the present phase.

    The next ones are within reach of the feet, with the foot in the air as if
    it landed now.  Before the first step, there are none until this tick ends
    the time to stand.

    Args:
        plan: all footsteps of the walk.
        state: walking state, whose `steps_taken` count in `plan`.
        feet: measured soles in W.
        model: reach and ground.
        period: control period [s].

    Returns:
        The footsteps, see `within_reach`.
    """
    phase = state.schedule.phase
    if phase is Phase.STANDING and state.remaining_time > 1.5 * period:
        return ()
    taken, landed = state.steps_taken, None
    if phase is Phase.SWING:
        landed = plan[taken]
        taken += 1
    return within_reach(
        plan[taken:],
        feet,
        reach=model.reach,
        landed=landed,
        ground=model.ground,
    )


def within_reach(
    commanded: tuple[Footstep, ...],
    feet: FootPoses,
    reach: ReachabilityParams,
    landed: Footstep | None = None,
    ground: Ground | None = None,
) -> tuple[Footstep, ...]:
    """The commanded footsteps, the first three within reach.

    After an adjusted step, the next commanded foothold may be out of reach, or
    on the wrong side of the stance foot: it is moved to the nearest foothold
    with uncrossed legs.  Each step is relative to the previous one, so that the
    feet return to the commanded footholds in a few steps, each at most
    `_RETURN` of the distance from the step as commanded to the edge of the
    reach.

    Args:
        commanded: footsteps in order; the feet take turns.
        feet: soles in W, of which the next step is made.
        reach: reach of each foot from the other one.
        landed: command of the previous step, or None; if the foot landed there,
            the next step may use the full reach.
        ground: regions, to the nearest foothold on which a step is moved, if
            there is any; None: flat ground.

    Returns:
        The footsteps; an unchanged one is the same object.
    """
    # The foot did not land where it was to: the feet return.
    returns = landed is not None and (
        math.dist(feet[landed.side].p_WF[:2], landed.pose.p_WF[:2])
        > _DISPLACED * reach.width_nominal
    )
    previous, steps = landed, []
    for command in commanded[:_NEXT]:
        stance = feet[command.side.other]
        step = _reachable(
            command,
            stance,
            origin=previous.pose if returns and previous else stance,
            share=_RETURN if returns else np.ones(2),
            reach=reach,
            ground=ground,
        )
        returns = step is not command
        feet, previous = feet.with_foot(step.side, step.pose), command
        steps.append(step)
    return (*steps, *commanded[_NEXT:])


def _reachable(
    command: Footstep,
    stance: FootPose,
    origin: FootPose,
    share: Array,
    reach: ReachabilityParams,
    ground: Ground | None,
) -> Footstep:
    """Returns the step `command` if it is within `share` (2,) of the reach.

    Another one otherwise: at the nearest foothold that is.  `origin` is the
    foot from which the command was meant to be made.
    """
    mirror, p_WF = np.array([1.0, command.side.sign]), command.pose.p_WF
    p_F = mirror * stance.to_sole(p_WF[None, :2])[0]
    meant = mirror * origin.to_sole(p_WF[None, :2])[0]
    rise = abs(p_WF[2] - stance.p_WF[2]) if ground is not None else 0.0
    if (
        rise <= reach.rise_max + _ROUNDING
        and reach.in_base_region(*p_F)
        and reach.in_base_region(*_scaled(p_F, meant, 1.0 / share))
    ):
        return command
    base = base_region(reach)
    part = intersection(convex_hull(_scaled(base, meant, share)), base)
    region = part if len(part) else base
    xy = stance.to_world((mirror * project(p_F, region))[None])[0]
    step = replace(
        command, pose=replace(command.pose, p_WF=np.append(xy, p_WF[2]))
    )
    if ground is None:
        return step
    moved = moved_to(
        ground,
        step,
        within=[in_world(part, stance, step.side) for part in (region, base)],
        height=float(stance.p_WF[2]),
        rise=reach.rise_max,
    )
    return moved or step


def _scaled(points: Array, meant: Array, share: Array) -> Array:
    """Returns footholds (..., 2), scaled about `meant`, but not inward."""
    offsets = points - meant
    return np.asarray(
        meant + np.where(offsets < [-math.inf, 0.0], 1.0, share) * offsets
    )
