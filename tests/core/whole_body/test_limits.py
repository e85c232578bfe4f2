"""Oracles: corner forces, definitions, limits by hand."""

import dataclasses
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import linprog

from nadia_balance.core.math.qp import QpProblem
from nadia_balance.core.whole_body.command import PELVIS, TORSO, Avoidance
from nadia_balance.core.whole_body.limits import (
    WholeBodyLimits,
    contact_wrench_cone,
)
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.core.whole_body.tasks import Motion
from nadia_balance.robot.kinematics import whole_body_model
from tests.qp_examples import by_quadprog, with_slack
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

LENGTH, WIDTH, FRICTION = 0.25, 0.12, 0.6


def generators():
    """Wrenches (16, 6) of the edges of the four corners' pyramids."""
    signs = np.array(list(itertools.product((1, -1), repeat=4)))
    corners = np.pad(
        signs[:, :2] * [0.5 * LENGTH, 0.5 * WIDTH], ((0, 0), (0, 1))
    )
    forces = np.column_stack([FRICTION * signs[:, 2:], np.ones(16)])
    return np.hstack([np.cross(corners, forces), forces])


def test_holds_what_forces_at_the_corners_can_do_and_nothing_else():
    """Oracle: linear programs that look for corner forces, near the edge."""
    U = contact_wrench_cone(LENGTH, WIDTH, FRICTION)
    edges = generators()
    rng = np.random.default_rng(1)
    verdicts = []
    for _ in range(200):
        inside = rng.exponential(size=16) @ edges
        wrench = inside + rng.normal(size=6) * [0.4, 0.8, 0.5, 5, 5, 1]
        slack = (U @ wrench).max()
        if abs(slack) < 1e-7:
            continue
        program = linprog(np.zeros(16), A_eq=edges.T, b_eq=wrench)
        assert (program.status == 0) == (slack < 0.0)
        verdicts.append(program.status == 0)
    assert 25 < sum(verdicts) < 175


@pytest.mark.parametrize("friction", [0.6, 0.35])
@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_wrenches_are_possible(contacts, friction):
    """Oracle: CoP in the sole, friction and force by their definitions."""
    params = WholeBodyQpParams()
    length, width = nadia().sole_length, nadia().sole_width
    for seed in range(3):
        terms, solution = solve(
            random_state(seed),
            contacts,
            momentum_rate=(300.0, 150.0, -100.0),
            friction=friction,
        )
        for side, carries in enumerate(contacts):
            wrench = solution.wrenches[6 * side : 6 * side + 6]
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
    rate = (0.0, 0.0, 500.0)
    _, free = solve(standing_state(), momentum_rate=rate)
    limits = model().max_torque
    ratio = 0.5 * np.max(np.abs(free.torques) / limits)
    _, solution = solve(
        standing_state(), max_torque=ratio * limits, momentum_rate=rate
    )
    used = np.abs(solution.torques) / (ratio * limits)
    assert used.max() == pytest.approx(1.0, abs=1e-6)


def test_joints_of_somebody_else_s_move_on_as_they_do():
    """Oracle: vdot is given, 0, at any torque; the posture would move them.

    Without it the elbow is accelerated, and no torque is beyond its limit.
    """
    name = "LEFT_ELBOW_Y"
    params = WholeBodyQpParams(given_joints=[name])
    robot = whole_body_model(nadia(), kinematics().plant, params)
    joint = kinematics().plant.GetJointByName(name)
    i = joint.velocity_start()
    assert robot.given == (i - 6,)
    state = standing_state()
    state[joint.position_start()] += 0.4
    weak = np.where(np.arange(robot.num_joints) == i - 6, 1e-4, 1.0)
    for given in robot, replace(robot, given=()):
        weakened = replace(given, max_torque=weak * given.max_torque)
        terms = terms_at(state)
        solution = WholeBodyQp(params, weakened, PERIOD).solve(
            terms, command(terms)
        )
        assert solution.qp.solved
        ratio = abs(solution.torques[i - 6]) / weakened.max_torque[i - 6]
        if given.given:
            assert solution.vdot[i] == pytest.approx(0.0, abs=1e-7)
            assert ratio > 10.0
        else:
            assert abs(solution.vdot[i]) > 1.0
            assert ratio < 1.0 + 1e-6


