"""The capture-point controller on a point mass, against closed forms."""

import math

import pytest

from nadia_balance.results.log import signal
from tests.diagrams.simulated import figures, simulated

WALK = "{duration: 4.0, gait: {num_steps: 2}}"


def test_walks_in_place_within_millimetres_of_the_reference():
    """Oracle: the plan, which knows all but when exactly the foot lands.

    The foot is sensed 3 ticks after it has landed: the ICP, at 0.45 m/s by
    then, is 3 mm ahead of a plan that waits.
    """
    found = figures(WALK, "lipm")
    assert found["recovered"]
    assert found["max_icp_error_m"] < 0.003
    assert found["steps_taken"] == 2
    assert found["swing_durations_s"] == pytest.approx([0.7] * 2, abs=0.012)
    assert found["qp_failures"] == 0


def test_walks_where_it_is_told():
    """Oracle: the vectors' sum by hand, and the feet together at the end.

    The turn, 30 deg in all, comes last.
    """
    text = (
        "{duration: 6.6, gait: {first_swing: left, steps: [{length: 0.3, "
        "sideways: 0.1}, {length: -0.2}, {yaw_deg: 15.0}, {yaw_deg: 15.0}]}}"
    )
    run = simulated(text, "lipm")
    assert run.fell_at is None
    soles = signal(run.logs, "walking_signal", -1)
    left, right = soles.left, soles.right
    yaw = math.radians(30.0)
    assert [left[2], right[2]] == pytest.approx([yaw, yaw], abs=1e-6)
    middle = 0.5 * (left[:2] + right[:2])
    assert middle == pytest.approx([0.1, 0.1], abs=1e-6)
    assert math.dist(left[:2], right[:2]) == pytest.approx(0.25, abs=1e-6)
