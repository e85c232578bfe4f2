"""The table of limits, and what a reader sees of it.

Oracle: the limits from which the trials were made up; the rest by hand.
"""

from dataclasses import replace

import pytest

from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.scripts.envelope_sweep import report
from nadia_balance.scripts.envelope_sweep.protocols import protocol_of
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
)
from nadia_balance.scripts.envelope_sweep.table import (
    References,
    Scale,
    limit_table,
)
from tests.scripts.envelope_sweep.made_up import (
    AT,
    SEARCH,
    identity_of,
    made_up_rows,
    made_up_table,
    paper_times,
    table_of,
)

ALL = "all_with_cross_over"
LEFT, LATE, EARLY = (
    Situation("push", at)
    for at in ("left swing 50 %", "right swing 75 %", "left swing 5 %")
)
COARSE = SearchParams(resolution=0.1, stride=4, largest=2.0)
# The paper has 1.15, 0.41 and no 45 degrees.
LIMITS = References(
    limit={ALL: {0.0: 1.86, 90.0: 0.82}},
    with_hips={ALL: {0.0: 2.60}},
    assumptions="a point mass 2 m high",
)
CELLS = {
    Cell(*AT, ALL, 0.0): 1.3,
    Cell(*AT, ALL, 45.0): 0.8,
    Cell(*AT, ALL, 90.0): 0.3,
}


def coarse_table(cells, **options):
    found = made_up_table(cells, COARSE, physical=LIMITS, **options)
    return replace(found, scale=Scale(mass=90.0, speed=2.0))


def read_table(text):
    """The rows of a Markdown table, by the names of its columns."""
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.strip().splitlines()
    ]
    return [dict(zip(lines[0], row, strict=True)) for row in lines[2:]]


def test_finds_the_limits_again_in_any_order():
    """They are multiples of the resolution, so found without an error."""
    limits = {
        cell: round(value / SEARCH.resolution) * SEARCH.resolution
        for cell, value in paper_times(1.1).items()
    }
    rows = made_up_rows(limits)
    found = table_of(rows[::-1], identity_of())
    assert found.records == table_of(rows, identity_of()).records
    assert len(found.records) == len(limits)
    for record in found.records:
        cell = Cell(*AT, record.mechanisms, record.direction_deg)
        assert record.recovered == pytest.approx(limits[cell], abs=1e-9)
        assert record.failed == pytest.approx(record.recovered + 0.02)
        assert record.complete
        assert record.paper == pytest.approx(paper_times(1.0)[cell])


@pytest.mark.parametrize("outcome", ["fell", "error", "crashed", "hung"])
def test_only_a_recovery_is_one(outcome):
    """Oracle: by hand; 0.1 m/s is recovered from, 0.2 m/s is not."""
    search = SearchParams(resolution=0.1, stride=1, replicas=1)
    rows = made_up_rows({Cell(*AT, "step", 0.0): 0.5}, search)[:2]
    rows[1]["outcome"] = outcome
    (record,) = table_of(rows, identity_of(search)).records
    found = record.recovered, record.failed, record.complete
    assert found == (0.1, 0.2, True)


@pytest.mark.parametrize("outcomes", [[], ["undecided"]])
def test_a_table_needs_a_trial_that_was_decided(outcomes, tmp_path):
    row = made_up_rows({Cell(*AT, "step", 0.0): 0.5})[0]
    rows = [{**row, "outcome": outcome} for outcome in outcomes]
    with pytest.raises(ValueError, match="none was decided"):
        limit_table(identity_of(), rows, tmp_path / "none")


def test_knows_the_figures_of_the_papers():
    """Oracle: read off the Nadia paper's Fig. 10, by hand, and off Fig. 6.

    There forces of 0.1 s over weight: of the weight they are 0.981 m/s.
    """
    known = protocol_of("nadia", AT).curves("push")
    for mechanisms, direction, paper in (
        ("icp_only", 0.0, 0.27),
        ("step", 330.0, 0.68),
        ("step_swing", 90.0, 0.20),
        ("step_swing_transfer", 210.0, 0.95),
        (ALL, 120.0, 0.30),
    ):
        assert known[mechanisms][direction] == paper
    assert list(known) == list(MECHANISMS)
    assert all(len(curve) == 12 for curve in known.values())
    for gait, mechanisms, direction, weights in (
        ("forward_fast", "feedback_step_timing", 0.0, 1.60),  # forward
        ("forward_slow", "feedback_timing", 330.0, 0.90),  # 30 deg outward
        ("in_place_fast", "feedback_step", 45.0, 0.61),  # 45 deg inward
        ("in_place_slow", "feedback", 210.0, 0.53),  # back, 30 deg outward
    ):
        situation = Situation(f"atlas_{gait}", "right swing 50 %")
        known = protocol_of("atlas", situation).curves(situation.scenario)
        assert set(known) == set(ATLAS_MECHANISMS)
        assert {len(curve) for curve in known.values()} == {14}
        found = known[mechanisms][direction]
        assert found == pytest.approx(0.981 * weights)
    for robot, scenario, at in (
        ("atlas", *AT),
        ("nadia", "backward_shove", AT.at),
        ("nadia", "push", "left swing 25 %"),
    ):
        assert protocol_of(robot, Situation(scenario, at)) is None


