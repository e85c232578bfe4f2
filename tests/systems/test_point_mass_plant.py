"""Oracle: core.lipm's closed form."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from nadia_balance.core.lipm import com_after, icp
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
from nadia_balance.systems.point_mass_plant import PointMassPlant

MASS, OMEGA, HEIGHT, PERIOD = 90.0, 3.2, 0.95, 0.002
FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))


def walking_state(phase):
    """The right foot is to swing, or swings."""
    step = Footstep(Side.RIGHT, FootPose([0.1, -0.125, 0.0]), 0.3, 0.7)
    start = ReferencePoint([0.01, 0.02], [0.1, -0.05], [0.0, 0.0])
    return WalkingState(
        ContactSchedule(phase, Side.LEFT, 0.7, FEET, (step,), start)
    )


def plant_with(phase=Phase.SWING, ecmp=(0.0, 0.0), swing=(0, 0, 0.05), push=0):
    """The plant and a context in which all inputs are fixed."""
    state = walking_state(phase)
    plant = PointMassPlant(MASS, OMEGA, HEIGHT, state, PERIOD)
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    values = {
        "ecmp_command": [0.0, 0.0, *ecmp],
        "swing_foot_reference": [*swing, *np.zeros(6), 0.3, 0.0, 0.0],
        "walking_state": Value(state),
        "push_force": [push, 0.0, 0.0],
    }
    for name, value in values.items():
        plant.GetInputPort(name).FixValue(context, value)
    return plant, simulator, context


def test_moves_as_the_pendulum_does():
    """Oracle: the closed form over half a second, in one piece."""
    ecmp = np.array([0.03, -0.02])
    plant, simulator, context = plant_with(ecmp=ecmp)
    start = plant.GetOutputPort("com_state").Eval(context).copy()
    simulator.AdvanceTo(0.499)
    com, velocity = com_after(start[:2], start[3:5], ecmp, OMEGA, 0.5)
    end = plant.GetOutputPort("com_state").Eval(context)
    assert end[:2] == pytest.approx(com, abs=1e-10)
    assert end[3:5] == pytest.approx(velocity, abs=1e-10)
    assert plant.GetOutputPort("icp").Eval(context) == pytest.approx(
        icp(com, velocity, OMEGA), abs=1e-10
    )


def test_a_push_changes_the_velocity_by_its_impulse():
    """Oracle: F t / m over one tick, to first order."""
    _, quiet, a = plant_with()
    _, pushed, b = plant_with(push=900.0)
    for simulator in (quiet, pushed):
        simulator.AdvanceTo(0.5 * PERIOD)
    change = (
        b.get_discrete_state_vector().value()
        - a.get_discrete_state_vector().value()
    )
    assert change[3] == pytest.approx(900.0 * PERIOD / MASS, rel=1e-4)


def test_the_swing_foot_is_where_it_is_told():
    """Oracle: the reference."""
    plant, _, context = plant_with(swing=(0.05, -0.13, 0.04))
    foot = plant.GetOutputPort("foot_poses").Eval(context)[Side.RIGHT]
    assert foot.p_WF == pytest.approx([0.05, -0.13, 0.04])
    assert foot.yaw == 0.3


@pytest.mark.parametrize(
    ("phase", "height", "shares"),
    [
        (Phase.TRANSFER, 0.0, (0.5, 0.5)),
        (Phase.SWING, 0.05, (1.0, 0.0)),
        (Phase.SWING, 0.0, (0.5, 0.5)),
    ],
)
def test_feet_on_the_ground_share_the_weight(phase, height, shares):
    """Oracle: by hand."""
    plant, _, context = plant_with(phase, swing=(0.0, 0.0, height))
    forces = plant.GetOutputPort("foot_forces").Eval(context)
    assert forces == pytest.approx(MASS * 9.81 * np.array(shares))
