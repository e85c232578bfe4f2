"""Oracle: core.plan.walking_state_machine, called with the same values."""

import numpy as np
import pytest

from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.plan.walking_state_machine import (
    Measurement,
    StateMachine,
    WalkingStateMachineParams,
)
from nadia_balance.core.steps.foothold_adjustment import unadjusted
from nadia_balance.core.walking.vocabulary import Phase, WalkingState
from nadia_balance.systems.signals import PHASES, WalkingSignal
from nadia_balance.systems.walking_state_machine import WalkingStateMachine
from tests.blocks import answer, asked, fix, running
from tests.example_walks import FEET, MODEL, walk

PERIOD = 0.002
PARAMS = WalkingStateMachineParams()
FORCES, ICP = np.array([400.0, 500.0]), np.array([0.01, 0.02])


def inputs(state):
    """All inputs that there must be."""
    return {
        "foot_poses": FEET,
        "foot_forces": FORCES,
        "icp": ICP,
        "icp_plan": plan_icp(state.schedule, IcpPlanParams(), MODEL),
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
    expected = StateMachine(PARAMS, MODEL, PERIOD).advance(
        state,
        inputs(state)["icp_plan"],
        Measurement(FEET, FORCES / (MODEL.mass * GRAVITY), ICP),
        time_gain=gain or 0.0,
    )
    now = walking_state(machine, context)
    assert now.time_in_phase == expected.time_in_phase
    assert now.schedule.phase is expected.schedule.phase
    assert now.schedule.footsteps == expected.schedule.footsteps
    simulator.AdvanceTo(0.9 * PERIOD)
    assert walking_state(machine, context) is now


def test_stands_unless_it_is_told_how_to_start():
    """Oracle: no steps, the feet as far apart as the model's."""
    machine = WalkingStateMachine(PARAMS, MODEL, PERIOD)
    schedule = walking_state(machine, asked(machine)).schedule
    assert (schedule.phase, schedule.footsteps) == (Phase.STANDING, ())
    width = schedule.feet.left.p_WF - schedule.feet.right.p_WF
    assert width == pytest.approx([0.0, MODEL.step_width, 0.0])


def signal_of(state):
    machine, _, context = machine_in(state)
    return WalkingSignal(answer(machine, context, "walking_signal"))


def test_signal_says_what_the_state_says():
    """Oracle: the state's own fields, by name."""
    found = signal_of(WalkingState(walk(length=0.3), 0.125, steps_taken=4))
    assert PHASES[int(found.phase)] is Phase.TRANSFER
    assert (found.support_side, found.target_side) == (1.0, -1.0)
    assert (found.time_in_phase, found.duration) == (0.125, 0.3)
    assert (found.waiting, found.steps_taken) == (0.0, 4.0)
    assert found.left == pytest.approx([0.0, 0.125, 0.0])
    assert found.right == pytest.approx([0.0, -0.125, 0.0])
    assert found.target == pytest.approx([0.3, -0.125, 0.0])


@pytest.mark.parametrize("adjuster", ["switched off", "on"])
def test_its_wait_ends_only_if_the_feet_may_go_elsewhere(adjuster):
    """Oracle: the parameter; who is switched off proposes None."""
    state = WalkingState(walk(), 0.3, 0.3)
    machine, simulator, context = machine_in(state)
    fix(machine, context, icp=[0.06, 0.02])
    proposed = unadjusted(state.schedule) if adjuster == "on" else None
    fix(machine, context, adjustment=proposed)
    simulator.AdvanceTo(5.0 * PERIOD)
    assert walking_state(machine, context).waiting
    simulator.AdvanceTo(PARAMS.lift_off.max_held_wait + 2.0 * PERIOD)
    phase = walking_state(machine, context).schedule.phase
    assert phase is (Phase.SWING if adjuster == "on" else Phase.TRANSFER)
    simulator.AdvanceTo(3.0 * PARAMS.lift_off.max_held_wait)
    assert walking_state(machine, context).waiting is (adjuster != "on")
