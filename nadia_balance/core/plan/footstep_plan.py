"""Footsteps by need and by command: to catch the robot, to walk, to stand.

Neither paper has this: their footsteps are given.  A robot that stands steps
when the ICP has left its feet, with the foot that captures it in fewer steps;
a robot that walks takes steps of the commanded velocity times their duration.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from nadia_balance.core.body import ground as terrain
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import (
    BASE,
    base_region,
    closest_point,
    in_world,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    contains,
    convex_hull,
    intersection,
    project,
)
from nadia_balance.core.steps import capture_region as capture
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    Side,
)
from nadia_balance.parameters.bounds import bounded

_STILL = 1e-6  # slower commands are to stand [m/s], [rad/s]


@dataclass(kw_only=True)
class FootstepPlannerParams:
    """When to step, how fast, and when to stand again."""

    # Durations of steps by command.
    swing_duration: float = bounded(0.6, least=0.02, most=10.0, unit="s")
    transfer_duration: float = bounded(0.2, least=0.02, most=10.0, unit="s")
    # Duration of the transfer before the first step by command.
    initial_transfer_duration: float = bounded(
        0.6, least=0.02, most=10.0, unit="s"
    )
    # Least share of these durations, for commands that need shorter steps.
    least_share: float = bounded(0.45, above=0.0, most=1.0)
    # Share of them that the step takes which ends a walk.
    closing_share: float = bounded(0.75, above=0.0, most=1.0)
    num_steps: int = bounded(4, least=1, most=10)  # queued by command
    # Limits of the change of speed.
    acceleration: float = bounded(0.6, above=0.0, unit="m/s^2")
    yaw_acceleration: float = bounded(1.5, above=0.0, unit="rad/s^2")
    # Share of the reach that commands may use, ahead and beyond side by side:
    # from farther apart, the trunk has to help a foot on.
    share_of_reach: float = bounded(0.5, above=0.0, most=1.0)
    # Share of a swing in which its foot must be able to come.
    share_of_swing: float = bounded(0.9, above=0.0, most=1.0)
    # Largest turn of a foot to the other one by command.
    max_turn_deg: float = bounded(30.0, above=0.0, most=90.0, unit="deg")
    # Share of a swing in which its foothold follows the command.
    revised_share: float = bounded(0.4, least=0.0, most=1.0)
    # Durations of steps that catch the robot.
    recovery_swing_duration: float = bounded(
        0.4, least=0.02, most=10.0, unit="s"
    )
    recovery_transfer_duration: float = bounded(
        0.06, least=0.02, most=10.0, unit="s"
    )
    # Distance of the ICP outside of the support that ankles and hips hold.
    held_outside: float = bounded(0.015, least=0.0, unit="m")
    # ICP error below which a robot is calm at touchdown.
    calm_error: float = bounded(0.04, above=0.0, unit="m")
    # Feet that are this close to being side by side may stand.
    square_length: float = bounded(0.05, above=0.0, unit="m")
    square_width: float = bounded(0.05, above=0.0, unit="m")
    square_yaw_deg: float = bounded(6.0, above=0.0, most=90.0, unit="deg")


@dataclass(frozen=True)
class Capture:
    """How a foot can catch the robot; in order, less is better."""

    steps: int  # that capture the ICP; one more than are tried: none does
    gap: float  # of the reach from the capture region [m]; 0 if it is captured
    crosses: bool  # the legs
    time: float  # of the foot's way, to the millisecond [s]

    @property
    def cost(self) -> tuple[float, ...]:
        """The numbers to compare.

        Crossing counts as a step: the next foot has to come round this one.
        """
        return self.steps + self.crosses, self.gap, self.crosses, self.time


def velocity_limits(
    params: FootstepPlannerParams, model: PointMassModel
) -> Array:
    """Returns the limits (2, 3) of a velocity command: least, most.

    They are those of forward, left [m/s] and turn [rad/s], each alone, of steps
    as planned or as short as `least_share`.
    """
    slow, fast = (
        _limits(params, model, share) for share in (1.0, params.least_share)
    )
    most = np.maximum(slow, fast)
    return np.array([-most[1], most[0]])


def pace(
    params: FootstepPlannerParams, model: PointMassModel, velocity: Array
) -> float:
    """Returns the share [-] of their durations that steps take at `velocity`.

    1, or less if it is too fast for the reach in steps as long as planned.
    """
    limits = _limits(params, model, 1.0)
    ahead = np.where(velocity > 0.0, limits[0], limits[1])
    share = float(np.min(ahead / np.maximum(np.abs(velocity), _STILL)))
    return min(max(share, params.least_share), 1.0)


def _limits(
    params: FootstepPlannerParams, model: PointMassModel, pace: float
) -> Array:
    """Returns the largest speeds (2, 3), forwards and backwards, of a pace.

    A step is within `share_of_reach` of the base region, and its foot, which
    moves by two steps, is there within `share_of_swing`.
    """
    reach, share = model.reach, params.share_of_reach
    time = pace * (params.swing_duration + params.transfer_duration)
    detour = model.detour
    left = params.share_of_swing * pace * params.swing_duration
    left -= detour.settling
    # time_from_rest, solved for the length.
    way = min(
        left * detour.max_speed, 0.25 * detour.max_acceleration * left * left
    )
    way = max(way, 0.0)
    ahead = min(share * reach.length_forward, 0.5 * way)
    back = min(share * reach.length_backward, 0.5 * way)
    aside = share * (reach.width_max - model.step_width)
    aside = 0.5 * min(aside + room_inside(model), way)
    turn = math.radians(params.max_turn_deg)
    return np.array([[ahead, aside, turn], [back, aside, turn]]) / time


def room_inside(model: PointMassModel) -> float:
    """Returns the way [m] by which feet may come closer than side by side.

    It is half of the room that the reach has for it.
    """
    return 0.5 * max(model.step_width - model.reach.width_min, 0.0)


@dataclass(frozen=True, eq=False)
class FootstepPlan:
    """The footstep planner of a robot.

    `min_swing_duration` [s] is that of the timing adaptation.
    """

    params: FootstepPlannerParams
    model: PointMassModel
    adjuster: capture.CaptureRegionStepAdjusterParams
    min_swing_duration: float = 0.25

    def footsteps(
        self,
        state: walking.WalkingState,
        velocity: Array,
        command: Array,
        icp: Array,
        reference: Array,
        feet: FootPoses,
        on: Mechanisms,
    ) -> tuple[Footstep, ...]:
        """Returns the footsteps after the present phase; () to stand.

        1. The ICP has left the support, or a swing ends with a large error of
           it: as few steps as capture it, of the better foot (`recovery`).
        2. A velocity is commanded: its next steps (`queue`).
        3. The robot is calm, and its feet are not side by side: one step.

        Args:
            state: the walking state; in a swing, its foot counts as landed.
            velocity: that of the walk (3,), forward, left [m/s], turn [rad/s];
                it follows the command.
            command: the velocity commanded (3,).
            icp: the measured ICP (2,) [m] in W, by angular momentum.
            reference: the ICP of the plan (2,) [m] in W.
            feet: the measured soles.
            on: mechanisms; without `step`, nothing but a command moves a foot.
        """
        schedule, p = state.schedule, self.params
        error = math.dist(icp, reference)
        next_velocity = self.after_step(velocity, command)
        moves = bool(np.any(np.abs(next_velocity) > _STILL))
        if schedule.phase is Phase.SWING:
            side = schedule.support_side
            landed = feet[side.other]
            caught = self.was_caught(state)
            # A push has priority over the command.
            if moves and error < 2.0 * p.calm_error:
                return self.queue(side, landed, velocity, command, caught)
            if on.step and self.leaves(feet, icp):
                return self.recovery((side,), schedule, feet, icp, on)
            if error < p.calm_error and not caught:
                return self.squaring(side, feet, closes=True)
            side = max(Side, key=lambda s: math.dist(feet[s].p_WF[:2], icp))
            return self.squaring(side, feet, icp, reactive=True)
        if on.step and self.leaves(feet, icp):
            return self.recovery(tuple(Side), schedule, feet, icp, on)
        if moves:
            side = self.first_side(schedule, command)
            return self.queue(side, feet[side.other], velocity, command, True)
        calm = error < 0.5 * p.calm_error
        if schedule.phase is Phase.STANDING and calm:
            return self.squaring(schedule.support_side.other, feet)
        return ()

    def was_caught(self, state: walking.WalkingState) -> bool:
        """True if the step in the air of `state` is not where it was told.

        The ICP is then not on its way to the next foot, as in a walk: it takes
        as long a transfer as from standing.
        """
        adjustment = state.adjustment
        if state.schedule.footsteps[0].reactive:
            return True
        if adjustment is None:
            return False
        told = adjustment.nominal.pose.p_WF[:2]
        away = math.dist(adjustment.pose.p_WF[:2], told)
        return away > self.params.calm_error

    def after_step(self, velocity: Array, command: Array) -> Array:
        """Returns the velocity (3,) at the next landing, from `velocity` on."""
        p = self.params
        time = p.swing_duration + p.transfer_duration
        rates = np.array([p.acceleration, p.acceleration, p.yaw_acceleration])
        most = time * rates
        return velocity + np.clip(command - velocity, -most, most)

    def recovery(
        self,
        sides: tuple[Side, ...],
        schedule: walking.ContactSchedule,
        feet: FootPoses,
        icp: Array,
        on: Mechanisms,
    ) -> tuple[Footstep, ...]:
        """Returns as few steps as capture the ICP, of the best of the feet."""
        captures = {
            side: self.capture(schedule, side, feet, icp, on) for side in sides
        }
        # Two equal feet: the one with less weight by the plan.
        swings = schedule.support_side.other
        side = min(sides, key=lambda s: (captures[s].cost, s is not swings))
        return self.caught(side, feet[side.other])[: captures[side].steps]

    def revised(
        self, state: walking.WalkingState, velocity: Array, command: Array
    ) -> tuple[Footstep, ...] | None:
        """Returns the footsteps that have not landed, by the command now.

        None: as they are.  They follow a command that has changed, until the
        foot in the air is too far on its way; never in a recovery.
        """
        schedule, p = state.schedule, self.params
        steps = schedule.footsteps
        if not steps or state.mode is walking.Mode.RECOVERING:
            return None
        swings = schedule.phase is Phase.SWING
        if swings and state.time_in_phase > p.revised_share * schedule.duration:
            return None
        first = steps[0]
        if np.any(np.abs(self.after_step(velocity, command)) > _STILL):
            stance = schedule.feet[first.side.other]
            wanted = self.queue(first.side, stance, velocity, command)
        elif swings:
            pose = self.beside(first.side, schedule.feet[first.side.other])
            wanted = () if pose is None else (replace(first, pose=pose),)
        else:
            wanted = self.squaring(first.side, schedule.feet)
        pairs = zip(steps, wanted, strict=False)
        same = all(self._is_near(one.pose, two.pose) for one, two in pairs)
        if same and len(steps) == len(wanted) or swings and not wanted:
            return None
        return wanted

    def _is_near(self, one: FootPose, two: FootPose) -> bool:
        """True for a difference within the adjuster's dead band."""
        away = math.dist(one.p_WF[:2], two.p_WF[:2])
        turn = math.remainder(one.yaw - two.yaw, math.tau)
        return (
            away + abs(turn) * self.model.step_width < self.adjuster.dead_band
        )

    def leaves(self, feet: FootPoses, icp: Array) -> bool:
        """True if the ICP (2,) [m] is beyond what both soles and hips hold."""
        soles = [feet[side].to_world(self.model.cop_area) for side in Side]
        support = convex_hull(np.concatenate(soles))
        return not contains(icp, support, self.params.held_outside)

    def first_side(
        self, schedule: walking.ContactSchedule, command: Array
    ) -> Side:
        """Returns the foot that begins a walk: the one that leads."""
        _, left, turn = command.tolist()
        for aside in left, turn:
            if abs(aside) > _STILL:
                return Side.LEFT if aside > 0.0 else Side.RIGHT
        return schedule.support_side.other

    def beside(self, side: Side, stance: FootPose) -> FootPose | None:
        """Returns the foot of `side` beside the `stance` foot; None: no ground.

        Where there is none exactly there, the nearest foothold counts.
        """
        wanted = stance.displaced(0.0, side.sign * self.model.step_width)
        return self._placed(wanted, stance, side)

    def squaring(
        self,
        side: Side,
        feet: FootPoses,
        icp: Array | None = None,
        closes: bool = False,
        reactive: bool = False,
    ) -> tuple[Footstep, ...]:
        """Returns the step that puts the foot of `side` beside the other one.

        () if it is there, or cannot be.  A step that `closes` a walk is quick;
        any other begins as a walk does, or sooner if the `icp` (2,) [m] is told
        and nearer to the stance foot than in standing.  A `reactive` one still
        belongs to a recovery.
        """
        p, foot, stance = self.params, feet[side], feet[side.other]
        pose = self.beside(side, feet[side.other])
        if pose is None:
            return ()
        x, y = pose.to_sole(foot.p_WF[:2]).tolist()
        turn = math.remainder(foot.yaw - pose.yaw, math.tau)
        if (
            abs(x) < p.square_length
            and abs(y) < p.square_width
            and abs(turn) < math.radians(p.square_yaw_deg)
        ):
            return ()
        share, half = 1.0, 0.5 * self.model.step_width
        if icp is not None:
            share = min(math.dist(icp, stance.p_WF[:2]) / half, 1.0)
        transfer, swing = p.transfer_duration, p.swing_duration
        transfer += share * (p.initial_transfer_duration - transfer)
        if closes:
            transfer = p.closing_share * p.transfer_duration
            swing = p.closing_share * p.swing_duration
        return (Footstep(side, pose, transfer, swing, reactive),)

    def queue(
        self,
        side: Side,
        stance: FootPose,
        velocity: Array,
        command: Array,
        starts: bool = False,
    ) -> tuple[Footstep, ...]:
        """Returns the next steps by command, the first one of `side`.

        Each takes the frame between the feet on by v T, with the `velocity` v
        at its landing, on its way to the `command`.  Of the lateral way of two
        steps the foot that leads takes what the other one leaves, which comes
        closer only by half of the room that the reach has for it.  A step
        without ground ends them.
        """
        p, half = self.params, 0.5 * self.model.step_width
        room = room_inside(self.model)
        share = pace(p, self.model, self.after_step(velocity, command))
        transfer, swing = share * p.transfer_duration, share * p.swing_duration
        time, before = transfer + swing, transfer
        if starts:
            before = p.initial_transfer_duration
        frame = stance.displaced(0.0, side.sign * half)
        steps: list[Footstep] = []
        for _ in range(p.num_steps):
            velocity = self.after_step(velocity, command)
            x, y, turn = (time * velocity).tolist()
            closer = math.copysign(min(abs(y), room), y)
            aside = 2.0 * y - closer if side.sign * y > 0.0 else closer
            frame = frame.displaced(x, aside, turn)
            wanted = frame.displaced(0.0, side.sign * half)
            pose = self._placed(wanted, stance, side)
            if pose is None:
                break
            steps.append(Footstep(side, pose, before, swing))
            if not np.any(np.abs(velocity) > _STILL):
                break  # the feet are side by side
            before = transfer
            stance, side = pose, side.other
        return tuple(steps)

    def caught(self, side: Side, stance: FootPose) -> tuple[Footstep, ...]:
        """Returns steps in place that catch the robot, the first of `side`."""
        p, steps = self.params, []
        for _ in range(self.adjuster.num_steps):
            pose = self.beside(side, stance)
            if pose is None:
                break
            step = Footstep(
                side,
                pose,
                p.recovery_transfer_duration,
                p.recovery_swing_duration,
                reactive=True,
            )
            steps.append(step)
            stance, side = pose, side.other
        return tuple(steps)

    def _placed(
        self, wanted: FootPose, stance: FootPose, side: Side
    ) -> FootPose | None:
        """Returns the pose `wanted`, within the base region, on the ground."""
        reach, ground = self.model.reach, self.model.ground
        mirror = np.array([1.0, side.sign])
        p_F = mirror * stance.to_sole(wanted.p_WF[:2])
        base = base_region(reach)
        if not reach.in_base_region(*p_F):
            xy = stance.to_world(mirror * project(p_F, base))
            wanted = replace(wanted, p_WF=np.append(xy, wanted.p_WF[2]))
        if ground is None:
            return wanted
        step = terrain.moved_to(
            ground,
            Footstep(side, wanted, 0.0, 0.0),
            [in_world(base, stance, side)],
            float(stance.p_WF[2]),
            reach.rise_max,
        )
        return None if step is None else step.pose

    def capture(
        self,
        schedule: walking.ContactSchedule,
        side: Side,
        feet: FootPoses,
        icp: Array,
        on: Mechanisms,
    ) -> Capture:
        """Returns how the foot of `side` can catch the ICP (2,) [m] in W.

        The foot goes to the point of its reach that is closest to the capture
        region C_n of the earliest touchdown; C_n is then that of the time at
        which it can be there.
        """
        p, stance = self.params, feet[side.other]
        steps = self.caught(side, stance)
        nowhere = Capture(self.adjuster.num_steps + 1, math.inf, False, 0.0)
        if not steps:
            return nowhere
        swing = replace(
            schedule,
            phase=Phase.SWING,
            support_side=side.other,
            feet=feet,
            footsteps=steps,
        )
        geometry = capture.SwingGeometry(swing, self.adjuster, self.model, on)
        place = feet[side].p_WF[:2]
        transfer = p.recovery_transfer_duration
        soonest = transfer + self.min_swing_duration

        def from_time(time: float) -> Array:
            times = time, time + self.adjuster.waiting_time
            return geometry.one_step_region(icp, times)

        first, captures = from_time(soonest), []
        for number, offsets in enumerate(geometry.offsets, start=1):
            region = capture.capture_region(first, offsets)
            for reach in geometry.places:
                goal = _nearest(place, reach.polygon, region)
                way = self.model.detour.time_of_way(place, goal, stance, side)
                time = max(soonest, transfer + way)
                then = capture.capture_region(from_time(time), offsets)
                gap = _gap(reach.polygon, then)
                count = number if gap == 0.0 else len(geometry.offsets) + 1
                captures.append(
                    Capture(
                        steps=count,
                        gap=round(gap, 3),
                        crosses=reach.reach != BASE,
                        time=round(way, 3),
                    )
                )
        return min(captures, key=lambda one: one.cost, default=nowhere)


def _nearest(place: Array, reach: Array, region: Array) -> Array:
    """Returns the point (2,) of `reach` in or closest to `region`."""
    common = intersection(reach, region)
    if len(common):
        return project(place, common)
    return closest_point(reach, region)[0]


def _gap(reach: Array, region: Array) -> float:
    """Returns the distance [m] of two polygons; 0 if they share an area."""
    if len(intersection(reach, region)):
        return 0.0
    return closest_point(reach, region)[1]
