"""Oracle: core.walking_state_machine, called with the same values."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from nadia_balance.core.foothold_adjustment import unadjusted
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
WEIGHT = 900.0  # [N]
PARAMS = WalkingStateMachineParams()
REACH = ReachabilityParams()
FORCES, ICP = np.array([400.0, 500.0]), np.array([0.01, 0.02])


def machine_in(state):
    """The system in `state`, its inputs fixed, and the plan it gets."""
    machine = WalkingStateMachine(PARAMS, state, SOLE, REACH, WEIGHT, PERIOD)
    simulator = Simulator(machine)
    context = simulator.get_mutable_context()
    plan = fix_inputs(machine, context, state)
    return machine, simulator, context, plan


def fix_inputs(machine, context, state, feet=FEET):
    """Fixes all inputs that there must be; returns the plan."""
    plan = plan_icp(state.schedule, SOLE, IcpPlanParams(), OMEGA)
    for name, value in {
        "foot_poses": feet and Value(feet),
        "foot_forces": FORCES,
        "icp": ICP,
        "icp_plan": Value(plan),
    }.items():
        if value is not None:
            machine.GetInputPort(name).FixValue(context, value)
    return plan


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
        Measurement(lambda: FEET, FORCES / WEIGHT, ICP),
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


@pytest.mark.parametrize("adjuster", ["missing", "switched off", "on"])
def test_its_patience_ends_only_if_the_feet_may_go_elsewhere(adjuster):
    """Oracle: the parameter; who is switched off proposes None."""
    state = WalkingState(walk(), 0.3, 0.3)
    machine, simulator, context, _ = machine_in(state)
    machine.GetInputPort("icp").FixValue(context, [0.06, 0.02])
    if adjuster != "missing":
        proposed = unadjusted(state.schedule) if adjuster == "on" else None
        machine.GetInputPort("adjustment").FixValue(context, Value(proposed))
    port = machine.GetOutputPort("walking_state")
    simulator.AdvanceTo(5.0 * PERIOD)
    assert port.Eval(context).waiting
    simulator.AdvanceTo(PARAMS.lift_off.held_patience + 2.0 * PERIOD)
    phase = port.Eval(context).schedule.phase
    assert phase is (Phase.SWING if adjuster == "on" else Phase.TRANSFER)
    simulator.AdvanceTo(3.0 * PARAMS.lift_off.held_patience)
    assert port.Eval(context).waiting is (adjuster != "on")


@pytest.mark.parametrize("time", [0.1, 0.3 - PERIOD])
def test_asks_where_the_feet_are_only_when_the_contacts_change(time):
    """Oracle: the error of a port that has no value; the last transfer."""
    state = WalkingState(replace(walk(), footsteps=()), time)
    machine = WalkingStateMachine(PARAMS, state, SOLE, REACH, WEIGHT, PERIOD)
    simulator = Simulator(machine)
    fix_inputs(machine, simulator.get_mutable_context(), state, feet=None)
    if time < 0.2:
        simulator.AdvanceTo(0.5 * PERIOD)
    else:
        with pytest.raises(RuntimeError, match="foot_poses"):
            simulator.AdvanceTo(0.5 * PERIOD)


@pytest.mark.parametrize("name", ["foot_poses", "icp_plan"])
def test_refuses_another_type(name):
    """Oracle: the message names the port."""
    at_the_end = WalkingState(replace(walk(), footsteps=()), 0.3 - PERIOD)
    machine, simulator, context, _ = machine_in(at_the_end)
    machine.GetInputPort(name).FixValue(context, Value(object()))
    with pytest.raises(TypeError, match=name):
        simulator.AdvanceTo(0.5 * PERIOD)


def test_needs_the_plan():
    """Oracle: Drake names the port that is not connected."""
    state = WalkingState(walk())
    machine = WalkingStateMachine(PARAMS, state, SOLE, REACH, WEIGHT, PERIOD)
    simulator = Simulator(machine)
    context = simulator.get_mutable_context()
    for name, value in ("foot_forces", FORCES), ("icp", ICP):
        machine.GetInputPort(name).FixValue(context, value)
    with pytest.raises(RuntimeError, match="icp_plan"):
        simulator.AdvanceTo(PERIOD)
    assert state.schedule.phase is Phase.TRANSFER
