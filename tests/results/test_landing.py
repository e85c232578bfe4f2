"""Oracles: limits and touchdowns by hand."""

import numpy as np
import pytest

from nadia_balance.results.landing import LandingLimits, hard_landing
from tests.results.made_up_run import make_log, summary_of

GENTLE = (2.0, 1.0, 0.1, 0.2, 0.01, 3.0, 1.2, 0.01)  # a Touchdown
LIMITS = LandingLimits(speed_along=1.0, speed_down=0.8, mean_force=5.0)


@pytest.mark.parametrize(
    ("column", "value", "what"),
    [
        (2, 1.01, "left foot at 1.01 m/s along the ground"),
        (3, 0.81, "left foot at 0.81 m/s downward"),
        (6, 5.1, "left foot with 5.1 times its weight"),
    ],
)
def test_a_landing_is_hard_above_each_limit(column, value, what):
    rows = np.array([GENTLE, GENTLE])
    rows[1, column] = value
    log = {"touchdowns": rows}
    assert hard_landing(log, LIMITS) == f"hard landing: {what}"
    assert hard_landing(log, None) == ""
    rows[1, column] = value - 0.2
    assert hard_landing(log, LIMITS) == ""
    assert hard_landing({}, LIMITS) == ""


def test_a_run_that_lands_hard_has_not_recovered():
    """Oracle: by hand; the right foot lands 20 ms before its swing ends."""
    log = make_log()
    walking = log["walking_signal"]
    swings = np.flatnonzero((walking[:, 0] == 2.0) & (walking[:, 15] == -1.0))
    tick = swings[walking[swings, 3] - walking[swings, 2] > 0.019][-1]
    hard = [log["t"][tick] + 0.001, -1.0, 2.0, *GENTLE[3:]]
    log["touchdowns"] = np.array([GENTLE, hard])
    summary = summary_of(log, landing=LIMITS)
    assert summary["outcome"] == "failed"
    expected = "hard landing: right foot at 2.00 m/s along the ground"
    assert summary["reason"] == expected
    first, second = summary["touchdowns"]
    assert (first["side"], first["speed_down"]) == ("left", 0.2)
    assert second["early"] == pytest.approx(walking[tick, 3] - walking[tick, 2])
    assert summary_of(log)["recovered"]
