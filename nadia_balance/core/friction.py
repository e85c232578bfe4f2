"""How much friction to count on, once a sole has slipped."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.walking import Array

_LOADED = 0.2  # of the weight: with less, a sole may slide without harm
_LESS = 0.9  # than what did not hold


@dataclass(kw_only=True)
class SlipParams:
    """What a slip is, and what is made of it."""

    # More than what noise and the edge of a foot that tilts come to.
    speed: float = bounded(0.2, above=0.0, unit="m/s")
    # A sole that has landed slides until it rests.
    settling_time: float = bounded(0.03, least=0.0, unit="s")
    # At less than this, nothing is learnt.
    least_friction: float = bounded(0.3, above=0.0)
    # The next ground may be better: what comes back.
    recovery: float = bounded(0.05, least=0.0, unit="1/s")


class FrictionEstimate(NamedTuple):
    """The `friction` to count on, and how long [s] each sole has carried."""

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

    `forces` (2, 3), in parts of the weight, are those that the (left, right)
    sole was to bear in the tick of `period` [s], and `velocities` (2, 3) [m/s]
    its own, in the frame of the sole.  A sole that slips has used up the
    friction: less is counted on than what it was told to bring.  After that
    the friction comes back to the `usual` one.
    """
    least = min(params.least_friction, usual)
    friction = min(last.friction + params.recovery * period, usual)
    loaded = []
    for (x, y, z), velocity, time in zip(
        forces.tolist(), velocities, last[1:], strict=True
    ):
        loaded.append(time + period if z > _LOADED else 0.0)
        used = max(abs(x), abs(y)) / max(z, _LOADED)  # as of the pyramid
        if (
            loaded[-1] > params.settling_time
            and used > least
            and np.hypot(*velocity[:2]) > params.speed
        ):
            friction = max(min(friction, _LESS * used), least)
    return FrictionEstimate(friction, *loaded)
