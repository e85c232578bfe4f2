"""How a simulation ends: in time, by a fall, an error, or the user; its log."""

import contextlib
import signal
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.walking.state import FootPose, Footstep, Side
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Command, load_scenario
from nadia_balance.diagrams.simulation import (
    RecoveryWatch,
    advance,
    closed_loop,
    pushed,
    simulate,
    start,
    until_ctrl_c,
    walk_to_push,
)
from nadia_balance.results.log import pushes
from nadia_balance.results.measurements import calm_steps
from tests.diagrams.simulated import diagram_of, simulated

PERIOD = 0.01  # of the point mass [s]
PUSHED = "{{gait: {{num_steps: 2}}, pushes: [{{delta_v: 0.1, {}}}]}}"


def test_zero_seconds_are_zero_seconds():
    """Oracle: the duration that was asked for, not that of the scenario."""
    diagram = diagram_of(plant="lipm")
    run = simulate(diagram, 0.0)
    assert (run.simulated_time, run.until) == (0.0, False)
    with pytest.raises(ValueError, match="^seed: must be in the scenario"):
        simulate(diagram, 0.0, seed=3)
    assert run.summary["plant"] == "lipm"


@pytest.mark.parametrize(("stops", "end"), [(True, 0.31), (False, 0.61)])
def test_ends_with_a_failure_if_it_is_told_to(stops, end):
    """Oracle: the diagram, asked by hand; without being told, the fall."""
    diagram = diagram_of(plant="lipm")
    diagram.improper_contacts = lambda context: (
        {"hand - ground"} if context.get_time() >= 0.305 else set()
    )
    diagram.fall_reason = lambda context: (
        "made up" if context.get_time() >= 0.605 else ""
    )
    run = advance(start(diagram), 1.0, stop_at_failure=stops)
    assert run.improper_contacts == ("hand - ground",)
    assert not run.until
    assert run.simulated_time == pytest.approx(end, abs=1.01 * PERIOD)
    assert run.fell_at == (None if stops else run.simulated_time)
    assert run.fall_reason == ("" if stops else "made up")
    assert run.logs["t"][-1] == pytest.approx(end, abs=2.01 * PERIOD)
    assert (run.error, run.interrupted) == ("", False)
    diagram.improper_contacts = lambda context: set()
    diagram.passed_limit = lambda context: context.get_time() >= 0.305
    run = advance(start(diagram), 0.4, stop_at_failure=stops)
    end = min(end, 0.4)
    assert run.simulated_time == pytest.approx(end, abs=1.01 * PERIOD)
    assert (run.fell_at, run.until) == (None, False)


def test_the_watch_sees_the_recovery_that_the_summary_finds():
    """Oracle: calm_steps of the whole run's log, cut off row by row."""
    text = "{mechanisms: all_with_cross_over, gait: {num_steps: 12}, "
    text += "lipm_period: 0.02, calm_steps: 2, pushes: [{delta_v: 0.5, "
    text += "direction_deg: 270, at: right swing 25 %}]}"
    diagram = diagram_of(text, "lipm")
    watches = [RecoveryWatch(diagram, more_steps=more) for more in (0, 1)]
    seen = [0, 0]  # ticks without a recovery, and steps after it

    def watch(context):
        recovered = [watch(context) for watch in watches]
        for i, now in enumerate(recovered):
            seen[i] += not now
        return all(recovered)

    run = advance(start(diagram), 9.0, until=watch)
    assert run.until
    for rows, calm in zip(seen, (2, 3), strict=True):
        found = [
            calm_steps({name: a[:end] for name, a in run.logs.items()})
            for end in (rows, rows + 1)
        ]
        assert found == [calm - 1, calm]


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
    assert rows == round(run.simulated_time / PERIOD) + 1
    whole = simulated("{duration: 1.0}", "lipm").logs
    for name in ("t", "icp", "walking_signal"):
        until_then = whole[name][:rows]
        assert np.array_equal(run.logs[name], until_then, equal_nan=True)


