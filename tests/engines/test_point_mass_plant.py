"""Oracle: core.math.lipm's closed form."""

import numpy as np
import pytest

from nadia_balance.core.math.lipm import GRAVITY, com_after, icp
from nadia_balance.core.walking.vocabulary import Phase, Side, WalkingState
from nadia_balance.engines.point_mass_plant import PointMassPlant
from tests.blocks import answer, running
from tests.example_walks import MODEL, ReferencePoint, replace, walk

PERIOD = 0.002
START = ReferencePoint([0.01, 0.02], [0.1, -0.05], [0.0, 0.0])


def plant_with(
    phase=Phase.SWING,
    ecmp=(0.0, 0.0),
    swing=(0, 0, 0.05),
    push=0,
    rates=(0.0,) * 6,
):
    """The plant, its simulator and a context in which all inputs are fixed.

    `swing` (3,) and `rates` [v(3), a(3)] are told to the right foot, which is
    to swing or swings.
    """
    state = WalkingState(replace(walk(), phase=phase, start=START))
    plant = PointMassPlant(MODEL, PERIOD, state)
    return plant, *running(
        plant,
        ecmp_command=[0.0, 0.0, *ecmp],
        swing_foot_reference=[*swing, *rates, 0.3, 0.5, -20.0],
        walking_state=state,
        push_force=[push, 0.0, 0.0],
    )


def test_moves_as_the_pendulum_does():
    """Oracle: the closed form over half a second, in one piece."""
    ecmp = np.array([0.03, -0.02])
    plant, simulator, context = plant_with(ecmp=ecmp)
    start = answer(plant, context, "com_state").copy()
    simulator.AdvanceTo(0.499)
    com, velocity = com_after(start[:2], start[3:5], ecmp, MODEL.omega, 0.5)
    end = answer(plant, context, "com_state")
    assert end[:2] == pytest.approx(com, abs=1e-10)
    assert end[3:5] == pytest.approx(velocity, abs=1e-10)
    expected = icp(com, velocity, MODEL.omega)
    assert answer(plant, context, "icp") == pytest.approx(expected, abs=1e-10)


def test_a_push_changes_the_velocity_by_its_impulse():
    """Oracle: F t / m over one tick, to first order."""
    velocities = []
    for push in 0.0, 900.0:
        plant, simulator, context = plant_with(push=push)
        simulator.AdvanceTo(0.5 * PERIOD)
        velocities.append(answer(plant, context, "com_state")[3])
    change = velocities[1] - velocities[0]
    assert change == pytest.approx(900.0 * PERIOD / MODEL.mass, rel=1e-4)


def test_the_swing_foot_goes_where_it_is_told():
    """Oracle: p + v t + a t^2 / 2, by hand, for one tick of 0.002 s."""
    rates = (0.5, -1.0, 1.5, 10.0, 20.0, -30.0)
    plant, simulator, context = plant_with(
        swing=(0.05, -0.13, 0.04), rates=rates
    )
    simulator.AdvanceTo(0.5 * PERIOD)
    foot = answer(plant, context, "foot_poses")[Side.RIGHT]
    told = [0.05 + 0.00102, -0.13 - 0.00196, 0.04 + 0.00294]
    assert foot.p_WF == pytest.approx(told, abs=1e-12)
    assert foot.yaw == pytest.approx(0.3 + 0.00096, abs=1e-12)


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
    forces = answer(plant, context, "foot_forces")
    assert forces == pytest.approx(MODEL.mass * GRAVITY * np.array(shares))
