"""Footsteps by need and by command: to catch the robot, to walk, to stand.

Neither paper has this: their footsteps are given.  A robot that stands steps
when the ICP has left its feet, with the foot that captures it in fewer steps;
a robot that walks takes steps of the commanded velocity times their duration.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nadia_balance.core.body.ground import moved_to
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import (
    BASE,
    base_region,
    distance_between,
    in_world,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    closest_point,
    contains,
    convex_hull,
    intersection,
    project,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    capture_region,
)
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Mode,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.parameters.bounds import bounded, parameters

_HALVINGS = 12  # of an interval of times [-]
_STILL = 1e-6  # slower commands are to stand [m/s], [rad/s]
# ICP errors in calm_error [-]: the least of a robot that has been pushed, and
# the largest of one that is still enough to square its feet.
_PUSHED, _CALM = 2.0, 0.5


@parameters
class FootstepPlannerParams:
    """When to step, how fast, and when to stand again."""

    swing_duration: float = bounded(
        0.6,
        doc="swing duration of steps by command",
        least=0.02,
        most=10.0,
        unit="s",
    )
    transfer_duration: float = bounded(
        0.2,
        doc="transfer duration of steps by command",
        least=0.02,
        most=10.0,
        unit="s",
    )
    initial_transfer_duration: float = bounded(
        0.6,
        doc="duration of the transfer before the first step by command",
        least=0.02,
        most=10.0,
        unit="s",
    )
    least_share: float = bounded(
        0.45,
        doc="least share of these durations, for commands that need shorter "
        "steps",
        above=0.0,
        most=1.0,
    )
    closing_share: float = bounded(
        0.75,
        doc="share of them that the step takes which ends a walk",
        above=0.0,
        most=1.0,
    )
    num_steps: int = bounded(
        4, doc="number of steps queued by command", least=1, most=10
    )
    acceleration: float = bounded(
        0.6, doc="limit of the change of speed", above=0.0, unit="m/s^2"
    )
    yaw_acceleration: float = bounded(
        1.5,
        doc="limit of the change of the turning speed",
        above=0.0,
        unit="rad/s^2",
    )
    share_of_reach: float = bounded(
        0.5,
        doc="share of the reach that commands may use, ahead and beyond side "
        "by side: from farther apart, the trunk has to help a foot on",
        above=0.0,
        most=1.0,
    )
    share_of_swing: float = bounded(
        0.9,
        doc="share of a swing in which its foot must be able to come",
        above=0.0,
        most=1.0,
    )
    max_turn_deg: float = bounded(
        30.0,
        doc="largest turn of a foot to the other one by command",
        above=0.0,
        most=90.0,
        unit="deg",
    )
    revised_share: float = bounded(
        0.4,
        doc="share of a swing in which its foothold follows the command",
        least=0.0,
        most=1.0,
    )
    recovery_swing_duration: float = bounded(
        0.4,
        doc="swing duration of steps that catch the robot",
        least=0.02,
        most=10.0,
        unit="s",
    )
    recovery_transfer_duration: float = bounded(
        0.06,
        doc="transfer duration of steps that catch the robot",
        least=0.02,
        most=10.0,
        unit="s",
    )
    held_outside: float = bounded(
        0.015,
        doc="distance of the ICP outside of the support that ankles and hips "
        "hold",
        least=0.0,
        unit="m",
    )
    calm_error: float = bounded(
        0.04,
        doc="ICP error below which a robot is calm at touchdown",
        above=0.0,
        unit="m",
    )
    square_length: float = bounded(
        0.05,
        doc="largest distance along the foot from side by side, to stand",
        above=0.0,
        unit="m",
    )
    square_width: float = bounded(
        0.05,
        doc="largest distance across the foot from side by side, to stand",
        above=0.0,
        unit="m",
    )
    square_yaw_deg: float = bounded(
        6.0,
        doc="largest turn from side by side, to stand",
        above=0.0,
        most=90.0,
        unit="deg",
    )


@dataclass(frozen=True)
class Capture:
    """How a foot can catch the robot; in order, less is better."""

    steps: int  # that capture the ICP; one more than are tried: none does
    gap: float  # of the reach from the capture region [m]; 0 if it is captured
    crosses: bool  # the legs
    time: float  # of the foot's motion, to the millisecond [s]

    @property
    def cost(self) -> tuple[float, ...]:
        """The numbers to compare.

        Crossing counts as a step: the next foot has to come round this one.
        """
        return self.steps + self.crosses, self.gap, self.crosses, self.time


def velocity_limits(
    params: FootstepPlannerParams, model: PointMassModel
) -> Array:
    """The limits of a velocity command: forward, left, turn, each alone.

    They hold for steps as planned or as short as `least_share`.

    Args:
        params: step durations, and shares of reach and swing.
        model: reach, step width and speed of the swing foot.

    Returns:
        The least and the largest velocity (2, 3) [m/s], [m/s], [rad/s].
    """
    paces = [_limits(params, model, p) for p in (1.0, params.least_share)]
    return np.array([np.min(paces, axis=0)[0], np.max(paces, axis=0)[1]])


def within_limits(velocity: Array, limits: Array) -> Array:
    """The velocity, slower in the same direction if it is too fast.

        |velocity / limits| <= 1

    A foot that moves ahead, aside and round at once has one way to go, and one
    time for it: full speed in two of these would ask for twice of it.

    Neither paper has this.

    Args:
        velocity: forward, left and turn (3,) [m/s], [m/s], [rad/s].
        limits: the least and the largest of each alone, below and above 0
            (2, 3) [m/s], [m/s], [rad/s].

    Returns:
        The velocity (3,) [m/s], [m/s], [rad/s].
    """
    return velocity / max(_share_of(velocity, limits), 1.0)


def _share_of(velocity: Array, limits: Array) -> float:
    """Returns the norm [-] of a velocity: 1 on the ellipsoid of `limits`."""
    limit = np.where(velocity > 0.0, limits[1], -limits[0])
    return math.hypot(*(velocity / np.maximum(limit, _STILL)).tolist())


def pace(
    params: FootstepPlannerParams, model: PointMassModel, velocity: Array
) -> float:
    """The share of their durations that steps take at a velocity.

    Args:
        params: step durations, and shares of reach and swing.
        model: reach, step width and speed of the swing foot.
        velocity: forward, left and turn (3,) [m/s], [m/s], [rad/s].

    Returns:
        1, or less if it is too fast for the reach in steps as long as planned;
        at least `least_share` [-].
    """
    share = _share_of(velocity, _limits(params, model, 1.0))
    return min(max(1.0 / max(share, _STILL), params.least_share), 1.0)


def _limits(
    params: FootstepPlannerParams, model: PointMassModel, pace: float
) -> Array:
    """Returns the least and the largest velocity (2, 3) of a pace.

    A step is within `share_of_reach` of the base region, and its foot, which
    moves by two steps, is there within `share_of_swing`.
    """
    reach, detour, share = model.reach, model.detour, params.share_of_reach
    swing = (
        params.share_of_swing * pace * params.swing_duration - detour.settling
    )
    # time_from_rest, solved for the length.
    length = max(
        min(
            swing * detour.max_speed,
            0.25 * detour.max_acceleration * swing * swing,
        ),
        0.0,
    )
    ahead = min(share * reach.length_forward, 0.5 * length)
    back = min(share * reach.length_backward, 0.5 * length)
    aside = share * (reach.width_max - model.step_width) + room_inside(model)
    aside = 0.5 * min(aside, length)
    turn = math.radians(params.max_turn_deg)
    time = pace * (params.swing_duration + params.transfer_duration)
    return np.array([[-back, -aside, -turn], [ahead, aside, turn]]) / time


def room_inside(model: PointMassModel) -> float:
    """Half of the room that the reach has for feet closer than side by side.

    Args:
        model: step width and reach.

    Returns:
        The distance by which feet may come closer [m].
    """
    return 0.5 * max(model.step_width - model.reach.width_min, 0.0)


def _moves(velocity: Array) -> bool:
    """True unless the `velocity` (3,) is to stand."""
    return bool(np.any(np.abs(velocity) > _STILL))


@dataclass(frozen=True, eq=False)
class FootstepPlan:
    """The footstep planner of a robot.

    Args:
        params: when to step and how fast.
        model: soles, reach, swing foot and ground.
        adjuster: capture regions of the steps that catch the robot.
        min_swing_duration: that of the timing adaptation [s].
    """

    params: FootstepPlannerParams
    model: PointMassModel
    adjuster: CaptureRegionStepAdjusterParams
    min_swing_duration: float = 0.25

    def footsteps(
        self,
        state: WalkingState,
        velocity: Array,
        command: Array,
        icp: Array,
        reference: Array,
        feet: FootPoses,
        on: Mechanisms,
    ) -> tuple[Footstep, ...]:
        """Plans the footsteps after the present phase.

        In a swing, whose foot counts as landed, the first that holds:

        1. A velocity is commanded, and the ICP's error is less than _PUSHED:
           the next steps of the walk (`queue`).
        2. The ICP leaves the support: as few steps as capture it (`recovery`).
        3. The error is less than 1, and the step in the air catches nothing:
           the other foot is put beside it (`squaring`).
        4. The foot that is farther from the ICP is put beside the other one.

        In standing or a transfer, the first that holds:

        1. The ICP leaves the support: as few steps as capture it, of the better
           foot (`recovery`).
        2. A velocity is commanded: the next steps of the walk (`queue`).
        3. It stands, the error is less than _CALM, and its feet are not side by
           side: one step (`squaring`).

        Errors are in `calm_error`.

        Args:
            state: the walking state; in a swing, its foot counts as landed.
            velocity: that of the walk (3,), forward, left [m/s], turn [rad/s];
                it follows the command.
            command: the velocity commanded (3,).
            icp: the measured ICP (2,) [m] in W, by angular momentum.
            reference: the ICP of the plan (2,) [m] in W.
            feet: the measured soles.
            on: mechanisms; without `step`, nothing but a command moves a foot.

        Returns:
            The footsteps; () to stand.
        """
        schedule = state.schedule
        error = math.dist(icp, reference) / self.params.calm_error
        moves = _moves(self.after_step(velocity, command))
        if schedule.phase is Phase.SWING:
            side, displaced = schedule.support_side, self.is_displaced(state)
            if moves and error < _PUSHED:
                return self.queue(
                    side,
                    stance=feet[side.other],
                    velocity=velocity,
                    command=command,
                    first_transfer=(
                        self.shift(icp, side, feet) if displaced else None
                    ),
                )
            if on.step and self.leaves(feet, icp):
                return self.recovery(
                    (side,), schedule=schedule, feet=feet, icp=icp, on=on
                )
            if error < 1.0 and not displaced:
                return self.squaring(side, feet, closes=True)
            side = max(Side, key=lambda s: math.dist(feet[s].p_WF[:2], icp))
            return self.squaring(side, feet, icp, reactive=True)
        if on.step and self.leaves(feet, icp):
            return self.recovery(
                tuple(Side), schedule=schedule, feet=feet, icp=icp, on=on
            )
        if moves:
            side = self.first_side(schedule, command)
            return self.queue(
                side,
                stance=feet[side.other],
                velocity=velocity,
                command=command,
                first_transfer=self.params.initial_transfer_duration,
            )
        if schedule.phase is Phase.STANDING and error < _CALM:
            return self.squaring(schedule.support_side.other, feet)
        return ()

    def other_foot(
        self,
        state: WalkingState,
        icp: Array,
        reference: Array,
        feet: FootPoses,
        on: Mechanisms,
    ) -> tuple[Footstep, ...] | None:
        """Plans the steps of the foot that is to stay, if it catches better.

        After a push in a transfer, the ICP may be at the foot to be lifted.
        Neither paper has this.

        Args:
            state: walking state, in a transfer.
            icp: the measured ICP (2,) [m] in W, by angular momentum.
            reference: the ICP of the plan (2,) [m] in W.
            feet: the measured soles.
            on: mechanisms, of which `step` and `cross_over` count.

        Returns:
            As few steps as capture the ICP; None: the foot that is to step
            needs no more, or is farther from the ICP, or there was no push.
        """
        schedule, stays = state.schedule, state.schedule.support_side
        far, near = (
            math.dist(icp, feet[side].p_WF[:2]) for side in (stays, stays.other)
        )
        if (
            not on.step
            or not schedule.footsteps
            or schedule.footsteps[0].reactive
            or far < near
            or math.dist(icp, reference) < _PUSHED * self.params.calm_error
        ):
            return None
        better, planned = (
            self.capture(schedule, side, feet=feet, icp=icp, on=on)
            for side in (stays, stays.other)
        )
        if better.cost[:2] >= planned.cost[:2]:
            return None
        return self.catching_steps(stays, feet[stays.other])[: better.steps]

    def is_displaced(self, state: WalkingState) -> bool:
        """True if the step in the air is not where it was commanded.

        The ICP is then not on its way to the next foot, as in a walk: it takes
        as long a transfer as from standing.

        Args:
            state: walking state in a swing.

        Returns:
            True for a reactive step, too.
        """
        adjustment = state.adjustment
        return state.schedule.footsteps[0].reactive or (
            adjustment is not None
            and math.dist(
                adjustment.pose.p_WF[:2], adjustment.nominal.pose.p_WF[:2]
            )
            > self.params.calm_error
        )

    def after_step(self, velocity: Array, command: Array) -> Array:
        """Velocity v + clip(command - v, -a T, a T), with T of a step.

        Args:
            velocity: velocity v of the walk (3,), forward, left [m/s], turn
                [rad/s].
            command: the velocity commanded (3,).

        Returns:
            The velocity (3,) at the next landing.
        """
        p = self.params
        change = (p.swing_duration + p.transfer_duration) * np.array(
            [p.acceleration, p.acceleration, p.yaw_acceleration]
        )
        return velocity + np.clip(command - velocity, -change, change)

    def recovery(
        self,
        sides: tuple[Side, ...],
        schedule: ContactSchedule,
        feet: FootPoses,
        icp: Array,
        on: Mechanisms,
    ) -> tuple[Footstep, ...]:
        """Minimise the cost of the Capture over the feet.

        Args:
            sides: feet that may step.
            schedule: present phase.
            feet: measured soles in W.
            icp: measured ICP (2,) in W [m].
            on: mechanisms, of which `cross_over` counts.

        Returns:
            As few steps as capture the ICP, of the best of the feet.
        """
        captures = {
            side: self.capture(schedule, side, feet=feet, icp=icp, on=on)
            for side in sides
        }
        # Two equal feet: the one with less weight by the plan.
        side = min(
            sides, key=lambda s: (captures[s].cost, s is schedule.support_side)
        )
        return self.catching_steps(side, feet[side.other])[
            : captures[side].steps
        ]

    def revised(
        self, state: WalkingState, velocity: Array, command: Array
    ) -> tuple[Footstep, ...] | None:
        """Plans the footsteps that have not landed, by the command now.

        They follow a command that has changed, until the foot in the air is
        too far on its way; never in a recovery.

        Args:
            state: walking state.
            velocity: that of the walk (3,), forward, left [m/s], turn [rad/s].
            command: the velocity commanded (3,).

        Returns:
            The footsteps; None: as they are.
        """
        schedule, steps = state.schedule, state.schedule.footsteps
        if not steps or state.mode is Mode.RECOVERING:
            return None
        swings = schedule.phase is Phase.SWING
        if swings and (
            state.time_in_phase > self.params.revised_share * schedule.duration
        ):
            return None
        side, stance = steps[0].side, schedule.feet[steps[0].side.other]
        if _moves(self.after_step(velocity, command)):
            revised = self.queue(side, stance, velocity, command)
        elif swings:
            pose = self.beside(side, stance)
            revised = (replace(steps[0], pose=pose),) if pose else ()
        else:
            revised = self.squaring(side, schedule.feet)
        if swings and not revised or self._are_near(steps, revised):
            return None
        return revised

    def _are_near(
        self, steps: tuple[Footstep, ...], others: tuple[Footstep, ...]
    ) -> bool:
        """True if no step differs by more than the adjuster's dead band."""
        return len(steps) == len(others) and all(
            math.dist(one.pose.p_WF[:2], two.pose.p_WF[:2])
            + abs(math.remainder(one.pose.yaw - two.pose.yaw, math.tau))
            * self.model.step_width
            < self.adjuster.dead_band
            for one, two in zip(steps, others, strict=True)
        )

    def leaves(self, feet: FootPoses, icp: Array) -> bool:
        """True if the ICP is beyond what both soles and hips hold.

        Args:
            feet: measured soles in W.
            icp: measured ICP (2,) in W [m].

        Returns:
            False up to `held_outside` of the hull of both soles.
        """
        corners = [feet[side].to_world(self.model.cop_area) for side in Side]
        both = convex_hull(np.concatenate(corners))
        return not contains(icp, both, self.params.held_outside)

    def first_side(self, schedule: ContactSchedule, command: Array) -> Side:
        """Chooses the foot that begins a walk: the one that leads.

        Args:
            schedule: present phase.
            command: the velocity commanded (3,).

        Returns:
            The foot that steps.
        """
        _, left, turn = command.tolist()
        for aside in left, turn:
            if abs(aside) > _STILL:
                return Side.LEFT if aside > 0.0 else Side.RIGHT
        return schedule.support_side.other

    def beside(self, side: Side, stance: FootPose) -> FootPose | None:
        """Places a foot `step_width` beside the stance foot.

        Args:
            side: foot to place.
            stance: stance foot in W.

        Returns:
            The pose in W, at the nearest foothold; None: no ground.
        """
        return self._placed(
            stance.displaced(0.0, side.sign * self.model.step_width),
            stance,
            side,
        )

    def squaring(
        self,
        side: Side,
        feet: FootPoses,
        icp: Array | None = None,
        closes: bool = False,
        reactive: bool = False,
    ) -> tuple[Footstep, ...]:
        """Plans the step that puts a foot beside the other one.

        Args:
            side: foot that steps.
            feet: soles in W.
            icp: measured ICP (2,) in W [m]: the nearer it is to the stance foot
                than in standing, the sooner the step; None: it begins as a walk
                does.
            closes: the step ends a walk, and is quick.
            reactive: the step still belongs to a recovery.

        Returns:
            One step; () if the foot is there, or cannot be.
        """
        p, stance = self.params, feet[side.other]
        pose = self.beside(side, stance)
        if pose is None or self._is_square(feet[side], pose):
            return ()
        share = 1.0
        if icp is not None:
            share = min(
                math.dist(icp, stance.p_WF[:2]) / (0.5 * self.model.step_width),
                1.0,
            )
        transfer, swing = p.transfer_duration, p.swing_duration
        transfer += share * (p.initial_transfer_duration - transfer)
        if closes:
            transfer = p.closing_share * p.transfer_duration
            swing = p.closing_share * p.swing_duration
        return (Footstep(side, pose, transfer, swing, reactive=reactive),)

    def shift(self, icp: Array, side: Side, feet: FootPoses) -> float:
        """The time in which the weight shifts from one foot to the other.

        The ICP is on its plan, and on its way.  A CoP that moves evenly from
        the centre of the one to that of the other in T leads an ICP there that
        has the share u of this way behind it, with (1 - exp(-w T)) / (w T) = u.
        Slower, the ICP passes the foot.

        Args:
            icp: measured ICP (2,) in W [m].
            side: foot that steps then.
            feet: soles in W.

        Returns:
            T [s], between a transfer of the walk and that of its begin.
        """
        start = feet[side].p_WF[:2]
        shift = feet[side.other].p_WF[:2] - start
        behind = float((icp - start) @ shift / (shift @ shift))
        shortest = self.params.transfer_duration
        longest = self.params.initial_transfer_duration
        for _ in range(_HALVINGS):
            time = 0.5 * (shortest + longest)
            x = self.model.omega * time
            if -math.expm1(-x) / x > behind:
                shortest = time
            else:
                longest = time
        return 0.5 * (shortest + longest)

    def _is_square(self, foot: FootPose, pose: FootPose) -> bool:
        """True if the `foot` is so close to its `pose` that it may stand."""
        x, y = pose.to_sole(foot.p_WF[:2]).tolist()
        return (
            abs(x) < self.params.square_length
            and abs(y) < self.params.square_width
            and abs(math.remainder(foot.yaw - pose.yaw, math.tau))
            < math.radians(self.params.square_yaw_deg)
        )

    def queue(
        self,
        side: Side,
        stance: FootPose,
        velocity: Array,
        command: Array,
        first_transfer: float | None = None,
    ) -> tuple[Footstep, ...]:
        """Each step takes the frame between the feet on by v T.

        With the velocity v at its landing, on its way to the command.  Of the
        lateral displacement of two steps the foot that leads takes what the
        other one leaves, which comes closer only by half of the room that the
        reach has for it.  A step without ground ends them.

        Args:
            side: foot that steps first.
            stance: the other foot in W.
            velocity: that of the walk (3,), forward, left [m/s], turn [rad/s].
            command: the velocity commanded (3,).
            first_transfer: its duration [s]; None: as the others.

        Returns:
            The next `num_steps` steps; fewer if they end side by side.
        """
        p, half = self.params, 0.5 * self.model.step_width
        room = room_inside(self.model)
        share = pace(p, self.model, self.after_step(velocity, command))
        transfer, swing = share * p.transfer_duration, share * p.swing_duration
        before = transfer if first_transfer is None else first_transfer
        frame = stance.displaced(0.0, side.sign * half)
        steps: list[Footstep] = []
        for _ in range(p.num_steps):
            velocity = self.after_step(velocity, command)
            x, y, turn = ((transfer + swing) * velocity).tolist()
            closer = math.copysign(min(abs(y), room), y)
            aside = 2.0 * y - closer if side.sign * y > 0.0 else closer
            frame = frame.displaced(x, aside, turn)
            placed = self._placed(
                frame.displaced(0.0, side.sign * half), stance, side
            )
            if placed is None:
                break
            steps.append(Footstep(side, placed, before, swing))
            if not _moves(velocity):
                break  # the feet are side by side
            before, stance, side = transfer, placed, side.other
        return tuple(steps)

    def catching_steps(
        self, side: Side, stance: FootPose
    ) -> tuple[Footstep, ...]:
        """Plans steps in place that catch the robot.

        Args:
            side: foot that steps first.
            stance: the other foot in W.

        Returns:
            As many steps as the capture region has; fewer without ground.
        """
        steps: list[Footstep] = []
        for _ in range(self.adjuster.num_steps):
            pose = self.beside(side, stance)
            if pose is None:
                break
            steps.append(
                Footstep(
                    side,
                    pose,
                    transfer_duration=self.params.recovery_transfer_duration,
                    swing_duration=self.params.recovery_swing_duration,
                    reactive=True,
                )
            )
            stance, side = pose, side.other
        return tuple(steps)

    def _placed(
        self, pose: FootPose, stance: FootPose, side: Side
    ) -> FootPose | None:
        """Returns the `pose`, within the base region, on the ground."""
        reach, mirror = self.model.reach, np.array([1.0, side.sign])
        p_F = mirror * stance.to_sole(pose.p_WF[:2])
        if not reach.in_base_region(*p_F):
            xy = stance.to_world(mirror * project(p_F, base_region(reach)))
            pose = replace(pose, p_WF=np.append(xy, pose.p_WF[2]))
        if self.model.ground is None:
            return pose
        step = moved_to(
            self.model.ground,
            Footstep(side, pose, 0.0, 0.0),
            within=[in_world(base_region(reach), stance, side)],
            height=float(stance.p_WF[2]),
            rise=reach.rise_max,
        )
        return None if step is None else step.pose

    def capture(
        self,
        schedule: ContactSchedule,
        side: Side,
        feet: FootPoses,
        icp: Array,
        on: Mechanisms,
    ) -> Capture:
        """Minimise the cost over the steps n and the regions of the reach.

        The foot goes to the point of its reach that is closest to the capture
        region C_n of the earliest touchdown; C_n is then that of the time at
        which it can be there.

        Args:
            schedule: present phase.
            side: foot that steps.
            feet: measured soles in W.
            icp: measured ICP (2,) in W [m].
            on: mechanisms, of which `cross_over` counts.

        Returns:
            How the foot can catch the ICP.
        """
        nowhere = Capture(
            steps=self.adjuster.num_steps + 1,
            gap=math.inf,
            crosses=False,
            time=0.0,
        )
        steps = self.catching_steps(side, feet[side.other])
        if not steps:
            return nowhere
        geometry = SwingGeometry(
            replace(
                schedule,
                phase=Phase.SWING,
                support_side=side.other,
                feet=feet,
                footsteps=steps,
            ),
            params=self.adjuster,
            model=self.model,
            on=on,
        )
        return min(
            self._captures(geometry, feet[side].p_WF[:2], icp),
            key=lambda capture: capture.cost,
            default=nowhere,
        )

    def _captures(
        self, geometry: SwingGeometry, start: Array, icp: Array
    ) -> Iterator[Capture]:
        """Yields how n steps catch the ICP, for each n and region of the reach.

        The swing foot starts at `start` (2,) [m] in W.
        """
        transfer = self.params.recovery_transfer_duration
        soonest = transfer + self.min_swing_duration

        waiting_time = self.adjuster.waiting_time
        first = geometry.one_step_region(icp, (soonest, soonest + waiting_time))
        for number, offsets in enumerate(geometry.offsets, start=1):
            region = capture_region(first, offsets)
            for place in geometry.places:
                time = self.model.detour.time_of_way(
                    start,
                    goal=_nearest(start, place.polygon, region),
                    stance=geometry.stance,
                    swing=geometry.swing,
                )
                touchdown = max(soonest, transfer + time)
                later = geometry.one_step_region(
                    icp, (touchdown, touchdown + waiting_time)
                )
                gap = distance_between(
                    place.polygon, capture_region(later, offsets)
                )
                yield Capture(
                    steps=number if gap == 0.0 else len(geometry.offsets) + 1,
                    gap=round(gap, 3),
                    crosses=place.reach != BASE,
                    time=round(time, 3),
                )


def _nearest(start: Array, reach: Array, region: Array) -> Array:
    """Returns the point (2,) of `reach` in or closest to `region`."""
    common = intersection(reach, region)
    if len(common):
        return project(start, common)
    return closest_point(reach, region)[0]
