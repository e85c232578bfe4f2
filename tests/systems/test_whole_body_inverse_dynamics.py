"""Oracles: WholeBodyQp, called by hand; the rate of the drives."""

import numpy as np
import pytest

from nadia_balance.core.body.model import JointImpedanceParams
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.robot.plants import actuators
from nadia_balance.systems.signals import QpStatus
from nadia_balance.systems.whole_body import WholeBodyInverseDynamics
from tests import example_walks
from tests.blocks import answer, asked, fix, running
from tests.core.whole_body.test_tasks import ELBOW, JointTask
from tests.whole_body_examples import (
    PERIOD,
    command,
    context_at,
    kinematics,
    make_infeasible,
    model,
    nadia,
    standing_state,
    terms_at,
)

PUSHED = np.array([200.0, 100.0, 0.0])
OUTPUTS = ("actuation", "foot_wrenches", "whole_body_qp_status")


def system_with(tasks=()):
    params = WholeBodyQpParams()
    return WholeBodyInverseDynamics(params, nadia(), PERIOD, tasks=tasks)


def inputs():
    """Nadia stands, and is asked to move aside."""
    return {
        "whole_body_terms": terms_at(standing_state()),
        "momentum_rate": PUSHED,
        "swing_foot_reference": np.zeros(12),
        "walking_state": WalkingState(example_walks.standing()),
    }


def outputs(system, context):
    return [answer(system, context, name).copy() for name in OUTPUTS]


@pytest.mark.parametrize("tasks", [[], [JointTask(ELBOW, 40.0, 30.0)]])
def test_gives_what_the_core_function_gives(tasks):
    """Oracle: WholeBodyQp, torques sorted by the plant's B matrix.

    With a task of a user's as well, which has its elbow accelerate.
    """
    system, values = system_with(tasks), inputs()
    terms = values["whole_body_terms"]
    core = WholeBodyQp(WholeBodyQpParams(), model(), PERIOD, tasks)
    solution = core.solve(terms, command(terms, momentum_rate=PUSHED))
    assert (solution.vdot[ELBOW] > 10.0) == bool(tasks)
    actuation, wrenches, status = outputs(system, asked(system, **values))
    B = kinematics().plant.MakeActuationMatrix()
    assert B[6:] @ actuation == pytest.approx(solution.torques, abs=1e-9)
    assert wrenches == pytest.approx(solution.wrenches, abs=1e-9)
    qp = solution.qp
    expected = [1.0, float(qp.fallback), qp.solves, qp.violation, 0.0]
    assert status == pytest.approx(expected)


class Recorder:
    """A task that wants nothing, and keeps the command."""

    name, weight = "recorder", 1.0

    def motion(self, terms, command):
        self.command = command


def test_a_task_sees_the_mechanisms_and_the_icp_error():
    """Oracle: by hand; without these inputs all are on, and it is 0."""
    told, alone = Recorder(), Recorder()
    reference = np.arange(8.0)  # begins with the ICP
    values = inputs() | {
        "mechanisms": MECHANISMS["step"].as_vector(),
        "icp": np.array([0.3, 1.1]),
        "icp_reference": reference,
    }
    system = system_with([told])
    outputs(system, asked(system, **values))
    assert told.command.mechanisms == MECHANISMS["step"]
    assert told.command.icp_error == pytest.approx([0.3, 0.1])
    system = system_with([alone])
    outputs(system, asked(system, **inputs()))
    assert alone.command.mechanisms == MECHANISMS["all_with_cross_over"]
    assert not alone.command.icp_error.any()


