"""Oracles: the names that two dataclasses share, and the scenario."""

from dataclasses import fields

from diagrams.run_info import run_info
from diagrams.scenario import load_scenario
from diagrams.simulation import Run
from diagrams.summary import RunInfo
from tests.diagrams.made_up_run import make_log


def run():
    """A run in which all has gone wrong: no value is a default."""
    return Run(
        logs=make_log(),
        fell_at=1.5,
        fall_reason="pelvis too low",
        simulated_time=2.0,
        cpu_time=3.0,
        interrupted=True,
        missed_pushes=1,
        improper_contacts=("hand - ground",),
        error="NaN",
    )


def test_keeps_all_that_the_run_says_of_itself():
    """Oracle: the fields of the same name, of which none is left out."""
    info = run_info(load_scenario("push"), run())
    shared = {f.name for f in fields(Run)} & {f.name for f in fields(RunInfo)}
    assert shared >= {"fell_at", "improper_contacts", "missed_pushes", "error"}
    for name in shared:
        assert getattr(info, name) == getattr(run(), name)


def test_says_what_was_simulated():
    """Oracle: the scenario."""
    scenario = load_scenario("push", text="{seed: 3}")
    info = run_info(scenario, run(), "lipm", "push")
    (push,) = scenario.pushes
    assert (info.plant, info.scenario, info.seed) == ("lipm", "push", 3)
    assert (info.delta_v, info.direction_deg) == (
        push.delta_v,
        push.direction_deg,
    )
    assert info.mechanisms == "all_with_cross_over"
    still = run_info(load_scenario("stand"), run())
    assert still.delta_v is still.direction_deg is None
