"""What a robot's legs can reach, and how near they come to their limits."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix

from nadia_balance.core.body.com_height import ComHeight, ComHeightParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    ReachabilityParams,
    step_regions,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.gait import Gait
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.parameters.scaling import scaled
from nadia_balance.robot.leg_strength import StandingKinematics, StandingLegs
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import (
    actuators,
    effort_limits,
    joints_above,
    knee_among,
)

_TILT = math.radians(35.0)  # largest tilt of the pelvis in a recovery [rad]
_LOWERED = 0.9  # CoM height above one sole, of that above both [-]
_LEVEL = 0.01  # tolerance of the planned CoM height [m]
_BESIDE = 0.05  # the CoM is in the feet's bounding box, grown by this [m]
_LESS = 0.95  # factor on the lengths in each iteration
_NARROWER = 0.04  # reduction of widths in each iteration [leg length]
_ITERATIONS = 24  # largest number of iterations
_NEAR = 0.9  # share of a limit from which a margin is short [-]
_HELD = 0.6  # share of the sole below which it is short [-]


def stride(robot: RobotModel, foothold: Array) -> Array | None:
    """Positions of a robot in a stride, by inverse kinematics.

    Both soles are flat, the CoM is between them at the height of the height
    plan, the pelvis nearly upright, and all joints are within their limits.

    Args:
        robot: the robot.
        foothold: position (2,) [m] of the left sole; the right one is at 0.

    Returns:
        Positions (nq,); None if the legs do not get there.
    """
    model = robot.point_mass
    height = ComHeight(ComHeightParams(), model).height_limit(
        FootPose(), FootPose(np.append(foothold, 0.0))
    )
    feet = np.array([foothold, [0.0, 0.0]])  # left, right
    ik = StandingKinematics(
        robot,
        feet,
        com=(
            [*(feet.min(axis=0) - _BESIDE), height - _LEVEL],
            [*(feet.max(axis=0) + _BESIDE), height + _LEVEL],
        ),
    )
    ik.AddOrientationConstraint(
        frameAbar=ik.plant.world_frame(),
        R_AbarA=RotationMatrix(),
        frameBbar=ik.plant.GetFrameByName(robot.pelvis_body),
        R_BbarB=RotationMatrix(),
        theta_bound=_TILT,
    )
    guess = robot.standing_positions()
    guess[4:6] = 0.5 * foothold
    guess[6] += height - model.com_height
    return ik.nearest(guess, [*guess[4:6], height], weight=0.01)


def reach_within(robot: RobotModel) -> tuple[ReachabilityParams, set[str]]:
    """A reach that inverse kinematics confirms.

    Regions shrink until their corners and midpoints of edges are reached, but
    for those beside the stance leg, which are no steps: the cross-over widths,
    or, if the base region is too large or no such width can shrink, lengths and
    largest width.

    Args:
        robot: the robot.

    Returns:
        The reach, and the regions that have failed: the last iteration left
        some of their points out.
    """
    reach = robot.point_mass.reach
    detour = robot.point_mass.detour
    missed: list[tuple[str, float]] = []
    for _ in range(_ITERATIONS):
        missed = [
            (name, y)
            for name, polygon in step_regions(reach, cross_over=True).items()
            for x, y in _around(polygon)
            if abs(x) >= detour.ahead or y >= detour.beside
            if stride(robot, np.array([x, y])) is None
        ]
        if not missed:
            break
        reach = _shrunk(reach, missed, _NARROWER * robot.params.legs.length)
    return reach, {name for name, _ in missed}


def _shrunk(
    reach: ReachabilityParams, missed: list[tuple[str, float]], step: float
) -> ReachabilityParams:
    """A smaller reach, for `missed` points: region, y [m]; `step` in [m]."""
    crossed = {name for name, y in missed if y < reach.width_nominal}
    least = -0.9 * reach.width_nominal
    narrower = reach
    if FORWARD in crossed:
        narrower = replace(
            narrower, width_forward=max(reach.width_forward - step, least)
        )
    if BACKWARD in crossed:
        narrower = replace(
            narrower, width_backward=max(reach.width_backward - step, least)
        )
    if narrower != reach and all(name != BASE for name, _ in missed):
        return narrower
    return replace(
        reach,
        length_forward=_LESS * reach.length_forward,
        length_backward=_LESS * reach.length_backward,
        width_max=max(_LESS * reach.width_max, 1.01 * reach.width_nominal),
    )


def _around(polygon: Array) -> Array:
    """Corners and midpoints (2 n, 2) of the edges: the reach is not convex."""
    return np.vstack([polygon, 0.5 * (polygon + np.roll(polygon, 1, axis=0))])


def too_weak(robot: RobotModel) -> list[str]:
    """Warnings of the joints by which one leg cannot carry the robot.

    Its CoM is above the centre of a sole, which has its whole weight.

    Args:
        robot: the robot.

    Returns:
        The warnings, one line each.
    """
    warnings = []
    for side, foot in robot.foot_bodies.items():
        legs = StandingLegs(robot, _over_sole(robot, side))
        limits = effort_limits(legs.plant)
        needed = np.abs(legs.standing_torques({side: 1.0}))
        for joint in joints_above(legs.plant, foot):
            i = joint.velocity_start()
            if needed[i] > limits[i]:
                warnings.append(
                    f"warning: effort limit of {joint.name()}, {limits[i]:g} "
                    f"N m: to carry it, one leg needs {needed[i]:.0f} N m"
                )
    return warnings


def _over_sole(robot: RobotModel, side: Side) -> Array:
    """Positions (nq,) with level soles, and the CoM above one of them.

    Those of standing between both, if there are none.
    """
    q, half = robot.standing_positions(), 0.5 * robot.params.step_width
    above = [0.0, side.sign * half]
    ik = StandingKinematics(
        robot,
        places=np.array([[0.0, half], [0.0, -half]]),
        com=([*above, _LOWERED * robot.com_height], [*above, robot.com_height]),
    )
    pelvis: Any = q[:4]
    ik.prog().AddBoundingBoxConstraint(pelvis, pelvis, ik.q()[:4])
    aside = q.copy()
    aside[5] += above[1]
    positions = ik.nearest(aside, [*above, robot.com_height], weight=0.01)
    return q if positions is None else positions


def margins(robot: RobotModel, torques: Array, speeds: Array) -> list[str]:
    """A table of the legs' margins.

    The CoP that an ankle holds is that of `cop_area`; a knee at the reach
    carries the robot alone, the feet at the ends of a longest step.

    Args:
        robot: the robot.
        torques: largest torques (nu,) of the drives in a walk, over their
            limits [-].
        speeds: largest speeds (nu,), likewise [-].

    Returns:
        The lines of the table, and a warning of each margin that is short.
    """
    model = robot.point_mass
    drive_lines, short_drives = _drive_margins(robot, torques, speeds)
    cop_lines, short_ankles = _cop_margins(model)
    short = [*short_drives, *short_ankles]
    swing = scaled(Gait(), robot.params.size).swing_duration
    least = model.detour.time_from_rest(model.reach.length_forward)
    if least > swing:
        short.append("speed of the leg joints, to be at the reach in a swing")
    name, knee = _knee_at_reach(robot)
    if knee > 1.0:
        short.append(f"torque of {name} to rise from the reach on one leg")
    return [
        f"{'margins, in place':40} torque  speed",
        *drive_lines,
        *cop_lines,
        f"  a foot is at the reach in {least:.2f} s of {swing:.2f} s",
        f"  one knee carries all, feet at the reach: {knee:.0%}",
        *(f"warning: short: {margin}" for margin in short),
    ]


def _drive_margins(
    robot: RobotModel, torques: Array, speeds: Array
) -> tuple[list[str], list[str]]:
    """Lines of the drives of both legs, and what is short."""
    plant = robot.control_plant()
    drives = [drive.joint().name() for drive in actuators(plant)]
    left, right = (
        [drives.index(joint.name()) for joint in joints_above(plant, foot)]
        for foot in robot.foot_bodies.values()
    )
    lines, short = [], []
    for pair in zip(left[::-1], right[::-1], strict=True):
        i = max(pair, key=torques.__getitem__)
        lines.append(f"  {drives[i]:38} {torques[i]:5.0%}  {speeds[i]:5.0%}")
        short += [
            f"{quantity} of {drives[i]}, {share:.0%} in place"
            for quantity, share in (
                ("torque", torques[i]),
                ("speed", speeds[i]),
            )
            if share > _NEAR
        ]
    return lines, short


def _cop_margins(model: PointMassModel) -> tuple[list[str], list[str]]:
    """Lines of the CoP that the ankles hold, and what is short."""
    lines, short = [], []
    for direction, i in ("ahead and behind", 0), ("aside", 1):
        area, sole = 100.0 * model.cop_area[:, i], 100.0 * model.sole[:, i]
        ahead, behind = area.max(), -area.min()
        toe, heel = sole.max(), -sole.min()
        lines.append(
            f"  ankles hold the CoP {direction}: {ahead:.1f} and {behind:.1f} "
            f"cm, of the sole's {toe:.1f} and {heel:.1f} cm"
        )
        if min(ahead / toe, behind / heel) < _HELD:
            short.append(f"torque of the ankles, CoP {direction}")
    return lines, short


def _knee_at_reach(robot: RobotModel) -> tuple[str, float]:
    """The knee with the largest torque over its limit, and that."""
    reach = robot.point_mass.reach
    q = stride(robot, np.array([reach.length_forward, reach.width_nominal]))
    if q is None:
        return "the knees", np.inf
    legs = StandingLegs(robot, q)
    limits = effort_limits(legs.plant)
    knees = []
    for side, foot in robot.foot_bodies.items():
        torques = legs.standing_torques({side: 1.0})
        knee = knee_among(joints_above(legs.plant, foot), legs.context)
        if knee:
            i = knee.velocity_start()
            knees.append((abs(torques[i]) / limits[i], knee.name()))
    ratio, name = max(knees, default=(np.inf, "the knees"))
    return name, float(ratio)