def test_joints_of_somebody_else_s_do_not_yield_either():
    """Oracle: vdot is given, 0, although no torque near the last one solves it.

    Where it is not given, the elbow is what yields.
    """
    name = "LEFT_ELBOW_Y"
    params = WholeBodyQpParams(given_joints=[name])
    robot = whole_body_model(nadia(), kinematics().plant, params)
    joint = kinematics().plant.GetJointByName(name)
    i = joint.velocity_start()
    state = standing_state()
    state[joint.position_start()] += 0.4
    terms = terms_at(state)
    last = np.random.default_rng(0).uniform(-1.0, 1.0, robot.num_joints)
    for given in robot, replace(robot, given=()):
        solution = WholeBodyQp(params, given, PERIOD).solve(
            terms, command(terms), last * robot.max_torque
        )
        assert solution.qp.solved and solution.qp.solves > 1
        still = abs(solution.vdot[i]) < 1e-6
        assert still == bool(given.given)


def knee_at(speed: float, joint: str = "LEFT_KNEE_Y"):
    """Nadia stands on its right foot; its left knee, or a joint, turns."""
    state = standing_state()
    knee = kinematics().plant.GetJointByName(joint).velocity_start()
    state[30 + knee] = speed
    return knee, terms_at(state)


@pytest.mark.parametrize(
    ("joint", "horizon"), [("LEFT_KNEE_Y", 0.13), ("LEFT_HIP_Y", 0.07)]
)
def test_joints_brake_before_their_limits(joint, horizon):
    """Oracle: the position that the horizon leads to, by hand.

    No swing task and no damping, which would brake the leg sooner.
    """
    params = WholeBodyQpParams(
        swing_position_weight=0.0, swing_height_weight=0.0, damping_ratio=0.0
    )
    knee, terms = knee_at(-3.0, joint)  # a knee straightens, and fast
    angle = standing_state()[knee + 1]
    wish, lowest = command(terms, (False, True)), angle - 0.005
    limited, free = (
        WholeBodyQp(params, body, PERIOD).solve(terms, wish).vdot[knee]
        for body in (model(**{joint: lowest}), model())
    )
    ahead = angle - 3.0 * horizon + 0.5 * horizon**2 * limited
    assert ahead == pytest.approx(lowest, abs=1e-9)
    assert free < limited - 1.0


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
    limited, free = (
        WholeBodyQp(eager, body, PERIOD).solve(terms, bend(terms))
        for body in (model(), ideal)
    )
    assert free.torques[knee - 6] > 200.0
    assert limited.torques[knee - 6] == pytest.approx(175.0, abs=ROUNDING)


def test_torques_change_no_faster_than_they_may():
    """Oracle: 50 times the limit in a second are 10 % of it in a tick."""
    terms = terms_at(standing_state())
    qp, step = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD), 0.1
    still = qp.solve(terms, command(terms)).torques
    wish = command(terms, momentum_rate=(800.0, 0.0, 0.0))
    free = qp.solve(terms, wish).torques
    torques = qp.solve(terms, wish, still).torques
    limits = model().max_torque
    assert np.max(np.abs(free - still) / limits) > step + 0.05
    assert np.max(np.abs(torques - still) / limits) == pytest.approx(step)


def test_a_foot_carries_no_more_than_it_may():
    """Oracle: the bound; the other foot takes the rest of the weight."""
    _, solution = solve(standing_state(), max_normal_forces=(100.0, math.inf))
    assert solution.wrenches[5] == pytest.approx(100.0, abs=1e-6)
    assert solution.wrenches[11] > 0.8 * (nadia().mass * 9.81 - 100.0)


