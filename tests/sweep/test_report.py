"""The limits of a sweep, and what a reader sees of them.

Oracle: the limits from which the trials were made up; the rest by hand.
"""

import csv
from pathlib import Path

import pytest

from nadia_balance.core.plan.gait import Gait
from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.diagrams.scenario import Command
from nadia_balance.diagrams.terrain import Terrain
from nadia_balance.sweep import report
from nadia_balance.sweep.limits import LIMITS, protocol_of
from nadia_balance.sweep.search import SearchParams
from nadia_balance.sweep.trials import Cell, Rows
from tests.sweep.made_up import AT, identity_of, made_up_rows, table_of

ALL = "all_with_cross_over"
COARSE = SearchParams(resolution=0.1, stride=4, largest=2.0)
# The paper has 1.15, 0.41 and no 45 degrees.
KNOWN = {0.0: 1.3, 45.0: 0.8, 90.0: 0.3}
CELLS = {Cell(*AT, ALL, direction): v for direction, v in KNOWN.items()}


def read_table(limits, kind):
    """The columns of a table, by their names."""
    _, text = report.table_of(limits, AT, kind)
    head, _, *lines = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
    )
    return dict(zip(head, zip(*lines, strict=True), strict=True))


@pytest.mark.parametrize("outcome", ["fell", "error"])
def test_only_a_recovery_is_one(outcome):
    """Oracle: by hand; 0.1 m/s is recovered from, 0.2 m/s is not."""
    search = SearchParams(resolution=0.1, stride=1, replicas=1)
    rows = made_up_rows({Cell(*AT, "step", 0.0): 0.5}, search)[:2]
    rows[1]["outcome"] = outcome
    (record,) = table_of(rows, search).records
    found = record["recovered"], record["failed"], record["complete"]
    assert found == (0.1, 0.2, True)


def test_knows_the_figures_of_the_papers():
    """Oracle: read off the Nadia paper's Fig. 10, by hand, and off Fig. 6.

    There forces of 0.1 s over weight: of the weight they are 0.981 m/s.
    """
    known = protocol_of("nadia", AT).curves("push")
    assert (known["step"][330.0], known[ALL][120.0]) == (0.68, 0.30)
    assert list(known) == list(MECHANISMS)
    assert all(len(curve) == 12 for curve in known.values())
    for gait, mechanisms, direction, weights in (
        ("forward_slow", "feedback_timing", 330.0, 0.90),  # 30 deg outward
        ("in_place_fast", "feedback_step", 45.0, 0.61),  # 45 deg inward
    ):
        situation = f"atlas_{gait}", "right swing 50 %"
        known = protocol_of("atlas", situation).curves(situation[0])
        assert set(known) == set(ATLAS_MECHANISMS)
        assert {len(curve) for curve in known.values()} == {14}
        found = known[mechanisms][direction]
        assert found == pytest.approx(0.981 * weights)
    assert protocol_of("atlas", AT) is None
    assert protocol_of("nadia", ("push", "left swing 25 %")) is None


def test_a_cell_of_a_table_may_have_any_text():
    """Oracle: by hand, in GitHub's Markdown."""
    head, rule, line = report.table(["who", "m/s"], [["a|b\nc", "1"]]).split(
        "\n"
    )
    assert head == "|    who | m/s |"
    assert rule == "|-------:|----:|"
    assert line == r"| a\|b c |   1 |"


def test_a_table_stands_beside_the_paper_and_the_limit():
    """By hand: 1.3 / 1.15 = 1.130, 0.3 / 0.41 = 0.732, mean 0.931."""
    found = table_of(made_up_rows(CELLS, COARSE), COARSE)
    assert read_table(found, report.RECOVERED) == {
        "direction": ("0", "45", "90", "mean"),
        ALL: ("1.30", "0.80", "0.30", "0.80"),
    }
    kinds = {kind[1]: kind for kind in report._TABLES}
    for title, values in {
        "times the paper's": ("1.13", "–", "0.73", "0.93"),
        "share of the limit": ("0.70", "0.43", "0.16", "0.43"),
        "share of the limit with hips": ("0.50", "0.31", "0.12", "0.31"),
        "limit with hips, falling [m/s]": ("3.00",) * 4,
        # The worst of four replicas.
        "tilt of the torso at the largest push [deg]": ("23",) * 4,
    }.items():
        assert read_table(found, kinds[title])[ALL] == values


def test_another_walk_is_told_and_not_compared_with_the_paper():
    """Oracle: the paper's robot steps in place, on level ground."""
    rows = made_up_rows(CELLS, COARSE)
    ruled = table_of(rows, COARSE, sensors="industrial")
    assert ruled.protocols.keys() == {AT} and not ruled.walk
    for changed, walk in (
        ({"terrain": Terrain(name="gap")}, {"terrain": "gap"}),
        (
            {"gait": Gait(), "commands": [Command(forward=0.3, turn=-0.2)]},
            {"commands": "0.3 0 -0.2 from 0 s"},
        ),
        ({"gait": Gait(swing_duration=0.8)}, {}),
    ):
        found = table_of(rows, COARSE, **changed)
        assert not found.protocols
        assert {record["paper"] for record in found.records} == {None}
        assert found.walk == walk
        page = report.report_text(found, Rows(Path("nowhere"), {}, rows))
        for name, text in walk.items():
            (line,) = (x for x in page.splitlines() if f" {name} |" in x)
            assert line.split("|")[2].strip() == text


def test_the_file_of_the_limits_has_four_digits(tmp_path):
    """Oracle: by hand; a push that was tried is as exact as it was."""
    search = SearchParams(resolution=0.00001, stride=1, replicas=1)
    rows = made_up_rows({Cell(*AT, "step", 0.0): 0.5}, COARSE)[:1]
    rows[0] |= {"delta_v": 0.12346, "positive_power_w": 12345.678}
    limits = table_of(rows, search)
    limits.records[0]["limit"] = 2.0 / 3.0
    folder = Rows(tmp_path, identity_of(search), rows)
    report.write_report(limits, folder)
    with open(tmp_path / LIMITS, encoding="utf-8") as file:
        (line,) = csv.DictReader(file)
    assert (line["recovered"], line["limit"]) == ("0.12346", "0.6667")
    assert line["positive_power_w"] == "12350.0"


def test_marks_what_is_not_sure():
    """Oracle: by hand; a mark of several is that of the least sure one."""
    cells = {**CELLS, Cell(*AT, "step", 0.0): 9.0}
    rows = made_up_rows(cells, COARSE)
    hurried = made_up_rows({Cell(*AT, "step", 90.0): 0.3}, COARSE)
    found = table_of(rows + hurried[:-1], COARSE)
    told = read_table(found, report.RECOVERED)
    assert [*told["step"]] == ["~2.00", "–", "~0.30", "~1.15"]
    assert told[ALL][-1] == "0.80"
