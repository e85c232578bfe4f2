"""Oracles: Drake's CoM, momentum and poses; Eq. 1 by hand."""

import math

import numpy as np
import pytest

from nadia_balance.core.walking.state import Side
from nadia_balance.systems.state import CentroidalEstimator
from tests.blocks import answer, asked
from tests.whole_body_examples import (
    context_at,
    kinematics,
    nadia,
    random_state,
)

ROBOT, PLANT = nadia(), kinematics().plant


def outputs(state, *names):
    """The outputs of these names."""
    estimator = CentroidalEstimator(ROBOT)
    context = asked(estimator, predicted_state=state)
    return [answer(estimator, context, name) for name in names]


@pytest.mark.parametrize("seed", range(3))
def test_com_and_alip_icp_are_those_of_the_plant(seed):
    """Oracle: Drake's CoM; its momentum about the point com_height below it.

    A point mass m at the CoM, v fast, has the momentum m z (-v_y, v_x) there.
    """
    state = random_state(seed, 10.0)
    com_state, alip_icp, icp = outputs(state, "com_state", "alip_icp", "icp")
    context = context_at(state)
    com = PLANT.CalcCenterOfMassPositionInWorld(context)
    velocity = PLANT.CalcCenterOfMassTranslationalVelocityInWorld(context)
    assert com_state == pytest.approx([*com, *velocity], abs=1e-12)
    contact = com - [0.0, 0.0, ROBOT.com_height]
    momentum = PLANT.CalcSpatialMomentumInWorldAboutPoint(context, contact)
    x, y, _ = momentum.rotational() / (ROBOT.mass * ROBOT.com_height)
    expected = com[:2] + np.array([y, -x]) / ROBOT.point_mass.omega
    assert alip_icp == pytest.approx(expected, abs=1e-12)
    assert np.abs(alip_icp - icp).max() > 0.01


def test_icp_is_eq_1_with_the_omega_of_the_robot():
    """Oracle: x + xdot / omega by hand."""
    com_state, icp = outputs(random_state(3, 10.0), "com_state", "icp")
    expected = com_state[:2] + com_state[3:5] / ROBOT.point_mass.omega
    assert icp == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("side", list(Side))
def test_foot_poses_are_those_of_the_soles(side):
    """Oracle: Drake's pose of the foot; where its x axis points to."""
    state = random_state(1, 10.0)
    (poses,), context = outputs(state, "foot_poses"), context_at(state)
    foot = PLANT.GetBodyByName(ROBOT.foot_bodies[side])
    X_WS = PLANT.EvalBodyPoseInWorld(context, foot) @ ROBOT.X_FootSole[side]
    x, y, _ = X_WS.rotation().matrix()[:, 0]
    assert poses[side].p_WF == pytest.approx(X_WS.translation(), abs=1e-12)
    assert poses[side].yaw == pytest.approx(math.atan2(y, x), abs=1e-12)
