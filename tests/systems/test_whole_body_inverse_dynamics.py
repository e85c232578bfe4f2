"""Oracles: WholeBodyQp, called by hand; the rate of the drives."""

import numpy as np
import pytest

from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.systems.signals import QpStatus
from nadia_balance.systems.whole_body import WholeBodyInverseDynamics
from tests import example_walks
from tests.blocks import answer, asked, fix, running
from tests.core.whole_body.test_tasks import ELBOW, JointTask
from tests.whole_body_examples import (
    PERIOD,
    command,
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
