"""What a reader sees.  Oracle: worst, mean, ratios and counts by hand."""

from dataclasses import replace

import pytest

from nadia_balance.scripts.envelope_sweep.limits import (
    Physical,
    Scale,
    envelope_of,
)
from nadia_balance.scripts.envelope_sweep.report import (
    LimitTables,
    capturability_table,
    outcomes_table,
    report_text,
    table_lines,
    what_was_done,
)
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
)
from tests.scripts.envelope_sweep.made_up import (
    AT,
    identity_of,
    made_up_envelope,
    made_up_rows,
    paper_times,
    read_table,
)

ALL = "all_with_cross_over"
LEFT = Situation("push", "left swing 25 %")
SEARCH = SearchParams(resolution=0.1, stride=4, largest=2.0)
# The paper has 1.15, 0.41 and no 45 degrees.
LIMITS = Physical(
    limit={ALL: {0.0: 1.86, 90.0: 0.82}},
    with_hips={ALL: {0.0: 2.60}},
    assumptions="a point mass 2 m high",
)
SCALE = Scale(mass=90.0, speed=2.0)
CELLS = {
    Cell(ALL, AT, 0.0): 1.3,
    Cell(ALL, AT, 45.0): 0.8,
    Cell(ALL, AT, 90.0): 0.3,
}


def tables_of(cells, **options):
    envelope = made_up_envelope(cells, SEARCH, **options)
    envelope = replace(envelope, physical={AT: LIMITS})
    return LimitTables(envelope=envelope, scale=SCALE)


def test_a_row_for_each_direction_beside_the_paper_and_the_limit():
    first, second, third = read_table(tables_of(CELLS).details(ALL, AT))
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
        "complete": "yes",
    }
    assert second["direction"] == "45°"
    assert second["recovered [m/s]"] == "0.80"
    assert second["paper [m/s]"] == second["/ limit"] == "–"
    assert (third["direction"], third["/ paper"]) == ("90° left", "0.73")


def test_worst_and_mean_are_over_the_directions():
    """Ratios are over those two directions that the paper has, too.

    1.3 / 1.15 = 1.130, 0.3 / 0.41 = 0.732, mean 0.931;
    1.3 / 1.86 = 0.699, 0.3 / 0.82 = 0.366, mean 0.532.
    """
    (row,) = read_table(tables_of(CELLS).summary(AT))
    assert row == {
        "worst / mean": f"`{ALL}`",
        "recovered [m/s]": "0.30 / 0.80",
        "paper [m/s]": "0.41 / 0.78",
        "/ paper": "0.73 / 0.93",
        "limit [m/s]": "0.82 / 1.34",
        "/ limit": "0.37 / 0.53",
        "with hips [m/s]": "2.60 / 2.60",
        "/ with hips": "0.50 / 0.50",
        "[N s]": "27 / 72",
        "/ sqrt(g z)": "0.150 / 0.400",
        "complete": "3 of 3",
    }


def test_cells_that_are_not_complete_say_so():
    cells = {**CELLS, Cell("step", AT, 0.0): 0.5}
    tables = tables_of(cells, is_unfinished=lambda c: c.direction_deg == 45.0)
    rows = read_table(tables.details(ALL, AT))
    assert [row["complete"] for row in rows] == ["yes", "no", "yes"]
    figures = [row["recovered [m/s]"] for row in rows]
    assert figures == ["1.30", "~0.80", "0.30"]
    rows = read_table(tables.details("step", AT))
    assert [r["complete"] for r in rows] == ["yes", "no limit", "no limit"]
    assert rows[1]["recovered [m/s]"] == rows[1]["fails at"] == "–"
    rows = read_table(tables.summary(AT))
    assert [row["complete"] for row in rows] == ["1 of 3", "2 of 3"]
    figures = [row["recovered [m/s]"] for row in rows]
    assert figures == ["0.50 / 0.50", "0.30 / ~0.80"]
    (row,) = read_table(what_was_done(tables.envelope))[1:2]
    assert list(row.values()) == ["limits", "3 of 6 complete"]


def test_a_limit_beyond_the_largest_push_is_only_a_bound():
    """By hand: the mean is (2.0 + 0.3) / 2 = 1.15, or more."""
    tables = tables_of({Cell(ALL, AT, 0.0): 9.0, Cell(ALL, AT, 90.0): 0.3})
    row, _ = read_table(tables.details(ALL, AT))
    assert (row["recovered [m/s]"], row["fails at"]) == (">=2.00", "–")
    (row,) = read_table(tables.summary(AT))
    assert row["recovered [m/s]"] == "0.30 / >=1.15"


