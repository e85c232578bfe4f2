import dataclasses
import math

import numpy as np
import pytest
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from nadia_balance.core.walking import Side
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
from tests.qp_examples import by_daqp, by_quadprog
from tests.whole_body_examples import (
    CONTACTS,
    ROUNDING,
    command,
    kinematics,
    model,
    nadia,
    random_state,
    solve,
    standing_state,
    terms_at,
)

SIDES = (Side.LEFT, Side.RIGHT)


def inverse_dynamics(plant: MultibodyPlant, state, found):
    """Generalised forces (nv,) for the accelerations and wrenches found."""
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    for side, wrench in zip(SIDES, np.split(found.wrenches, 2), strict=True):
        foot = plant.GetBodyByName(nadia().foot_bodies[side])
        R_WB = plant.EvalBodyPoseInWorld(context, foot).rotation()
        foot.AddInForce(
            context,
            R_WB @ nadia().X_FootSole[side].translation(),
            SpatialForce(wrench),
            plant.world_frame(),
            forces,
        )
    return plant.CalcInverseDynamics(context, found.vdot, forces)


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_torques_wrenches_and_accelerations_belong_together(contacts):
    """Oracle: Drake's inverse dynamics with the wrenches applied."""
    for seed in range(10):
        state = random_state(seed)
        _, found = solve(state, contacts, momentum_rate=(30.0, -20.0, 10.0))
        expected = np.concatenate([np.zeros(6), found.torques])
        by_drake = inverse_dynamics(kinematics().plant, state, found)
        assert by_drake == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_agrees_with_independent_solvers(contacts):
    """Oracles: quadprog and daqp on the same matrices, torques in N m."""
    qp = WholeBodyQp(WholeBodyQpParams(), model())
    for seed in range(10):
        terms = terms_at(random_state(seed))
        wish = command(terms, contacts, (200.0, -100.0, 50.0))
        found = qp.solve(terms, wish)
        problem = qp.problem(terms, wish)
        for solver in (by_quadprog, by_daqp):
            x = solver(*problem)
            torques = problem.C[:23] @ x + terms.forces[6:, -1]
            assert found.torques == pytest.approx(
                nadia().mass * torques, abs=1e-4
            )


def test_a_still_robot_needs_the_torques_of_gravity_alone():
    """Oracle: the whole weight on the soles, no acceleration at all."""
    at_rest = dataclasses.replace(model(), posture=standing_state()[7:30])
    terms = terms_at(standing_state())
    # The normal forces' regularisation lowers the CoM a little, and the IK
    # that makes the robot stand does not care about the torso: leave both out.
    params = WholeBodyQpParams(normal_weight=1e-12, torso_weight=0.0)
    found = WholeBodyQp(params, at_rest).solve(terms, command(terms))
    assert found.vdot == pytest.approx(np.zeros(29), abs=1e-6)
    weight = found.wrenches[5] + found.wrenches[11]
    assert weight == pytest.approx(nadia().mass * 9.81, rel=1e-7)


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_gives_the_momentum_that_is_wished_for(contacts):
    """Oracle: the sum of contact forces and weight.

    Wished for is what the pendulum does about the middle of what carries.
    """
    terms = terms_at(standing_state())
    cop = np.mean(terms.sole_positions[list(contacts)], axis=0)
    stiffness = nadia().mass * 9.81 / nadia().com_height
    wish = -stiffness * cop + [0.0, 0.0, 25.0]
    params = WholeBodyQpParams(momentum_weight=1e4, height_weight=1e4)
    _, found = solve(standing_state(), contacts, params, momentum_rate=wish)
    forces = found.wrenches[3:6] + found.wrenches[9:12]
    rate = forces - [0.0, 0.0, nadia().mass * 9.81]
    assert rate == pytest.approx(wish, abs=0.5)  # of up to 125 N


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_soles_on_the_ground_stay(contacts):
    """Oracle: a sole's acceleration is minus its velocity times damping."""
    params = WholeBodyQpParams(stance_tilt_gain=0.0)
    for seed in range(5):
        terms, found = solve(random_state(seed), contacts, params)
        acceleration = terms.rows @ np.append(found.vdot, 1.0)
        for side, carries in enumerate(contacts):
            if carries:
                rows = slice(6 * side, 6 * side + 6)
                assert acceleration[rows] == pytest.approx(
                    -params.stance_damping * terms.velocities[rows], abs=1e-7
                )


