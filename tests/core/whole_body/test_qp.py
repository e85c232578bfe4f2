"""Oracles: Drake's inverse dynamics, other QP codes, by hand."""

import dataclasses
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from scipy.optimize import minimize_scalar

from nadia_balance.core.walking.state import Side
from nadia_balance.core.whole_body.limits import WholeBodyLimits
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from tests.core.whole_body.test_limits import knee_at
from tests.qp_examples import by_quadprog
from tests.whole_body_examples import (
    CONTACTS,
    PERIOD,
    ROUNDING,
    command,
    context_at,
    kinematics,
    model,
    nadia,
    random_state,
    solve,
    standing_state,
    terms_at,
    yielding,
)


def test_torques_change_faster_if_nothing_else_is_possible():
    """Oracles: quadprog finds no solution; its best of all rates that do.

    Between the torques of joints at their limits and those of standing lie many
    ticks.  A rate (1 + h) times the limit costs 1e4 h^2, a convex problem in h.
    """
    terms, last = terms_at(standing_state()), model().max_torque
    params = WholeBodyQpParams()
    qp = WholeBodyQp(params, model(), PERIOD)
    problem = qp.problem(terms, command(terms), last)
    with pytest.raises(ValueError, match="inconsistent"):
        by_quadprog(problem)
    drives = qp.problem(terms, command(terms))  # without a limit of the rate
    torques = slice(18, 41)  # behind the equalities
    step = model().drives.max_torque_rate * PERIOD * last / model().mass

    def best(haste):
        lower, upper = drives.lower.copy(), drives.upper.copy()
        lower[torques] = np.maximum(
            lower[torques], problem.lower[torques] - haste * step
        )
        slower = problem.upper[torques] + haste * step
        upper[torques] = np.minimum(upper[torques], slower)
        soft = yielding(drives._replace(lower=lower, upper=upper))
        x = by_quadprog(soft)
        return 0.5 * x @ soft.H @ x + soft.g @ x + 5e3 * haste**2, x

    haste = minimize_scalar(
        lambda haste: best(haste)[0],
        bounds=(7.0, 12.0),
        method="bounded",
        options={"xatol": 1e-9},
    ).x
    solution = qp.solve(terms, command(terms), last)
    assert solution.qp.solves == 2
    assert solution.vdot == pytest.approx(best(haste)[1][:29], abs=1e-4)
    changes = np.abs(solution.torques - last) / (model().mass * step)
    assert np.max(changes) == pytest.approx(1.0 + haste, abs=1e-6)


def test_damping_torques_slow_the_joints_down():
    """Oracles: Drake's mass matrix, the pelvis held; the limits."""
    params, plant = WholeBodyQpParams(), kinematics().plant
    qp, state = WholeBodyQp(params, model(), PERIOD), random_state(1)
    context = context_at(state)
    M, v = plant.CalcMassMatrix(context)[6:, 6:], state[36:]
    torques = qp.damping_torques(terms_at(state))
    slowed = np.linalg.solve(M, torques)
    assert slowed == pytest.approx(-params.failure_damping * v, rel=1e-6)
    state[36:] *= 100.0
    torques = qp.damping_torques(terms_at(state), np.zeros(23))
    used = np.abs(torques) / model().max_torque
    assert np.max(used) == pytest.approx(0.1)  # a tick away from nothing


def inverse_dynamics(state, solution):
    """Generalised forces (nv,) for the accelerations and wrenches found."""
    plant, context = kinematics().plant, context_at(state)
    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    for side, wrench in zip(Side, np.split(solution.wrenches, 2), strict=True):
        foot = plant.GetBodyByName(nadia().foot_bodies[side])
        R_WB = plant.EvalBodyPoseInWorld(context, foot).rotation()
        foot.AddInForce(
            context,
            R_WB @ nadia().X_FootSole[side].translation(),
            SpatialForce(wrench),
            plant.world_frame(),
            forces,
        )
    return plant.CalcInverseDynamics(context, solution.vdot, forces)


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_torques_wrenches_and_accelerations_belong_together(contacts):
    """Oracle: Drake's inverse dynamics with the wrenches applied."""
    for seed in range(3):
        state = random_state(seed)
        _, solution = solve(state, contacts, momentum_rate=(30.0, -20.0, 10.0))
        expected = np.concatenate([np.zeros(6), solution.torques])
        by_drake = inverse_dynamics(state, solution)
        assert by_drake == pytest.approx(expected, abs=ROUNDING)


