"""Oracles: WholeBodyQp, called by hand; the torques of the tick."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.walking import Phase, WalkingState
from nadia_balance.core.whole_body_command import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyLimits, WholeBodyQp
from nadia_balance.systems.momentum_qp import QpStatus
from nadia_balance.systems.whole_body_inverse_dynamics import (
    WholeBodyInverseDynamics,
)
from tests import example_walks
from tests.blocks import answer, asked, fix, running, tick
from tests.whole_body_examples import (
    command,
    kinematics,
    model,
    nadia,
    standing_state,
    terms_at,
)

PERIOD = 0.002
PUSHED = np.array([200.0, 100.0, 0.0])
OUTPUTS = ("actuation", "foot_wrenches", "whole_body_qp_status")


@pytest.fixture
def system():
    return WholeBodyInverseDynamics(WholeBodyQpParams(), nadia(), PERIOD)


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


def test_gives_what_the_core_function_gives(system):
    """Oracle: WholeBodyQp, torques sorted by the plant's B matrix."""
    terms = terms_at(standing_state())
    found = WholeBodyQp(WholeBodyQpParams(), model()).solve(
        terms, command(terms, momentum_rate=PUSHED)
    )
    actuation, wrenches, status = outputs(system, asked(system, **inputs()))
    B = kinematics().plant.MakeActuationMatrix()
    assert B[6:] @ actuation == pytest.approx(found.torques, abs=1e-9)
    assert wrenches == pytest.approx(found.wrenches, abs=1e-9)
    qp = found.qp
    expected = [1.0, float(qp.fallback), qp.iterations, qp.violation, 0.0]
    assert status == pytest.approx(expected)


def test_holds_the_torques_of_a_tick_until_the_next(system):
    """Oracle: bits, whatever the inputs become after the update."""
    simulator, context = running(system, **inputs())
    told = outputs(system, context)
    simulator.AdvanceTo(1e-9)  # the update of the tick at 0
    fix(system, context, momentum_rate=-PUSHED)
    for time in 0.0, 0.25, 0.5, 0.999:
        simulator.AdvanceTo(1e-9 + time * PERIOD)
        for held, first in zip(outputs(system, context), told, strict=True):
            assert np.array_equal(held, first)
    simulator.AdvanceTo(PERIOD)
    assert np.abs(outputs(system, context)[0] - told[0]).max() > 1.0


def test_remembers_the_active_rows(system):
    """Oracle: the second tick needs a single solve."""
    simulator, context = running(system, **inputs())
    cold = outputs(system, context)
    tick(simulator, PERIOD)
    warm = outputs(system, context)
    assert QpStatus(cold[2]).iterations > QpStatus(warm[2]).iterations == 1
    assert warm[0] == pytest.approx(cold[0], abs=1e-7)


def test_solves_once_for_all_outputs_and_the_update(system, monkeypatch):
    """Oracle: a counter in the place of the core function."""
    calls, solve = [], WholeBodyQp.solve
    monkeypatch.setattr(
        WholeBodyQp, "solve", lambda *args: calls.append(1) or solve(*args)
    )
    simulator, context = running(system, **inputs())
    tick(simulator, PERIOD)
    calls.clear()
    outputs(system, context)
    simulator.AdvanceTo(1.5 * PERIOD)
    outputs(system, context)
    assert len(calls) == 1


def test_holds_the_last_torque_when_there_is_none(system, monkeypatch):
    """Oracle: a QP without solution, by an impossible bound of forces."""
    simulator, context = running(system, **inputs())
    good = outputs(system, context)
    tick(simulator, PERIOD)
    make_infeasible(monkeypatch)
    fix(system, context, momentum_rate=PUSHED + 1.0)
    for failures in (1, 2, 3):
        actuation, wrenches, status = outputs(system, context)
        assert np.array_equal(actuation, good[0])
        assert np.array_equal(wrenches, good[1])
        view = QpStatus(status)
        assert (view.solved, view.fallback, view.failures) == (0, 1, failures)
        tick(simulator, PERIOD)
    monkeypatch.undo()
    fix(system, context, momentum_rate=PUSHED)
    actuation, _, status = outputs(system, context)
    assert actuation == pytest.approx(good[0], abs=1e-7)
    assert (QpStatus(status).solved, QpStatus(status).failures) == (1, 3)


def make_infeasible(monkeypatch):
    """Bounds one torque from below by 1 and from above by -1."""
    bounds = WholeBodyLimits.bounds

    def impossible(self, terms, wish, C):
        lower, upper = bounds(self, terms, wish, C)
        C[0] = C[1]
        lower[0], upper[1] = 1.0, -1.0
        return lower, upper

    monkeypatch.setattr(WholeBodyLimits, "bounds", impossible)


def test_lifts_the_foot_that_swings(system):
    """Oracle: no wrench on it, and the other one carries."""
    swing = replace(example_walks.walk(), phase=Phase.SWING)
    terms = terms_at(standing_state())
    context = asked(
        system,
        whole_body_terms=terms,
        momentum_rate=np.zeros(3),
        swing_foot_reference=[*terms.sole_positions[1], *np.zeros(9)],
        walking_state=WalkingState(swing),
    )
    _, wrenches, status = outputs(system, context)
    assert QpStatus(status).solved
    assert wrenches[6:] == pytest.approx(np.zeros(6), abs=1e-5)
    assert wrenches[5] > 300.0
