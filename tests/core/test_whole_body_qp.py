"""Oracles: Drake's inverse dynamics, other QP codes, corner forces, by hand."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from scipy.optimize import linprog

from nadia_balance.core.walking import Side
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import (
    WholeBodyLimits,
    WholeBodyQp,
    contact_wrench_cone,
)
from tests.qp_examples import by_clarabel, by_quadprog
from tests.whole_body_examples import (
    CONTACTS,
    PERIOD,
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

LENGTH, WIDTH, FRICTION = 0.25, 0.12, 0.6


def wrench_of(forces):
    """[tau, f] about the centre of forces (4, 3) at the sole's corners."""
    corners = np.array(
        [
            [a * 0.5 * LENGTH, b * 0.5 * WIDTH, 0.0]
            for a, b in itertools.product((1, -1), repeat=2)
        ]
    )
    return np.concatenate([np.cross(corners, forces).sum(0), forces.sum(0)])


def generators():
    """Wrenches (16, 6) of the edges of the four corners' pyramids."""
    wrenches = []
    for corner, a, b in itertools.product(range(4), (1, -1), (1, -1)):
        forces = np.zeros((4, 3))
        forces[corner] = [a * FRICTION, b * FRICTION, 1.0]
        wrenches.append(wrench_of(forces))
    return np.array(wrenches)


def test_holds_what_forces_at_the_corners_can_do():
    """Oracle: random corner forces inside their friction pyramids."""
    U = contact_wrench_cone(LENGTH, WIDTH, FRICTION)
    rng = np.random.default_rng(0)
    for _ in range(500):
        forces = np.empty((4, 3))
        forces[:, 2] = rng.exponential(size=4) * (rng.random(4) < 0.7)
        most = FRICTION * forces[:, 2:]
        forces[:, :2] = most * rng.uniform(-1.0, 1.0, size=(4, 2))
        assert np.all(U @ wrench_of(forces) <= 1e-12)


def test_holds_nothing_else():
    """Oracle: linear programs that look for corner forces, near the edge."""
    U = contact_wrench_cone(LENGTH, WIDTH, FRICTION)
    edges = generators()
    rng = np.random.default_rng(1)
    verdicts = []
    for _ in range(400):
        inside = rng.exponential(size=16) @ edges
        wrench = inside + rng.normal(size=6) * [0.4, 0.8, 0.5, 5, 5, 1]
        slack = (U @ wrench).max()
        if abs(slack) < 1e-7:
            continue
        found = linprog(np.zeros(16), A_eq=edges.T, b_eq=wrench)
        assert (found.status == 0) == (slack < 0.0)
        verdicts.append(found.status == 0)
    assert 50 < sum(verdicts) < 350


def test_refuses_what_is_no_sole():
    """Oracle: the message names the argument."""
    with pytest.raises(ValueError, match="width = 0.0: must be > 0"):
        contact_wrench_cone(0.2, 0.0, 0.5)


@pytest.mark.parametrize("friction", [0.6, 0.35])
@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_wrenches_are_possible(contacts, friction):
    """Oracle: CoP in the sole, friction and force by their definitions."""
    params = WholeBodyQpParams()
    length, width = nadia().sole_length, nadia().sole_width
    for seed in range(5):
        hard_push = (300.0, 150.0, -100.0)
        terms, found = solve(
            random_state(seed),
            contacts,
            momentum_rate=hard_push,
            friction=friction,
        )
        for side, carries in enumerate(contacts):
            wrench = found.wrenches[6 * side : 6 * side + 6]
            if not carries:
                assert wrench == pytest.approx(np.zeros(6), abs=ROUNDING)
                continue
            R_FW = terms.rotations[side].T
            tau, f = R_FW @ wrench[:3], R_FW @ wrench[3:]
            cop = np.array([-tau[1], tau[0]]) / f[2]
            reach = np.array([length, width]) / 2 - params.sole_margin
            assert np.all(np.abs(cop) * f[2] < reach * f[2] + ROUNDING)
            assert np.all(np.abs(f[:2]) < friction * f[2] + ROUNDING)
            assert f[2] > params.min_normal_force - ROUNDING