class Planner(LeafSystem):
    """Tells footsteps that are none of those that are allowed."""

    def __init__(self, steps):
        super().__init__()
        self.DeclareAbstractOutputPort(
            "footsteps",
            lambda: Value(object()),
            lambda _, output: output.set_value(steps),
        )


AT_ONCE = Footstep(Side.LEFT, FootPose(), 0.3, 0.0)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ([], "TypeError: walking_state_machine: input port 'footsteps'"),
        ((AT_ONCE,), "has a transfer of 0.3 s and a swing of 0.0 s"),
        ((replace(AT_ONCE, swing_duration=np.nan),), "a swing of nan s"),
        ((replace(AT_ONCE, transfer_duration=-1.0),), "a transfer of -1.0 s"),
    ],
)
def test_a_planner_of_the_users_that_is_wrong_ends_the_run(steps, words):
    """Oracle: the words, and the log until then: one row."""
    sources = {"footsteps": Planner(steps)}
    diagram = LipmDiagram(
        load_scenario("stand"), sources=sources, footstep_planner=None
    )
    run = simulate(diagram, 1.0)
    assert words in run.error
    assert len(run.logs["t"]) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"plant": "point_mass"}, "^plant = 'point_mass': must be one of"),
        ({"plant": "lipm", "controller": "a:B"}, "^controller = 'a:B': must"),
    ],
)
def test_what_is_simulated_is_one_of_two(arguments, message):
    with pytest.raises(ValueError, match=message):
        closed_loop(load_scenario("push"), **arguments)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"delta_v": "0.3"}, "delta_v = '0.3': must be a number"),
        ({"direction": [1]}, r"direction = \[1\]: must be degrees"),
        ({"direction": True}, "direction = True: must be degrees"),
        ({"at": 1.0}, "at = 1.0: must be a moment"),
        ({"shape": 5}, "shape = 5: must be a name"),
        ({"duration": "x"}, "duration = 'x': must be a number"),
    ],
)
def test_a_call_names_what_has_another_type(changes, message):
    """Oracle: the rules."""
    with pytest.raises(ValueError, match=f"^{message}"):
        simulate("push", **changes)


def test_a_diagram_checks_its_scenario():
    """Oracle: the rules of load_scenario, which did not make it."""
    good = load_scenario("push")
    for bad, message in (
        (replace(good, engine="bullet"), "engine = 'bullet': must be one of"),
        (replace(good, duration=-1.0), "duration = -1.0: must be"),
        (replace(good, commands=[Command()]), "gait.num_steps = .*: must not"),
        ("push", "scenario = 'push': must be a Scenario"),
    ):
        with pytest.raises(ValueError, match=f"^{message}"):
            LipmDiagram(bad)


def test_a_number_that_is_none_stops_the_point_mass():
    """Oracle: the first block that reads it; it is put into the state."""
    text = "{gait: {num_steps: 2}, mechanisms: all_with_cross_over}"
    simulator = start(diagram_of(text, "lipm"))
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    plant_context = diagram.plant.GetMyMutableContextFromRoot(context)

    def poison(_):
        if context.get_time() >= 1.6:  # in a swing
            plant_context.get_mutable_discrete_state(0)[4] = np.nan
        return ""

    diagram.fall_reason = poison
    run = advance(simulator, 2.0)
    where = "walking_state_machine: input port 'icp'"
    assert run.error == f"{where} is not finite at {run.simulated_time:.3f} s"
    assert (run.fell_at, run.fall_reason) == (None, "")  # it did not fall
    # Put in after one tick, and read in the next.
    assert run.simulated_time == pytest.approx(1.6, abs=2.01 * PERIOD)
    # The row of that very tick is there unless it cannot be computed.
    rows = round(run.simulated_time / PERIOD)
    assert len(run.logs["t"]) in (rows, rows + 1)
    assert np.isfinite(run.logs["ecmp_command"]).all()


