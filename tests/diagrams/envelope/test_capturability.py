"""Oracles: the walking state and the outcome of the same run; mirrors."""

import copy
import functools

import numpy as np
import pytest
from pydrake.systems.framework import EventStatus

from diagrams.envelope.capturability import Predictions, Reader, predictions
from diagrams.lipm import LipmDiagram
from diagrams.run_info import run_info
from diagrams.run_log import PHASE, SOLES, Log, pushes, steps
from diagrams.scenario import Scenario, load_scenario
from diagrams.simulation import simulate, start
from diagrams.summary import summarize
from nadia_balance.core.walking import Phase, Side, WalkingState
from nadia_balance.robot import load_robot
from tests.diagrams.made_up_run import cut

ALL = "all_with_cross_over"
PUSH = "delta_v: %g, direction_deg: %g, phase: %s, side: right, fraction: 0.25"
TEXT = "{duration: 6.0, gait: {num_steps: 4}, mechanisms: %s, pushes: [{%s}]}"


def pushed(mechanisms, direction, delta_v, phase="swing") -> Scenario:
    push = PUSH % (delta_v, direction, phase)
    return load_scenario("push", text=TEXT % (mechanisms, push))


@functools.cache
def run_of(mechanisms, direction, delta_v, phase="swing"):
    """The scenario, its log and whether it recovers; do not change them."""
    scenario = pushed(mechanisms, direction, delta_v, phase)
    run = simulate(LipmDiagram(scenario), scenario.duration)
    figures = summarize(run.logs, run_info(scenario, run, "lipm"))
    return scenario, run.logs, figures["recovered"]


@functools.cache
def robot():
    return load_robot("nadia")


def predicted(scenario, log) -> Predictions:
    return predictions(log, scenario, robot())


@pytest.mark.parametrize("mechanisms", ["icp_only", ALL])
@pytest.mark.parametrize("phase", ["swing", "transfer"])
def test_a_tiny_push_is_predicted_and_recovered_from(mechanisms, phase):
    """Oracle: the run; 2 cm/s move the ICP by 6 mm."""
    scenario, log, recovered = run_of(mechanisms, 0.0, 0.02, phase)
    assert recovered
    found = predicted(scenario, log)
    assert found.at_push in (0, 1)
    assert set(found.at_touchdowns) <= {0, 1}


@pytest.mark.parametrize("mechanisms", ["icp_only", ALL])
@pytest.mark.parametrize("phase", ["swing", "transfer"])
def test_a_huge_push_is_predicted_and_is_the_end(mechanisms, phase):
    """Oracle: the run; 4 m/s, twice what any controller recovers from."""
    scenario, log, recovered = run_of(mechanisms, 0.0, 4.0, phase)
    assert not recovered
    found = predicted(scenario, log)
    assert found.at_push == -1
    assert set(found.at_touchdowns) <= {-1}


def test_a_push_that_takes_a_step_is_predicted_to_take_it():
    """Oracle: the run: with steps it recovers, by ankles and hips it falls.

    Sideways, away from the stance foot, where the feet are not in the way.
    """
    for mechanisms, recovers, at_push in (
        (ALL, True, 1),
        ("icp_only", False, -1),
    ):
        scenario, log, recovered = run_of(mechanisms, 270.0, 0.7)
        assert recovered == recovers
        assert predicted(scenario, log).at_push == at_push


def test_there_is_a_prediction_for_each_touchdown_after_the_push():
    """Oracle: the steps that landed, less those before the push's end."""
    for direction, delta_v in (90.0, 0.5), (0.0, 0.02):
        scenario, log, _ = run_of(ALL, direction, delta_v)
        end = pushes(log)[-1].end
        landed = [s for s in steps(log) if s.swing.end >= end - 1e-9]
        assert len(landed) == 4
        assert len(predicted(scenario, log).at_touchdowns) == 4


def test_in_the_end_of_a_run_the_feet_hold_the_icp():
    """Oracle: the run: it has recovered, and no step is left."""
    scenario, log, recovered = run_of(ALL, 90.0, 0.5)
    assert recovered
    assert predicted(scenario, log).at_touchdowns[-1] == 0


def test_nothing_is_predicted_without_a_push_or_before_its_end():
    """Oracle: a log without its push, and one that is cut off in the push."""
    scenario, log, _ = run_of(ALL, 90.0, 0.5)
    quiet = {**log, "push_force": 0.0 * log["push_force"]}
    assert predicted(scenario, quiet) == Predictions(None, ())
    (push,) = pushes(log)
    assert predicted(scenario, cut(log, push.first + 5)) == Predictions(
        None, ()
    )
    last = push.first + 10  # 0.1 s
    cut_after = predicted(scenario, cut(log, last + 1))
    assert cut_after == Predictions(predicted(scenario, log).at_push, ())


def test_a_push_on_who_only_stands_is_captured_by_the_feet_or_not_at_all():
    """Oracle: the ICP, v / omega ahead of the middle; the toes at 0.105 m."""
    for delta_v, expected in (0.2, 0), (1.0, -1):
        scenario = load_scenario("push_standing", text="{duration: 1.3}")
        scenario.pushes[0].delta_v = delta_v
        log = simulate(LipmDiagram(scenario), scenario.duration).logs
        ahead = np.max(log["icp"][:, 0])
        assert (ahead < 0.105) == (expected == 0)
        assert predicted(scenario, log) == Predictions(expected, ())


