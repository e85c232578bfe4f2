"""A robot that stands, steps when it must, and walks where it is told.

Most of it on the point mass, which is fast; the whole robot once.
"""

import math

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.plan.gait import Gait, StepVector
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Command, Scenario, load_scenario
from nadia_balance.diagrams.simulation import simulate
from nadia_balance.results.log import icp_error, signal_view, steps
from nadia_balance.results.measurements import is_square
from nadia_balance.results.story import telling_lines
from nadia_balance.results.summary import Run
from nadia_balance.robot.model import load_robot
from nadia_balance.systems.signals import MODES
from tests.diagrams.simulated import run_of


def quick(name, **changes) -> Scenario:
    """The scenario in ticks of 20 ms, which are as good for a point mass."""
    return load_scenario(name, lipm_period=0.02, **changes)


def pushed(direction, delta_v, robot="nadia", **changes) -> Run:
    """The point mass, pushed while it stands."""
    scenario = quick("stand", robot=robot, **changes)
    scenario = scenario.with_push(direction=direction, delta_v=delta_v)
    return simulate(LipmDiagram(scenario))


@pytest.mark.parametrize(
    ("robot", "direction"),
    [
        *(("nadia", direction) for direction in (0, 90, 130, 235)),
        *(("g1", direction) for direction in (50, 180, 270, 340)),
    ],
)
def test_a_standing_robot_steps_and_stands_again(robot, direction):
    """Oracle: in 5 s after the push it stands, feet side by side.

    The run ends then; without the mechanism `step` the point mass falls.
    """
    size = 0.9 if direction in (90, 270) else 1.1
    run = pushed(direction, size, robot)
    assert run.summary["recovered"], run.summary["reason"]
    walking = signal_view(run.logs, "walking_signal")
    assert walking.steps_taken[-1] > 0
    last = signal_view(run.logs, "walking_signal", -1)
    assert is_square(last) and run.logs["t"][-1] < 6.1 + 0.6
    modes = {MODES[int(mode)].value for mode in walking.mode}
    assert "recovering" in modes and "standing" in modes
    still = pushed(direction, size, robot, mechanisms="icp_only")
    assert not still.summary["recovered"]


@pytest.mark.parametrize("direction", [0, 90, 200])
def test_what_ankles_hold_needs_no_step(direction):
    """Oracle: by hand: dv / w moves the ICP, and stays within the soles.

    It is decided half a second after the error has gone.
    """
    run = pushed(direction, 0.3)
    assert 0.3 / load_robot("nadia").point_mass.omega < 0.11
    assert run.summary["steps_taken"] == 0 and run.summary["recovered"]
    assert run.logs["t"][-1] < 3.0


