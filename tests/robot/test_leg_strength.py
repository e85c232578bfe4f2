"""Oracles: Drake's inverse dynamics, with joints at their limits."""

import itertools
import math
import shutil

import numpy as np
import pytest
from pydrake.multibody.tree import MultibodyForces

from nadia_balance.core.walking.state import Side
from nadia_balance.robot.leg_strength import StandingLegs
from nadia_balance.robot.model import MODELS, load_robot
from nadia_balance.robot.plants import actuators
from tests.robot.test_model import change, standing

ROBOTS = {name: load_robot(name) for name in ("nadia", "atlas", "g1")}
# Directions of a foot in the plane [rad].
ANGLES = np.linspace(0.0, math.tau, 64, endpoint=False)


def limits(robot, speeds):
    return StandingLegs(robot, robot.standing_positions()).foot_limits(speeds)


def efforts(plant):
    """Effort limits (nv,); those of the base are endless."""
    limits = np.full(plant.num_velocities(), np.inf)
    for actuator in actuators(plant):
        limits[actuator.joint().velocity_start()] = actuator.effort_limit()
    return limits


def moving(plant, context, robot, side, angle):
    """Joint velocities (nv,) at which this sole, level, has 1 m/s at `angle`.

    From velocities of the foot as Drake propagates them, one joint at a time;
    the pelvis rests.  At rest, accelerations are alike.
    """
    foot = plant.GetBodyByName(robot.foot_bodies[side])
    p_FS = robot.X_FootSole[side].translation()
    nv = plant.num_velocities()
    columns = np.zeros((6, nv))
    for i in range(6, nv):
        plant.SetVelocities(context, np.eye(nv)[i])
        R_WF = plant.EvalBodyPoseInWorld(context, foot).rotation()
        velocity = plant.EvalBodySpatialVelocityInWorld(context, foot)
        columns[:, i] = velocity.Shift(R_WF @ p_FS).get_coeffs()
    plant.SetVelocities(context, np.zeros(nv))
    leg = np.flatnonzero(np.abs(columns).max(axis=0) > 1e-12)
    assert leg.size == 6
    goal = [0.0, 0.0, 0.0, math.cos(angle), math.sin(angle), 0.0]
    velocities = np.zeros(nv)
    velocities[leg] = np.linalg.solve(columns[:, leg], goal)
    return velocities


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_a_foot_is_as_fast_as_the_first_joint_at_its_limit(robot):
    """Oracle: Drake's inverse dynamics and velocities, the pelvis held.

    Half of 0.1 m/s^2 is rounding; the worst direction is within pi / 64 of one
    that is tried, where cos(pi / 64) of the limit is used.  A quintic from rest
    to rest peaks at 1.875 of its mean; 0.7 of the speed are for the way ahead.
    """
    plant, context = standing(robot)
    gravity = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, gravity)
    effort = efforts(plant)
    acceleration, speed, weakest, slowest = limits(
        robot, robot.max_joint_speeds
    )
    torques, speeds = [], []
    for side, angle in itertools.product(Side, ANGLES):
        rates = moving(plant, context, robot, side, angle)
        needed = plant.CalcInverseDynamics(
            context, acceleration * rates, gravity
        )
        torques.append(np.where(rates == 0.0, 0.0, np.abs(needed / effort)))
        speeds.append(np.abs(rates[6:]) / robot.max_joint_speeds)
    rounding = 0.05 / acceleration
    least = math.cos(math.pi / 64.0) - rounding
    assert least <= np.max(torques) <= 1.0 + rounding
    joint = plant.GetJointByName(weakest).velocity_start()
    assert np.max(torques, axis=0)[joint] >= least
    # Between the angles tried, a joint may be a little faster.
    expected = 0.7 / 1.875 / np.max(speeds)
    assert 0.995 * expected - 0.005 <= speed <= expected + 0.005
    joint = plant.GetJointByName(slowest).velocity_start() - 6
    assert np.max(speeds, axis=0)[joint] >= 0.995 * np.max(speeds)
    endless = np.full(robot.max_joint_speeds.size, np.inf)
    assert limits(robot, speeds=endless).speed == math.inf
    detour, given = robot.point_mass.detour, robot.params.swing_detour
    assert detour.max_acceleration == min(acceleration, given.max_acceleration)
    assert detour.max_speed == min(speed, given.max_speed)


def test_a_weak_ankle_narrows_the_area_of_both_feet(tmp_path):
    """Oracle: by hand: torque over weight is the lever, from the ankle."""
    weak = shutil.copytree(MODELS / "nadia", tmp_path / "weak") / "robot.yaml"
    change(weak, "max_torque: 184", "max_torque: 20")
    change(weak, "max_torque: 377", "max_torque: 120")
    robot = load_robot(str(weak))
    plant, context = standing(robot)
    ankle = plant.GetBodyByName("RIGHT_ANKLE_LINK")
    x = ankle.EvalPoseInWorld(context).translation()[0]
    weight = robot.mass * 9.81
    area = robot.point_mass.cop_area
    np.testing.assert_array_equal(robot.point_mass.sole, robot.sole)
    half_width = 20.0 / weight
    assert half_width < 0.06 and x - 120.0 / weight < -0.125
    front = [x + 120.0 / weight, half_width]
    assert area.max(axis=0) == pytest.approx(front, abs=1e-4)
    assert area.min(axis=0) == pytest.approx([-0.125, -half_width], abs=1e-4)


def test_an_ankle_that_is_weak_on_one_side_narrows_both():
    """Oracle: by hand, as above; the sole is beside the ankle.

    The area is that of either foot, which are mirror images.
    """
    robot = ROBOTS["g1"]
    legs = StandingLegs(robot, robot.standing_positions())
    half = legs.cop_area(robot.sole)[:, 1].max()
    for shift in 0.01, -0.01:
        y = legs.cop_area(robot.sole + [0.0, shift])[:, 1]
        assert y.max() == -y.min()
        assert y.max() == pytest.approx(half - 0.01, abs=1e-3)


def test_refuses_an_ankle_that_cannot_carry_the_robot():
    """Oracle: the message; a sole in front of what 35 N m can hold."""
    robot = ROBOTS["g1"]
    far = robot.sole + [0.3, 0.0]
    message = (
        r"^effort limit of left_ankle_pitch_joint = 35: must hold the weight "
        r"of \d+ N somewhere on the sole$"
    )
    legs = StandingLegs(robot, robot.standing_positions())
    with pytest.raises(ValueError, match=message):
        legs.cop_area(far)