class Turn:
    """A user's task: `rows` of the terms have an angular acceleration."""

    weight = 100.0

    def __init__(self, rows, acceleration):
        self._rows, self._acceleration = rows, acceleration

    def motion(self, terms, command):
        return Motion(terms.rows[self._rows], self._acceleration)


def leaning(body, yaw, tilt, rate):
    """[q, v] of Nadia on level soles; `body` leans, the others hardly do.

    `tilt` [rad] and `rate` [rad/s] are about x and y of the robot, at `yaw`.
    """
    plant, nq = kinematics().plant, kinematics().plant.num_positions()
    context = context_at(standing_state())
    pelvis = plant.GetBodyByName(nadia().pelvis_body)
    R = RotationMatrix.MakeZRotation(yaw)
    turning, joints = np.zeros(3), {"SPINE": 1.0}
    if body is PELVIS:
        turning = R @ np.array([*rate, 0.0])
        angle = math.hypot(*tilt)
        R = R @ RotationMatrix(AngleAxis(angle, np.array([*tilt, 0.0]) / angle))
        joints = {"SPINE": -1.0, "LEFT_HIP": -1.0, "RIGHT_HIP": -1.0}
    pose = RigidTransform(R, pelvis.EvalPoseInWorld(context).translation())
    plant.SetFreeBodyPose(context, pelvis, pose)
    for group, sign in joints.items():
        for axis, angle, speed in zip("XY", tilt, rate, strict=True):
            joint = plant.GetJointByName(f"{group}_{axis}")
            joint.set_angle(context, joint.get_angle(context) + sign * angle)
            joint.set_angular_rate(context, sign * speed)
    state = plant.GetPositionsAndVelocities(context)
    state[nq : nq + 3] = turning
    return state


def tilt_ahead(terms, body, vdot, horizon):
    """Tilt [rad] of a body that turns on with the angular acceleration."""
    R = terms.rotations[2 if body is TORSO else 3]
    w = terms.velocities[body]
    acceleration = terms.rows[body] @ np.append(vdot, 1.0)
    step = horizon / 300
    for k in range(300):
        turn = step * (w + (k + 0.5) * step * acceleration)
        angle = np.linalg.norm(turn)
        R = RotationMatrix(AngleAxis(angle, turn / angle)).matrix() @ R
    return math.acos(R[2, 2])


@pytest.mark.parametrize("body", [TORSO, PELVIS], ids=["torso", "pelvis"])
@pytest.mark.parametrize(
    ("yaw", "tilt", "rate", "near"),
    [
        (1.0, (0.05, 0.15), (0.0, 0.0), 0.001),
        (0.0, (0.0, 0.2), (0.0, 0.7), 0.001),
        (2.0, (-0.12, 0.15), (-0.5, 0.5), 0.02),
        (-0.8, (0.2, -0.05), (0.3, -0.6), 0.8),  # swings round
    ],
)
def test_the_trunk_stops_at_its_largest_tilt(body, yaw, tilt, rate, near):
    """Oracle: its rotation over the horizon, by Rodrigues' formula.

    A task swings it outward.  The limit is on a sum of rotation vectors, which
    is the tilt up to `near` [deg]: the better, the more they are in line.
    """
    terms = terms_at(leaning(body, yaw, tilt, rate))
    x, y, _ = terms.rotations[2 if body is TORSO else 3][:, 2]
    outward = np.array([-y, x, 0.0]) / math.hypot(x, y)
    task, wish = Turn(body, 30.0 * outward), command(terms)
    ahead = []
    for max_tilt in 18.0, 180.0:
        params = WholeBodyQpParams(
            max_trunk_tilt_deg=max_tilt, trunk_tilt_horizon=0.15
        )
        solution = WholeBodyQp(params, model(), PERIOD, [task]).solve(
            terms, wish
        )
        assert solution.qp.solves == 1
        ahead.append(tilt_ahead(terms, body, solution.vdot, 0.15))
    assert math.degrees(ahead[0]) == pytest.approx(18.0, abs=near)
    assert math.degrees(ahead[1]) > 25.0


