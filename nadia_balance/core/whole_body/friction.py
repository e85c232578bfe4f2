"""The friction coefficient assumed by the controller after a slip."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import bounded

_LOADED = 0.2  # share of the weight below which slips are ignored [-]
_LESS = 0.9  # new estimate over the friction used in a slip [-]


@dataclass(kw_only=True)
class SlipParams:
    """Slip detection and the reaction to it."""

    # Sole speed of a slip, above noise and the motion of a tilting foot.
    speed: float = bounded(0.2, above=0.0, unit="m/s")
    # Time after touchdown in which sliding is no slip.
    settling_time: float = bounded(0.03, least=0.0, unit="s")
    # Lower bound of the estimate; slips at less friction are ignored.
    least_friction: float = bounded(0.3, above=0.0)
    # Rate at which the estimate returns, as the next ground may be better.
    recovery: float = bounded(0.05, least=0.0, unit="1/s")


class FrictionEstimate(NamedTuple):
    """The assumed `friction`, and the time [s] under load of each sole."""

    friction: float
    left_loaded: float
    right_loaded: float


def friction_after(
    last: FrictionEstimate,
    forces: Array,
    velocities: Array,
    usual: float,
    params: SlipParams,
    period: float,
) -> FrictionEstimate:
    """Returns the estimate a tick later.

    `forces` (2, 3), as shares of the weight, are the desired forces on the
    (left, right) sole in the tick of `period` [s], `velocities` (2, 3) [m/s]
    its velocities, both in the sole frame.  A slip lowers the estimate to _LESS
    times the friction that the desired force needed; then it returns to the
    `usual` one.
    """
    least = min(params.least_friction, usual)
    friction = min(last.friction + params.recovery * period, usual)
    loaded = []
    for (x, y, z), velocity, time in zip(
        forces.tolist(), velocities, last[1:], strict=True
    ):
        loaded.append(time + period if z > _LOADED else 0.0)
        used = max(abs(x), abs(y)) / max(z, _LOADED)  # of the pyramid
        if (
            loaded[-1] > params.settling_time
            and used > least
            and np.hypot(*velocity[:2]) > params.speed
        ):
            friction = max(min(friction, _LESS * used), least)
    return FrictionEstimate(friction, *loaded)
