"""Oracles: forces that make a robot move as told; Drake's contact results."""

import math

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces

from nadia_balance.core.estimation.foot_forces import BANDWIDTH
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.estimation import Imu
from nadia_balance.systems.foot_forces import FootForceEstimator
from tests import blocks
from tests.diagrams.simulated import run_of, soon
from tests.whole_body_examples import nadia, standing_positions

PERIOD, STEP = 0.004, 1e-4  # of the block, and of what is integrated here [s]
PLANT = nadia().control_plant()
CONTEXT = PLANT.CreateDefaultContext()
NQ, NV = PLANT.num_positions(), PLANT.num_velocities()
PLACES = (
    SensorParams(imu_position=[0.2, 0.1, -0.05], imu_rpy_deg=[90.0, 0.0, 20.0]),
    SensorParams(imu_body="TORSO_LINK", imu_position=[0.1, -0.05, 0.3]),
)


def positions(t: float) -> np.ndarray:
    """Nadia sways, bends its joints, and falls over by 0.4 rad in 0.2 s."""
    q = standing_positions().copy()
    turn = RollPitchYaw(0.1, 0.5 * math.sin(5.0 * t), 0.4 * math.sin(5.0 * t))
    q[:4] = turn.ToQuaternion().wxyz()
    q[4:7] += 0.03 * np.sin(np.array([8.0, 7.0, 11.0]) * t)
    phase = np.arange(NQ - 7)
    q[7:] += 0.05 * (np.sin(10.0 * t + phase) - np.sin(phase))
    return q


def velocities(t: float) -> np.ndarray:
    q, change = positions(t), positions(t + STEP) - positions(t - STEP)
    PLANT.SetPositions(CONTEXT, q)
    return PLANT.MapQDotToVelocity(CONTEXT, change / (2.0 * STEP))


def dynamics(t: float) -> tuple[np.ndarray, np.ndarray]:
    """The drives' torques (nu,), and the forces (2,) up on the soles.

    Of all wrenches that move the base as told, the least.
    """
    vdot = (velocities(t + STEP) - velocities(t - STEP)) / (2.0 * STEP)
    v = velocities(t)
    PLANT.SetPositions(CONTEXT, positions(t))
    PLANT.SetVelocities(CONTEXT, v)
    forces = MultibodyForces(PLANT)
    PLANT.CalcForceElementsContribution(CONTEXT, forces)
    needed = PLANT.CalcInverseDynamics(CONTEXT, vdot, forces)
    world = PLANT.world_frame()
    J = np.vstack(
        [
            PLANT.CalcJacobianSpatialVelocity(
                CONTEXT,
                JacobianWrtVariable.kV,
                PLANT.GetFrameByName(name),
                nadia().X_FootSole[side].translation(),
                world,
                world,
            )
            for side, name in nadia().foot_bodies.items()
        ]
    )
    wrenches = np.linalg.lstsq(J[:, :6].T, needed[:6], rcond=None)[0]
    torques = needed - J.T @ wrenches
    return torques[actuated_velocities(PLANT)], wrenches[[5, 11]]


@pytest.mark.parametrize("sensors", PLACES)
def test_tells_the_forces_that_move_a_robot(sensors):
    """Oracle: inverse dynamics in W, with the IMU's body anywhere; the lag of
    the observer, integrated in small steps.
    """
    n = 60
    inputs, states, lagged = [], [], []
    r, count = dynamics(0.0)[1], round(PERIOD / STEP)
    for i in range(n):
        t = i * PERIOD
        torques, forces = dynamics(t)
        states.append({"state": np.concatenate((positions(t), velocities(t)))})
        joints = np.concatenate((positions(t)[7:], velocities(t)[6:]))
        inputs.append({"joints": joints, "torques": torques})
        lagged.append(r)
        ahead = dynamics(t + PERIOD)[1]
        for k in range(count):
            between = forces + (k + 0.5) / count * (ahead - forces)
            r = r + STEP * BANDWIDTH * (between - r)
    imu = Imu(nadia(), sensors, PERIOD)
    (readings,) = blocks.told(imu, PERIOD, states, "imu")
    for row, reading in zip(inputs, readings, strict=True):
        row["imu"] = reading
    block = FootForceEstimator(nadia(), sensors, PERIOD)
    (forces,) = blocks.told(block, PERIOD, inputs, "foot_forces")
    weight = nadia().mass * 9.81
    # It begins in motion, which the first tick takes for rest.
    errors = (forces - np.array(lagged))[20:] / weight
    assert np.abs(errors).max() < 0.01
    assert np.ptp(np.array(lagged), axis=0).min() > 0.1 * weight