@pytest.mark.parametrize("body", [TORSO, PELVIS], ids=["torso", "pelvis"])
def test_a_tilt_in_the_margin_costs(body):
    """Oracle: quadprog, a limit at its beginning with a slack of its own.

    The cost of the slack s is 1/2 100 s^2; a task swings the body outward.
    """
    terms = terms_at(leaning(body, 0.7, (0.1, 0.3), (0.2, 0.3)))
    at_once, later = (
        WholeBodyQp(
            WholeBodyQpParams(
                max_trunk_tilt_deg=15.0 + margin, trunk_tilt_margin_deg=margin
            ),
            model(),
            PERIOD,
            [Turn(body, np.array([10.0, 20.0, 0.0]))],
        )
        for margin in (0.0, 30.0)
    )
    wish = command(terms)
    problem = at_once.problem(terms, wish)
    expected = by_quadprog(with_slack(problem, {64: 100.0, 65: 100.0}))
    solution = later.solve(terms, wish)
    assert solution.qp.solves == 1
    assert solution.vdot == pytest.approx(expected[:29], abs=1e-5)
    assert np.max(expected[-2:]) > 1.0  # rad/s^2 that are missing


def contradictions():
    """A state, parameters and a body for which the QP has no solution.

    The knee has to bend, with soles at rest: 1.5 rad in 70 ms are 600 rad/s^2.
    """
    knee, upright = knee_at(0.0)[0], standing_state()
    bent = model(LEFT_KNEE_Y=upright[knee + 1] + 1.5)
    yield upright, WholeBodyQpParams(knee_limit_horizon=0.07), bent
    upright_soon = WholeBodyQpParams(
        max_trunk_tilt_deg=0.5, trunk_tilt_horizon=0.02
    )
    for part in TORSO, PELVIS:
        tilted = leaning(part, 0.7, (0.1, 0.18), (0.0, 0.0))
        yield tilted, upright_soon, model()


@pytest.mark.parametrize(
    ("state", "params", "body"),
    list(contradictions()),
    ids=["knee", "torso", "pelvis"],
)
def test_joints_and_trunk_yield_if_nothing_else_is_possible(
    state, params, body
):
    """Oracles: quadprog finds no solution; the optimum with a slack a row."""
    qp, terms = WholeBodyQp(params, body, PERIOD), terms_at(state)
    problem = qp.problem(terms, command(terms))
    with pytest.raises(ValueError, match="inconsistent"):
        by_quadprog(problem)
    expected = by_quadprog(yielding(problem))[:29]
    solution = qp.solve(terms, command(terms))
    assert solution.qp.solves - solution.qp.fallback == 2
    assert solution.vdot == pytest.approx(expected, abs=1e-5)


def test_links_yield_if_nothing_else_is_possible():
    """Oracles: quadprog finds no solution; its optimum with one slack more.

    Two links would have to part from a third on both of its sides at once.
    """
    terms = terms_at(standing_state())
    apart = np.zeros((2, 30))
    apart[:, 12], apart[:, -1] = (1.0, -1.0), (-20.0, -30.0)
    braking = np.zeros((0, 30))
    terms = terms._replace(avoidance=Avoidance(apart, braking))
    qp = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD)
    problem = qp.problem(terms, command(terms))
    with pytest.raises(ValueError, match="inconsistent"):
        by_quadprog(problem)
    soft = yielding(problem)
    n, m = soft.g.size, len(soft.A)
    H = np.pad(soft.H, ((0, 1), (0, 1)))
    H[n, n] = 100.0
    shared = np.zeros((m, 1))
    shared[len(problem.A) - 2 : len(problem.A)] = 1.0
    expected = by_quadprog(
        QpProblem(
            H=H,
            g=np.append(soft.g, 0.0),
            A=np.hstack((soft.A, shared)),
            lower=soft.lower,
            upper=soft.upper,
        )
    )
    solution = qp.solve(terms, command(terms))
    assert expected[-1] >= 25.0 - 1e-9  # half of the contradiction
    assert solution.qp.solves == 2
    assert solution.vdot == pytest.approx(expected[:29], abs=1e-5)
