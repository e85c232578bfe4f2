"""What a robot's legs can reach, and how near they come to their limits."""

import math
from dataclasses import replace

import numpy as np
from pydrake.math import RotationMatrix

from nadia_balance.core.body.com_height import ComHeight, ComHeightParams
from nadia_balance.core.body.reachability import (
    BASE,
    ReachabilityParams,
    step_regions,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.gait import Gait
from nadia_balance.core.walking.state import FootPose
from nadia_balance.parameters.scaling import scaled
from nadia_balance.robot import plants
from nadia_balance.robot.leg_strength import StandingKinematics, StandingLegs
from nadia_balance.robot.model import RobotModel

_TILT = math.radians(35.0)  # largest tilt of the pelvis in a recovery [rad]
_LEVEL = 0.01  # tolerance of the planned CoM height [m]
_BESIDE = 0.05  # the CoM is in the feet's bounding box, grown by this [m]
_LESS = 0.95  # factor on the lengths in each iteration
_NARROWER = 0.04  # reduction of widths in each iteration [leg length]
_TURNS = 24  # largest number of iterations
_NEAR = 0.9  # share of a limit from which a margin is short [-]
_HELD = 0.6  # share of the sole below which it is short [-]


def stride(robot: RobotModel, foothold: Array) -> Array | None:
    """Positions (nq,), the left foot at `foothold` (2,) [m], the right at 0.

    None if the legs do not get there.  Both soles are flat, the CoM is between
    them at the height of the height plan, the pelvis nearly upright, and all
    joints are within their limits.
    """
    model, other = robot.point_mass, FootPose(np.append(foothold, 0.0))
    height = ComHeight(ComHeightParams(), model).height_limit(FootPose(), other)
    feet = np.array([foothold, [0.0, 0.0]])  # left, right
    low = [*(feet.min(axis=0) - _BESIDE), height - _LEVEL]
    high = [*(feet.max(axis=0) + _BESIDE), height + _LEVEL]
    ik = StandingKinematics(robot, feet, (low, high))
    pelvis = ik.plant.GetFrameByName(robot.pelvis_body)
    world, upright = ik.plant.world_frame(), RotationMatrix()
    ik.AddOrientationConstraint(world, upright, pelvis, upright, _TILT)
    guess, middle = robot.standing_positions(), 0.5 * foothold
    guess[4:6] = middle
    guess[6] += height - model.com_height
    return ik.nearest(guess, [*middle, height], weight=0.01)


def reach_within(robot: RobotModel) -> tuple[ReachabilityParams, set[str]]:
    """Returns a reach that inverse kinematics confirms, and failed regions.

    Regions shrink until their corners and midpoints of edges are reached, but
    for those beside the stance leg, which are no steps: the cross-over widths,
    or, if the base region is too large or no such width can shrink, lengths and
    largest width.  Regions have failed if the last iteration left some out.
    """
    reach, leg = robot.point_mass.reach, robot.params.legs.length
    detour = robot.point_mass.detour
    missed: list[tuple[str, Array]] = []
    for _ in range(_TURNS):
        missed = [
            (name, (x, y))
            for name, polygon in step_regions(reach, True).items()
            for x, y in _around(polygon)
            if abs(x) >= detour.ahead or y >= detour.beside
            if stride(robot, np.array([x, y])) is None
        ]
        if not missed:
            break
        less, nominal = {}, reach.width_nominal
        for name, (_, y) in missed:
            if name != BASE and y < nominal:
                width = getattr(reach, f"width_{name}") - _NARROWER * leg
                less[f"width_{name}"] = max(width, -0.9 * nominal)
        narrower = replace(reach, **less)
        if narrower == reach or any(name == BASE for name, _ in missed):
            names = "length_forward", "length_backward", "width_max"
            less = {name: _LESS * getattr(reach, name) for name in names}
            less["width_max"] = max(less["width_max"], 1.01 * nominal)
            narrower = replace(reach, **less)
        reach = narrower
    return reach, {name for name, _ in missed}


def _around(polygon: Array) -> Array:
    """Corners and midpoints (2 n, 2) of the edges: the reach is not convex."""
    return np.vstack([polygon, 0.5 * (polygon + np.roll(polygon, 1, axis=0))])


def too_weak(robot: RobotModel) -> list[str]:
    """Returns a warning of each joint by which one leg cannot carry the robot.

    It stands in its posture, its whole weight at the centre of a sole.
    """
    legs = StandingLegs(robot, robot.standing_positions())
    limits, found = plants.effort_limits(legs.plant), []
    for side, foot in robot.foot_bodies.items():
        needed = np.abs(legs.standing_torques({side: 1.0}))
        for joint in plants.joints_above(legs.plant, foot):
            i = joint.velocity_start()
            if needed[i] > limits[i]:
                what = f"effort limit of {joint.name()}, {limits[i]:g} N m"
                why = f"to carry it, one leg needs {needed[i]:.0f} N m"
                found.append(f"warning: {what}: {why}")
    return found


def margins(robot: RobotModel, torques: Array, speeds: Array) -> list[str]:
    """Returns a table of the legs' margins, and a warning of each short one.

    `torques` and `speeds` (nu,) are the largest of the drives in a walk, over
    their limits.  The CoP that an ankle holds is that of `cop_area`; a knee at
    the reach carries the robot alone, the feet at the ends of a longest step.
    """
    plant, short = robot.control_plant(), []
    drives = [drive.joint().name() for drive in plants.actuators(plant)]
    left, right = (
        [joint.name() for joint in plants.joints_above(plant, foot)[::-1]]
        for foot in robot.foot_bodies.values()
    )
    lines = [f"{'margins, in place':40} torque  speed"]
    for pair in zip(left, right, strict=True):
        i = max(map(drives.index, pair), key=torques.__getitem__)
        name, torque, speed = drives[i], torques[i], speeds[i]
        lines.append(f"  {name:38} {torque:5.0%}  {speed:5.0%}")
        for what, share in (("torque", torque), ("speed", speed)):
            if share > _NEAR:
                short.append(f"{what} of {name}, {share:.0%} in place")
    model = robot.point_mass
    for what, i in (("ahead and behind", 0), ("aside", 1)):
        (ahead, behind), (toe, heel) = (
            (100.0 * sole[:, i].max(), -100.0 * sole[:, i].min())
            for sole in (model.cop_area, model.sole)
        )
        lines.append(
            f"  ankles hold the CoP {what}: {ahead:.1f} and {behind:.1f} cm, "
            f"of the sole's {toe:.1f} and {heel:.1f} cm"
        )
        if min(ahead / toe, behind / heel) < _HELD:
            short.append(f"torque of the ankles, CoP {what}")
    swing = scaled(Gait(), robot.params.size).swing_duration
    least = model.detour.time_from_rest(model.reach.length_forward)
    lines.append(f"  a foot is at the reach in {least:.2f} s of {swing:.2f} s")
    if least > swing:
        short.append("speed of the leg joints, to be at the reach in a swing")
    name, knee = _knee_at_reach(robot)
    lines.append(f"  one knee carries all, feet at the reach: {knee:.0%}")
    if knee > 1.0:
        short.append(f"torque of {name} to rise from the reach on one leg")
    return lines + [f"warning: short: {each}" for each in short]


def _knee_at_reach(robot: RobotModel) -> tuple[str, float]:
    """The knee with the largest torque over its limit, and that."""
    plant, reach = robot.control_plant(), robot.point_mass.reach
    foothold = np.array([reach.length_forward, reach.width_nominal])
    q = stride(robot, foothold)
    if q is None:
        return "the knees", np.inf
    legs, found = StandingLegs(robot, q), []
    limits = plants.effort_limits(plant)
    for side, foot in robot.foot_bodies.items():
        torques = legs.standing_torques({side: 1.0})
        above = plants.joints_above(legs.plant, foot)
        pitches = [j for j in above if plants.is_pitch(j, legs.context)]
        if len(pitches) > 1:
            i = pitches[1].velocity_start()
            found.append((abs(torques[i]) / limits[i], pitches[1].name()))
    ratio, name = max(found, default=(np.inf, "the knees"))
    return name, float(ratio)
