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


def plant_with(
    phase=Phase.SWING,
    ecmp=(0.0, 0.0),
    swing=(0, 0, 0.05),
    push=0,
    rates=(0.0,) * 6,
):
    """The plant and a context in which all inputs are fixed.

    `swing` (3,) and `rates` [v(3), a(3)] are told to the foot.
    """
    state = walking_state(phase)
    plant = PointMassPlant(MASS, OMEGA, HEIGHT, state, PERIOD)
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    values = {
        "ecmp_command": [0.0, 0.0, *ecmp],
        "swing_foot_reference": [*swing, *rates, 0.3, 0.5, -20.0],
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
    change = b.get_discrete_state(0).value() - a.get_discrete_state(0).value()
    assert change[3] == pytest.approx(900.0 * PERIOD / MASS, rel=1e-4)


def test_the_swing_foot_starts_where_it_stands():
    """Oracle: the schedule."""
    plant, _, context = plant_with()
    feet = plant.GetOutputPort("foot_poses").Eval(context)
    assert np.array_equal(feet[Side.RIGHT].p_WF, FEET.right.p_WF)
    assert feet[Side.RIGHT].yaw == FEET.right.yaw
    assert feet[Side.LEFT] is FEET.left


def test_the_swing_foot_goes_where_it_is_told():
    """Oracle: p + v t + a t^2 / 2, by hand, for one tick of 0.002 s."""
    rates = (0.5, -1.0, 1.5, 10.0, 20.0, -30.0)
    plant, simulator, context = plant_with(
        swing=(0.05, -0.13, 0.04), rates=rates
    )
    simulator.AdvanceTo(0.5 * PERIOD)
    foot = plant.GetOutputPort("foot_poses").Eval(context)[Side.RIGHT]
    told = [0.05 + 0.00102, -0.13 - 0.00196, 0.04 + 0.00294]
    assert foot.p_WF == pytest.approx(told, abs=1e-12)
    assert foot.yaw == pytest.approx(0.3 + 0.00096, abs=1e-12)


def test_the_ground_stops_the_swing_foot():
    """Oracle: the height of the soles, 0."""
    plant, simulator, context = plant_with(swing=(0.05, -0.13, -0.01))
    simulator.AdvanceTo(0.5 * PERIOD)
    foot = plant.GetOutputPort("foot_poses").Eval(context)[Side.RIGHT]
    assert foot.p_WF[2] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize(
    "name", ["ecmp_command", "push_force", "swing_foot_reference"]
)
def test_does_not_move_by_a_number_that_is_none(name, bad):
    """Oracle: the message; the state stays as it was."""
    plant, simulator, context = plant_with()
    plant.set_name("mass")
    port = plant.GetInputPort(name)
    port.FixValue(context, np.full(port.size(), bad))
    before = states(context)
    with pytest.raises(RuntimeError, match=f"^mass: .*'{name}' is not finite"):
        simulator.AdvanceTo(0.5 * PERIOD)
    assert states(context) == before


def states(context):
    """All numbers in the discrete state."""
    groups = range(context.num_discrete_state_groups())
    return [context.get_discrete_state(i).value().tolist() for i in groups]


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
    plant, simulator, context = plant_with(phase, swing=(0.0, 0.0, height))
    simulator.AdvanceTo(0.5 * PERIOD)
    forces = plant.GetOutputPort("foot_forces").Eval(context)
    assert forces == pytest.approx(MASS * 9.81 * np.array(shares))