def test_the_report_has_every_table():
    both = paper_times(1.0) | paper_times(0.8, LEFT)
    envelope = made_up_envelope(both, SEARCH)
    envelope = replace(envelope, physical={AT: LIMITS})
    text = report_text(envelope, SCALE)
    assert text.startswith("# Push-recovery envelope: nadia, whole body\n")
    assert "\n\n\n" not in text
    assert "computed for a point mass 2 m high." in text.replace("\n", " ")
    tables = LimitTables(envelope=envelope, scale=SCALE)
    parts = [what_was_done(envelope)]
    parts += [outcomes_table(envelope), capturability_table(envelope)]
    for at in (AT, LEFT):
        parts.append(tables.summary(at))
        parts += [tables.details(name, at) for name in envelope.mechanisms]
    for part in parts:
        assert part in text
    lines = [line for line in text.splitlines() if not line.startswith("|")]
    assert max(map(len, lines)) <= 80


# On the terminal.


def test_has_a_line_for_each_direction_and_a_column_for_each_set():
    """Oracle: the limits, rounded down to the resolution by hand."""
    cells = {
        Cell("icp_only", AT, 0.0): 0.31,
        Cell("icp_only", AT, 90.0): 0.12,
        Cell(ALL, AT, 90.0): 9.0,
        Cell(ALL, LEFT, 90.0): 1.0,
    }
    hurried = Cell("icp_only", AT, 0.0)
    envelope = made_up_envelope(cells, SEARCH, is_unfinished=hurried.__eq__)
    assert table_lines(envelope) == [
        "",
        "largest recovered push [m/s], push, right swing 25 %",
        "direction  icp_only  all_with_cross_over",
        "        0     ~0.30                    -",
        "       90      0.10               >=2.00",
        "",
        "largest recovered push [m/s], push, left swing 25 %",
        "direction  icp_only  all_with_cross_over",
        "        0         -                    -",
        "       90         -                 1.00",
        "~ the search is not complete",
        ">= nothing larger was decided",
        "",
    ]


# Trials: 0.1 to 0.3 m/s recover, 0.4 m/s does not; 0.1 m/s recovers, 0.2 not.
ONE_EACH = SearchParams(resolution=0.1, stride=1, replicas=1)
FEW = {Cell("icp_only", AT, 0.0): 0.3, Cell("step", AT, 0.0): 0.1}


def envelope_from(changed):
    """The envelope of the made-up rows; `changed`: row number -> values."""
    rows = made_up_rows(FEW, ONE_EACH)
    for number, values in changed.items():
        rows[number] = rows[number] | values
    return envelope_of(identity_of(ONE_EACH), rows)


def test_counts_how_the_trials_ended():
    rows = read_table(outcomes_table(envelope_from({3: {"outcome": "failed"}})))
    assert [list(row.values()) for row in rows] == [
        ["recovered", "3", "1", "4"],
        ["fell", "0", "1", "1"],
        ["failed", "1", "0", "1"],
    ]


def test_says_why_trials_have_no_answer_or_no_verdict():
    crash = {"outcome": "crashed", "reason": "SIGSEGV | x"}
    short = {"outcome": "undecided", "reason": "the run is too short"}
    envelope = envelope_from({2: short, 3: crash, 5: crash})
    first, second = outcomes_table(envelope).split("\n\n")
    assert read_table(first)[-1]["outcome"] == "crashed"
    assert second.splitlines()[2:] == [
        "| crashed: SIGSEGV \\| x           |      2 |",
        "| undecided: the run is too short |      1 |",
    ]
    (line,) = (line for line in table_lines(envelope) if "did not run" in line)
    assert line.startswith("2 of 6 trials did not run to their end (error, ")
    flood = {n: {"outcome": "error", "reason": f"no {n}"} for n in range(6)}
    assert outcomes_table(envelope_from(flood)).count("error: no") == 6


@pytest.mark.parametrize(
    ("number", "changed", "wrong"),
    [(2, {"outcome": "fell"}, ["1 (25.0 %)", "1 (25.0 %)", "4 (25.0 %)"])],
)
def test_counts_false_predictions(number, changed, wrong):
    """Of four foretold capturable one fell; of two lost none recovered."""
    text = capturability_table(envelope_from({number: changed}))
    rows = [list(row.values()) for row in read_table(text)]
    assert [row[0] for row in rows[::3]] == ["`icp_only`", "`step`", "all"]
    assert rows[-3:] == [
        ["all", "end of the push", "4", wrong[0], "2", "0 (0.0 %)"],
        ["all", "first touchdown", "4", wrong[1], "2", "0 (0.0 %)"],
        ["all", "every touchdown", "16", wrong[2], "4", "0 (0.0 %)"],
    ]