@pytest.mark.parametrize("unsolved", [3, 25, 26])
def test_damps_without_a_solution_and_gives_up_in_the_end(
    monkeypatch, unsolved
):
    """Oracles: at rest no damping, reached by the drives' rate; the count.

    The QP has no solution by an impossible bound; then it has one again.
    """
    system = system_with()
    simulator, context = running(system, **inputs())
    good, *_ = outputs(system, context)
    simulator.AdvanceTo(PERIOD)
    make_infeasible(monkeypatch)
    fix(system, context, momentum_rate=PUSHED + 1.0)
    step = nadia().drives.max_torque_rate * PERIOD
    step *= kinematics().plant.GetEffortUpperLimits()
    for failures in range(1, unsolved + 1):
        actuation, wrenches, status = outputs(system, context)
        left = np.maximum(np.abs(good) - failures * step, 0.0)
        assert actuation == pytest.approx(np.sign(good) * left, abs=1e-9)
        assert not wrenches.any()
        assert not QpStatus(status).solved
        assert QpStatus(status).failures == failures
        simulator.AdvanceTo((failures + 1) * PERIOD)
    monkeypatch.undo()
    actuation, wrenches, status = outputs(system, context)
    goes_on = unsolved <= 25  # 0.05 s
    assert QpStatus(status).solved == wrenches.any() == goes_on
    assert QpStatus(status).failures == unsolved + (not goes_on)
    assert actuation.any() == goes_on


def moving_state() -> np.ndarray:
    """Nadia stands; joints that are not of its legs move."""
    state = standing_state().copy()
    speeds = np.random.default_rng(3).uniform(-0.5, 0.5, model().num_joints)
    speeds[model().is_leg_joint] = 0.0
    state[-speeds.size :] = speeds
    return state


def test_the_joint_command_leads_along_the_accelerations_of_the_qp():
    """Oracles: the motion from q, v at vdot, half a period on, in the plant's
    order; of a mass m on a spring, kp = m w^2 and kd = m d.
    """
    impedance = JointImpedanceParams(stiffness=30.0, damping=50.0)
    system = WholeBodyInverseDynamics(
        WholeBodyQpParams(), nadia(), PERIOD, impedance=impedance
    )
    state, plant = moving_state(), kinematics().plant
    values = inputs() | {"whole_body_terms": terms_at(state)}
    context = asked(system, **values)
    q, v, tau, kp, kd = answer(system, context, "joint_command").reshape(5, -1)
    assert tau.tolist() == answer(system, context, "actuation").tolist()
    vdot = answer(system, context, "generalized_acceleration")
    half, lag = 0.5 * PERIOD, nadia().drives.lag
    M = plant.CalcMassMatrix(context_at(state))
    for i, actuator in enumerate(actuators(plant)):
        joint = actuator.joint()
        k, place = joint.velocity_start(), joint.position_start()
        speed = state[plant.num_positions() + k]
        assert v[i] == pytest.approx(speed + half * vdot[k])
        # The state is that when torques act, lag and half a period ahead; the
        # drives hold the joint in the middle of the period.
        now = state[place] - (lag + half) * speed
        later = now + half * speed + 0.5 * half**2 * vdot[k]
        assert q[i] == pytest.approx(later, abs=1e-4)
        # What is left of M when all else is free: its Schur complement.
        others = np.delete(np.arange(len(M)), k)
        held = np.linalg.solve(M[np.ix_(others, others)], M[others, k])
        inertia = M[k, k] - M[k, others] @ held
        assert kp[i] == pytest.approx(900.0 * inertia, rel=0.2)
        assert kd[i] == pytest.approx(50.0 * inertia, rel=0.2)


def test_without_a_solution_the_drives_damp(monkeypatch):
    """Oracle: by hand: no spring; gains are 0 where there is no impedance."""
    make_infeasible(monkeypatch)
    for impedance in None, JointImpedanceParams(stiffness=30.0, damping=50.0):
        system = WholeBodyInverseDynamics(
            WholeBodyQpParams(), nadia(), PERIOD, impedance=impedance
        )
        context = asked(system, **inputs())
        command = answer(system, context, "joint_command").reshape(5, -1)
        assert (
            command[2].tolist() == answer(system, context, OUTPUTS[0]).tolist()
        )
        assert not command[[1, 3]].any()
        assert np.all(command[4] > 0.0) == bool(impedance)
