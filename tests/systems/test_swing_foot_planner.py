"""Oracle: core.swing_foot, called with the same values."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from nadia_balance.core.swing_foot import (
    FootMotion,
    SwingFootParams,
    swing_foot_motion,
)
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.systems.swing_foot_planner import SwingFootPlanner

PERIOD = 0.002
PARAMS = SwingFootParams()


def swing(t):
    """The right foot swings 0.3 m forward."""
    feet = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))
    step = Footstep(Side.RIGHT, FootPose([0.3, -0.125, 0.0]), 0.3, 0.7)
    start = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    schedule = ContactSchedule(
        Phase.SWING, Side.LEFT, 0.7, feet, (step,), start
    )
    return WalkingState(schedule, t)


def test_continues_from_the_last_reference():
    """Oracle: the core function, from the discrete state."""
    planner = SwingFootPlanner(PARAMS, swing(0.0), PERIOD)
    context = planner.CreateDefaultContext()
    port = planner.GetInputPort("walking_state")
    port.FixValue(context, Value(swing(0.2)))
    previous = np.array([0.1, -0.1, 0.05, 0.5, 0, 0, 0, 0, 0, 0.1, 0, 0])
    context.SetDiscreteState(previous)
    expected = swing_foot_motion(
        FootMotion.from_vector(previous), swing(0.2), PERIOD, PARAMS
    ).as_vector()
    assert planner.get_output_port().Eval(context) == pytest.approx(
        expected, abs=1e-15
    )


def test_remembers_what_it_said():
    """Oracle: x+ = y."""
    planner = SwingFootPlanner(PARAMS, swing(0.0), PERIOD)
    simulator = Simulator(planner)
    context = simulator.get_mutable_context()
    port = planner.GetInputPort("walking_state")
    port.FixValue(context, Value(swing(0.002)))
    said = planner.get_output_port().Eval(context).copy()
    simulator.AdvanceTo(0.5 * PERIOD)
    assert context.get_discrete_state_vector().value() == pytest.approx(said)


def test_refuses_another_type():
    """Oracle: the message names system, port and both types."""
    planner = SwingFootPlanner(PARAMS, swing(0.0), PERIOD)
    context = planner.CreateDefaultContext()
    port = planner.GetInputPort("walking_state")
    port.FixValue(context, Value(object()))
    with pytest.raises(TypeError, match="walking_state.*object.*WalkingState"):
        planner.get_output_port().Eval(context)
