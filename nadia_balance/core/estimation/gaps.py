"""A log of sensors with gaps: short ones are bridged, long ones refused."""

from collections.abc import Mapping

import numpy as np

from nadia_balance.core.math.arrays import Array

LONGEST = 0.02  # gap that is bridged [s]
UNEVEN = 0.02  # of a period, by which times may differ [-]
_ROUNDING = 1e-9  # of times [s]


def bridged(t: Array, signals: Mapping[str, Array]) -> dict[str, Array]:
    """Fills rows that are missing, or not finite, with the row before them.

    Args:
        t: times (n,), which rise by the same period but for gaps [s].
        signals: arrays (n, k), by name.

    Returns:
        The signals in equal steps, and `t` (m,) from 0 on.

    Raises:
        ValueError: names the row and the time of a gap longer than LONGEST, or
            of a time that does not fit the others.
    """
    if len(t) < 2 or not np.isfinite(t).all():
        raise ValueError("t must be two times or more, and finite")
    t = t - t[0]
    steps = np.diff(t)
    period = float(np.median(steps))
    if not 0.0 < period <= LONGEST:
        raise ValueError(f"t must rise, in steps of at most {LONGEST} s")
    counts = np.round(steps / period).astype(int)
    rough = np.abs(steps - counts * period) > UNEVEN * period
    for i in np.flatnonzero(rough | (counts < 1)).tolist():
        raise ValueError(_at(i + 1, t, "t must rise in equal steps"))
    for i in np.flatnonzero(
        (counts - 1) * period > LONGEST + _ROUNDING
    ).tolist():
        raise ValueError(
            _at(i + 1, t, f"must be at most {LONGEST} s after the row before")
        )
    rows = np.repeat(np.arange(len(t)), [*counts, 1])
    good = np.all(
        [np.isfinite(values).all(axis=1) for values in signals.values()], axis=0
    )
    held = _last_good(rows.tolist(), good, t, period)
    times: Array = period * np.arange(len(rows), dtype=float)
    return {"t": times} | {
        name: values[held] for name, values in signals.items()
    }


def _last_good(
    rows: list[int], good: Array, t: Array, period: float
) -> list[int]:
    """The row that stands for each one; ValueError: none is near."""
    held, last, missing = [], -1, 0
    for row in rows:
        missing = 0 if good[row] else missing + 1
        if good[row]:
            last = row
        if last < 0 or missing * period > LONGEST + _ROUNDING:
            raise ValueError(_at(row, t, "must be finite"))
        held.append(last)
    return held


def _at(row: int, t: Array, rule: str) -> str:
    return f"row {row + 1}, t = {t[row]:.3f} s: {rule}"
