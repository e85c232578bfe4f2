"""Contact schedules to plan for: straight, turning, sideways, and random."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from nadia_balance.core.body.model import LegGeometry, PointMassModel
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.body.swing_detour import SwingDetourParams
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.plan.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
)

SOLE = rectangle(0.25, 0.12)
# A foot that slides while it lands, and is as fast as its acceleration allows.
IDEAL_DETOUR = SwingDetourParams(
    max_speed=math.inf, max_descent=math.inf, max_braking=math.inf, settling=0.0
)
MODEL = PointMassModel(
    mass=90.9,
    com_height=0.95,
    step_width=0.25,
    sole=SOLE,
    legs=LegGeometry(
        length=0.782, ankle_height=0.098, com_above_hip=0.12, hip_width=0.26
    ),
    reach=ReachabilityParams(),
    detour=IDEAL_DETOUR,
)
OMEGA = MODEL.omega
ALL = MECHANISMS["all_with_cross_over"]
UNCROSSED = MECHANISMS["step_swing_transfer"]
FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))


def at_rest(point):
    """A reference that rests at `point`."""
    return ReferencePoint(point, np.zeros(2), point)


def standing(feet=FEET, start=None):
    """Stands for ever, at rest between the feet unless told otherwise."""
    mid = 0.5 * (feet.left.p_WF + feet.right.p_WF)[:2]
    start = at_rest(mid) if start is None else start
    return ContactSchedule(Phase.STANDING, Side.LEFT, math.inf, feet, (), start)


def walk(
    length=0.3, sideways=0.0, turn=0.0, num_steps=3, transfer=0.3, swing=0.7
):
    """In the first transfer, at rest; the right foot goes first."""
    steps, centre, yaw = [], np.zeros(2), 0.0
    for i in range(num_steps):
        side = Side.RIGHT if i % 2 == 0 else Side.LEFT
        yaw += turn
        c, s = math.cos(yaw), math.sin(yaw)
        R = np.array([[c, -s], [s, c]])
        centre = centre + R @ [length, sideways]
        p = centre + R @ [0.0, 0.125 * side.sign]
        steps.append(Footstep(side, FootPose([*p, 0.0], yaw), transfer, swing))
    now, start = (Phase.TRANSFER, Side.LEFT, transfer), at_rest(np.zeros(2))
    return ContactSchedule(*now, FEET, tuple(steps), start)


def swing(**gait):
    """The first swing of a walk: the right foot's."""
    schedule = walk(**gait)
    duration = schedule.footsteps[0].swing_duration
    return replace(schedule, phase=Phase.SWING, duration=duration)


def planned(schedule):
    """The ICP plan of the schedule, with the default parameters."""
    return plan_icp(schedule, IcpPlanParams(), MODEL)


def successor(schedule, plan, t=None):
    """The schedule after this one, if all goes as planned until `t`."""
    t = schedule.duration if t is None else t
    steps = schedule.footsteps
    if schedule.phase is Phase.TRANSFER:
        return replace(
            schedule,
            phase=Phase.SWING if steps else Phase.STANDING,
            duration=steps[0].swing_duration if steps else math.inf,
            start=plan.at(t).point(),
        )
    feet = schedule.feet.with_foot(steps[0].side, steps[0].pose)
    side, steps = schedule.support_side.other, steps[1:]
    duration = steps[0].transfer_duration if steps else 0.8
    start = plan.at(t).point()
    return ContactSchedule(Phase.TRANSFER, side, duration, feet, steps, start)


def stepping(feet, pose, phase=Phase.SWING, side=Side.RIGHT, duration=0.7):
    """The foot of the `side` swings, or is about to, from `feet` to `pose`."""
    now = {"phase": phase, "support_side": side.other, "duration": duration}
    steps = (Footstep(side, pose, 0.3, duration),)
    return replace(standing(feet), footsteps=steps, **now)


def _mapped(schedule, feet, A, shift, turn):
    """The same walk, with p -> A p + shift and yaw -> turn(yaw)."""

    def move(pose):
        return FootPose([*(A @ pose.p_WF[:2] + shift), 0.0], turn(pose.yaw))

    old = schedule.start
    com, cop = A @ old.com + shift, A @ old.cop + shift
    start = ReferencePoint(com, A @ old.com_velocity, cop)
    steps = [replace(s, pose=move(s.pose)) for s in schedule.footsteps]
    feet = FootPoses(*map(move, feet))
    return replace(schedule, feet=feet, footsteps=tuple(steps), start=start)


def moved(schedule, angle, shift):
    """The same walk, turned about 0 by `angle` and then moved by `shift`."""
    c, s = math.cos(angle), math.sin(angle)
    R, feet = np.array([[c, -s], [s, c]]), schedule.feet
    return _mapped(
        schedule, (feet.left, feet.right), R, shift, lambda yaw: yaw + angle
    )


def mirrored(schedule):
    """The same walk with left and right exchanged: y becomes -y."""
    flip, feet = np.diag([1.0, -1.0]), schedule.feet
    there = _mapped(
        schedule, (feet.right, feet.left), flip, 0.0, lambda yaw: -yaw
    )
    side = schedule.support_side.other
    steps = [replace(s, side=s.side.other) for s in there.footsteps]
    return replace(there, support_side=side, footsteps=tuple(steps))


def _near(size):
    return st.floats(-size, size, allow_subnormal=False)


@st.composite
def random_walks(draw):
    """A transfer or swing with 1 to 4 wild steps and a wild start."""
    start = walk(
        length=draw(_near(0.5)),
        sideways=draw(_near(0.2)),
        turn=draw(_near(0.5)),
        num_steps=draw(st.integers(1, 4)),
        transfer=draw(st.floats(0.05, 1.0)),
        swing=draw(st.floats(0.3, 1.5)),
    )

    def wild(pose):
        p_WF = pose.p_WF + [draw(_near(0.1)), draw(_near(0.1)), 0.0]
        return FootPose(p_WF, pose.yaw + draw(_near(0.3)))

    steps = tuple(replace(s, pose=wild(s.pose)) for s in start.footsteps)
    xy = st.tuples(_near(0.05), _near(0.05))
    velocity = st.tuples(_near(0.2), _near(0.2))
    swinging = draw(st.booleans())
    return replace(
        start,
        phase=Phase.SWING if swinging else Phase.TRANSFER,
        duration=steps[0].swing_duration if swinging else start.duration,
        footsteps=steps,
        start=ReferencePoint(draw(xy), draw(velocity), draw(xy)),
    )
