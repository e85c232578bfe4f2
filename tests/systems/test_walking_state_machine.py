"""Oracle: core.plan.walking_state_machine, called with the same values."""

import numpy as np
import pytest

from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan.walking_state_machine import (
    StateMachine,
    WalkingStateMachineParams,
)
from nadia_balance.core.walking.state import (
    FootPose,
    Footstep,
    Mode,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems.plan import WalkingStateMachine
from nadia_balance.systems.signals import PHASES, WalkingSignal
from tests.blocks import answer, fix, running
from tests.example_walks import FEET, MODEL, planned, standing, walk

PERIOD = 0.002
PARAMS = WalkingStateMachineParams()
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
    expected = StateMachine(PARAMS, MODEL, PERIOD).advance(
        state,
        inputs(state)["icp_plan"],
        FEET,
        FORCES / (MODEL.mass * GRAVITY),
        ICP,
        footsteps=lambda: None,
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
    signal = WalkingSignal(answer(machine, context, "walking_signal"))
    assert PHASES[int(signal.phase)] is Phase.TRANSFER
    assert (signal.support_side, signal.target_side) == (1.0, -1.0)
    assert (signal.time_in_phase, signal.duration) == (0.125, 0.3)
    assert (signal.waiting, signal.steps_taken) == (0.0, 4.0)
    assert signal.left == pytest.approx([0.0, 0.125, 0.0])
    assert signal.right == pytest.approx([0.0, -0.125, 0.0])
    assert signal.target == pytest.approx([0.3, -0.125, 0.0])


def step(side, x=0.0):
    pose = FootPose([x, 0.125 * side.sign, 0.0])
    return Footstep(side, pose, 0.3, 0.7)


@pytest.mark.parametrize("first", list(Side))
def test_a_robot_that_stands_asks_for_footsteps_in_each_tick(first):
    """Oracle: the port: () while it is to stand, then a step of either foot."""
    state = WalkingState(standing())
    machine, simulator, context = machine_in(state)
    fix(machine, context, footsteps=())
    simulator.AdvanceTo(0.5 * PERIOD)
    assert walking_state(machine, context).mode is Mode.STANDING
    steps = step(first, 0.1), step(first.other, 0.2)
    fix(machine, context, footsteps=steps)
    simulator.AdvanceTo(1.5 * PERIOD)
    now = walking_state(machine, context)
    assert now.schedule.phase is Phase.TRANSFER
    assert now.schedule.footsteps == steps
    assert now.schedule.support_side is first.other
    assert now.mode is Mode.WALKING


def test_footsteps_that_have_not_landed_can_be_revised():
    """Oracle: the port's poses; the phase goes on.  (): it comes to rest."""
    state = WalkingState(walk(length=0.3), 0.1, 0.1)
    machine, simulator, context = machine_in(state)
    steps = step(Side.RIGHT, 0.05), step(Side.LEFT, 0.05)
    fix(machine, context, revised_footsteps=steps)
    simulator.AdvanceTo(0.5 * PERIOD)
    now = walking_state(machine, context)
    assert now.schedule.footsteps == steps
    assert now.elapsed == pytest.approx(0.1 + PERIOD)
    fix(machine, context, revised_footsteps=())
    simulator.AdvanceTo(1.5 * PERIOD)
    now = walking_state(machine, context)
    assert now.schedule.footsteps == () and now.elapsed <= PERIOD
    assert now.mode is Mode.STANDING


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ([step(Side.LEFT)], "got a list, needs a tuple"),
        (("left",), "has a str, needs Footsteps at 0.000 s"),
        ((step(Side.LEFT),) * 2, "has feet left, left: they must take turns"),
    ],
)
@pytest.mark.parametrize("port", ["footsteps", "revised_footsteps"])
def test_footsteps_of_no_robot_are_refused(port, steps, message):
    """Oracle: the message, which names the port."""
    machine, simulator, context = machine_in(WalkingState(standing()))
    fix(machine, context, **{port: steps})
    with pytest.raises((RuntimeError, TypeError), match=message) as error:
        simulator.AdvanceTo(0.5 * PERIOD)
    assert f"input port '{port}'" in str(error.value)
