"""How near a robot's legs come to their limits."""

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.size import scaled
from nadia_balance.core.plan.gait import Gait
from nadia_balance.robot.checks import standing_torques
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import (
    actuators,
    context_at,
    effort_limits,
    is_pitch,
    joints_above,
)
from nadia_balance.robot.reach import stride

_NEAR = 0.9  # share of a limit from which a margin is short [-]
_HELD = 0.6  # share of the sole below which it is short [-]


def margins(robot: RobotModel, torques: Array, speeds: Array) -> list[str]:
    """Returns a table of the legs' margins, and a warning of each short one.

    `torques` and `speeds` (nu,) are the largest of the drives in a walk, over
    their limits.  The CoP that an ankle holds is that of `cop_area`; a knee at
    the reach carries the robot alone, the feet at the ends of a longest step.
    """
    plant, lines, short = robot.control_plant(), [], []
    drives = [drive.joint().name() for drive in actuators(plant)]
    left, right = (
        [joint.name() for joint in joints_above(plant, foot)[::-1]]
        for foot in robot.foot_bodies.values()
    )
    lines.append(f"{'margins, in place':40} torque  speed")
    for pair in zip(left, right, strict=True):
        i = max(map(drives.index, pair), key=torques.__getitem__)
        name, torque, speed = drives[i], torques[i], speeds[i]
        lines.append(f"  {name:38} {torque:5.0%}  {speed:5.0%}")
        if torque > _NEAR:
            short.append(f"torque of {name}, {torque:.0%} in place")
        if speed > _NEAR:
            short.append(f"speed of {name}, {speed:.0%} in place")
    model = robot.point_mass
    for what, i in (("ahead and behind", 0), ("aside", 1)):
        ends = [
            [100.0 * sole[:, i].max(), -100.0 * sole[:, i].min()]
            for sole in (model.cop_area, model.sole)
        ]
        (ahead, behind), (toe, heel) = ends
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
    found, limits = [], effort_limits(plant)
    legs = plant, q, robot.foot_bodies, robot.X_FootSole
    for side, foot in robot.foot_bodies.items():
        torques = standing_torques(*legs, {side: 1.0})
        context = context_at(plant, q)
        pitches = [j for j in joints_above(plant, foot) if is_pitch(j, context)]
        if len(pitches) > 1:
            i = pitches[1].velocity_start()
            found.append((abs(torques[i]) / limits[i], pitches[1].name()))
    ratio, name = max(found, default=(np.inf, "the knees"))
    return name, float(ratio)
