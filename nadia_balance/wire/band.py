"""An overhead band that holds a robot which does not stand by itself."""

from dataclasses import dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY

STIFF_FOR = 2.5  # joints hold for so long before it is lowered [s]
LOWERED_IN, LIFTED_IN = 1.0, 0.5  # [s]
CLEARANCE = 0.03  # of the soles of a hanging robot [m]


@dataclass
class Band:
    """As an operator uses it: lifts a robot that is let go, sets one down.

    Above the pelvis it pulls by m g and a damped spring, times `hold`.  Once
    the joints have been stiff for STIFF_FOR it lets down, until it is slack.

    Args:
        mass: of the robot [kg].
        height: of its point of attack when the robot stands [m].
        catches: whether it lifts a robot that is let go once it was slack.
    """

    mass: float
    height: float
    catches: bool = True
    hold: float = 1.0
    _stiff: float = 0.0  # for how long the joints have been [s]
    _anchor: Array | None = None  # (2,)

    @property
    def is_slack(self) -> bool:
        """Whether the robot stands, or lies, by itself."""
        return self.hold == 0.0

    def advance(self, is_stiff: bool, dt: float) -> None:
        """Lifts or lowers for a while.

        Args:
            is_stiff: whether the joints of the robot are held.
            dt: duration [s].
        """
        self._stiff = self._stiff + dt if is_stiff else 0.0
        if self._stiff > STIFF_FOR:
            self.hold = max(self.hold - dt / LOWERED_IN, 0.0)
        elif not is_stiff and (self.catches or self.hold > 0.0):
            self.hold = min(self.hold + dt / LIFTED_IN, 1.0)
        if self.is_slack:
            self._anchor = None

    def force(self, p: Array, v: Array) -> Array:
        """The force on the robot.

        Args:
            p: point of attack in W (3,) [m].
            v: its velocity (3,) [m/s].

        Returns:
            The force (3,) [N].
        """
        if self.is_slack:
            return np.zeros(3)
        if self._anchor is None:
            self._anchor = p[:2].copy()
        stiffness, weight = 100.0 * self.mass, self.mass * GRAVITY
        damping = 10.0 * self.mass
        force = -damping * v
        force[:2] += stiffness * (self._anchor - p[:2])
        force[2] += weight + stiffness * (self.height + CLEARANCE - p[2])
        force[2] = np.clip(force[2], 0.0, 1.5 * weight)
        return self.hold * force
