"""Oracle: the limits from which the trials were made up; counts by hand."""

import math

import pytest

from nadia_balance.core.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.scripts.envelope_sweep.limits import (
    Rates,
    confusion,
    envelope_of,
    mark,
    paper_curves,
    scale_of,
)
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    Limit,
    SearchParams,
    Situation,
)
from tests.scripts.envelope_sweep.made_up import (
    AT,
    SEARCH,
    identity_of,
    made_up_envelope,
    made_up_rows,
    paper_times,
)

ALL = "all_with_cross_over"
LEFT, LATE, EARLY = (
    Situation("push", at)
    for at in ("left swing 50 %", "right swing 75 %", "left swing 5 %")
)


def test_finds_the_limits_again_in_any_order():
    """They are multiples of the resolution, so found without an error."""
    limits = {
        cell: round(value / SEARCH.resolution) * SEARCH.resolution
        for cell, value in paper_times(1.1).items()
    }
    rows = made_up_rows(limits)
    envelope = envelope_of(identity_of(), rows[::-1])
    assert set(envelope.limits) == set(limits)
    for cell, found in envelope.limits.items():
        assert found.recovered == pytest.approx(limits[cell], abs=1e-9)
        assert found.failed == pytest.approx(found.recovered + 0.02)
        assert found.complete
    assert not envelope.missing
    assert envelope.limits == envelope_of(identity_of(), rows).limits
    assert list(envelope.curve(ALL, AT)) == [30.0 * i for i in range(12)]


def test_names_are_in_the_order_of_the_paper_and_its_moment_is_first():
    envelope = made_up_envelope(
        {
            Cell(name, at, direction): 0.2
            for name in (ALL, "icp_only", "step_swing")
            for at in (EARLY, LATE, LEFT, AT)
            for direction in (270.0, 0.0)
        }
    )
    assert envelope.mechanisms == ("icp_only", "step_swing", ALL)
    assert envelope.situations == (AT, EARLY, LEFT, LATE)
    assert envelope.directions == (0.0, 270.0)


def test_says_which_cells_are_not_complete_or_not_begun():
    hurried = Cell("step", AT, 90.0)
    cells = {Cell("step", AT, 0.0): 0.3, hurried: 0.2, Cell(ALL, AT, 0.0): 0.5}
    envelope = made_up_envelope(cells, is_unfinished=hurried.__eq__)
    assert envelope.missing == [hurried, Cell(ALL, AT, 90.0)]
    assert envelope.limits[hurried] == Limit(
        recovered=pytest.approx(0.2),
        failed=pytest.approx(0.22),
        complete=False,
    )
    assert list(envelope.curve(ALL, AT)) == [0.0]


@pytest.mark.parametrize("outcome", ["fell", "error", "crashed", "hung"])
def test_only_a_recovery_is_one(outcome):
    """Oracle: by hand; 0.1 m/s is recovered from, 0.2 m/s is not."""
    search = SearchParams(resolution=0.1, stride=1, replicas=1)
    rows = made_up_rows({Cell("step", AT, 0.0): 0.5}, search)
    rows = [dict(row) for row in rows if row["delta_v"] < 0.25]
    rows[1]["outcome"] = outcome
    (found,) = envelope_of(identity_of(search), rows).limits.values()
    assert found == Limit(recovered=0.1, failed=0.2, complete=True)


def test_marks_what_is_not_sure_and_writes_the_digits_that_tell():
    """Oracle: by hand; a mark of several is that of the least sure one."""
    sure = Limit(recovered=0.5, failed=0.52, complete=True)
    bound = Limit(recovered=3.0, failed=None, complete=True)
    open_end = Limit(recovered=0.3, failed=None, complete=False)
    assert mark([]) == mark([sure]) == ""
    assert mark([sure, bound]) == ">="
    assert mark([sure, open_end, bound]) == "~"
    cells = {Cell("step", AT, 0.0): 0.2}
    words = map(made_up_envelope(cells).limit_words, (sure, bound, open_end))
    assert list(words) == ["0.50", ">=3.00", "~0.30"]
    fine = made_up_envelope(cells, SearchParams(resolution=0.005))
    assert fine.words(0.3) == "0.300"


def test_an_envelope_needs_a_trial():
    with pytest.raises(ValueError, match="rows = .*at least one trial"):
        envelope_of(identity_of(), [])


def test_the_scale_of_a_robot_is_its_mass_and_its_height_s():
    """Oracle: sqrt(g z), with com_height of Nadia's robot.yaml; 91 kg."""
    mass, speed = scale_of("nadia")
    assert speed == pytest.approx(math.sqrt(9.81 * 0.888), rel=1e-12)
    assert mass == pytest.approx(91.0, abs=0.5)
    for robot in "nobody", "/nowhere/robot.yaml":
        assert scale_of(robot) is None


def test_knows_the_figures_of_the_paper():
    """Oracle: read off the paper's Fig. 10, by hand."""
    known = paper_curves("nadia", AT)
    for mechanisms, direction, paper in (
        ("icp_only", 0.0, 0.27),
        ("step", 330.0, 0.68),
        ("step_swing", 90.0, 0.20),
        ("step_swing_transfer", 210.0, 0.95),
        (ALL, 120.0, 0.30),
    ):
        assert known[mechanisms][direction] == paper
    assert list(known) == list(MECHANISMS)
    for curve in known.values():
        assert list(curve) == [30.0 * i for i in range(12)]


def test_knows_the_figure_of_the_atlas_paper():
    """Oracle: read off its Fig. 6, by hand, as forces of 0.1 s over weight.

    A force of the weight for 0.1 s is 0.981 m/s.
    """
    for gait, mechanisms, direction, weights in (
        ("forward_fast", "feedback_step_timing", 0.0, 1.60),  # forward
        ("forward_slow", "feedback_timing", 330.0, 0.90),  # 30 deg outward
        ("in_place_fast", "feedback_step", 45.0, 0.61),  # 45 deg inward
        ("in_place_slow", "feedback", 210.0, 0.53),  # back, 30 deg outward
    ):
        situation = Situation(f"atlas_{gait}", "right swing 50 %")
        known = paper_curves("atlas", situation)
        assert set(known) == set(ATLAS_MECHANISMS)
        assert {len(curve) for curve in known.values()} == {14}
        found = known[mechanisms][direction]
        assert found == pytest.approx(0.981 * weights)


@pytest.mark.parametrize(
    ("robot", "scenario", "at"),
    [
        ("atlas", *AT),
        ("nadia", "backward_shove", AT.at),
        ("nadia", "push", "left swing 25 %"),
    ],
)
def test_others_are_compared_with_nothing(robot, scenario, at):
    assert paper_curves(robot, Situation(scenario, at)) == {}


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
            ("error", 1, "1"),
        )
    ]
    found = [
        (r.capturable, r.false_capturable, r.lost, r.false_lost)
        for r in confusion(rows).values()
    ]
    assert found == [(3, 2, 2, 1), (2, 1, 2, 1), (6, 2, 2, 1)]
    nothing = Rates(capturable=0, false_capturable=0, lost=0, false_lost=0)
    assert list(confusion([]).values()) == [nothing] * 3
