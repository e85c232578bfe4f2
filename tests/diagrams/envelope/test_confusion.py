"""Oracle: made-up trials, counted by hand."""

import pytest

from diagrams.envelope.confusion import Rates, confusion


def row(mechanisms, outcome, at_push, at_touchdowns=""):
    return {
        "mechanisms": mechanisms,
        "outcome": outcome,
        "predicted_at_push": at_push,
        "predicted_at_touchdowns": at_touchdowns,
    }


ROWS = [
    row("step", "recovered", 1, "1;0;0"),
    row("step", "recovered", -1, "-1;0"),  # false lost
    row("step", "fell", 2, "-1"),  # false capturable
    row("step", "failed", 0, "0;0"),  # false capturable
    row("step", "fell", -1),
    row("step", "fell", None),  # during the push
    row("step", "crashed", None),
    row("step", "hung", "", ""),
    row("step", "error", 1, "1"),
    row("icp_only", "recovered", 0, "0"),
]


def test_counts_false_predictions():
    """Oracle: by hand."""
    _, step, _ = confusion(ROWS)
    assert step.mechanisms == "step"
    assert step.at_push == Rates(
        capturable=3, false_capturable=2, lost=2, false_lost=1
    )
    assert step.at_first_touchdown == Rates(
        capturable=2, false_capturable=1, lost=2, false_lost=1
    )
    assert step.at_touchdowns == Rates(
        capturable=6, false_capturable=2, lost=2, false_lost=1
    )
    assert step.at_push.false_capturable_rate == pytest.approx(2 / 3)
    assert step.at_push.false_lost_rate == pytest.approx(1 / 2)
    assert step.at_touchdowns.false_capturable_rate == pytest.approx(1 / 3)


def test_all_trials_are_counted_together_in_the_end():
    """Oracle: the sum; mechanisms as in Fig. 10, others after them."""
    found = confusion([*ROWS, row("custom", "fell", -1, "-1;-1")])
    names = [c.mechanisms for c in found]
    assert names == ["icp_only", "step", "custom", "all"]
    assert found[-1].at_push == Rates(
        capturable=4, false_capturable=2, lost=3, false_lost=1
    )
    assert found[-1].at_first_touchdown == Rates(
        capturable=3, false_capturable=1, lost=3, false_lost=1
    )
    assert found[-1].at_touchdowns == Rates(
        capturable=7, false_capturable=2, lost=4, false_lost=1
    )


def test_the_touchdowns_may_be_numbers_too():
    """Oracle: the same in text."""
    text = [row("step", "fell", "-1", "1;0;-1"), row("step", "fell", 0, "1")]
    numbers = [row("step", "fell", -1, (1, 0, -1)), row("step", "fell", 0, [1])]
    assert confusion(text) == confusion(numbers)


def test_there_is_no_rate_of_nothing():
    """Oracle: 0 / 0 is no number."""
    (nothing,) = confusion([])
    assert nothing.mechanisms == "all"
    for rates in nothing.at_push, nothing.at_touchdowns:
        assert (rates.capturable, rates.lost) == (0, 0)
        assert rates.false_capturable_rate is None
        assert rates.false_lost_rate is None
