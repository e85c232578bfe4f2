"""Oracles: Drake's inverse dynamics, with joints at their limits."""

import math
import shutil

import numpy as np
import pytest
import yaml
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import MultibodyForces

from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.robot.leg_strength import cop_area, foot_limits
from nadia_balance.robot.model import MODELS, load_robot

ROBOTS = {name: load_robot(name) for name in ("nadia", "atlas", "g1")}
# Directions of a foot in the plane [rad].
ANGLES = np.linspace(0.0, math.tau, 64, endpoint=False)


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]


def standing(robot):
    """Its plant, and the context in which it stands."""
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.standing_positions())
    return plant, context


def limits(robot, **changed):
    arguments = {
        "plant": robot.control_plant(),
        "q": robot.standing_positions(),
        "feet": robot.foot_bodies,
        "soles": robot.X_FootSole,
        "speeds": robot.max_joint_speeds,
    }
    return foot_limits(**(arguments | changed))


def efforts(plant):
    """Effort limits (nv,); those of the base are endless."""
    found = np.full(plant.num_velocities(), np.inf)
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        found[actuator.joint().velocity_start()] = actuator.effort_limit()
    return found


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
    found = np.zeros(nv)
    found[leg] = np.linalg.solve(columns[:, leg], goal)
    return found


def test_a_foot_accelerates_until_the_first_joint_is_at_its_limit(robot):
    """Oracle: Drake's inverse dynamics, gravity included, the pelvis held.

    Half of 0.1 m/s^2 is rounding; the worst direction is within pi / 64 of one
    that is tried, where cos(pi / 64) of the limit is used.
    """
    plant, context = standing(robot)
    gravity = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, gravity)
    found, effort = limits(robot)[0], efforts(plant)
    used = []
    for side in Side:
        for angle in ANGLES:
            vdot = found * moving(plant, context, robot, side, angle)
            leg = vdot != 0.0
            torques = plant.CalcInverseDynamics(context, vdot, gravity)
            used.append(np.max(np.abs(torques / effort)[leg]))
    rounding = 0.05 / found
    least = math.cos(math.pi / 64.0) - rounding
    assert least <= max(used) <= 1.0 + rounding


def test_a_foot_is_as_fast_as_the_first_joint_at_its_limit(robot):
    """Oracle: Drake's velocities; peak and share by hand.

    A quintic from rest to rest peaks at 1.875 times its mean; 0.7 of the
    joints' speed are for the way over the ground.
    """
    plant, context = standing(robot)
    found = limits(robot)[1]
    used = [
        np.max(np.abs(moving(plant, context, robot, side, angle)[6:]) / speeds)
        for speeds in [robot.max_joint_speeds]
        for side in Side
        for angle in ANGLES
    ]
    expected = 0.7 / 1.875 / max(used)
    # Between the angles tried, a joint may be a little faster.
    assert 0.995 * expected - 0.005 <= found <= expected + 0.005
    endless = np.full(robot.max_joint_speeds.size, np.inf)
    assert limits(robot, speeds=endless)[1] == math.inf


def test_the_swing_is_no_faster_than_the_leg(robot):
    """Oracle: the lesser of the leg's limits and those of robot.yaml."""
    detour, own = robot.point_mass.detour, robot.params.swing_detour
    acceleration, speed = limits(robot)
    assert detour.max_acceleration == min(acceleration, own.max_acceleration)
    assert detour.max_speed == min(speed, own.max_speed)


def ankle_torques(robot, side, p_SC):
    """Torques by joint [N m] if the whole weight is at `p_SC` (2,) [m]."""
    plant, context = standing(robot)
    foot = plant.GetBodyByName(robot.foot_bodies[side])
    forces = MultibodyForces(plant)
    weight = robot.mass * 9.81
    foot.AddInForce(
        context,
        robot.X_FootSole[side] @ [*p_SC, 0.0],
        SpatialForce(np.zeros(3), np.array([0.0, 0.0, weight])),
        plant.world_frame(),
        forces,
    )
    none = np.zeros(plant.num_velocities())
    return np.abs(plant.CalcInverseDynamics(context, none, forces)), plant


def test_the_ankle_holds_the_cop_up_to_the_edges_of_its_area(robot):
    """Oracle: Drake's inverse dynamics with the weight at the corners.

    0.1 mm of the weight is rounding.  G1's toes are too long for its ankles:
    at its front edge the pitch joint is at its limit; other soles are whole.
    """
    area = robot.point_mass.cop_area
    assert area.shape == (4, 2)
    rounding = 1e-4 * robot.mass * 9.81
    ankles = {"nadia": "ANKLE", "atlas": "leg_ak", "g1": "ankle"}[robot.name]
    for side in Side:
        for corner in area:
            torques, plant = ankle_torques(robot, side, corner)
            effort = efforts(plant)
            for joint in map(plant.get_joint, plant.GetJointIndices()):
                if ankles in joint.name() and joint.num_velocities():
                    i = joint.velocity_start()
                    assert torques[i] <= effort[i] + rounding
    if robot.name != "g1":
        np.testing.assert_array_equal(area, robot.sole)
        return
    front, back = area[:, 0].max(), area[:, 0].min()
    assert back == robot.sole[:, 0].min() and front < robot.sole[:, 0].max()
    assert np.ptp(area[:, 1]) == np.ptp(robot.sole[:, 1])
    for side in Side:
        torques, plant = ankle_torques(robot, side, (front, 0.0))
        pitch = plant.GetJointByName(f"{side.value}_ankle_pitch_joint")
        used = torques[pitch.velocity_start()]
        assert used == pytest.approx(35.0, abs=rounding)


def test_a_weak_ankle_narrows_the_area_of_both_feet(tmp_path):
    """Oracle: by hand: torque over weight is the lever, from the ankle."""
    robot = weaker(tmp_path, {"LEFT_ANKLE_X": 20.0, "RIGHT_ANKLE_Y": 120.0})
    plant, context = standing(robot)
    ankle = plant.GetBodyByName("RIGHT_ANKLE_LINK")
    x = ankle.EvalPoseInWorld(context).translation()[0]
    weight = robot.mass * 9.81
    area = robot.point_mass.cop_area
    np.testing.assert_array_equal(robot.point_mass.sole, robot.sole)
    half_width = 20.0 / weight
    assert half_width < 0.06 and x - 120.0 / weight < -0.125
    assert area.max(axis=0) == pytest.approx(
        [x + 120.0 / weight, half_width], abs=1e-4
    )
    assert area.min(axis=0) == pytest.approx([-0.125, -half_width], abs=1e-4)


def weaker(tmp_path, torques):
    """Nadia with these torque limits, loaded from a robot.yaml."""
    folder = shutil.copytree(MODELS / "nadia", tmp_path / "weak")
    path = folder / "robot.yaml"
    tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    tree["drives"]["max_torque"] |= torques
    path.write_text(yaml.safe_dump(tree), encoding="utf-8")
    return load_robot(str(path))


def test_refuses_an_ankle_that_cannot_carry_the_robot():
    """Oracle: the message; a sole in front of what 35 N m can hold."""
    robot = ROBOTS["g1"]
    far = robot.sole + [0.3, 0.0]
    message = (
        r"^effort limit of left_ankle_pitch_joint = 35: must hold the weight "
        r"of \d+ N somewhere on the sole$"
    )
    legs = robot.foot_bodies, robot.X_FootSole, far
    with pytest.raises(ValueError, match=message):
        cop_area(robot.control_plant(), robot.standing_positions(), *legs)
