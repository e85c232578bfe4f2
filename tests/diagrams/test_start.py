"""The walking state from which every diagram starts."""

import math

import numpy as np
import pytest

from diagrams.simulation import simulate
from diagrams.start import initial_walking_state
from nadia_balance.core.walking import Phase, Side
from nadia_balance.robot import MODELS
from tests.diagrams.simulated import diagram_of, scenario_of


def state_of(text):
    return initial_walking_state(scenario_of(text))


def test_stands_with_the_feet_side_by_side_about_the_origin():
    """Oracle: step_width / 2 to either side, by hand."""
    schedule = state_of("{gait: {step_width: 0.3}}").schedule
    assert schedule.phase is Phase.STANDING
    assert schedule.feet[Side.LEFT].p_WF == pytest.approx([0.0, 0.15, 0.0])
    assert schedule.feet[Side.RIGHT].p_WF == pytest.approx([0.0, -0.15, 0.0])
    assert [schedule.feet[side].yaw for side in Side] == [0.0, 0.0]


def test_stands_and_steps_as_wide_as_the_robot(tmp_path):
    """Oracle: step_width / 2 of robot.yaml, by hand."""
    text = (MODELS / "nadia" / "robot.yaml").read_text()
    assert "step_width: 0.25" in text
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace("step_width: 0.25", "step_width: 0.3"))
    schedule = state_of(f"{{robot: {path}, gait: {{num_steps: 1}}}}").schedule
    for pose in schedule.feet.right, schedule.footsteps[0].pose:
        assert pose.p_WF == pytest.approx([0.0, -0.15, 0.0])


def test_rests_between_the_feet():
    start = state_of("{}").schedule.start
    for point in (start.com, start.com_velocity, start.cop):
        assert np.array_equal(point, [0.0, 0.0])


def test_stands_for_ever_without_steps():
    schedule = state_of("{}").schedule
    assert schedule.footsteps == ()
    assert schedule.duration == math.inf


def test_waits_before_the_first_step():
    text = "{gait: {num_steps: 2}, controller: {walking_state_machine: "
    text += "{standing_duration: 0.7}}}"
    schedule = state_of(text).schedule
    assert schedule.duration == 0.7
    assert len(schedule.footsteps) == 2


@pytest.mark.parametrize("side", list(Side))
def test_shifts_to_the_foot_that_does_not_swing_first(side):
    state = state_of(f"{{gait: {{num_steps: 2, first_swing: {side.value}}}}}")
    assert state.schedule.footsteps[0].side is side
    assert state.schedule.support_side is side.other


def test_footholds_say_themselves_which_foot_swings_first():
    """Though `first_swing` is right by default."""
    schedule = state_of("{gait: {footholds: [{side: left, y: 0.2}]}}").schedule
    assert schedule.footsteps[0].side is Side.LEFT
    assert schedule.support_side is Side.RIGHT


def test_walks_at_once_if_told_so():
    """A phase of no length would divide by zero.

    Oracle: the first transfer of 0.8 s ends after the tick that stands.
    """
    text = "{duration: 1.0, gait: {num_steps: 1}, controller: "
    text += "{walking_state_machine: {standing_duration: 0.0}}}"
    assert state_of(text).schedule.duration == 0.002
    diagram = diagram_of(text, "lipm")
    run = simulate(diagram, 0.9)
    swings = run.logs["walking_signal"][:, 0] == 2
    assert run.logs["t"][np.argmax(swings)] == pytest.approx(0.802, abs=0.003)


def test_refuses_a_step_out_of_reach():
    with pytest.raises(ValueError, match=r"^step 1 \(right\): 1.200 m forward"):
        state_of("{gait: {num_steps: 2, step: {length: 1.2}}}")
