"""Oracle: core.walking_state_machine, called with the same values."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import Phase, WalkingState
from nadia_balance.core.walking_state_machine import (
    Measurement,
    WalkingStateMachineParams,
    advance,
)
from nadia_balance.systems.walking_state_machine import (
    WalkingStateMachine,
    walking_signal,
)
from tests.example_walks import FEET, OMEGA, SOLE, standing, walk

PERIOD = 0.002
PARAMS = WalkingStateMachineParams()
REACH = ReachabilityParams()
FORCES, ICP = np.array([400.0, 500.0]), np.array([0.01, 0.02])


def machine_in(state):
    """The system in `state`, its inputs fixed, and the plan it gets."""
    machine = WalkingStateMachine(PARAMS, state, SOLE, REACH, PERIOD)
    simulator = Simulator(machine)
    context = simulator.get_mutable_context()
    plan = plan_icp(state.schedule, SOLE, IcpPlanParams(), OMEGA)
    for name, value in {
        "foot_poses": Value(FEET),
        "foot_forces": FORCES,
        "icp": ICP,
        "icp_plan": Value(plan),
    }.items():
        machine.GetInputPort(name).FixValue(context, value)
    return machine, simulator, context, plan


@pytest.mark.parametrize("time", [0.1, 0.3 - PERIOD])
def test_advances_once_a_period(time):
    """Oracle: the core function, within a phase and at its end."""
    state = WalkingState(walk(), time)
    machine, simulator, context, plan = machine_in(state)
    port = machine.GetOutputPort("walking_state")
    assert port.Eval(context) is state
    simulator.AdvanceTo(0.5 * PERIOD)
    expected = advance(
        state,
        plan,
        Measurement(FEET, FORCES, ICP),
        PERIOD,
        SOLE,
        REACH,
        PARAMS,
    )
    now = port.Eval(context)
    assert now.time_in_phase == expected.time_in_phase
    assert now.schedule.phase is expected.schedule.phase
    assert now.schedule.footsteps == expected.schedule.footsteps
    simulator.AdvanceTo(0.9 * PERIOD)
    assert port.Eval(context) is now


def test_signal_says_what_the_state_says():
    """Oracle: the state's own fields, in the order of the docstring."""
    state = WalkingState(walk(length=0.3), 0.125, steps_taken=4)
    machine, _, context, _ = machine_in(state)
    signal = machine.GetOutputPort("walking_signal").Eval(context)
    assert signal == pytest.approx(
        [1, 1, 0.125, 0.3, 0, 4]
        + [0, 0.125, 0, 0, -0.125, 0]
        + [0.3, -0.125, 0, -1]
    )


def test_signal_has_no_target_when_no_step_is_left():
    """Oracle: NaN, and side 0."""
    signal = walking_signal(WalkingState(standing()))
    assert signal[0] == 0.0
    assert np.all(np.isnan(signal[12:15]))
    assert signal[15] == 0.0


def test_a_clone_goes_its_own_way():
    """Oracle: the state is in the Context, not in the system."""
    state = WalkingState(walk(), 0.1)
    machine, simulator, context, _ = machine_in(state)
    clone = context.Clone()
    simulator.AdvanceTo(2.5 * PERIOD)
    port = machine.GetOutputPort("walking_state")
    assert port.Eval(clone) is state
    assert port.Eval(context).time_in_phase > 0.1


@pytest.mark.parametrize("name", ["foot_poses", "icp_plan"])
def test_refuses_another_type(name):
    """Oracle: the message names the port."""
    machine, simulator, context, _ = machine_in(WalkingState(walk()))
    machine.GetInputPort(name).FixValue(context, Value(object()))
    with pytest.raises(TypeError, match=name):
        simulator.AdvanceTo(0.5 * PERIOD)


def test_needs_the_plan():
    """Oracle: Drake names the port that is not connected."""
    state = WalkingState(walk())
    machine = WalkingStateMachine(PARAMS, state, SOLE, REACH, PERIOD)
    with pytest.raises(RuntimeError, match="foot_poses"):
        Simulator(machine).AdvanceTo(PERIOD)
    assert state.schedule.phase is Phase.TRANSFER
