import math

import numpy as np
import pytest

from nadia_balance.core.whole_body_limits import WholeBodyLimits
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
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


def test_refuses_a_margin_that_leaves_nothing_of_the_sole():
    """Oracle: half of Nadia's sole is 0.06 m wide."""
    WholeBodyLimits(WholeBodyQpParams(sole_margin=0.059), model())
    message = "^sole_margin = 0.061: must leave some of the sole$"
    with pytest.raises(ValueError, match=message):
        WholeBodyLimits(WholeBodyQpParams(sole_margin=0.061), model())


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
    lowest = state[knee + 1] - 0.005
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


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_a_foot_in_the_air_has_no_limits(contacts):
    """Oracle: the number of rows; a mask of all marks those there are."""
    terms = terms_at(standing_state())
    problem = WholeBodyQp(WholeBodyQpParams(), model()).problem(
        terms, command(terms, contacts)
    )
    limits = WholeBodyLimits(WholeBodyQpParams(), model())
    assert len(problem.C) == 2 * 23 + 17 * sum(contacts)
    assert len(problem.C) == limits.num_rows(sum(contacts))
    marks = limits.rows_of(contacts)
    assert np.all(marks[:46])
    assert np.all(marks[46:63] == contacts[0])
    assert np.all(marks[63:] == contacts[1])


def test_without_braking_joints_accelerate_as_they_may():
    """Oracle: the parameter; all other bounds stay."""
    params = WholeBodyQpParams(max_joint_acceleration=300.0)
    terms = terms_at(random_state(1, 5.0))
    problem = WholeBodyQp(params, model()).problem(terms, command(terms))
    bounds = np.array((problem.lower, problem.upper))
    WholeBodyLimits(params, model()).stop_braking(*problem[-2:])
    assert np.all(problem.lower[23:46] == -300.0)
    assert np.all(problem.upper[23:46] == 300.0)
    bounds[:, 23:46] = (-300.0,), (300.0,)
    assert np.array_equal((problem.lower, problem.upper), bounds)


def test_braking_is_no_harder_than_allowed():
    """Oracle: the parameter, for joints far beyond their limits."""
    qp = WholeBodyQp(WholeBodyQpParams(max_joint_acceleration=300.0), model())
    state = standing_state()
    state[7:30] += 10.0
    terms = terms_at(state)
    problem = qp.problem(terms, command(terms))
    assert problem.lower[23:46] == pytest.approx(np.full(23, -300.0))
    assert problem.upper[23:46] == pytest.approx(np.full(23, -300.0))