def test_a_tilted_sole_is_brought_level():
    """Oracle: it turns towards the vertical by the gain times the tilt."""
    state = standing_state()
    state[0:4] = [math.cos(0.01), math.sin(0.01), 0.0, 0.0]  # roll 0.02
    terms, found = solve(state)
    turn = (terms.rows @ np.append(found.vdot, 1.0))[0:3]
    gain = WholeBodyQpParams().stance_tilt_gain
    assert turn == pytest.approx([-gain * math.sin(0.02), 0, 0], abs=1e-6)


def test_the_load_is_shared_so_that_the_cop_stays_in_the_middle():
    """Oracle: symmetric, so half of the weight each and no moment about x."""
    _, found = solve(standing_state())
    assert found.wrenches[5] == pytest.approx(found.wrenches[11], rel=0.01)
    assert np.all(np.abs(found.wrenches[[0, 6]]) < 0.1)


def test_starts_warm():
    """Oracle: the active rows of the same problem need one solve."""
    terms = terms_at(random_state(3))
    qp = WholeBodyQp(WholeBodyQpParams(), model())
    wish = command(terms, momentum_rate=(300.0, 150.0, 0.0))
    cold = qp.solve(terms, wish)
    warm = qp.solve(terms, wish, cold.qp.active)
    assert cold.qp.iterations > 1
    assert warm.qp.iterations == 1
    assert warm.torques == pytest.approx(cold.torques, abs=1e-7)


def test_rows_of_a_foot_that_has_left_are_forgotten():
    """Oracle: the optimum without a guess."""
    terms = terms_at(random_state(3))
    qp = WholeBodyQp(WholeBodyQpParams(), model())
    pushed = (300.0, 150.0, 0.0)
    both = qp.solve(terms, command(terms, momentum_rate=pushed))
    one = command(terms, (True, False), pushed)
    warm = qp.solve(terms, one, both.qp.active)
    assert np.any(both.qp.active[63:])
    assert not np.any(warm.qp.active[63:])
    assert warm.torques == pytest.approx(qp.solve(terms, one).torques, abs=1e-6)


def test_gives_up_braking_if_nothing_else_is_possible():
    """Oracles: quadprog finds no solution; the optimum without the limit."""
    state = standing_state()
    knee = kinematics().plant.GetJointByName("LEFT_KNEE_Y").velocity_start()
    beyond = model(LEFT_KNEE_Y=state[knee + 1] + 10.0)
    terms = terms_at(state)
    qp, wish = WholeBodyQp(WholeBodyQpParams(), beyond), command(terms)
    with pytest.raises(ValueError, match="inconsistent"):
        by_quadprog(*qp.problem(terms, wish))
    found, (_, free) = qp.solve(terms, wish), solve(state)
    assert found.qp.solved
    assert found.qp.iterations > free.qp.iterations
    assert found.torques == pytest.approx(free.torques, abs=1e-6)


def test_says_that_there_is_no_solution():
    """Oracle: limp legs cannot press the soles down."""
    terms = terms_at(standing_state())
    params = WholeBodyQpParams(
        max_effort_ratio=1e-6, min_normal_force=2e3, unloaded_force=3e3
    )
    found = WholeBodyQp(params, model()).solve(terms, command(terms))
    assert not found.qp.solved
    assert np.isnan(found.torques).all()


@pytest.mark.parametrize("name", ["momentum_rate", "heading", "swing"])
def test_refuses_nan(name):
    """Oracle: no torque comes out."""
    terms = terms_at(standing_state())
    good = command(terms, (True, False))
    bad = good._replace(**{name: np.full_like(getattr(good, name), np.nan)})
    qp = WholeBodyQp(WholeBodyQpParams(), model())
    with pytest.raises(ValueError, match="must be finite"):
        qp.solve(terms, bad)