@pytest.mark.parametrize(
    ("command", "tolerance"),
    [
        ((0.3, 0.0, 0.0), 0.05),
        ((-0.4, 0.0, 0.0), 0.05),
        ((0.0, 0.15, 0.0), 0.05),
        ((0.0, -0.25, 0.0), 0.05),
        ((0.0, 0.0, 0.4), 0.05),
        ((0.0, 0.0, -0.8), 0.05),
    ],
)
def test_walks_as_fast_as_it_is_told_and_stops(command, tolerance):
    """Oracle: the way and the turn of two steps over their time; 1.6 s.

    The ICP stays within 2 cm of its plan.
    """
    scenario = load_scenario("walk_by_command", duration=6.6)
    forward, left, turn = command
    go = Command(time=0.1, forward=forward, left=left, turn=turn)
    scenario = scenario.changed(commands=[go, Command(time=4.6)])
    run = simulate(LipmDiagram(scenario), 6.6)
    t, walking = run.logs["t"], signal_view(run.logs, "walking_signal")
    landed = [s for s in steps(run.logs) if 2.5 < s.swing.end < 4.6]
    first, last = landed[0], landed[2 * ((len(landed) - 1) // 2)]
    time = last.swing.end - first.swing.end
    yaw = last.achieved.yaw - first.achieved.yaw
    way = first.achieved.to_sole(last.achieved.p_WF[:2])
    wanted = np.array([forward, left]) * time
    if not turn:
        assert way == pytest.approx(wanted, abs=tolerance * abs(wanted).max())
    assert yaw == pytest.approx(turn * time, abs=0.05 * abs(turn) * time)
    assert np.max(icp_error(run.logs)) < 0.02
    stands = t[(t > 4.6) & (walking.phase == 0.0)][0]
    assert stands - 4.6 <= 1.6
    assert is_square(signal_view(run.logs, "walking_signal", -1))


@pytest.mark.parametrize("late", np.arange(0.0, 0.8, 0.08).round(2).tolist())
def test_it_stops_at_any_time_of_a_step(late):
    """Oracle: 1.6 s from the command until it stands, at 0.3 m/s."""
    stop = 2.2 + late
    scenario = load_scenario("walk_by_command", duration=stop + 1.7)
    commands = [Command(time=0.1, forward=0.3), Command(time=stop)]
    scenario = scenario.changed(commands=commands)
    run = simulate(LipmDiagram(scenario), scenario.duration)
    t, walking = run.logs["t"], signal_view(run.logs, "walking_signal")
    assert t[(t > stop) & (walking.phase == 0.0)][0] - stop <= 1.61


def test_a_push_has_priority_and_the_walk_goes_on():
    """Oracle: by hand: recovering after the push; then 0.3 m/s again."""
    scenario = quick("stand", duration=8.5)
    scenario = scenario.changed(commands=[Command(time=0.1, forward=0.3)])
    scenario = scenario.with_push(delta_v=0.7, direction=60.0, at="2.4 s")
    run = simulate(LipmDiagram(scenario), 8.5)
    t, walking = run.logs["t"], signal_view(run.logs, "walking_signal")
    soon = (t > 2.6) & (t < 3.4)
    assert np.any(walking.mode[soon] == 2.0)
    late = [s for s in steps(run.logs) if s.swing.end > 6.0]
    first, last = late[0], late[2 * ((len(late) - 1) // 2)]
    way = math.dist(first.achieved.p_WF, last.achieved.p_WF)
    time = last.swing.end - first.swing.end
    assert way / time == pytest.approx(0.3, rel=0.05)


def test_a_push_in_a_phase_that_never_comes_is_undecided():
    """Oracle: exit of the run; the reason says so."""
    scenario = quick("stand", duration=3.0)
    scenario = scenario.with_push(delta_v=0.2, at="right swing 25 %")
    summary = simulate(LipmDiagram(scenario)).summary
    assert summary["outcome"] == "undecided"
    assert summary["reason"].startswith("not pushed: the push did not come")


@pytest.fixture
def plate(tmp_path) -> str:
    """A scenario on a plate that ends 0.4 m ahead, as text."""
    path = tmp_path / "plate.yaml"
    path.write_text(
        "regions: [{name: plate, vertices: [[0.4, 0.4], [-1.5, 0.4], "
        "[-1.5, -0.4], [0.4, -0.4]]}]\n"
    )
    return f"{{lipm_period: 0.02, terrain: {{name: {path}}}}}"


@pytest.mark.parametrize(("direction", "lines"), [(0.0, 1), (180.0, 0)])
def test_says_once_that_there_is_no_ground(plate, direction, lines):
    """Oracle: by hand: 1 m/s takes a step of 0.6 m; backward there is room."""
    scenario = load_scenario("stand", text=plate)
    scenario = scenario.with_push(direction=direction, delta_v=1.0)
    run = simulate(LipmDiagram(scenario))
    told = "\n".join(telling_lines(run.logs, run.summary))
    assert told.count("no ground in reach where it has to step") == lines
    assert run.summary["recovered"] == (not lines)


class Sideways(LeafSystem):
    """A source of the user's: to the left, for ever, ever a little faster."""

    def __init__(self, speed):
        super().__init__()
        self.speed = speed
        self.DeclareVectorOutputPort("velocity_command", 3, self.calc)

    def calc(self, context, output):
        later = 1e-3 * context.get_time()  # a new command in each tick
        output.SetFromVector([0.0, self.speed + later, 0.0])


def test_a_source_of_the_users_is_connected_by_its_name():
    """Oracle: by hand, the middle of the feet after 4 s; names refused."""
    scenario = quick("stand", duration=4.0)
    sources = {"velocity_command": Sideways(0.1)}
    run = simulate(LipmDiagram(scenario, sources=sources), 4.0)
    now = signal_view(run.logs, "walking_signal", -1)
    middle = 0.5 * (now.left[1] + now.right[1])
    assert middle == pytest.approx(0.1 * 2.7, abs=0.1)
    for name, message in (
        ("mechanisms", "must be of an open input"),
        ("weather", "must be of an open input"),
        ("revised_footsteps", "must have an output 'revised_footsteps'"),
    ):
        with pytest.raises(ValueError, match=message):
            LipmDiagram(
                scenario, sources={name: Sideways(0.1)}, footstep_planner=None
            )


def test_a_command_of_the_scenario_that_is_too_fast_is_told():
    """Oracle: by hand: of two shares 0.8 of their limits 1 / sqrt(1.28) is."""
    scenario = quick("stand")
    x, y, _ = LipmDiagram(scenario).velocity_limits[1]
    rows = [
        Command(forward=0.8 * x, left=0.8 * y),
        Command(time=1.0, forward=0.9 * x),
    ]
    diagram = LipmDiagram(scenario.changed(commands=rows))
    (words,) = [line for line in diagram.remarks() if "commands" in line]
    taken = [0.8 * x / math.sqrt(1.28), 0.8 * y / math.sqrt(1.28), 0.0]
    assert words.startswith("commands[0] = [")
    assert words.endswith(f", {np.round(taken, 3).tolist()} is taken")


@pytest.mark.parametrize(("duration", "is_told"), [(0.4, False), (0.2, True)])
def test_a_swing_that_is_too_short_for_the_legs_is_told(duration, is_told):
    """Oracle: by hand: way 0.5 m, 2 sqrt(0.5 / 45.2) + 0.02 s = 0.23 s."""
    gait = Gait(
        num_steps=4, swing_duration=duration, step=StepVector(length=0.5)
    )
    diagram = LipmDiagram(quick("stand").changed(gait=gait))
    told = [line for line in diagram.remarks() if "its foot needs" in line]
    assert len(told) == is_told
    for line in told:
        assert line.startswith("step 1: its foot needs 0.23 s for 0.50 m, the")
        assert "45.2 m/s^2 (LEFT_HIP_X)" in line


def test_a_source_that_is_too_fast_is_told_once():
    """Oracle: the way of a source at the limit of left; the words, by hand."""
    scenario = quick("stand", duration=4.0)
    limit = LipmDiagram(scenario).velocity_limits[1, 1]
    places = []
    for speed in 9.0, limit:
        sources = {"velocity_command": Sideways(speed)}
        run = simulate(LipmDiagram(scenario, sources=sources), 4.0)
        places.append(signal_view(run.logs, "walking_signal", -1).left[1])
        told = "\n".join(telling_lines(run.logs, run.summary))
        words = f"{limit:.2f} of {speed:.2f} m/s left is taken"
        assert told.count("more than it can walk") == told.count(words) == 1
    assert places[0] == pytest.approx(places[1], abs=1e-3)


def test_the_whole_robot_catches_itself_and_stands():
    """Oracle: the verdict, and more than ankles and hips hold: 0.44 m/s."""
    scenario = load_scenario("stand", duration=5.5)
    scenario = scenario.with_push(delta_v=0.9, direction=30.0, at="0.2 s")
    summary = run_of(scenario).summary
    assert summary["recovered"], summary["reason"]
    assert 1 <= summary["steps_taken"] <= 5
    assert summary["self_contacts"] == []


def test_legs_that_are_swung_fast_do_not_carry_the_icp_away():
    """Oracle: the velocity commanded, to 10 %; the ICP within 3 cm.

    With a clock that goes by `icp` it walks 0.47 m/s; if it waits with its feet
    far apart, 0.34.
    """
    scenario = load_scenario("walk_by_command", robot="g1", duration=6.0)
    scenario = scenario.changed(
        commands=[Command(time=0.1, forward=0.7, left=-0.1)]
    )
    run = run_of(scenario)
    landed = [s for s in steps(run.logs) if s.swing.end > 3.0]
    first, last = landed[0], landed[2 * ((len(landed) - 1) // 2)]
    way = last.achieved.p_WF[0] - first.achieved.p_WF[0]
    time = last.swing.end - first.swing.end
    assert way / time == pytest.approx(0.7, rel=0.1)
    assert np.max(icp_error(run.logs)[run.logs["t"] > 3.0]) < 0.03
