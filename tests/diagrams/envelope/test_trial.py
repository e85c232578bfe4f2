"""What is simulated, and what becomes of it: push.py is the oracle."""

import json

import pytest

from diagrams.envelope import trial as module
from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_plan import Cell
from diagrams.envelope.trial import DIAGRAMS, run_trial, trial_scenario
from diagrams.run_info import run_info
from diagrams.run_log import pushes
from diagrams.scenario import load_scenario
from diagrams.simulation import simulate
from diagrams.summary import summarize
from nadia_balance.typed_yaml import load_typed
from scripts import push
from tests.diagrams.envelope.quick_trials import (
    PERIOD,
    facts,
    stepping,
    text_of,
    trial,
)

NARROW = "controller: {step_adjuster: {reachability: {width_min: 0.05}}}"


@pytest.mark.parametrize("delta_v", [0.3, 1.5])
def test_replica_0_is_what_push_runs_with_the_same_flags(tmp_path, delta_v):
    """Oracle: the scenario and the summary that push.py leaves behind."""
    words = "--plant lipm --no-meshcat --seed 3 --duration 4 --direction 120"
    push.main(
        [
            *words.split(),
            *("--mechanisms", "step_swing", "--at", "left transfer 50 %"),
            *("--delta-v", str(delta_v), "--out", str(tmp_path)),
        ]
    )
    base = load_scenario("push", text="{duration: 4.0, seed: 3}")
    cell = Cell("step_swing", Moment("transfer", "left", 0.5), 120.0)
    scenario = trial_scenario(base, cell, delta_v, 0, PERIOD)
    written = load_typed(
        type(scenario),
        "scenario",
        filename=tmp_path / "scenario.yaml",
        child_name="push",
    )
    assert text_of(scenario) == text_of(written)
    summary = json.loads((tmp_path / "summary.json").read_text())
    row = run_trial(scenario, "lipm")
    assert (row["outcome"] == "recovered") is summary["recovered"]
    for name in ("reason", "steps_after_push", "max_icp_error_m"):
        assert row[name] == summary[name]


def test_other_replicas_differ_by_seed_and_a_tick_and_nothing_else():
    """Oracle: put back what differs, and compare all of the texts."""
    base = stepping()
    base.seed, base.pushes[0].delay = 7, 0.5
    first = text_of(trial(base=base))
    for replica in range(5):
        scenario = trial(base=base, replica=replica)
        assert scenario.seed == 7 + replica
        assert scenario.pushes[0].delay == 0.5 + (replica % 2) * PERIOD
        scenario.seed, scenario.pushes[0].delay = 7, 0.5
        assert text_of(scenario) == first


def test_every_second_push_comes_one_tick_later():
    """Oracle: the log; a swing begins after 1.3 s and lasts 0.7 s."""
    base = stepping(2.0)
    begins = []
    for replica in range(3):
        scenario = trial(base=base, replica=replica, moment="right swing 50 %")
        (felt,) = pushes(logs_of(scenario))
        begins.append(felt.start)
    assert begins == pytest.approx([1.65, 1.66, 1.65], abs=1.01 * PERIOD)
    assert begins[1] - begins[0] == pytest.approx(PERIOD, abs=1e-9)
    assert begins[2] == begins[0]


def logs_of(scenario, plant="lipm"):
    return simulate(DIAGRAMS[plant](scenario), scenario.duration).logs


def test_leaves_the_scenario_of_the_sweep_as_it_is():
    base = stepping(push="{force: 100.0, time: 1.0}")
    before = text_of(base)
    (pushed,) = trial(0.4, base=base).pushes
    assert (pushed.delta_v, pushed.force) == (0.4, None)
    assert (pushed.time, pushed.phase) == (None, "swing")
    assert text_of(base) == before


def test_refuses_what_push_would_refuse():
    with pytest.raises(ValueError, match=r"delta_v = -0\.1: must be finite"):
        trial(-0.1)


@pytest.mark.parametrize(
    ("delta_v", "outcome"), [(0.1, "recovered"), (2.5, "fell")]
)
def test_the_verdict_is_that_of_the_summary(delta_v, outcome):
    """Oracle: simulated and judged once more, as push.py does it."""
    scenario = trial(delta_v)
    row = run_trial(scenario, "lipm")
    summary = summary_of(scenario, "lipm")
    assert row["outcome"] == outcome
    assert (outcome == "recovered") is summary["recovered"]
    shared = set(row) & set(summary)
    assert len(shared) == 6
    assert {name: row[name] for name in shared} == {
        name: summary[name] for name in shared
    }


def summary_of(scenario, plant):
    run = simulate(DIAGRAMS[plant](scenario), scenario.duration)
    return summarize(run.logs, run_info(scenario, run, plant))


def test_ends_with_the_first_improper_contact():
    """Oracle: a run to the end of a robot whose feet touch."""
    text = "{duration: 0.3, gait: {num_steps: 1, step_width: 0.1}, %s}"
    scenario = trial(base=load_scenario("push", text=text % NARROW))
    row = run_trial(scenario, "humanoid")
    summary = summary_of(scenario, "humanoid")
    assert not summary["recovered"]
    assert row["outcome"] == "failed"
    assert row["reason"] == "contact of LEFT_ANKLE_LINK - RIGHT_ANKLE_LINK"
    assert row["max_icp_error_m"] < summary["max_icp_error_m"]
    assert row["max_torque_ratio"] <= summary["max_torque_ratio"]


def test_who_was_not_pushed_has_failed():
    """Oracle: the run ends before the swing in which the push should be."""
    row = run_trial(trial(base=stepping(1.2)), "lipm")
    assert row["outcome"] == "failed"
    assert row["reason"].startswith("not pushed")
    assert row["predicted_at_push"] is None


@pytest.mark.parametrize(
    ("robot", "plant", "reason"),
    [
        ("nadia", "lipn", "KeyError: 'lipn'"),
        ("nobody", "lipm", "ValueError: robot = 'nobody': must be one of"),
    ],
)
def test_an_error_is_a_row_like_any_other(robot, plant, reason):
    scenario = trial()
    scenario.robot = robot
    row = run_trial(scenario, plant)
    assert row["outcome"] == "error"
    assert row["reason"].startswith(reason)
    assert list(row) == list(run_trial(trial(base=stepping(0.1)), "lipm"))


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_run_that_an_error_stops_is_one_too():
    """Oracle: a force that is too large for a number."""
    row = run_trial(trial(1e308), "lipm")
    assert row["outcome"] == "error"
    told = "stopped: plant: input port 'push_force' is not finite"
    assert row["reason"] == told


def test_ctrl_c_gives_no_row(monkeypatch):
    """Oracle: an interrupted run, made by the fall that is looked for."""

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module.DIAGRAMS["lipm"], "fall_reason", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_trial(trial(), "lipm")


def test_tells_what_the_controller_predicted():
    """Oracle: a row is plain JSON; one prediction for each landing."""
    row = run_trial(trial(0.2), "lipm")
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert row["predicted_at_push"] >= 0
    assert len(row["predicted_at_touchdowns"]) == row["steps_after_push"] > 0
    assert 0.0 < row["cpu_s"] < float("inf")


def test_the_same_trial_gives_the_same_row():
    scenario = trial(0.5, replica=1)
    once, again = (run_trial(scenario, "lipm") for _ in range(2))
    assert facts(once) == facts(again)
