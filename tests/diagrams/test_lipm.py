"""The brain on a point mass, against closed forms."""

import math

import numpy as np
import pytest

from diagrams.run_log import icp_error
from diagrams.simulation import simulate
from nadia_balance.balance_controller import point_mass_of
from nadia_balance.core.lipm import com_after, icp_after
from tests.diagrams.simulated import diagram_of, figures, simulated

PERIOD = 0.002
WALK = "{duration: 6.0, gait: {num_steps: 4}}"
PUSHED = (
    "{{duration: 4.0, "
    "pushes: [{{delta_v: {}, time: 1.0, duration: {}, direction_deg: {}}}]}}"
)


@pytest.fixture(scope="module")
def model():
    return point_mass_of(diagram_of(plant="lipm").robot)


def test_the_icp_follows_eq_3_from_tick_to_tick(model):
    """Oracle: the closed form with the eCMP of each tick, to rounding."""
    logs = simulated(WALK, "lipm").logs
    icp, ecmp = logs["icp"], logs["ecmp_command"][:, 2:]
    for i in range(len(icp) - 1):
        then = icp_after(icp[i], ecmp[i], model.omega, PERIOD)
        assert icp[i + 1] == pytest.approx(then, abs=1e-12)


def test_the_point_mass_follows_its_closed_form_under_a_push(model):
    """Oracle: cosh and sinh about the eCMP, shifted by F / (m omega^2)."""
    logs = simulated(PUSHED.format(0.3, 0.1, 30.0), "lipm").logs
    stiffness = model.mass * model.omega**2
    pivots = logs["ecmp_command"][:, 2:] - logs["push_force"][:, :2] / stiffness
    com, velocity = np.hsplit(logs["com_state"][:, [0, 1, 3, 4]], 2)
    for i in range(len(com) - 1):
        then = com_after(com[i], velocity[i], pivots[i], model.omega, PERIOD)
        assert com[i + 1] == pytest.approx(then[0], abs=1e-12)
        assert velocity[i + 1] == pytest.approx(then[1], abs=1e-12)


@pytest.mark.parametrize("direction", [0.0, 90.0, 210.0])
def test_a_push_changes_the_velocity_by_delta_v(direction):
    """Oracle: delta_v, in the given direction.

    A push of one tick, so short that the brain cannot answer; gravity takes
    part with omega^2 x the ICP error of 0 x 0.002 s.
    """
    logs = simulated(PUSHED.format(0.2, PERIOD, direction), "lipm").logs
    pushed = np.flatnonzero(np.linalg.norm(logs["push_force"], axis=1))
    assert len(pushed) == 1
    # The push is decided on at 1 s, and felt from the next tick on.
    assert logs["t"][pushed[0]] == pytest.approx(1.0 + PERIOD)
    velocity = logs["com_state"][:, 3:5]
    change = velocity[pushed[0] + 1] - velocity[pushed[0]]
    angle = math.radians(direction)
    expected = 0.2 * np.array([math.cos(angle), math.sin(angle)])
    # sinh(omega T) / (omega T) - 1 = 7e-6 of it.
    assert change == pytest.approx(expected, abs=1e-5 * 0.2)


def test_a_push_lasts_as_long_as_it_is_told():
    """Oracle: force x ticks x period = mass x delta_v."""
    diagram = diagram_of(PUSHED.format(0.3, 0.1, 90.0), "lipm")
    logs = simulated(PUSHED.format(0.3, 0.1, 90.0), "lipm").logs
    impulse = PERIOD * np.sum(logs["push_force"], axis=0)
    expected = [0.0, 0.3 * diagram.robot.mass, 0.0]
    assert impulse == pytest.approx(expected, abs=1e-9)


def test_stands_without_any_error():
    """The start is an equilibrium, and an exact one."""
    logs = simulated("{duration: 2.0}", "lipm").logs
    assert np.max(icp_error(logs)) == 0.0


def test_walks_in_place_within_millimetres_of_the_reference():
    """Oracle: the plan, which knows all but when exactly the foot lands.

    The foot is sensed 3 ticks after it has landed: the ICP, at 0.45 m/s by
    then, is 3 mm ahead of a plan that waits.
    """
    found = figures(WALK, "lipm")
    assert found["recovered"]
    assert found["max_icp_error_m"] < 0.003
    assert found["steps_taken"] == 4
    assert found["swing_durations_s"] == pytest.approx([0.7] * 4, abs=0.012)
    assert found["qp_failures"] == 0


