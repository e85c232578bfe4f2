"""Oracle: core.plan.walking_state_machine, called with the same values."""

import numpy as np
import pytest

from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan import walking_state_machine as core
from nadia_balance.core.walking.vocabulary import Phase, WalkingState
from nadia_balance.systems.plan import WalkingStateMachine
from nadia_balance.systems.signals import PHASES, WalkingSignal
from tests.blocks import answer, fix, running
from tests.example_walks import FEET, MODEL, planned, walk

PERIOD = 0.002
PARAMS = core.WalkingStateMachineParams()
FORCES, ICP = np.array([400.0, 500.0]), np.array([0.01, 0.02])


def inputs(state):
    """All inputs that there must be."""
    return {
        "foot_poses": FEET,
        "foot_forces": FORCES,
        "icp": ICP,
        "icp_plan": planned(state.schedule),
    }


def machine_in(state):
    """The system in `state`, its simulator and context."""
    machine = WalkingStateMachine(PARAMS, MODEL, PERIOD, state)
    return machine, *running(machine, **inputs(state))


def walking_state(machine, context):
    return answer(machine, context, "walking_state")


@pytest.mark.parametrize(
    ("time", "gain"), [(0.1, None), (0.1, 0.05), (0.3 - PERIOD, None)]
)
def test_advances_once_a_period(time, gain):
    """Oracle: the core function, within a phase and at its end."""
    state = WalkingState(walk(), time)
    machine, simulator, context = machine_in(state)
    if gain is not None:
        fix(machine, context, time_adjustment=[gain, 0.2])
    assert walking_state(machine, context) is state
    simulator.AdvanceTo(0.5 * PERIOD)
    expected = core.StateMachine(PARAMS, MODEL, PERIOD).advance(
        state,
        inputs(state)["icp_plan"],
        FEET,
        FORCES / (MODEL.mass * GRAVITY),
        ICP,
        time_gain=gain or 0.0,
    )
    now = walking_state(machine, context)
    assert now.time_in_phase == expected.time_in_phase
    assert now.schedule.phase is expected.schedule.phase
    assert now.schedule.footsteps == expected.schedule.footsteps
    simulator.AdvanceTo(0.9 * PERIOD)
    assert walking_state(machine, context) is now


def test_signal_says_what_the_state_says():
    """Oracle: the state's own fields, by name."""
    state = WalkingState(walk(length=0.3), 0.125, steps_taken=4)
    machine, _, context = machine_in(state)
    found = WalkingSignal(answer(machine, context, "walking_signal"))
    assert PHASES[int(found.phase)] is Phase.TRANSFER
    assert (found.support_side, found.target_side) == (1.0, -1.0)
    assert (found.time_in_phase, found.duration) == (0.125, 0.3)
    assert (found.waiting, found.steps_taken) == (0.0, 4.0)
    assert found.left == pytest.approx([0.0, 0.125, 0.0])
    assert found.right == pytest.approx([0.0, -0.125, 0.0])
    assert found.target == pytest.approx([0.3, -0.125, 0.0])
