"""What is simulated, and what becomes of it: one whole run is the oracle."""

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.scripts.envelope_sweep import trial as module
from nadia_balance.scripts.envelope_sweep.trial import run_trial
from nadia_balance.typed_yaml import load_typed
from tests.diagrams import simulated
from tests.scripts.envelope_sweep.made_up import stepping_sweep, walk_of

ALL = "all_with_cross_over"


@pytest.fixture(autouse=True)
def no_walk_of_another_test():
    module._walked.cache_clear()


def tried(walk, delta_v, direction=120.0, plant="lipm"):
    """The row of one trial."""
    return run_trial({}, walk, (plant, ""), delta_v, direction)


def judged(walk, delta_v, direction=120.0, plant="lipm"):
    """The run of that push from start to end, and its summary."""
    scenario = load_typed(Scenario, "walk", data=walk)
    scenario.pushes[0].delta_v = delta_v
    scenario.pushes[0].direction_deg = direction
    run = simulated.run_of(scenario, plant)
    return run, simulated.judged(scenario, plant)


def test_a_row_does_not_depend_on_what_was_tried_before():
    """Oracle: each of them from its own start to its own end.

    One walk for all; the run is too short to end before its time.
    """
    walk = walk_of(replica=1)
    sizes = [(0.1, 0.0), (0.45, 90.0), (2.5, 200.0)]
    for i in (2, 0, 1, 1):
        row, (_, summary) = tried(walk, *sizes[i]), judged(walk, *sizes[i])
        assert (row["outcome"] == "recovered") is summary["recovered"]
        shared = set(row) & set(summary) - {"outcome"}
        assert len(shared) == 10
        assert {name: row[name] for name in shared} == {
            name: summary[name] for name in shared
        }


def test_the_robot_itself_gives_the_bits_of_one_run():
    """Oracle: as above, of the whole robot, which is pushed at a time."""
    text = "{duration: 0.8, pushes: [{delta_v: 0, at: 0.3 s}]}"
    scenario = load_scenario("push_standing", text=text)
    _, summary = judged(yaml_dump_typed(scenario), 0.2, 30.0, "humanoid")
    row = tried(yaml_dump_typed(scenario), 0.2, 30.0, "humanoid")
    assert row["max_icp_error_m"] == summary["max_icp_error_m"] > 0.01
    assert row["max_torque_ratio"] == summary["max_torque_ratio"]


def test_an_error_is_a_row_like_any_other(monkeypatch):
    """Oracle: Python's own words."""
    monkeypatch.setattr(module.simulation, "RecoveryWatch", {}.__getitem__)
    row = tried(walk_of(stepping_sweep(0.1)), 0.3)
    assert row["outcome"] == "error"
    assert row["reason"].startswith("KeyError: <")


# What the capture regions foretell, beside what becomes of it.


@pytest.mark.parametrize(
    ("mechanisms", "delta_v", "direction", "outcome", "foretold"),
    [
        # Away from the stance foot, where the feet are not in the way.
        (ALL, 0.7, 270.0, "recovered", 1),
        ("icp_only", 0.7, 270.0, "fell", -1),
    ],
)
def test_what_becomes_of_a_push_is_foretold(
    mechanisms, delta_v, direction, outcome, foretold
):
    """Oracle: the run, of what takes a step."""
    walk = walk_of(stepping_sweep(5.0), mechanisms)
    row = tried(walk, delta_v, direction)
    assert row["outcome"] == outcome
    assert row["predicted_at_push"] == foretold


def test_a_push_on_who_only_stands_is_captured_by_the_feet_or_not_at_all():
    """Oracle: the ICP, v / omega ahead of the middle; the toes at 0.105 m."""
    scenario = load_scenario("push_standing", text="{duration: 1.3}")
    scenario.pushes[0].delta_v = 0.0
    walk = yaml_dump_typed(scenario)
    for delta_v, expected in (0.2, 0), (1.0, -1):
        run, _ = judged(walk, delta_v, 0.0)
        assert (np.max(run.logs["icp"][:, 0]) < 0.105) == (expected == 0)
        row = tried(walk, delta_v, 0.0)
        assert row["predicted_at_push"] == expected
