"""The capture-point controller on a point mass, against closed forms."""

import math

import pytest

from nadia_balance.core.math.lipm import com_after, icp_after
from nadia_balance.results.log import signal
from tests.diagrams.simulated import diagram_of, figures, simulated

PERIOD = 0.002
WALK = "{duration: 4.0, gait: {num_steps: 2}}"


def pushed(delta_v, duration, direction, until=1.6):
    """Stands, and is pushed at 0.2 s."""
    return (
        f"{{duration: {until}, pushes: [{{delta_v: {delta_v}, at: 0.2 s, "
        f"duration: {duration}, direction_deg: {direction}}}]}}"
    )


@pytest.fixture(scope="module")
def model():
    return diagram_of(plant="lipm").robot.point_mass


def test_the_icp_follows_eq_3_from_tick_to_tick(model):
    """Oracle: the closed form with the eCMP of each tick, to rounding."""
    logs = simulated(WALK, "lipm").logs
    icp, ecmp = logs["icp"], signal(logs, "ecmp_command").ecmp.T
    for i in range(len(icp) - 1):
        then = icp_after(icp[i], ecmp[i], model.omega, PERIOD)
        assert icp[i + 1] == pytest.approx(then, abs=1e-12)


def test_the_point_mass_follows_its_closed_form_under_a_push(model):
    """Oracle: cosh and sinh about the eCMP, shifted by F / (m omega^2)."""
    logs = simulated(pushed(0.3, 0.1, 30.0), "lipm").logs
    stiffness = model.mass * model.omega**2
    ecmp = signal(logs, "ecmp_command").ecmp.T
    pivots = ecmp - signal(logs, "push_signal").force.T[:, :2] / stiffness
    state = signal(logs, "com_state")
    com, velocity = state.position[:2].T, state.velocity[:2].T
    for i in range(len(com) - 1):
        then = com_after(com[i], velocity[i], pivots[i], model.omega, PERIOD)
        assert com[i + 1] == pytest.approx(then[0], abs=1e-12)
        assert velocity[i + 1] == pytest.approx(then[1], abs=1e-12)


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
