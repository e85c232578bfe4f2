"""Oracles: sums over bodies, finite differences, points on the sole."""

import math

import numpy as np
import pytest

from nadia_balance.core.walking.vocabulary import FootPoses, Side
from nadia_balance.systems.centroidal_estimator import CentroidalEstimator
from tests.blocks import answer, asked
from tests.whole_body_examples import nadia, random_state

ROBOT = nadia()
PLANT = ROBOT.control_plant()
OUTPUTS = ("com_state", "icp", "foot_poses")


def outputs(state, estimator=None):
    """com_state, icp, foot_poses of a state."""
    estimator = estimator or CentroidalEstimator(ROBOT)
    context = asked(estimator, predicted_state=state)
    return [answer(estimator, context, name) for name in OUTPUTS]


def com_of(q) -> np.ndarray:
    """CoM by the definition: bodies weighted by their mass."""
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositions(context, q)
    indices = PLANT.GetBodyIndices(ROBOT_INSTANCE)
    bodies = [PLANT.get_body(i) for i in indices]
    weighted = [
        body.default_mass()
        * (PLANT.EvalBodyPoseInWorld(context, body) @ body.default_com())
        for body in bodies
    ]
    return sum(weighted) / ROBOT.mass


ROBOT_INSTANCE = PLANT.GetBodyByName(ROBOT.pelvis_body).model_instance()


@pytest.mark.parametrize("seed", range(3))
def test_com_state_is_the_mean_of_the_bodies_and_its_derivative(seed):
    """Oracle: the mass-weighted sum, and its central difference."""
    state = random_state(seed, 10.0)
    q, v = np.split(state, [PLANT.num_positions()])
    com_state, *_ = outputs(state)
    assert com_state[:3] == pytest.approx(com_of(q), abs=1e-12)
    context, h = PLANT.CreateDefaultContext(), 1e-6
    PLANT.SetPositions(context, q)
    qdot = PLANT.MapVelocityToQDot(context, v)
    slope = (com_of(q + h * qdot) - com_of(q - h * qdot)) / (2.0 * h)
    # Rounding 1e-16 / h, and truncation h^2 times the third derivative.
    assert com_state[3:] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_alip_icp_is_that_of_the_momentum_about_the_contact(seed):
    """Oracle: Drake's momentum about the point com_height below the CoM.

    A point mass m at the CoM, v fast, has the momentum m z (-v_y, v_x) there.
    """
    state = random_state(seed, 10.0)
    estimator = CentroidalEstimator(ROBOT)
    inputs = asked(estimator, predicted_state=state)
    com = answer(estimator, inputs, "com_state")[:3]
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositionsAndVelocities(context, state)
    about_com, about_contact = (
        PLANT.CalcSpatialMomentumInWorldAboutPoint(context, point).rotational()
        for point in (com, com - [0.0, 0.0, ROBOT.com_height])
    )
    terms = answer(estimator, inputs, "whole_body_terms")
    assert ROBOT.mass * terms.angular_momentum == pytest.approx(
        about_com, abs=1e-10
    )
    x, y, _ = about_contact / (ROBOT.mass * ROBOT.com_height)
    expected = com[:2] + np.array([y, -x]) / ROBOT.point_mass.omega
    found = answer(estimator, inputs, "alip_icp")
    assert found == pytest.approx(expected, abs=1e-12)
    assert np.abs(found - answer(estimator, inputs, "icp")).max() > 0.01


def test_icp_is_eq_1_with_the_omega_of_the_robot():
    """Oracle: x + xdot / omega by hand."""
    com_state, icp, _ = outputs(random_state(3, 10.0))
    expected = com_state[:2] + com_state[3:5] / ROBOT.point_mass.omega
    assert icp == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_foot_poses_are_those_of_the_soles(seed):
    """Oracle: two points of the sole, moved by the plant's kinematics."""
    state = random_state(seed, 10.0)
    _, _, poses = outputs(state)
    assert isinstance(poses, FootPoses)
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositionsAndVelocities(context, state)
    for side in Side:
        foot = PLANT.GetFrameByName(ROBOT.foot_bodies[side])
        X_FS = ROBOT.X_FootSole[side]
        points = np.array([X_FS @ [0, 0, 0], X_FS @ [0.1, 0, 0]]).T
        centre, ahead = PLANT.CalcPointsPositions(
            context, foot, points, PLANT.world_frame()
        ).T
        assert poses[side].p_WF == pytest.approx(centre, abs=1e-12)
        yaw = math.atan2(ahead[1] - centre[1], ahead[0] - centre[0])
        assert poses[side].yaw == pytest.approx(yaw, abs=1e-12)
