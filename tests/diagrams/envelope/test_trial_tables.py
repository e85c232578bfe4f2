"""Oracle: trials counted by hand."""

from diagrams.envelope.envelope_data import envelope_of
from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.references import MOMENT
from diagrams.envelope.trial_tables import (
    capturability_section,
    losses_section,
    outcomes_section,
)
from tests.diagrams.envelope.made_up_trials import (
    identity_of,
    made_up_envelope,
    made_up_rows,
    read_table,
)

SEARCH = SearchParams(resolution=0.1, stride=1, replicas=1)
# One trial of each: 0.1 to 0.3 m/s recover, 0.4 m/s does not, and so on.
CELLS = {("icp_only", MOMENT, 0.0): 0.3, ("step", MOMENT, 0.0): 0.1}
RECOVERED, FELL = "recovered", "fell, or went down past saving"


def envelope_from(changed):
    """The envelope of the made-up rows; `changed`: row number -> values."""
    rows = made_up_rows(CELLS, SEARCH)
    for number, values in changed.items():
        rows[number] = rows[number] | values
    return envelope_of(identity_of(SEARCH), rows)


def test_counts_how_the_trials_ended():
    rows = read_table(outcomes_section(envelope_from({})))
    assert rows == [
        {"outcome": RECOVERED, "`icp_only`": "3", "`step`": "1", "all": "4"},
        {"outcome": FELL, "`icp_only`": "1", "`step`": "1", "all": "2"},
    ]


def test_says_why_trials_have_no_answer():
    crash = {"outcome": "crashed", "reason": "SIGSEGV | x"}
    text = outcomes_section(envelope_from({3: crash, 5: crash}))
    table, rest = text.split("\n\n", 1)
    died = read_table(table)[-1]
    assert died["outcome"] == "the process died"
    assert (died["`icp_only`"], died["all"]) == ("1", "2")
    assert "count as not recovered" in rest
    assert rest.endswith("\n* 2 x crashed: SIGSEGV | x\n")


def test_says_of_how_many_that_recovered_less_was_asked():
    """One is marked so of four, and another one that did not recover."""
    short = {"reason": "the run is too short for 8 more steps, 3 were required"}
    text = outcomes_section(envelope_from({0: short, 3: short}))
    _, rest = text.split("\n\n", 1)
    expected = f"Recovered with a reservation:\n\n* 1 x {short['reason']}\n"
    assert rest == expected
    assert "reservation" not in outcomes_section(envelope_from({}))


def test_a_flood_of_reasons_is_cut():
    rows = made_up_rows(
        {("step", MOMENT, float(i)): 0.0 for i in range(13)}, SEARCH
    )
    rows = [
        row | {"outcome": "error", "reason": f"reason {i}"}
        for i, row in enumerate(rows)
    ]
    text = outcomes_section(envelope_of(identity_of(SEARCH), rows))
    assert text.count("x error: reason") == 10
    assert text.endswith("* and 3 other reasons\n")


def test_an_outcome_that_nobody_knows_is_not_lost():
    rows = read_table(outcomes_section(envelope_from({3: {"outcome": "hm"}})))
    assert [row["outcome"] for row in rows] == [RECOVERED, FELL, "hm"]


def test_lists_where_more_mechanisms_recover_less():
    text = losses_section(envelope_from({}))
    first, table = text.split("\n\n")
    assert first == "Once, by more than 0.1 m/s:"
    assert read_table(table) == [
        {
            "where": "0° forward, right swing 25 %",
            "more [m/s]": "`step` 0.10",
            "fewer [m/s]": "`icp_only` 0.30",
            "difference": "-0.20",
            "complete": "yes",
        }
    ]


def test_says_that_more_mechanisms_never_recover_less():
    cells = {("icp_only", MOMENT, 0.0): 0.3, ("step", MOMENT, 0.0): 0.3}
    envelope = made_up_envelope(cells, SEARCH)
    assert losses_section(envelope) == "No: nowhere by more than 0.1 m/s.\n"


def test_one_set_of_mechanisms_is_not_compared():
    cells = {("step", MOMENT, 0.0): 0.3}
    envelope = made_up_envelope(cells, SEARCH)
    assert losses_section(envelope) == "Only one set of mechanisms was tried.\n"


def test_counts_false_predictions():
    """Of four predicted capturable one fell; of two lost none recovered.

    At the first touchdown it is the same; of all, four of sixteen are of the
    trial that fell.
    """
    fell = {"outcome": "fell"}
    text = capturability_section(envelope_from({2: fell}))
    rows = [list(row.values()) for row in read_table(text)]
    assert [row[0] for row in rows[::3]] == ["`icp_only`", "`step`", "all"]
    assert rows[-3:] == [
        ["all", "end of the push", "4", "1 (25.0 %)", "2", "0 (0.0 %)"],
        ["all", "first touchdown", "4", "1 (25.0 %)", "2", "0 (0.0 %)"],
        ["all", "every touchdown", "16", "4 (25.0 %)", "4", "0 (0.0 %)"],
    ]


def test_the_touchdowns_of_one_trial_dilute_those_of_another():
    """By hand: one of two trials is wrong, but one of five touchdowns."""
    rows = made_up_rows({("step", MOMENT, 0.0): 0.2}, SEARCH)[:2]
    rows[0] |= {"outcome": "fell", "predicted_at_touchdowns": "1"}
    envelope = envelope_of(identity_of(SEARCH), rows)
    wrong = [
        row["of them did not recover"]
        for row in read_table(capturability_section(envelope))[-3:]
    ]
    assert wrong == ["1 (50.0 %)", "1 (50.0 %)", "1 (20.0 %)"]


def test_a_rate_of_nothing_is_none():
    cells = {("step", MOMENT, 0.0): 0.0}
    envelope = made_up_envelope(cells, SEARCH)
    cells = capturability_section(envelope).splitlines()[-1].split("|")
    assert [cell.strip() for cell in cells[3:7]] == ["0", "–", "2", "0 (0.0 %)"]
