"""The flags mean what their help says."""

import argparse

import pytest

from diagrams.command_line import scenario_flags
from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_flags import (
    DURATION,
    QUICK,
    directions,
    moments,
    sweep_flags,
    sweep_from,
)
from diagrams.envelope.trial import trial_scenario
from diagrams.lipm import LipmDiagram
from diagrams.mechanisms import MECHANISMS
from diagrams.required_steps import required_steps
from diagrams.simulation import simulate
from nadia_balance.robot import MODELS
from tests.diagrams.test_required_steps import log_of


def sweep_of(*argv):
    parser = argparse.ArgumentParser()
    sweep_flags(parser)
    scenario_flags(parser, name="push")
    parser.set_defaults(timeout=600.0)
    return sweep_from(parser.parse_args(argv))


def test_without_flags_it_is_the_papers_figure():
    """Oracle: five columns, twelve directions, 25 % into a right swing."""
    sweep = sweep_of()
    assert sweep.mechanisms == tuple(MECHANISMS)
    assert sweep.directions == tuple(30.0 * i for i in range(12))
    assert sweep.moments == (Moment("swing", "right", 0.25),)
    assert sweep.search == SearchParams()
    assert (sweep.plant, sweep.scenario_name) == ("humanoid", "push")


def test_quick_is_eight_directions_once():
    sweep = sweep_of("--quick")
    assert sweep.directions == tuple(45.0 * i for i in range(8))
    assert sweep.mechanisms == ("all_with_cross_over",)
    assert sweep.search == SearchParams(resolution=0.1, stride=4, replicas=1)


@pytest.mark.parametrize(
    ("flag", "value"),
    [
        ("directions", "3"),
        ("mechanisms", "step"),
        ("resolution", "0.05"),
        ("stride", "2"),
        ("replicas", "4"),
    ],
)
def test_quick_leaves_alone_what_is_given(flag, value):
    """Oracle: the sweep that has all of the quick flags written out."""
    flags = {**{k: str(v) for k, v in QUICK.items()}, flag: value}
    written_out = [f"--{name}={value}" for name, value in flags.items()]
    asked = sweep_of("--quick", f"--{flag}", value)
    assert tried(asked) == tried(sweep_of(*written_out))
    assert tried(asked) != tried(sweep_of("--quick"))


def tried(sweep):
    return sweep.cells(), sweep.search


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("4", (0.0, 90.0, 180.0, 270.0)),
        ("1", (0.0,)),
        ("90,", (90.0,)),
        ("90.0", (90.0,)),
        ("0, 30 ,-90", (0.0, 30.0, 270.0)),
        ("-1e-9,359.5", (0.0, 359.5)),
    ],
)
def test_directions_are_a_count_or_a_list(text, degrees):
    assert directions(text) == degrees


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0", "directions = '0': as a count must be in [1, 72]; one dir"),
        ("90", "directions = '90': as a count must be in [1, 72]; one dir"),
        ("0,x", "directions = 'x': must be degrees, such as"),
        ("nan,", "directions = 'nan': must be degrees"),
        ("inf,", "directions = 'inf': must be degrees"),
    ],
)
def test_refuses_directions_that_are_none(text, message):
    with pytest.raises(ValueError) as refused:
        directions(text)
    assert str(refused.value).startswith(message)


def test_moments_are_a_list():
    assert moments("right swing 25 %, left transfer 50%") == (
        Moment("swing", "right", 0.25),
        Moment("transfer", "left", 0.5),
    )


@pytest.mark.parametrize("text", ["noon", "right swing 101 %", "25 %"])
def test_refuses_a_moment_that_is_none(text):
    with pytest.raises(ValueError) as refused:
        moments(f"right swing 25 %,{text}")
    assert str(refused.value) == (
        f'phases = {text!r}: must be like "right swing 25 %", from 0 to 100 %'
    )


def test_the_duration_is_just_long_enough():
    """Oracle: the steps that such a run requires, and a shorter one."""
    sweep = sweep_of("--plant", "lipm")
    scenario = trial_scenario(
        sweep.scenario, sweep.cells()[0], 0.02, 0, sweep.period
    )
    run = simulate(LipmDiagram(scenario), scenario.duration)
    assert required_steps(scenario, run.logs) == (8, 8)
    scenario.duration -= 1.0
    assert required_steps(scenario, run.logs) == (7, 8)


@pytest.mark.parametrize(
    ("begin", "taken", "steps"),
    [
        *[(3.3, 2, 8), (4.0, 2, 8), (4.3, 3, 8), (5.0, 3, 8)],
        *[(5.02, 3, 8), (5.2, 3, 7)],
    ],
)
def test_other_moments_have_time_for_eight_steps(begin, taken, steps):
    """Oracle: by hand, the end of each phase, when a push begins at the latest.

    The whole robot lands 6 ms late, so that her left swing ends at 5.014 s; a
    push decided on in one tick is felt in the next, and the odd replicas come
    a tick later.  At 5.2 s it would be a later step.
    """
    scenario = sweep_of("--phases", "left swing 100 %").scenario
    assert required_steps(scenario, log_of((begin, taken))) == (steps, 8)


@pytest.mark.parametrize(
    ("flags", "duration"),
    [
        ([], DURATION),
        (["--scenario_text", "gait: {swing_duration: 0.65}"], DURATION),
        (["--scenario_text", "duration: 14.0"], 14.0),
        (["--duration", "9"], 9.0),
        (["--phases", "right swing 25.0%"], DURATION),
        (["--phases", "right swing 25 %, left transfer 50 %"], 14.1),
        (["--phases", "right swing 26 %"], 14.1),
        (["--scenario_name", "cross_over"], 13.5),
    ],
)
def test_only_the_default_moment_of_its_scenario_takes_less_time(
    flags, duration
):
    assert sweep_of(*flags).scenario.duration == duration


def test_a_robot_file_is_found_from_anywhere(monkeypatch):
    monkeypatch.chdir(MODELS / "nadia")
    sweep = sweep_of("--robot", "robot.yaml")
    assert sweep.scenario.robot == str(MODELS / "nadia" / "robot.yaml")


def test_mechanisms_are_a_list():
    names = ("step", "icp_only")
    assert sweep_of("--mechanisms", "step, icp_only").mechanisms == names


def test_the_flags_of_a_scenario_are_its_own():
    sweep = sweep_of("--seed", "5", "--plant", "lipm", "--largest", "1")
    assert sweep.scenario.seed == 5
    assert sweep.plant == "lipm"
    assert sweep.search.largest == 1.0
