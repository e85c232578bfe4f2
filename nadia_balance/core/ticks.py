"""What a time means to a controller that acts once in a period."""

import math


def number_of_ticks(duration: float, period: float) -> int:
    """Returns how many ticks of `period` [s] last for `duration` [s].

    To the nearest, and at least one: nothing happens faster than that.
    """
    return max(round(duration / period), 1)


def share_of_tick(time_constant: float, period: float) -> float:
    """Returns the share of a remainder that is taken in each tick, in (0, 1].

    1 - e^(-period / time_constant): whatever the `period` [s] is, the same
    is left after the same time, 1/e of it after the `time_constant` [s].  If
    that is 0, all is taken at once.
    """
    if time_constant == 0.0:
        return 1.0
    return -math.expm1(-period / time_constant)
