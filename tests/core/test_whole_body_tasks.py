"""Oracles: PD laws written out; Drake's momentum by finite differences."""

import math

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from nadia_balance.core.whole_body_command import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.core.whole_body_tasks import WholeBodyTasks, rotation_error
from tests.whole_body_examples import (
    CONTACTS,
    PERIOD,
    command,
    kinematics,
    model,
    nadia,
    random_state,
    standing_state,
    terms_at,
)

STEP = 1e-6


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_tasks_are_met_where_nothing_is_in_the_way(slope):
    """Oracle: PD laws written out, with vanishing weight on all the rest.

    The swing sole is to be tilted forward by `slope` [rad], on which it is
    turned: Drake's angle and axis.
    """
    state = standing_state()
    state[0:4] = [math.cos(0.05), 0.0, 0.0, math.sin(0.05)]  # yaw 0.1
    for joint in ("SPINE_X", "SPINE_Y", "SPINE_Z"):
        plant = kinematics().plant
        state[plant.GetJointByName(joint).position_start()] = 0.0
    params = WholeBodyQpParams(
        pelvis_weight=1e3,
        torso_weight=1e3,
        swing_position_weight=1e3,
        swing_orientation_weight=1e3,
        momentum_weight=0.0,
        angular_momentum_weight=0.0,
        posture_weight=1e-6,
        leg_posture_weight=1e-6,
        acceleration_weight=1e-6,
        moment_weight=1e-6,
        tangential_weight=1e-6,
    )
    terms = terms_at(state)
    swing = np.zeros(12)
    swing[:3] = terms.sole_positions[1] + [0.01, 0.02, 0.03]
    swing[3:9] = [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]
    swing[9:] = [0.15, 0.4, 0.5]
    wish = command(terms, (True, False))._replace(
        swing=swing, heading=(0.2, 0.3, 0.4), turn=(0.05, 0.1, 0.2)
    )
    wish.normals[1] = math.sin(slope), 0.0, math.cos(slope)
    found = WholeBodyQp(params, model(), PERIOD).solve(terms, wish)
    acceleration = terms.rows @ np.append(found.vdot, 1.0)
    kp, kd = params.orientation_gain, 2.0 * math.sqrt(params.orientation_gain)
    upright = [0.0, 0.0, kp * math.sin(0.1) + kd * 0.3 + 0.4]
    assert acceleration[-6:-3] == pytest.approx(upright, abs=2e-3)
    turned = [0.0, 0.0, kp * math.sin(0.15) + kd * 0.4 + 0.6]
    assert found.vdot[:3] == pytest.approx(turned, abs=2e-3)
    kp, kd = 200.0, 2.0 * math.sqrt(200.0)
    wanted = RotationMatrix.MakeYRotation(slope) @ RotationMatrix(
        RollPitchYaw(0.0, 0.0, 0.15)
    )
    R_WF = RotationMatrix(terms.rotations[1])
    to_go = (wanted @ R_WF.inverse()).ToAngleAxis()
    turn = kp * math.sin(to_go.angle()) * to_go.axis()
    turn[2] += kd * 0.4 + 0.5
    assert acceleration[6:9] == pytest.approx(turn, abs=2e-3)
    kp, kd = 300.0, 2.0 * math.sqrt(300.0)
    move = swing[6:9] + kp * np.array([0.01, 0.02, 0.03]) + kd * swing[3:6]
    assert acceleration[9:12] == pytest.approx(move, abs=2e-3)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -3.0])
def test_error_turns_to_upright(yaw):
    """Oracle: Drake's angle and axis of the same rotation."""
    R = RollPitchYaw(0.1, -0.2, yaw + 0.15).ToRotationMatrix()
    to_go = RotationMatrix.MakeZRotation(yaw) @ R.inverse()
    turn = to_go.ToAngleAxis()
    expected = math.sin(turn.angle()) * turn.axis()
    assert rotation_error(yaw, R.matrix()) == pytest.approx(expected)


def momentum_at(state):
    """Linear and angular momentum about the CoM, by Drake, per mass."""
    plant = kinematics().plant
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    momentum = plant.CalcSpatialMomentumInWorldAboutPoint(
        context, plant.CalcCenterOfMassPositionInWorld(context)
    )
    both = [momentum.translational(), momentum.rotational()]
    return np.concatenate(both) / nadia().mass


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_momentum_rows_are_its_rate(contacts, seed=1):
    """Oracle: finite differences of Drake's spatial momentum.

    S vdot + r is the rate minus what is wished for: for the horizontal part
    a share of the vertical force, for the angular momentum the damping.
    """
    unweighted = WholeBodyQpParams(
        momentum_weight=1.0, height_weight=1.0, angular_momentum_weight=1.0
    )
    state, plant = random_state(seed), kinematics().plant
    terms, wish = terms_at(state), np.array([10.0, -20.0, 30.0])
    rows = WholeBodyTasks(unweighted, model()).rows(
        terms, command(terms, contacts, wish)
    )
    vdot = np.random.default_rng(seed).normal(size=29)
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    qdot = plant.MapVelocityToQDot(context, terms.v)
    ahead, behind = (
        momentum_at(state + sign * STEP * np.concatenate([qdot, vdot]))
        for sign in (1.0, -1.0)
    )
    missing = (ahead - behind) / (2.0 * STEP)
    missing[:2] -= wish[:2] / (9.81 * nadia().mass) * (missing[2] + 9.81)
    missing[2] -= wish[2] / nadia().mass
    damping = unweighted.angular_momentum_damping
    missing[3:] += damping * momentum_at(state)[3:]
    # Truncation and rounding at this step both leave about 1e-8.
    assert (rows @ np.append(vdot, 1.0))[:6] == pytest.approx(missing, abs=1e-6)


def test_weights_are_those_of_the_squares():
    """Oracle: the rows of a task, with its weight and without."""
    terms = terms_at(random_state(0))
    wish = command(terms, (True, False), (10.0, -20.0, 30.0))
    names = (
        "momentum_weight",
        "height_weight",
        "angular_momentum_weight",
        "torso_weight",
        "pelvis_weight",
        "swing_orientation_weight",
        "swing_position_weight",
    )
    ones, weights = dict.fromkeys(names, 1.0), WholeBodyQpParams()
    weighted, plain = (
        WholeBodyTasks(params, model()).rows(terms, wish)
        for params in (weights, WholeBodyQpParams(**ones))
    )
    for name, row in zip(names, (0, 2, 3, 6, 9, 12, 15), strict=True):
        assert weighted[row] @ weighted[row] == pytest.approx(
            getattr(weights, name) * (plain[row] @ plain[row])
        )