def walked(robot: str, errors: str = "{}") -> tuple:
    """Two steps of a robot that has no sensors in its feet."""
    text = f"{{imperfections: {errors}, gait: {{num_steps: 2}}}}"
    scenario = load_scenario("walk_in_place", robot=robot, text=text)
    scenario = soon(scenario).changed(
        sensors="proprioceptive", duration=2.4, seed=3
    )
    run = run_of(scenario)
    assert run.fell_at is None
    assert not run.error
    return load_robot(robot), run.logs


def judge(log, forces) -> tuple[float, list[float], int]:
    """The rms error per weight, delays of touchdowns [s], ticks of nonsense."""
    n, weight = len(log["t"]), float(log["weight"])
    true = log["step_forces"].reshape(n, -1, 2).mean(axis=1)
    error = (forces - true)[50:] / weight
    delays, wrong = [], 0
    for foot, sign in enumerate((1.0, -1.0)):
        carries = forces[:, foot] > 0.0
        for touchdown in log["touchdowns"]:
            if touchdown[1] == sign:
                first = np.searchsorted(log["t"], touchdown[0])
                told = first + np.argmax(carries[first:])
                delays.append(log["t"][told] - touchdown[0])
        in_air = np.convolve(true[:, foot] > 0.0, np.ones(9), "same") == 0
        wrong += int((carries & in_air).sum())
    return float(np.sqrt(np.mean(error**2))), delays, wrong


@pytest.mark.parametrize("robot", ["g1", "nadia"])
@pytest.mark.parametrize("errors", ["{}", "{torso_mass_ratio: 1.1}"])
def test_a_robot_walks_by_what_its_joints_feel(robot, errors):
    """Oracle: Drake's contact results: 8 % rms, 12 ms, nothing in the air."""
    _, log = walked(robot, errors)
    rms, delays, wrong = judge(log, log["estimated_foot_forces"])
    assert rms < 0.08
    assert len(delays) >= 2
    assert max(delays) < 0.012
    assert wrong == 0


def friction(log, limits):
    """Coulomb friction of 2 % of the limit, which drives overcome."""
    joints = log["state"][:, log["joint_speed_columns"]]
    return log["torques"] + 0.02 * limits * np.tanh(joints / 0.05)


def late(log, limits):
    """Torques of the tick before."""
    return np.vstack((log["torques"][:1], log["torques"][:-1]))


def noisy(log, limits):
    """White noise of 1 % of the limit."""
    noise = np.random.default_rng(1).normal(size=log["torques"].shape)
    return log["torques"] + 0.01 * limits * noise


@pytest.mark.parametrize("robot", ["g1", "nadia"])
@pytest.mark.parametrize("wrong", [friction, late, noisy])
def test_drives_that_do_not_know_their_torques_well(robot, wrong):
    """Oracle: Drake's contact results of the walk before.

    Friction alone, 7 N m at Nadia's ankle, takes 3 % of the weight more than
    the 5 % of drives that know their torques.
    """
    model, log = walked(robot)
    torques = wrong(log, log["effort_limits"])
    sensors = load_sensors("proprioceptive")
    block = FootForceEstimator(model, sensors, PERIOD)
    names = ("imu", "joints")
    inputs = [
        {name: log[name][i] for name in names} | {"torques": torques[i]}
        for i in range(len(log["t"]))
    ]
    (forces,) = blocks.told(block, PERIOD, inputs, "foot_forces")
    rms, delays, _ = judge(log, forces)
    assert rms < (0.09 if wrong is friction else 0.08)
    assert max(delays) < 0.012