@pytest.mark.parametrize(
    ("when", "missed"),
    [
        ("at: 0.9 s", 0),  # ends with the run
        ("at: 0.95 s", 1),  # is cut off by the end
        ("at: right swing 25 %", 1),
    ],
)
def test_counts_the_pushes_that_did_not_come(when, missed):
    """Oracle: 0.5 s of standing, then 0.8 s of transfer, then a swing."""
    run = simulate(diagram_of(PUSHED.format(when), "lipm"), 1.0 + PERIOD)
    assert run.missed_pushes == missed


WALKS = {
    "at: right swing 25 %": 1.475,
    "at: right transfer 100 %": 1.3,
    "at: right swing 25 %, delay: 0.03": 1.475,
}


@pytest.mark.parametrize("when", WALKS)
def test_from_a_walk_one_goes_on_as_in_one_go(when):
    """Oracle: all arrays of the log of one run from start to end.

    From one walk, with a push of nothing, two pushes of different sizes.
    """
    text = "{mechanisms: all_with_cross_over, seed: 3, duration: 2.2, "
    text += f"gait: {{num_steps: 3}}, pushes: [{{SIZE, {when}}}]}}"
    diagram = diagram_of(text.replace("SIZE", "delta_v: 0"), "lipm")
    walked, run = walk_to_push(diagram)
    assert run.until
    assert run.simulated_time == pytest.approx(WALKS[when], abs=1.01 * PERIOD)
    for delta_v, direction in (0.3, 40.0), (0.6, -130.0):
        size = f"delta_v: {delta_v}, direction_deg: {direction}"
        whole = simulated(text.replace("SIZE", size), "lipm")
        after = advance(pushed(diagram, walked, delta_v, direction), 2.2)
        assert whole.missed_pushes == after.missed_pushes == 0
        for name, values in whole.logs.items():
            assert np.array_equal(values, after.logs[name], equal_nan=True)


def test_ctrl_c_is_a_question_at_first():
    """Oracles: real signals; in the end, all is as before."""
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), until_ctrl_c() as pressed:
        assert not pressed()
        signal.raise_signal(signal.SIGINT)
        assert pressed()
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("plant", ["lipm", "humanoid"])
def test_equals_the_ports_at_that_instant(plant):
    """Oracle: every logged port, evaluated by hand; exactly equal.

    The log has the time and the size of the push that the scenario asks for.
    """
    text = "{gait: {num_steps: 2}, pushes: [{delta_v: 0.1, at: 0.2 s}]}"
    diagram = diagram_of(text, plant)
    simulator = start(diagram)
    period = diagram.push.period
    k = round(0.252 / period)  # within the push
    simulator.AdvanceTo(period * k)
    by_hand = simulator.get_context().Clone()
    logs = diagram.read_logs(simulator.get_context())
    assert logs["t"][k] == pytest.approx(period * k)
    (push,) = pushes(logs)
    assert push.start == pytest.approx(0.2)
    assert push.delta_v == pytest.approx(0.1)
    newtons = diagram.robot.mass * 0.1 / 0.1
    assert np.linalg.norm(push.force) == pytest.approx(newtons)
    ports = ports_of(diagram)
    rows = len(logs["t"])
    names = {n for n, a in logs.items() if a.ndim == 2 and len(a) == rows}
    # Computed from the state; constant.
    names -= {"foot_poses", "trunk_tilt", "mechanisms"}
    assert len(names) >= 10
    for name in names:
        context = ports[name].get_system().GetMyContextFromRoot(by_hand)
        assert np.array_equal(ports[name].Eval(context), logs[name][k]), name


def ports_of(diagram):
    """Name -> output port, under the names of the log; outermost first."""
    systems, ports = [diagram], {}
    for system in systems:
        if hasattr(system, "GetSystems"):
            systems += system.GetSystems()
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            ports.setdefault(port.get_name(), port)
    if isinstance(diagram.plant, MultibodyPlant):
        ports["state"] = diagram.plant.get_state_output_port()
        if diagram.robot.drives is None:
            ports["torques"] = ports["actuation"]
    return ports
