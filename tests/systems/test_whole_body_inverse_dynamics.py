import numpy as np
import pytest
from pydrake.common.value import Value

from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.core.whole_body_limits import WholeBodyLimits
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.systems.whole_body_inverse_dynamics import (
    WholeBodyInverseDynamics,
)
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


def walking_state(phase=Phase.STANDING):
    feet = FootPoses(
        FootPose(np.array([0.0, 0.125, 0.0])),
        FootPose(np.array([0.0, -0.125, 0.0])),
    )
    rest = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    return WalkingState(ContactSchedule(phase, Side.LEFT, 1.0, feet, (), rest))


def standing(**params):
    """The system, and a context in which Nadia stands."""
    return standing_in(
        WholeBodyInverseDynamics(nadia(), WholeBodyQpParams(**params), PERIOD)
    )


def standing_in(system):
    context = system.CreateDefaultContext()
    fix(system, context, "estimated_state", standing_state())
    fix(system, context, "momentum_rate", PUSHED)
    fix(system, context, "swing_foot_reference", np.zeros(12))
    fix(system, context, "walking_state", Value(walking_state()))
    return system, context


def fix(system, context, name, value):
    system.GetInputPort(name).FixValue(context, value)


def outputs(system, context):
    return [
        system.GetOutputPort(name).Eval(context)
        for name in ("actuation", "foot_wrenches", "qp_status")
    ]


def tick(system, context):
    updates = system.EvalUniquePeriodicDiscreteUpdate(context)
    context.get_mutable_discrete_state().SetFrom(updates)


def test_gives_what_the_core_function_gives():
    """Oracle: WholeBodyQp, torques sorted by the plant's B matrix."""
    system, context = standing()
    terms = terms_at(standing_state())
    found = WholeBodyQp(WholeBodyQpParams(), model()).solve(
        terms, command(terms, momentum_rate=PUSHED)
    )
    actuation, wrenches, status = outputs(system, context)
    B = kinematics().plant.MakeActuationMatrix()
    assert B[6:] @ actuation == pytest.approx(found.torques, abs=1e-9)
    assert wrenches == pytest.approx(found.wrenches, abs=1e-9)
    qp = found.qp
    assert status == pytest.approx([1, 0, qp.iterations, qp.violation, 0])


def test_remembers_the_active_rows():
    """Oracle: the second tick needs a single solve."""
    system, context = standing()
    cold = outputs(system, context)
    tick(system, context)
    warm = outputs(system, context)
    assert cold[2][2] > 1
    assert warm[2][2] == 1
    assert warm[0] == pytest.approx(cold[0], abs=1e-7)


def test_solves_once_for_all_outputs_and_the_update(monkeypatch):
    """Oracle: a counter in the place of the core function."""
    calls = []
    solve = WholeBodyQp.solve

    def counted(*args):
        calls.append(1)
        return solve(*args)

    monkeypatch.setattr(WholeBodyQp, "solve", counted)
    system, context = standing()
    outputs(system, context)
    outputs(system, context)
    system.EvalUniquePeriodicDiscreteUpdate(context)
    assert len(calls) == 1


def test_contexts_do_not_know_of_each_other():
    """Oracle: a fresh context gives the same bits after others were used."""
    system, context = standing()
    first = [value.copy() for value in outputs(system, context)]
    tick(system, context)
    fix(system, context, "momentum_rate", -PUSHED)
    outputs(system, context)
    _, fresh = standing_in(system)
    for expected, found in zip(first, outputs(system, fresh), strict=True):
        assert np.array_equal(expected, found)


def test_holds_the_last_torque_when_there_is_none(monkeypatch):
    """Oracle: a QP without solution, by an impossible bound of forces."""
    system, context = standing()
    good = [value.copy() for value in outputs(system, context)]
    tick(system, context)
    make_infeasible(monkeypatch)
    fix(system, context, "momentum_rate", PUSHED + 1.0)
    for failures in (1, 2, 3):
        actuation, wrenches, status = outputs(system, context)
        assert np.array_equal(actuation, good[0])
        assert np.array_equal(wrenches, good[1])
        assert (status[0], status[1], status[4]) == (0, 1, failures)
        tick(system, context)
    monkeypatch.undo()
    fix(system, context, "momentum_rate", PUSHED)
    actuation, _, status = outputs(system, context)
    assert actuation == pytest.approx(good[0], abs=1e-7)
    assert (status[0], status[4]) == (1, 3)


def make_infeasible(monkeypatch):
    """Bounds one torque from below by 1 and from above by -1."""
    bounds = WholeBodyLimits.bounds

    def impossible(self, terms, wish, C):
        lower, upper = bounds(self, terms, wish, C)
        C[0] = C[1]
        lower[0], upper[1] = 1.0, -1.0
        return lower, upper

    monkeypatch.setattr(WholeBodyLimits, "bounds", impossible)


@pytest.mark.parametrize(
    "port", ["estimated_state", "momentum_rate", "swing_foot_reference"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_refuses_what_is_not_finite_by_name(port, value):
    """Oracle: the message names system and port."""
    system, context = standing()
    system.set_name("legs")
    bad = system.GetInputPort(port).Eval(context).copy()
    bad[-1] = value
    fix(system, context, port, bad)
    with pytest.raises(RuntimeError, match=f"legs: .*'{port}' is not finite"):
        outputs(system, context)


def test_refuses_another_type_of_walking_state():
    """Oracle: the message names port and both types."""
    system, context = standing()
    fix(system, context, "walking_state", Value(FootPose()))
    with pytest.raises(
        TypeError, match="'walking_state' got a FootPose, needs a WalkingState"
    ):
        outputs(system, context)


def test_lifts_the_foot_that_swings():
    """Oracle: no wrench on it, and the other one carries."""
    system, context = standing()
    fix(system, context, "walking_state", Value(walking_state(Phase.SWING)))
    fix(system, context, "momentum_rate", np.zeros(3))
    terms = terms_at(standing_state())
    swing = np.concatenate([terms.sole_positions[1], np.zeros(9)])
    fix(system, context, "swing_foot_reference", swing)
    _, wrenches, status = outputs(system, context)
    assert status[0] == 1
    assert wrenches[6:] == pytest.approx(np.zeros(6), abs=1e-5)
    assert wrenches[5] > 300.0


def test_updates_with_the_control_period():
    """Oracle: Drake's own account of the discrete update."""
    system, _ = standing()
    timing = system.GetUniquePeriodicDiscreteUpdateAttribute()
    assert (timing.period_sec(), timing.offset_sec()) == (PERIOD, 0.0)
