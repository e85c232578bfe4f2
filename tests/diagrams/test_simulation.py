"""How a simulation ends: in time, by a fall, an error, or the user."""

import contextlib
import signal
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


@pytest.mark.parametrize(("stops", "end"), [(True, 0.31), (False, 0.61)])
def test_ends_with_an_improper_contact_if_it_is_told_to(stops, end):
    """Oracle: the diagram, asked by hand; without being told, the fall."""
    diagram = diagram_of(plant="lipm")
    diagram.improper_contacts = touches_at(0.305)
    diagram.fall_reason = falls_at(0.605)
    run = simulate(diagram, 1.0, stop_at_improper_contact=stops)
    assert run.improper_contacts == ("hand - ground",)
    assert run.simulated_time == pytest.approx(end, abs=1.01 * PERIOD)
    assert run.fell_at == (None if stops else run.simulated_time)
    assert (run.error, run.interrupted) == ("", False)


def touches_at(begin):
    return lambda context: (
        {"hand - ground"} if context.get_time() >= begin else set()
    )


def falls_at(end):
    return lambda context: "made up" if context.get_time() >= end else ""


def test_ctrl_c_keeps_what_was_logged():
    """Oracle: the same run without an interruption, row by row.

    Pressed while somebody drops exceptions, as NumPy and pybind11 do.
    """

    def interrupt(context):
        if context.get_time() >= 0.3:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        return ""

    diagram = diagram_of(plant="lipm")
    diagram.fall_reason = interrupt
    run = simulate(diagram, 1.0)
    assert run.interrupted
    assert run.fell_at is None
    # Pressed in one tick, seen in the next.
    assert run.simulated_time == pytest.approx(0.3, abs=2.01 * PERIOD)
    rows = len(run.logs["t"])
    assert rows == round(run.simulated_time / PERIOD)
    whole = simulate(diagram_of(plant="lipm"), 1.0).logs
    for name in ("t", "icp", "walking_signal"):
        assert np.array_equal(
            run.logs[name], whole[name][:rows], equal_nan=True
        )


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize(
    ("when", "row", "where"),
    [
        (0.3, 0, "walking_state_machine: input port 'icp'"),
        (1.6, 4, "walking_state_machine: input port 'icp'"),  # in a swing
        # The height is not in the ICP.
        (0.3, 2, "momentum_qp: input port 'com_state'"),
        (1.6, 5, "momentum_qp: input port 'com_state'"),
    ],
)
def test_a_number_that_is_none_stops_the_point_mass(bad, when, row, where):
    """Oracle: the first block that reads it; it is put into the state."""
    text = "{gait: {num_steps: 2}, mechanisms: all_with_cross_over}"
    simulator = start(diagram_of(text, "lipm"))
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    plant_context = diagram.plant.GetMyMutableContextFromRoot(context)

    def poison(_):
        if context.get_time() >= when:
            plant_context.get_mutable_discrete_state(0)[row] = bad
        return ""

    diagram.fall_reason = poison
    run = advance(simulator, 2.0)
    assert run.error == f"{where} is not finite"
    assert (run.fell_at, run.fall_reason) == (None, "")  # she did not fall
    # The fall is looked for, and so the number put in, every 0.01 s.
    assert run.simulated_time == pytest.approx(when, abs=0.013)
    assert len(run.logs["t"]) == round(run.simulated_time / PERIOD)
    assert np.isfinite(run.logs["ecmp_command"]).all()


def test_an_error_is_one_line_and_never_empty():
    """Oracle: without a message, the kind of error has to do."""
    for error, line in (
        (RuntimeError("two\n  lines"), "two lines"),
        (ValueError(), "ValueError"),
    ):
        diagram = diagram_of(plant="lipm")
        diagram.fall_reason = raises_at(0.1, error)
        assert simulate(diagram, 0.2).error == line


def raises_at(end, error):
    def look(context):
        if context.get_time() >= end:
            raise error
        return ""

    return look


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
        ("phase: transfer, side: right, fraction: 1.0", 1),
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


def test_can_be_held_back_to_real_time():
    """Oracle: the clock on the wall; a lower bound holds on any machine."""
    simulator = start(diagram_of(plant="lipm"))
    began = time.perf_counter()
    advance(simulator, 0.2, realtime_rate=1.0)
    assert time.perf_counter() - began > 0.15
