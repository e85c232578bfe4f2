import math

import numpy as np
import pytest

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
from nadia_balance.core.whole_body_command import whole_body_command
from nadia_balance.core.whole_body_params import WholeBodyQpParams

WEIGHT = 900.0
REST = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))


def state(phase, support=Side.LEFT, yaws=(0.0, 0.0), steps=1, **kwargs):
    """A phase of 1 s; `yaws` of the left and the right foot."""
    feet = FootPoses(
        FootPose(np.array([0.0, 0.1, 0.0]), yaws[0]),
        FootPose(np.array([0.0, -0.1, 0.0]), yaws[1]),
    )
    step = Footstep(support.other, feet[support.other], 0.3, 0.7)
    schedule = ContactSchedule(phase, support, 1.0, feet, (step,) * steps, REST)
    return WalkingState(schedule, **kwargs)


def command(walking_state, swing=None, **params):
    return whole_body_command(
        WholeBodyQpParams(**params),
        walking_state,
        np.zeros(3),
        np.zeros(12) if swing is None else swing,
        WEIGHT,
    )


@pytest.mark.parametrize(
    ("phase", "support", "contacts"),
    [
        (Phase.STANDING, Side.LEFT, (True, True)),
        (Phase.TRANSFER, Side.RIGHT, (True, True)),
        (Phase.SWING, Side.LEFT, (True, False)),
        (Phase.SWING, Side.RIGHT, (False, True)),
    ],
)
def test_only_the_swing_foot_does_not_carry(phase, support, contacts):
    """Oracle: a table."""
    assert command(state(phase, support)).contacts == contacts


def test_looks_ahead_between_the_feet():
    """Oracle: the mean, also across the cut of the circle at pi."""
    ahead = command(state(Phase.TRANSFER, yaws=(0.1, 0.5))).heading
    assert ahead == pytest.approx([0.3, 0.0, 0.0])
    ahead = command(state(Phase.TRANSFER, yaws=(3.1, -3.1))).heading
    assert math.remainder(ahead[0] - math.pi, math.tau) == pytest.approx(0.0)


def test_turns_with_the_swing_foot():
    """Oracle: half of the swing foot's yaw, and of its derivatives."""
    swing = np.zeros(12)
    swing[9:] = [0.5, 1.0, 2.0]
    ahead = command(state(Phase.SWING, yaws=(0.1, 0.0)), swing).heading
    assert ahead == pytest.approx([0.3, 0.5, 1.0])


@pytest.mark.parametrize(
    ("time", "expected"),
    [(0.0, math.inf), (0.79, math.inf), (0.9, 475.0), (1.0, 50.0)],
)
def test_the_trailing_foot_unloads_at_the_end_of_a_transfer(time, expected):
    """Oracle: linear from the weight to 50 N, in the last 0.2 s."""
    bounds = command(
        state(Phase.TRANSFER, time_in_phase=time),
        unloading_fraction=0.2,
        unloaded_force=50.0,
    ).max_normal_forces
    assert bounds == pytest.approx((math.inf, expected))


@pytest.mark.parametrize(
    "both_stay",
    [
        state(Phase.TRANSFER, steps=0, time_in_phase=1.0),
        state(Phase.TRANSFER, time_in_phase=1.0, waiting=True),
        state(Phase.STANDING, time_in_phase=1.0),
    ],
    ids=["last transfer", "waiting", "standing"],
)
def test_no_foot_unloads_that_is_not_about_to_leave(both_stay):
    """Oracle: no bound."""
    assert command(both_stay).max_normal_forces == (math.inf, math.inf)


def test_unloading_can_be_switched_off():
    """Oracle: no bound until the very end."""
    late = state(Phase.TRANSFER, time_in_phase=0.999)
    bounds = command(late, unloading_fraction=0.0).max_normal_forces
    assert bounds == (math.inf, math.inf)