@pytest.mark.parametrize("delta_v", [0.4, 0.9])
def test_the_mirrored_push_has_the_same_predictions(delta_v):
    """Oracle: the mirror, of steps of the other foot."""
    scenario, log, _ = run_of(ALL, 60.0, delta_v)
    other = copy.deepcopy(scenario)
    other.gait.first_swing = "left"
    other.pushes[0].side, other.pushes[0].direction_deg = "left", -60.0
    there = simulate(LipmDiagram(other), other.duration).logs
    assert predicted(other, there) == predicted(scenario, log)


def test_a_foot_that_is_far_away_comes_too_late():
    """Oracle: 9 m in less than 1 s, at no more than 35 m/s^2: 1.01 s."""
    scenario, log, _ = run_of(ALL, 270.0, 0.7)
    reference = log["swing_foot_reference"].copy()
    reference[:, 0] += 9.0
    away = {**log, "swing_foot_reference": reference}
    assert predicted(scenario, log).at_push == 1
    assert predicted(scenario, away).at_push == -1


def test_a_stance_foot_that_slips_in_a_swing_moves_no_footstep():
    """Oracle: the state machine moves them when a transfer begins."""
    scenario, log, _ = run_of(ALL, 0.0, 0.02)
    signal = log["walking_signal"].copy()
    row = pushes(log)[-1].first + 10
    swing = signal[:, PHASE] == signal[row, PHASE]
    signal[swing, SOLES[Side.LEFT].start + 1] += 1.5
    slipped = {**log, "walking_signal": signal}
    steps_of = [
        Reader(each, scenario, robot()).state(row).schedule.footsteps
        for each in (log, slipped)
    ]
    for step, other in zip(*steps_of, strict=True):
        assert_same_step(step, other)


def recorded(scenario: Scenario) -> tuple[Log, dict[int, WalkingState]]:
    """The log of a run, and by row what the walking state really was."""
    diagram = LipmDiagram(scenario)
    machine = diagram.brain.GetSubsystemByName("walking_state_machine")
    port, states = machine.GetOutputPort("walking_state"), {}

    def look(context):
        # One period after the update that made it, and logged it.
        row = round(context.get_time() / scenario.lipm_period) - 1
        states[row] = port.Eval(machine.GetMyContextFromRoot(context))
        return EventStatus.DidNothing()

    simulator = start(diagram)
    simulator.set_monitor(look)
    simulator.AdvanceTo(scenario.duration)
    return diagram.read_logs(simulator.get_context()), states


@pytest.mark.parametrize("mechanisms", ["icp_only", ALL])
def test_the_walking_state_is_that_of_the_run(mechanisms):
    """Oracle: the state machine's, in each row: footsteps, feet, clock.

    She walks a curve and crosses her legs, so that footholds are not as they
    were commanded: in swings, adjusted, and in transfers, moved within reach.
    """
    delta_v = 0.6 if mechanisms == ALL else 0.1
    scenario = pushed(mechanisms, 75.0, delta_v)
    scenario.gait.num_steps, scenario.gait.step.length = 5, 0.2
    scenario.gait.step.yaw_deg = 8.0
    log, states = recorded(scenario)
    reader, phases, moved = Reader(log, scenario, robot()), set(), set()
    for row in range(0, len(log["t"]), 7):
        found, real = reader.state(row), states[row]
        assert found.time_in_phase == real.time_in_phase
        assert found.elapsed == pytest.approx(real.elapsed, abs=1e-9)
        ours, its = found.schedule, real.schedule
        assert ours.phase is its.phase
        assert ours.support_side is its.support_side
        assert ours.duration == its.duration
        for side in ours.feet.__dataclass_fields__:
            assert_same_pose(getattr(ours.feet, side), getattr(its.feet, side))
        assert len(ours.footsteps) == len(its.footsteps)
        for step, real_step in zip(ours.footsteps, its.footsteps, strict=True):
            assert_same_step(step, real_step)
        if its.footsteps and its.footsteps[0] is not real.commanded[0]:
            moved.add(its.phase)
        if its.phase is Phase.SWING and real.adjustment:
            nominal = found.adjustment.nominal
            assert_same_step(nominal, real.adjustment.nominal)
        phases.add(ours.phase)
    assert phases == set(Phase)
    elsewhere = {Phase.TRANSFER, Phase.SWING} if mechanisms == ALL else set()
    assert moved == elsewhere


def assert_same_step(step, other):
    assert step.side is other.side
    assert step.transfer_duration == other.transfer_duration
    assert step.swing_duration == other.swing_duration
    assert_same_pose(step.pose, other.pose)


def assert_same_pose(pose, other):
    np.testing.assert_allclose(pose.p_WF[:2], other.p_WF[:2], atol=1e-12)
    assert pose.yaw == pytest.approx(other.yaw, abs=1e-12)