def test_a_still_robot_in_its_posture_needs_no_acceleration():
    """Oracle: the whole weight on the soles; gravity alone loads the joints."""
    at_rest = dataclasses.replace(model(), posture=standing_state()[7:30])
    terms = terms_at(standing_state())
    # The normal forces' regularisation lowers the CoM a little, and the IK
    # that makes the robot stand does not care about the torso: leave both out.
    params = WholeBodyQpParams(normal_weight=1e-12, torso_weight=0.0)
    solution = WholeBodyQp(params, at_rest, PERIOD).solve(terms, command(terms))
    assert solution.vdot == pytest.approx(np.zeros(29), abs=1e-6)
    weight = solution.wrenches[5] + solution.wrenches[11]
    assert weight == pytest.approx(nadia().mass * 9.81, rel=1e-7)


@pytest.mark.parametrize("edge", [0.11, -0.11])
def test_a_sole_that_rolls_leaves_only_its_edge_on_the_ground(edge):
    """Oracles: Drake's acceleration of the edge; the wrench's moment there.

    The other sole stays; the rolling one turns, unless it is to stay flat.
    """
    plant, foot = kinematics().plant, nadia().foot_bodies[Side.LEFT]
    X_FootSole = nadia().X_FootSole[Side.LEFT]
    frame, W = plant.GetBodyByName(foot).body_frame(), plant.world_frame()
    at, V = X_FootSole @ [edge, 0.0, 0.0], JacobianWrtVariable.kV
    free = WholeBodyQpParams(stance_tilt_gain=0.0, swing_orientation_weight=0.0)
    flat, turns = WholeBodyQpParams(stance_tilt_gain=0.0), []
    for seed, params in itertools.product(range(3), (free, flat)):
        terms = terms_at(random_state(seed))
        wish = command(terms, momentum_rate=(80.0, 0.0, 0.0))
        wish = wish._replace(edges=(edge, 0.0))
        solution = WholeBodyQp(params, model(), PERIOD).solve(terms, wish)
        assert solution.qp.solved
        context = context_at(random_state(seed))
        J = plant.CalcJacobianTranslationalVelocity(context, V, frame, at, W, W)
        bias = plant.CalcBiasTranslationalAcceleration(
            context, V, frame, at, W, W
        )
        assert J @ solution.vdot + bias.ravel() == pytest.approx(
            -params.stance_damping * (J @ terms.v), abs=1e-6
        )
        R_WF = terms.rotations[0]
        moment, force = np.split(solution.wrenches[:6], 2)
        about_edge = moment - np.cross(edge * R_WF[:, 0], force)
        assert R_WF[:, 1] @ about_edge == pytest.approx(0.0, abs=ROUNDING)
        still = -params.stance_damping * terms.velocities[:12]
        left = (terms.rows @ np.append(solution.vdot, 1.0))[:12] - still
        assert left[6:] == pytest.approx(np.zeros(6), abs=1e-6)
        turn = R_WF.T @ left[:3]
        assert turn[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-6)
        turns.append(abs(turn[1]))
    assert np.all(np.array(turns[::2]) > 10.0 * np.array(turns[1::2]))


@pytest.mark.parametrize("ground", [0.0, 0.17])
def test_a_tilted_sole_is_brought_on_its_ground(ground):
    """Oracle: it turns towards the normal by the gain times the sine.

    The left one is in the air and sinks along the normal.
    """
    state = standing_state()
    state[0:4] = [math.cos(0.01), math.sin(0.01), 0.0, 0.0]  # roll 0.02
    terms, params = terms_at(state), WholeBodyQpParams()
    normals = np.array([[0.0, -math.sin(ground), math.cos(ground)]] * 2)
    wish = command(terms)._replace(normals=normals, sinking=(0.3, 0.0))
    solution = WholeBodyQp(params, model(), PERIOD).solve(terms, wish)
    moves = (terms.rows @ np.append(solution.vdot, 1.0))[:12]
    expected = params.stance_tilt_gain * math.sin(ground - 0.02)
    assert moves[:3] == pytest.approx([expected, 0.0, 0.0], abs=1e-6)
    down = -0.3 * params.stance_damping * normals[0]
    assert moves[3:6] == pytest.approx(down, abs=1e-6)
    assert moves[9:] == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize("speed", [6.0, 15.0, -15.0])
def test_a_joint_s_speed_comes_before_its_position(speed):
    """Oracle: the speed 20 ms ahead is at its limit, by hand.

    The lower limit of the position is out of reach within the upper one of the
    speed; a knee that is too fast to return has to slow down first.
    """
    knee, terms = knee_at(speed)
    q = standing_state()[7:30]
    beyond = replace(model(), position_lower=q + 4.0, position_upper=q + 9.0)
    limits = WholeBodyLimits(WholeBodyQpParams(), beyond, PERIOD)
    bounds = np.zeros((2, 400))
    limits.fill(np.zeros((400, 41)), bounds, terms, command(terms))
    lower, upper = bounds[:, 23 + knee - 6]
    max_speed = 0.95 * beyond.max_speed[knee - 6]
    assert lower == pytest.approx(
        np.clip((max_speed - speed) / 0.02, -500, 500)
    )
    assert lower == pytest.approx(upper)
