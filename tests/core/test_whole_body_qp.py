import dataclasses
import math

import daqp
import numpy as np
import pytest
import quadprog
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from nadia_balance.core.walking import Side
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
from tests.whole_body_examples import (
    CONTACTS,
    command,
    kinematics,
    model,
    nadia,
    random_state,
    standing_state,
    terms_at,
)

SIDES = (Side.LEFT, Side.RIGHT)

# The solver accepts 1e-8 of the largest acceleration, here times 91 kg.
ROUNDING = 1e-5  # [N], [N m]


def solve(state, contacts=(True, True), params=None, **kwargs):
    terms = terms_at(state)
    qp = WholeBodyQp(params or WholeBodyQpParams(), model())
    found = qp.solve(terms, command(terms, contacts, **kwargs))
    assert found.qp.solved
    return terms, found


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
def test_wrenches_are_possible(contacts):
    """Oracle: CoP in the sole, friction and force by their definitions."""
    params = WholeBodyQpParams()
    length, width = nadia().sole_length, nadia().sole_width
    for seed in range(10):
        hard_push = (300.0, 150.0, -100.0)
        terms, found = solve(
            random_state(seed), contacts, momentum_rate=hard_push
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
            assert np.all(np.abs(f[:2]) < params.friction * f[2] + ROUNDING)
            assert f[2] > params.min_normal_force - ROUNDING


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_agrees_with_independent_solvers(contacts):
    """Oracles: quadprog and daqp on the same matrices, torques in N m."""
    qp = WholeBodyQp(WholeBodyQpParams(), model())
    for seed in range(10):
        terms = terms_at(random_state(seed))
        wish = command(terms, contacts, (200.0, -100.0, 50.0))
        found = qp.solve(terms, wish)
        problem = (
            *qp._cost(terms, wish),
            *qp._equalities(terms, wish),
            *qp._limits.rows(terms, wish),
        )
        for solver in (by_quadprog, by_daqp):
            x = solver(*problem)
            torques = problem[4][34:57] @ x * nadia().mass + terms.bias[6:]
            assert found.torques == pytest.approx(torques, abs=1e-4)


def by_quadprog(H, g, A_eq, b_eq, C, lower, upper):
    below, above = np.isfinite(lower), np.isfinite(upper)
    rows = np.vstack([A_eq, C[below], -C[above]])
    bounds = np.concatenate([b_eq, lower[below], -upper[above]])
    return quadprog.solve_qp(H, -g, rows.T, bounds, len(b_eq))[0]


def by_daqp(H, g, A_eq, b_eq, C, lower, upper):
    rows = np.ascontiguousarray(np.vstack([A_eq, C]))
    above = np.concatenate([b_eq, np.minimum(upper, 1e30)])
    below = np.concatenate([b_eq, np.maximum(lower, -1e30)])
    sense = np.zeros(len(above), dtype=np.int32)
    sense[: len(b_eq)] = 5  # equality
    x, _, flag, _ = daqp.solve(
        H, g, rows, above, below, sense, primal_tol=1e-10, dual_tol=1e-12
    )
    assert flag == 1
    return x


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
        acceleration = terms.J @ found.vdot + terms.Jdot_v
        for side, carries in enumerate(contacts):
            if carries:
                rows = slice(6 * side, 6 * side + 6)
                assert acceleration[rows] == pytest.approx(
                    -params.stance_damping * terms.Jv[rows], abs=1e-7
                )


def test_a_tilted_sole_is_brought_level():
    """Oracle: it turns towards the vertical by the gain times the tilt."""
    state = standing_state()
    state[0:4] = [math.cos(0.01), math.sin(0.01), 0.0, 0.0]  # roll 0.02
    terms, found = solve(state)
    turn = (terms.J @ found.vdot + terms.Jdot_v)[0:3]
    gain = WholeBodyQpParams().stance_tilt_gain
    assert turn == pytest.approx([-gain * math.sin(0.02), 0, 0], abs=1e-6)


def test_tasks_are_met_where_nothing_is_in_the_way():
    """Oracle: PD laws written out, with vanishing weight on all the rest."""
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
    wish = dataclasses.replace(
        command(terms, (True, False)),
        swing=swing,
        heading=np.array([0.2, 0.3, 0.4]),
    )
    found = WholeBodyQp(params, model()).solve(terms, wish)
    acceleration = terms.J @ found.vdot + terms.Jdot_v
    kp, kd = params.orientation_gain, 2.0 * math.sqrt(params.orientation_gain)
    upright = [0.0, 0.0, kp * math.sin(0.1) + kd * 0.3 + 0.4]
    assert found.vdot[:3] == pytest.approx(upright, abs=2e-3)
    assert acceleration[12:15] == pytest.approx(upright, abs=2e-3)
    kp, kd = 200.0, 2.0 * math.sqrt(200.0)
    turn = [0.0, 0.0, kp * math.sin(0.05) + kd * 0.4 + 0.5]
    assert acceleration[6:9] == pytest.approx(turn, abs=2e-3)
    kp, kd = 150.0, 2.0 * math.sqrt(150.0)
    move = swing[6:9] + kp * np.array([0.01, 0.02, 0.03]) + kd * swing[3:6]
    assert acceleration[9:12] == pytest.approx(move, abs=2e-3)


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
    assert not found.qp.fallback


def test_joints_brake_before_their_limits():
    """Oracle: the position that the horizon leads to, by hand."""
    params = WholeBodyQpParams()
    state, horizon = standing_state(), params.joint_limit_horizon
    knee = kinematics().plant.GetJointByName("LEFT_KNEE_Y").velocity_start()
    state[30 + knee] = -3.0  # straightens, and fast
    lowest = state[knee + 1] - 0.02
    qp = WholeBodyQp(params, model(LEFT_KNEE_Y=lowest))
    terms = terms_at(state)
    found = qp.solve(terms, command(terms, (False, True)))
    ahead = state[knee + 1] + horizon * (-3.0)
    ahead += 0.5 * horizon**2 * found.vdot[knee]
    assert ahead == pytest.approx(lowest, abs=1e-9)
    free = WholeBodyQp(params, model()).solve(
        terms, command(terms, (False, True))
    )
    assert free.vdot[knee] < found.vdot[knee] - 1.0


def test_a_foot_carries_no_more_than_it_may():
    """Oracle: the bound; the other foot takes the rest of the weight."""
    _, found = solve(standing_state(), max_normal_forces=(100.0, math.inf))
    assert found.wrenches[5] == pytest.approx(100.0, abs=1e-6)
    assert found.wrenches[11] > 0.8 * (nadia().mass * 9.81 - 100.0)


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
    assert np.any(both.qp.active[17:34])
    assert not np.any(warm.qp.active[17:34])
    assert warm.torques == pytest.approx(qp.solve(terms, one).torques, abs=1e-6)


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
    bad = dataclasses.replace(
        good, **{name: np.full_like(getattr(good, name), np.nan)}
    )
    qp = WholeBodyQp(WholeBodyQpParams(), model())
    with pytest.raises(ValueError, match="must be finite"):
        qp.solve(terms, bad)


BAD = [
    ("momentum_weight", -1.0),
    ("posture_weight", 0.0),
    ("friction", math.nan),
    ("max_effort_ratio", 1.5),
    ("unloading_fraction", 1.1),
    ("unloaded_force", 1.0),
    ("joint_lower_limits", {"LEFT_KNEE_Y": math.inf}),
    ("solver", "mosek"),
]


@pytest.mark.parametrize(("name", "value"), BAD)
def test_refuses_parameters_out_of_range(name, value):
    """Oracle: the message begins with the field that was spoilt."""
    params = WholeBodyQpParams(**{name: value})
    with pytest.raises(ValueError, match=f"^{name}.* must be"):
        WholeBodyQp(params, model())


def test_the_defaults_are_valid():
    """Oracle: no error."""
    WholeBodyQpParams().validate()
