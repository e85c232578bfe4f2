"""Oracles: counts by hand, and what is left after tick upon tick."""

import math

import pytest

from nadia_balance.core.ticks import number_of_ticks, share_of_tick


@pytest.mark.parametrize(
    ("duration", "period", "ticks"),
    [
        (0.05, 0.002, 25),
        (0.05, 0.01, 5),
        (0.05, 0.001, 50),
        (0.05, 0.004, 12),  # 12.5: to the even number
        (0.004, 0.002, 2),
        (0.004, 0.0005, 8),
        (0.004, 0.003, 1),  # 1.33
        (0.004, 0.01, 1),  # 0.4: but there is one
        (0.0, 0.002, 1),
    ],
)
def test_a_time_is_a_number_of_ticks(duration, period, ticks):
    assert number_of_ticks(duration, period) == ticks


@pytest.mark.parametrize("share", [0.1, 0.4, 0.99])
@pytest.mark.parametrize("ratio", [1, 2, 5, 10])
def test_in_the_same_time_the_same_is_done_whatever_the_period(share, ratio):
    """Oracle: what is left after so many short ticks, one by one."""
    time_constant = -0.001 / math.log(1.0 - share)
    left = 1.0
    for _ in range(ratio):
        left -= share * left
    found = share_of_tick(time_constant, 0.001 * ratio)
    assert found == pytest.approx(1.0 - left, abs=1e-12)


def test_after_the_time_constant_the_euler_th_part_is_left():
    """Oracle: its definition."""
    assert share_of_tick(0.01, 0.01) == pytest.approx(1.0 - 1.0 / math.e)


def test_without_a_time_constant_all_is_done_at_once():
    """Oracle: the limit of an ever smaller one."""
    assert share_of_tick(0.0, 0.002) == share_of_tick(1e-300, 0.002) == 1.0