def test_refuses_a_margin_that_leaves_nothing_of_the_sole():
    """Oracle: half of Nadia's sole is 0.06 m wide."""
    WholeBodyLimits(WholeBodyQpParams(sole_margin=0.059), model(), PERIOD)
    message = "^sole_margin = 0.061: must leave some of the sole$"
    with pytest.raises(ValueError, match=message):
        WholeBodyLimits(WholeBodyQpParams(sole_margin=0.061), model(), PERIOD)


def test_keeps_to_the_torque_limits():
    """Oracle: the limits; without them the knees would take more."""
    wish = {"momentum_rate": (0.0, 0.0, 500.0)}
    _, free = solve(standing_state(), **wish)
    limits = model().max_torque
    ratio = 0.5 * np.max(np.abs(free.torques) / limits)
    params = WholeBodyQpParams(max_effort_ratio=ratio)
    _, found = solve(standing_state(), params=params, **wish)
    used = np.abs(found.torques) / (ratio * limits)
    assert used.max() == pytest.approx(1.0, abs=1e-6)


def test_joints_brake_before_their_limits():
    """Oracle: the position that the horizon leads to, by hand.

    No swing task, which would brake the knee sooner.
    """
    params = WholeBodyQpParams(swing_position_weight=0.0)
    state, horizon = standing_state(), params.joint_limit_horizon
    knee = kinematics().plant.GetJointByName("LEFT_KNEE_Y").velocity_start()
    state[30 + knee] = -3.0  # straightens, and fast
    lowest = state[knee + 1] - 0.005
    qp = WholeBodyQp(params, model(LEFT_KNEE_Y=lowest), PERIOD)
    terms = terms_at(state)
    found = qp.solve(terms, command(terms, (False, True)))
    ahead = state[knee + 1] + horizon * (-3.0)
    ahead += 0.5 * horizon**2 * found.vdot[knee]
    assert ahead == pytest.approx(lowest, abs=1e-9)
    free = WholeBodyQp(params, model(), PERIOD).solve(
        terms, command(terms, (False, True))
    )
    assert free.vdot[knee] < found.vdot[knee] - 1.0


def knee_at(speed: float):
    """Nadia stands on its right foot; its left knee bends at `speed`."""
    state = standing_state()
    knee = kinematics().plant.GetJointByName("LEFT_KNEE_Y").velocity_start()
    state[30 + knee] = speed
    return knee, terms_at(state)


def bend(terms):
    """Asks the swing foot to be 3 m behind, which bends the knee."""
    wish = command(terms, (False, True))
    wish.swing[0] -= 3.0
    return wish


def test_keeps_to_the_torque_speed_line():
    """Oracle: at 0.75 of the speed half the torque is left, by hand."""
    knee, terms = knee_at(9.0)
    ideal = dataclasses.replace(
        model(), drives=None, max_speed=np.full(23, np.inf)
    )
    eager = WholeBodyQpParams(damping_ratio=0.0, speed_limit_horizon=0.002)
    found, free = (
        WholeBodyQp(eager, body, PERIOD).solve(terms, bend(terms))
        for body in (model(), ideal)
    )
    assert free.torques[knee - 6] > 200.0
    assert found.torques[knee - 6] == pytest.approx(175.0, abs=ROUNDING)


def test_joints_stay_below_their_speed_limits():
    """Oracle: the speed that the horizon leads to, by hand."""
    params = WholeBodyQpParams(damping_ratio=0.0)
    ideal = dataclasses.replace(model(), max_speed=np.full(23, 1e9))
    knee, terms = knee_at(11.0)
    found, free = (
        WholeBodyQp(params, body, PERIOD).solve(terms, bend(terms))
        for body in (model(), ideal)
    )
    ahead = 11.0 + params.speed_limit_horizon * found.vdot[knee]
    assert ahead <= 12.0 + 1e-9
    assert free.vdot[knee] > found.vdot[knee] + 10.0


def test_torques_change_no_faster_than_they_may():
    """Oracle: 50 times the limit in a second are 10 % of it in a tick."""
    terms = terms_at(standing_state())
    qp, step = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD), 0.1
    still = qp.solve(terms, command(terms)).torques
    wish = command(terms, momentum_rate=(800.0, 0.0, 0.0))
    free = qp.solve(terms, wish).torques
    found = qp.solve(terms, wish, still).torques
    limits = model().max_torque
    assert np.max(np.abs(free - still) / limits) > step + 0.05
    assert np.max(np.abs(found - still) / limits) == pytest.approx(step)