def test_a_row_for_each_direction_beside_the_paper_and_the_limit():
    """By hand: 1.3 / 1.15 = 1.130, 0.3 / 0.41 = 0.732, mean 0.931."""
    found = coarse_table(CELLS)
    first, second, third, mean = read_table(
        report.details(found, found.records)
    )
    assert first == {
        "direction": "0° forward",
        "recovered [m/s]": "1.30",
        "fails at": "1.40",
        "paper [m/s]": "1.15",
        "/ paper": "1.13",
        "limit [m/s]": "1.86",
        "/ limit": "0.70",
        "with hips [m/s]": "2.60",
        "/ with hips": "0.50",
        "[N s]": "117",
        "/ sqrt(g z)": "0.650",
        "torso [deg]": "23",  # the worst of four replicas
        "pelvis [deg]": "10",
        "CoM sag [m]": "0.12",
        "power [W]": "2000",
    }
    assert second["direction"] == "45°"
    assert second["paper [m/s]"] == second["/ limit"] == "–"
    assert (third["direction"], third["/ paper"]) == ("90° left", "0.73")
    assert (mean["recovered [m/s]"], mean["/ paper"]) == ("0.80", "0.93")
    assert (mean["[N s]"], mean["/ sqrt(g z)"]) == ("72", "0.400")


def test_marks_what_is_not_sure_and_writes_the_digits_that_tell():
    """Oracle: by hand; a mark of several is that of the least sure one."""
    hurried = Cell(*AT, "step", 90.0)
    cells = {**CELLS, Cell(*AT, "step", 0.0): 9.0, hurried: 0.3}
    found = coarse_table(cells, is_unfinished=hurried.__eq__)
    rows = read_table(report.overview(found, AT))
    assert [row["direction"] for row in rows] == ["0", "45", "90", "mean"]
    assert [row["step"] for row in rows] == [">=2.00", "–", "~0.30", "~1.15"]
    assert [row[ALL] for row in rows] == ["1.30", "0.80", "0.30", "0.80"]
    assert "4 of 6 complete |" in report.what_was_done(found)
    told = report.said_lines(found)
    assert any(line.startswith("~ the search") for line in told)
    assert any(line.startswith(">= nothing") for line in told)
    fine = made_up_table({hurried: 0.3}, SearchParams(resolution=0.005))
    assert "0.300" in report.overview(fine, AT)


# Trials: 0.1 to 0.3 m/s recover, 0.4 m/s does not; 0.1 m/s recovers, 0.2 not.
ONE_EACH = SearchParams(resolution=0.1, stride=1, replicas=1)
FEW = {Cell(*AT, "icp_only", 0.0): 0.3, Cell(*AT, "step", 0.0): 0.1}


def changed_table(changed):
    """The table of the made-up rows; `changed`: row number -> values."""
    rows = made_up_rows(FEW, ONE_EACH)
    for number, values in changed.items():
        rows[number] = rows[number] | values
    return table_of(rows, identity_of(ONE_EACH))


def test_counts_how_the_trials_ended():
    rows = read_table(
        report.outcomes_table(changed_table({3: {"outcome": "failed"}}))
    )
    assert [list(row.values()) for row in rows] == [
        ["recovered", "3", "1", "4"],
        ["fell", "0", "1", "1"],
        ["failed", "1", "0", "1"],
    ]


def test_counts_false_predictions():
    """Oracle: by hand; trials without an answer are left out."""
    rows = [
        {
            "outcome": outcome,
            "predicted_at_push": at_push,
            "predicted_at_touchdowns": at_touchdowns,
        }
        for outcome, at_push, at_touchdowns in (
            ("recovered", 1, "1;0;0"),
            ("recovered", -1, "-1;0"),  # false lost
            ("fell", 2, "-1"),  # false capturable
            ("failed", 0, "0;0"),  # false capturable
            ("fell", -1, ""),
            ("fell", None, ""),  # during the push
            ("crashed", None, ""),
            ("undecided", 1, "1"),
        )
    ]
    counts = [
        [pairs.count(pair) for pair in [(1, 1), (1, 0), (0, 0), (0, 1)]]
        for pairs in report.foretold(rows).values()
    ]
    assert counts == [[1, 2, 1, 1], [1, 1, 1, 1], [4, 2, 1, 1]]
    # One of four trials predicted as capturable fell; no lost one recovered.
    found = changed_table({2: {"outcome": "fell"}})
    *_, line = read_table(report.predictions_table(found))
    told = ["all", "every touchdown", "16", "4 (25.0 %)", "4", "0 (0.0 %)"]
    assert list(line.values()) == told