@pytest.mark.parametrize(
    "step", ["length: 0.3", "length: -0.2", "sideways: 0.1", "yaw_deg: 15.0"]
)
def test_walks_where_it_is_told(step):
    """Oracle: three steps of the vector, and the feet together at the end."""
    text = (
        "{duration: 5.6, gait: {num_steps: 3, first_swing: left, step: {%s}}}"
    )
    run = simulated(text % step, "lipm")
    assert run.fell_at is None
    name, value = step.split(": ")
    expected = {"length": 0.0, "sideways": 0.0, "yaw_deg": 0.0}
    expected[name] = 3 * float(value)
    left, right = run.logs["walking_signal"][-1, 6:12].reshape(2, 3)
    yaw = math.radians(expected["yaw_deg"])
    assert [left[2], right[2]] == pytest.approx([yaw, yaw], abs=1e-6)
    middle = 0.5 * (left[:2] + right[:2])
    goal = [expected["length"], expected["sideways"]]
    assert middle == pytest.approx(goal, abs=1e-6)
    assert math.dist(left[:2], right[:2]) == pytest.approx(0.25, abs=1e-6)


def test_recovers_from_a_push_within_its_reach_and_not_from_a_hopeless_one():
    """Oracle: delta_v / omega is to stay on the sole of 0.125 x 0.185 m."""
    good = figures(PUSHED.format(0.3, 0.1, 90.0), "lipm")
    assert good["recovered"]
    bad = simulated(PUSHED.format(2.0, 0.1, 90.0), "lipm")
    assert bad.fall_reason == "CoM out of reach of both feet"
    assert 1.0 < bad.fell_at < 2.0
    assert bad.missed_pushes == 0


def test_the_mirrored_push_gives_the_mirrored_path():
    """Oracle: the mirror; a point mass has no left and right.

    The first foot to swing is mirrored too.  The QP's rounding differs.
    """
    text = (
        "{duration: 4.0, gait: {num_steps: 3, first_swing: %s}, pushes: "
        "[{delta_v: 0.2, phase: swing, side: %s, direction_deg: %s}]}"
    )
    right = simulated(text % ("right", "right", 60), "lipm").logs
    left = simulated(text % ("left", "left", -60), "lipm").logs
    for name in ("icp", "icp_reference", "ecmp_command"):
        mirror = np.tile([1.0, -1.0], right[name].shape[1] // 2)
        assert right[name] == pytest.approx(left[name] * mirror, abs=1e-9)


@pytest.mark.parametrize(
    ("mechanisms", "built"),
    [
        ("mechanisms: icp_only", set()),
        ("mechanisms: step", {"step_adjuster"}),
        ("mechanisms: step_swing", {"step_adjuster", "timing_adapter"}),
        (
            "mechanisms: custom, controller: {step_adjuster: {enabled: false}}",
            {"timing_adapter"},
        ),
    ],
)
def test_has_only_what_its_mechanisms_use(mechanisms, built):
    """Oracle: by hand; the regions come from who adjusts the step."""
    diagram = diagram_of(f"{{{mechanisms}}}", "lipm")
    brain = diagram.GetSubsystemByName("capture_point_controller")
    adapters = {"step_adjuster", "timing_adapter"}
    assert built == {n for n in adapters if brain.HasSubsystemNamed(n)}
    assert brain.HasOutputPort("capture_regions") is ("step_adjuster" in built)
    assert not brain.HasInputPort("mechanisms")


def test_the_seed_shifts_the_start():
    """Oracle: none is exact; others differ, by 10 um at most."""
    starts = [
        simulate(diagram_of(f"{{seed: {seed}}}", "lipm"), 0.01).logs["icp"][0]
        for seed in (0, 1, 1, 2)
    ]
    assert np.array_equal(starts[0], [0.0, 0.0])
    assert np.array_equal(starts[1], starts[2])
    assert not np.array_equal(starts[1], starts[3])
    assert 1e-9 < np.max(np.abs(starts)) < 1.1e-5