def test_torques_change_faster_if_nothing_else_is_possible():
    """Oracles: quadprog finds no solution; the optimum without that limit."""
    terms, last = terms_at(standing_state()), model().max_torque
    qp = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD)
    with pytest.raises(ValueError, match="inconsistent"):
        by_quadprog(qp.problem(terms, command(terms), last))
    found = qp.solve(terms, command(terms), last)
    free = qp.solve(terms, command(terms))
    assert found.torques == pytest.approx(free.torques, abs=1e-6)


def test_damping_torques_slow_the_joints_down():
    """Oracles: Drake's mass matrix, the pelvis held; the limits."""
    params, plant = WholeBodyQpParams(), kinematics().plant
    qp = WholeBodyQp(params, model(), PERIOD)
    state = random_state(1)
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    M, v = plant.CalcMassMatrix(context)[6:, 6:], state[36:]
    torques = qp.damping_torques(terms_at(state))
    slowed = np.linalg.solve(M, torques)
    assert slowed == pytest.approx(-params.failure_damping * v, rel=1e-6)
    state[36:] *= 100.0
    torques = qp.damping_torques(terms_at(state), np.zeros(23))
    used = np.abs(torques) / model().max_torque
    assert np.max(used) == pytest.approx(0.1)  # a tick away from nothing


def test_a_foot_carries_no_more_than_it_may():
    """Oracle: the bound; the other foot takes the rest of the weight."""
    _, found = solve(standing_state(), max_normal_forces=(100.0, math.inf))
    assert found.wrenches[5] == pytest.approx(100.0, abs=1e-6)
    assert found.wrenches[11] > 0.8 * (nadia().mass * 9.81 - 100.0)


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
    for seed in range(5):
        state = random_state(seed)
        _, found = solve(state, contacts, momentum_rate=(30.0, -20.0, 10.0))
        expected = np.concatenate([np.zeros(6), found.torques])
        by_drake = inverse_dynamics(kinematics().plant, state, found)
        assert by_drake == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_agrees_with_independent_solvers(contacts):
    """Oracles: quadprog and Clarabel on the same matrices, torques in N m."""
    qp = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD)
    for seed in range(5):
        terms = terms_at(random_state(seed))
        wish = command(terms, contacts, (200.0, -100.0, 50.0))
        found = qp.solve(terms, wish)
        problem = qp.problem(terms, wish)
        first = 6 * sum(contacts) + 6  # after the equalities
        for solver, accuracy in (by_quadprog, 1e-7), (by_clarabel, 1e-3):
            torques = problem.A[first : first + 23] @ solver(problem)
            torques += terms.forces[6:, -1]
            assert found.torques == pytest.approx(
                nadia().mass * torques, abs=accuracy
            )


def test_a_still_robot_in_its_posture_needs_no_acceleration():
    """Oracle: the whole weight on the soles; gravity alone loads the joints."""
    at_rest = dataclasses.replace(model(), posture=standing_state()[7:30])
    terms = terms_at(standing_state())
    # The normal forces' regularisation lowers the CoM a little, and the IK
    # that makes the robot stand does not care about the torso: leave both out.
    params = WholeBodyQpParams(normal_weight=1e-12, torso_weight=0.0)
    found = WholeBodyQp(params, at_rest, PERIOD).solve(terms, command(terms))
    assert found.vdot == pytest.approx(np.zeros(29), abs=1e-6)
    weight = found.wrenches[5] + found.wrenches[11]
    assert weight == pytest.approx(nadia().mass * 9.81, rel=1e-7)


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_gives_the_momentum_that_is_wished_for(contacts):
    """Oracle: the sum of contact forces and weight.

    Wished for is what the pendulum does about the middle of what carries: a
    force on the line from there to the CoM, whatever its size.
    """
    terms = terms_at(standing_state())
    cop = np.mean(terms.sole_positions[list(contacts)], axis=0)
    stiffness = nadia().mass * 9.81 / nadia().com_height
    wish = -stiffness * cop + [0.0, 0.0, 25.0]
    params = WholeBodyQpParams(momentum_weight=1e4, height_weight=1e4)
    _, found = solve(standing_state(), contacts, params, momentum_rate=wish)
    forces = found.wrenches[3:6] + found.wrenches[9:12]
    weight = nadia().mass * 9.81
    wish[:2] *= forces[2] / weight
    rate = forces - [0.0, 0.0, weight]
    assert rate == pytest.approx(wish, abs=0.5)  # of up to 130 N


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
        found = WholeBodyQp(params, model(), PERIOD).solve(terms, wish)
        assert found.qp.solved
        context = plant.CreateDefaultContext()
        plant.SetPositionsAndVelocities(context, random_state(seed))
        J = plant.CalcJacobianTranslationalVelocity(context, V, frame, at, W, W)
        bias = plant.CalcBiasTranslationalAcceleration(
            context, V, frame, at, W, W
        )
        assert J @ found.vdot + bias.ravel() == pytest.approx(
            -params.stance_damping * (J @ terms.v), abs=1e-6
        )
        R_WF = terms.rotations[0]
        moment, force = np.split(found.wrenches[:6], 2)
        about_edge = moment - np.cross(edge * R_WF[:, 0], force)
        assert R_WF[:, 1] @ about_edge == pytest.approx(0.0, abs=ROUNDING)
        still = -params.stance_damping * terms.velocities[:12]
        left = (terms.rows @ np.append(found.vdot, 1.0))[:12] - still
        assert left[6:] == pytest.approx(np.zeros(6), abs=1e-6)
        turn = R_WF.T @ left[:3]
        assert turn[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-6)
        turns.append(abs(turn[1]))
    assert np.all(np.array(turns[::2]) > 10.0 * np.array(turns[1::2]))


