"""How a simulation ends: in time, by a fall, an error, or the user."""

import time

import numpy as np
import pytest

from diagrams.simulation import advance, simulate, start
from tests.diagrams.simulated import diagram_of

PERIOD = 0.002
PUSHED = "{{gait: {{num_steps: 2}}, pushes: [{{delta_v: 0.1, {}}}]}}"


def test_ends_in_time():
    run = simulate(diagram_of(plant="lipm"), 0.5)
    assert (run.fell_at, run.fall_reason, run.interrupted) == (None, "", False)
    assert run.simulated_time == 0.5
    assert len(run.logs["t"]) == 250


def test_ends_with_a_fall():
    """Oracle: the diagram, asked by hand; it is watched every 0.01 s."""
    diagram = diagram_of(plant="lipm")
    diagram.fall_reason = falls_at(0.305)
    run = simulate(diagram, 1.0)
    assert run.fell_at == pytest.approx(0.31, abs=1.01 * PERIOD)
    assert run.fall_reason == "made up"
    assert run.simulated_time == run.fell_at
    assert run.logs["t"][-1] == pytest.approx(run.fell_at, abs=1.01 * PERIOD)


def falls_at(end):
    return lambda context: "made up" if context.get_time() >= end else ""


def test_ctrl_c_keeps_what_was_logged():
    """Oracle: the same run without an interruption, row by row."""

    def interrupt(context):
        if context.get_time() >= 0.3:
            raise KeyboardInterrupt
        return ""

    diagram = diagram_of(plant="lipm")
    diagram.fall_reason = interrupt
    run = simulate(diagram, 1.0)
    assert run.interrupted
    assert run.fell_at is None
    assert run.simulated_time == pytest.approx(0.3, abs=1.01 * PERIOD)
    rows = len(run.logs["t"])
    assert rows == round(run.simulated_time / PERIOD)
    whole = simulate(diagram_of(plant="lipm"), 1.0).logs
    for name in ("t", "icp", "walking_signal"):
        assert np.array_equal(
            run.logs[name], whole[name][:rows], equal_nan=True
        )


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_number_that_is_none_stops_the_point_mass(bad):
    """Oracle: it is put into the state at 0.3 s, and nothing hides it."""
    simulator = start(diagram_of("{gait: {num_steps: 2}}", "lipm"))
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    plant_context = diagram.plant.GetMyMutableContextFromRoot(context)

    def poison(_):
        if context.get_time() >= 0.3:
            plant_context.get_mutable_discrete_state_vector()[0] = bad
        return ""

    diagram.fall_reason = poison
    run = advance(simulator, 1.0)
    assert run.fell_at == pytest.approx(0.3, abs=1.01 * PERIOD)
    assert run.fall_reason.startswith("stopped: ")
    assert "finite" in run.fall_reason
    assert "\n" not in run.fall_reason
    assert len(run.logs["t"]) == round(run.fell_at / PERIOD)
    assert np.isfinite(run.logs["ecmp_command"]).all()


def test_an_error_of_the_program_is_not_hidden():
    diagram = diagram_of(plant="lipm")
    diagram.fall_reason = None  # no function: a TypeError
    with pytest.raises(TypeError):
        simulate(diagram, 1.0)


@pytest.mark.parametrize(
    ("when", "missed"),
    [
        ("time: 0.5", 0),
        ("time: 0.9", 0),  # ends with the run
        ("time: 0.95", 1),  # is cut off by the end
        ("phase: swing, side: right", 1),
        ("phase: transfer, side: right", 0),
    ],
)
def test_counts_the_pushes_that_did_not_come(when, missed):
    """Oracle: 0.5 s of standing, then 0.8 s of transfer, then a swing."""
    run = simulate(diagram_of(PUSHED.format(when), "lipm"), 1.002)
    assert run.missed_pushes == missed


def test_a_diagram_has_no_memory_of_an_earlier_run():
    """Oracle: two simulators of one diagram give the same bits."""
    diagram = diagram_of(PUSHED.format("time: 0.2"), "lipm")
    first, second = (simulate(diagram, 2.0).logs for _ in range(2))
    for name, values in first.items():
        assert np.array_equal(values, second[name], equal_nan=True), name


def test_starts_with_the_posture_or_says_why_not():
    """Oracle: straight legs are far too short for a stance of 1.8 m."""
    diagram = diagram_of("{gait: {step_width: 0.3}}")
    diagram.scenario.gait.step_width = 1.8
    with pytest.raises(ValueError, match=r"^step_width = 1.8, com_height"):
        start(diagram)


def test_can_be_held_back_to_real_time():
    """Oracle: the clock on the wall; a lower bound holds on any machine."""
    simulator = start(diagram_of(plant="lipm"))
    began = time.perf_counter()
    advance(simulator, 0.2, realtime_rate=1.0)
    assert time.perf_counter() - began > 0.15
