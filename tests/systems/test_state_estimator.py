"""Oracles: Drake's kinematics of the state that is told, and the plant's."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.diagrams import humanoid
from nadia_balance.diagrams.simulation import closed_loop, simulate
from nadia_balance.results.estimation import lost_at, measure_estimate, nees
from nadia_balance.systems.estimation import START, StateEstimator
from tests import run_cache
from tests.blocks import answer, asked, fix
from tests.diagrams.simulated import (
    EARLY,
    all_of,
    diagram_of,
    scenario_of,
    simulated,
)
from tests.whole_body_examples import (
    context_at,
    kinematics,
    nadia,
    standing_positions,
)

PERIOD, NJ = 0.004, 23
TORSO = SensorParams(
    imu_body="TORSO_LINK",
    imu_position=[0.1, -0.05, 0.3],
    imu_rpy_deg=[30.0, -40.0, 170.0],
)


def test_the_pelvis_moves_as_an_imu_on_the_torso_says():
    """Oracle: in the plant, the IMU then has the velocity of the filter, 0."""
    q, rng = standing_positions(), np.random.default_rng(2)
    joints = np.concatenate((q[7:], rng.uniform(-1.0, 1.0, NJ)))
    rate = np.array([0.3, -0.2, 0.5])
    imu = np.concatenate((np.zeros(6), rate))
    block = StateEstimator(nadia(), TORSO, PERIOD, q)
    context = asked(
        block, imu=imu, joints=joints, foot_forces=np.array([450.0, 450.0])
    )
    estimated_state = answer(block, context, "estimated_state")
    assert estimated_state[:30] == pytest.approx(q, abs=1e-12)
    plant, context = kinematics().plant, context_at(estimated_state)
    body = plant.GetBodyByName("TORSO_LINK")
    turn = RollPitchYaw(np.radians(TORSO.imu_rpy_deg))
    X_BI = RigidTransform(turn, TORSO.imu_position)
    X_WB = plant.EvalBodyPoseInWorld(context, body)
    V = plant.EvalBodySpatialVelocityInWorld(context, body)
    V = V.Shift(X_WB.rotation() @ X_BI.translation())
    assert V.translational() == pytest.approx(np.zeros(3), abs=1e-12)
    R_IW = (X_WB @ X_BI).rotation().inverse()
    assert R_IW @ V.rotational() == pytest.approx(rate, abs=1e-12)


def test_a_gyro_far_from_the_pelvis_adds_its_errors_to_the_velocity():
    """Oracle: the covariance of 1000 velocities of the pelvis, in turn told
    with the bias and noise of the latest rate, beside a perfect gyro's.
    """
    rng, noise, bias = np.random.default_rng(5), 1e-4, 3e-3
    rate = {"joints": np.zeros(2 * NJ), "foot_forces": np.full(2, 450.0)}
    rate["joints"][:NJ] = standing_positions()[7:]
    covariances, velocities = [], []
    for errors in ({}, {"gyro_noise": noise, "gyro_bias": bias}):
        sensors = replace(TORSO, **errors)
        block = StateEstimator(nadia(), sensors, PERIOD, standing_positions())
        context = asked(block, imu=np.zeros(9), **rate)
        covariances.append(answer(block, context, "estimate_covariance"))
    for wrong in rng.normal(0.0, np.hypot(noise / 0.001**0.5, bias), (1000, 3)):
        fix(block, context, imu=np.append(np.zeros(6), wrong))
        velocities.append(answer(block, context, "estimated_state")[-NJ - 3 :])
    spread = np.cov(np.array(velocities)[:, :3], rowvar=False)
    more = (covariances[1] - covariances[0]).reshape(9, 9)[3:6, 3:6]
    assert np.abs(spread - more).max() < 0.1 * np.linalg.norm(more, 2)


def test_the_robot_is_told_where_it_stands_not_quite():
    """Oracle: moments of 200 seeds; joints are as they were."""
    q = standing_positions()
    positions = np.array(
        [StateEstimator.with_start_error(q, seed) for seed in range(200)]
    )
    assert np.array_equal(positions[:, 7:], np.tile(q[7:], (200, 1)))
    for error, size in (
        (2.0 * positions[:, 1:4], START[0]),
        (positions[:, 4:7] - q[4:7], START[2]),
    ):
        deviation = error.std(axis=0)
        assert deviation == pytest.approx(size, rel=4.0 / 400**0.5)


@pytest.mark.parametrize(
    ("engine", "estimator", "velocity", "duration"),
    [
        ("drake", "invariant", 0.012, 2.4),
        ("mujoco", "invariant", 0.012, 1.5),
        ("drake", "complementary", 0.03, 1.5),
    ],
)
def test_walks_by_its_sensors(engine, estimator, velocity, duration):
    """Oracle: the plant's state: velocity, tilt, place, and 3 deviations.

    In two steps, or one and the beginning of the next.
    """
    run = simulated(
        f"{{duration: {duration}, {EARLY % 'num_steps: 2'}, sensors: consumer, "
        f"seed: 3, engine: {engine}, estimator: {estimator}}}"
    )
    assert not run.error
    assert run.fell_at is None
    found = measure_estimate(run.logs)
    assert found["rms_velocity_m_s"] < velocity
    assert found["max_tilt_deg"] < 0.8
    assert max(found["last_horizontal_m"], found["max_height_m"]) < 0.03
    assert found["mean_nees"] < 25.0
    assert lost_at(run.logs) is None


class Misled(StateEstimator):
    """Reads 0 of a loaded foot, 0.6 of the weight of another, in 5 % of all."""

    def __init__(self, robot, *args, **more):
        super().__init__(robot, *args, **more)
        read_forces, weight = self._forces, robot.mass * 9.81

        def forces(context):
            rng = np.random.default_rng(round(context.get_time() / PERIOD))
            loads, wrong = read_forces(context), rng.random(2) < 0.05
            other = np.where(loads > 0.3 * weight, 0.0, 0.6 * weight)
            return np.where(wrong, other, loads)

        self._forces = forces


@pytest.mark.parametrize(("direction", "delta_v"), [(90.0, 0.41), (180.0, 0.8)])
def test_recovers_with_wrong_contacts_on_slippery_ground(direction, delta_v):
    """Oracle: the plant's state, after half of docs/results/fig10's limits.

    Friction 0.4, and soles slip; feet that swing are loaded for the filter.
    """
    scenario = scenario_of(
        "{mechanisms: all_with_cross_over, duration: 2.4, sensors: consumer, "
        f"{EARLY % 'num_steps: 4'}, imperfections: {{friction_ratio: "
        f"0.5}}, pushes: [{{delta_v: {delta_v}, at: right swing 25 %, "
        f"direction_deg: {direction}}}]}}"
    )

    def misled():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(humanoid, "StateEstimator", Misled)
            return simulate(closed_loop(scenario), scenario.duration)

    run = run_cache.once(__name__, all_of(scenario, "humanoid"), misled)
    assert not run.error
    assert run.fell_at is None
    found = measure_estimate(run.logs)
    assert found["rms_velocity_m_s"] < 0.05
    feet = run.logs["foot_poses"].reshape(-1, 2, 4)
    loaded = run.logs["foot_forces"] > 0.3 * run.logs["weight"]
    slips = np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=2)
    assert np.sum(slips * loaded[1:] * loaded[:-1]) > 0.01  # both soles'


def test_a_saturated_imu_is_an_error_that_tells_when():
    """Oracle: the range; just below it there is an estimate."""
    q = standing_positions()
    sensors = SensorParams(gyro_range=5.0, force_range=20.0)
    block = StateEstimator(nadia(), sensors, PERIOD, q)
    joints = np.concatenate((q[7:], np.zeros(NJ)))
    for entry, limit in ((2, -5.0), (4, 20.0), (8, 5.0)):
        imu = np.zeros(9)
        imu[entry] = 0.999 * limit
        context = asked(
            block, imu=imu, joints=joints, foot_forces=np.full(2, 450.0)
        )
        context.SetTime(1.2)
        answer(block, context, "estimated_state")
        imu[entry] = limit
        fix(block, context, imu=imu)
        message = "input port 'imu' is saturated at 1.200 s$"
        with pytest.raises(RuntimeError, match=message):
            answer(block, context, "estimated_state")


def test_a_run_ends_when_the_estimator_is_lost(monkeypatch):
    """Oracle: by hand: told a place 0.1 m off, 20 deviations, at once."""
    step = np.eye(30)[4] * 0.1
    monkeypatch.setattr(
        StateEstimator, "with_start_error", lambda q, _: q + step
    )
    run = simulate(diagram_of("{sensors: consumer}"), 1.0)
    assert run.simulated_time == pytest.approx(0.2, abs=PERIOD)
    assert lost_at(run.logs) == pytest.approx(0.2)
    assert (run.error, run.fell_at) == ("", None)


def test_a_filter_that_is_wrong_of_itself_is_lost():
    """Oracle: by hand: ten deviations of one error from 1 s on, for 0.2 s."""
    t = np.arange(0.0, 2.0, PERIOD)
    state = np.zeros((len(t), 13 + 2 * NJ))
    state[:, 0] = 1.0
    told, P = state.copy(), np.tile(np.eye(9).ravel() * 1e-4, (len(t), 1))
    told[t >= 1.0, 6] = 0.1
    log = {"t": t, "state": state, "estimated_state": told}
    log["estimate_covariance"] = P
    assert nees(log)[-1] == pytest.approx(100.0)
    assert lost_at(log) == pytest.approx(1.2)
    told[t >= 1.15] = state[t >= 1.15]
    assert lost_at(log) is None


def test_begins_by_its_joints_where_level_soles_stand():
    """Oracle: the pose of the soles in Drake's plant, in another posture."""
    robot = nadia()
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    q = robot.standing_positions(0.3)
    q[7:] += np.random.default_rng(2).uniform(-0.1, 0.1, len(q) - 7)
    joints = np.concatenate((q[7:], np.zeros(len(q) - 7)))
    block = StateEstimator(robot, SensorParams(), PERIOD, None)
    imu = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 0.0])
    half = 0.5 * robot.mass * 9.81
    estimate = answer(
        block,
        asked(block, imu=imu, joints=joints, foot_forces=[half, half]),
        "estimated_state",
    )
    plant.SetPositions(context, estimate[: len(q)])
    left, right = (
        plant.GetFrameByName(name).CalcPoseInWorld(context)
        @ robot.X_FootSole[side]
        for side, name in robot.foot_bodies.items()
    )
    assert left.rotation().matrix() == pytest.approx(np.eye(3), abs=1e-9)
    middle = 0.5 * (left.translation() + right.translation())
    assert middle == pytest.approx(np.zeros(3), abs=1e-9)