@pytest.mark.parametrize("ground", [0.0, 0.17])
def test_a_tilted_sole_is_brought_on_its_ground(ground):
    """Oracle: it turns towards the normal by the gain times the sine."""
    state = standing_state()
    state[0:4] = [math.cos(0.01), math.sin(0.01), 0.0, 0.0]  # roll 0.02
    terms, params = terms_at(state), WholeBodyQpParams()
    normals = np.array([[0.0, -math.sin(ground), math.cos(ground)]] * 2)
    wish = command(terms)._replace(normals=normals)
    found = WholeBodyQp(params, model(), PERIOD).solve(terms, wish)
    turn = (terms.rows @ np.append(found.vdot, 1.0))[0:3]
    expected = params.stance_tilt_gain * math.sin(ground - 0.02)
    assert turn == pytest.approx([expected, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("contacts", "speed"), [((True, True), 0.0), ((False, True), 15.0)]
)
def test_gives_up_braking_if_nothing_else_is_possible(contacts, speed):
    """Oracles: quadprog finds no solution; the optimum without the limits.

    The sole stays; or the knee bends faster than it may, and has to bend more.
    """
    state = standing_state()
    knee = kinematics().plant.GetJointByName("LEFT_KNEE_Y").velocity_start()
    beyond = model(LEFT_KNEE_Y=state[knee + 1] + 10.0)
    state[30 + knee] = speed
    terms = terms_at(state)
    wish = command(terms, contacts)
    qp = WholeBodyQp(WholeBodyQpParams(), beyond, PERIOD)
    problem = qp.problem(terms, wish)
    with pytest.raises(ValueError, match="inconsistent"):
        by_quadprog(problem)
    found = qp.solve(terms, wish)
    assert found.qp.solved and found.qp.solves == 2
    first = 6 * sum(contacts) + 6 + 23  # after the torques
    joints = slice(first, first + 23)
    problem.lower[joints], problem.upper[joints] = -500.0, 500.0
    expected = by_quadprog(problem)[:29]
    assert found.vdot == pytest.approx(expected, abs=1e-6)


def test_says_that_there_is_no_solution():
    """Oracle: limp legs cannot press the soles down."""
    terms = terms_at(standing_state())
    params = WholeBodyQpParams(
        max_effort_ratio=1e-6, min_normal_force=2e3, unloaded_force=3e3
    )
    found = WholeBodyQp(params, model(), PERIOD).solve(terms, command(terms))
    assert not found.qp.solved
    assert np.isnan(found.torques).all()


@pytest.mark.parametrize("name", ["momentum_rate", "heading", "swing"])
def test_refuses_nan(name):
    """Oracle: no torque comes out."""
    terms = terms_at(standing_state())
    good = command(terms, (True, False))
    bad = good._replace(**{name: np.full_like(getattr(good, name), np.nan)})
    qp = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD)
    with pytest.raises(ValueError, match="must be finite"):
        qp.solve(terms, bad)
