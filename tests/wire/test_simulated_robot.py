"""A simulated robot does what it is commanded to, and tells what it senses."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.wire.kinds import joint_names
from nadia_balance.wire.messages import JointCommand, Mode
from nadia_balance.wire.simulated_robot import SimulatedRobot

ZERO = np.zeros(29)
STIFF = JointCommand(ZERO, ZERO, ZERO, kp=ZERO + 40.0, kd=ZERO + 1.0)
TURNED = SensorParams(imu_rpy_deg=[0.0, 0.0, 90.0])


def hanging(engine: str, command: JointCommand, seconds: float):
    """A robot on its band that has had a command for a while."""
    robot = SimulatedRobot(load_robot("g1"), TURNED, engine)
    for _ in range(round(seconds / 0.002)):
        robot.step(command)
    return robot


@pytest.mark.parametrize("engine", ["mujoco", "drake"])
def test_hangs_at_rest_and_says_so(engine):
    """Oracles: the specific force at rest is -g, in the frame of the IMU,
    which looks to the left, of a robot that hangs upright; the drives' law.
    """
    robot = hanging(engine, STIFF, 2.0)
    state = robot.state()
    assert state.time == pytest.approx(2.0)
    up = RotationMatrix(Quaternion(state.quaternion)).matrix()[2]
    np.testing.assert_allclose(state.force, 9.81 * up, atol=0.3)
    np.testing.assert_allclose(state.gyro, 0.0, atol=0.1)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(state.quaternion, [half, 0, 0, half], atol=0.1)
    law = -40.0 * state.q - state.dq
    np.testing.assert_allclose(state.tau, law, atol=0.1)
    assert np.abs(state.tau).max() > 1.0  # of the arms, which are heavy


@pytest.mark.parametrize("name", ["atlas", "nadia"])
def test_hangs_upright_in_the_posture_of_standing(name):
    """Oracle: a body hangs with its centre of mass below the band.

    Atlas' is 3 cm ahead of its pelvis.
    """
    model = load_robot(name)
    robot = SimulatedRobot(model, SensorParams())
    plant = model.control_plant()
    q = model.standing_positions()[actuated_velocities(plant) + 1]
    stiffness = 4.0 * plant.GetEffortUpperLimits()
    zero = np.zeros(len(q))
    stiff = JointCommand(q, zero, zero, stiffness, 0.02 * stiffness)
    for _ in range(1200):
        robot.step(stiff)
    w, x, y, z = robot.pose[:4]
    cosine = (w**2 - x**2 - y**2 + z**2) / (w**2 + x**2 + y**2 + z**2)
    assert np.arccos(cosine) < 0.15


def test_drives_hold_where_they_are_told_to_and_are_off_when_off():
    """Oracle: the joint of that name, alone."""
    knee = joint_names(load_robot("g1")).index("left_knee_joint")
    target = ZERO.copy()
    target[knee] = 0.8
    stiff = JointCommand(target, ZERO, ZERO, ZERO + 60.0, ZERO + 1.0)
    robot = hanging("mujoco", stiff, 1.0)
    q = robot.state().q
    assert q[knee] == pytest.approx(0.8, abs=0.1)
    assert np.abs(np.delete(q, knee)).max() < 0.2
    off = JointCommand(target, ZERO, ZERO + 9.0, ZERO, ZERO, Mode.OFF)
    for _ in range(50):
        robot.step(off)
    assert np.abs(robot.state().tau).max() < 1e-6


def test_is_pushed_as_its_pelvis_looks():
    """Oracle: momentum over time; pushed to the left, it looks to the left."""
    robot = SimulatedRobot(load_robot("g1"), SensorParams(), "mujoco")
    half = np.sqrt(0.5)
    robot._engine.SetPositions(
        robot._engine.GetMyMutableContextFromRoot(
            robot._simulator.get_mutable_context()
        ),
        np.array([half, 0.0, 0.0, half]),
    )
    robot.band.hold = 0.0
    robot.push(0.5, 90.0)
    (force,) = robot._forces(robot._output("state"))
    expected = [-load_robot("g1").mass * 0.5 / 0.1, 0.0, 0.0]
    np.testing.assert_allclose(
        force.F_Bq_W.translational(), expected, atol=1e-9
    )
    robot.samples = 50
    assert robot._forces(robot._output("state")) == []


def test_is_down_when_its_pelvis_is_low_or_tilted():
    """Oracle: 0.6 of its height, 1 rad."""
    robot = SimulatedRobot(load_robot("g1"), SensorParams(), "mujoco")
    context = robot._engine.GetMyMutableContextFromRoot(
        robot._simulator.get_mutable_context()
    )
    for tilt, height, is_down in (
        (0.95, 0.7, False),
        (-1.05, 0.7, True),
        (0.0, 0.4, True),
    ):
        q = [np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0, 1.0, 2.0, height]
        robot._engine.SetPositions(context, np.array(q))
        assert robot.is_down is is_down


@pytest.mark.parametrize(
    ("engine", "model", "message"),
    [
        ("bullet", None, "engine = 'bullet': must be one of drake, mujoco"),
        ("drake", Path("g1.xml"), "model = g1.xml: must come with engine = "),
        ("mujoco", Path("none.xml"), "model = none.xml: "),
    ],
)
def test_refuses_engines_and_models(engine, model, message):
    """Oracle: the rules."""
    with pytest.raises(ValueError, match=message):
        SimulatedRobot(load_robot("g1"), SensorParams(), engine, model)
