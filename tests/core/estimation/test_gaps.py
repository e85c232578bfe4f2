"""Gaps in a log.  Oracle: by hand, rows taken out of a whole one."""

import numpy as np
import pytest

from nadia_balance.core.estimation.gaps import bridged

T = 0.004 * np.arange(50) + 7.0
WHOLE = {"a": np.arange(50.0)[:, None], "b": np.sin(T)[:, None] * [1.0, 2.0]}


def without(*rows):
    """The log without these rows."""
    kept = np.delete(np.arange(50), rows)
    return T[kept], {name: values[kept] for name, values in WHOLE.items()}


def test_a_whole_log_stays_as_it_is():
    log = bridged(T, WHOLE)
    assert log["t"] == pytest.approx(T - 7.0)
    for name, values in WHOLE.items():
        assert (log[name] == values).all()


@pytest.mark.parametrize(
    "rows", [[7], [7, 8, 9], [7, 30, 31], [*range(20, 25)]]
)
def test_a_short_gap_holds_the_row_before(rows):
    """20 ms are five rows."""
    log = bridged(*without(*rows))
    assert log["t"] == pytest.approx(T - 7.0)
    expected = [i - 1 if i in rows else i for i in range(50)]
    for i in range(50):
        while expected[i] in rows:
            expected[i] -= 1
    assert log["a"][:, 0].tolist() == expected


def test_rows_that_are_not_finite_are_bridged_alike():
    values = {name: array.copy() for name, array in WHOLE.items()}
    values["b"][11, 1] = np.nan
    values["a"][12] = np.inf
    log = bridged(T, values)
    assert log["a"][9:15, 0].tolist() == [9, 10, 10, 10, 13, 14]
    assert np.isfinite(log["b"]).all()


@pytest.mark.parametrize(
    ("t", "spoilt", "message"),
    [
        (np.delete(T, range(20, 26)), (), "row 21, t = 0.104 s: must be at"),
        (np.append(T[:9], T[8:]), (), "row 10, t = 0.032 s: t must rise in"),
        (np.where(T == T[5], T - 0.001, T), (), "row 6, t = 0.019 s: t must"),
        (T, range(30, 36), "row 36, t = 0.140 s: must be finite"),
        (T, [0], "row 1, t = 0.000 s: must be finite"),
        (T[:1], (), "t must be two times"),
        (T[::-1], (), "t must rise"),
    ],
)
def test_a_long_gap_is_told_by_row_and_time(t, spoilt, message):
    a = np.arange(float(len(t)))[:, None]
    a[[*spoilt]] = np.nan
    with pytest.raises(ValueError, match=f"^{message}"):
        bridged(t, {"a": a})
