"""The point-mass model, the robot model of capture-point control."""

from dataclasses import dataclass
from functools import cached_property

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.body.swing_detour import SwingDetourParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import bounded
from nadia_balance.core.math.lipm import natural_frequency


@dataclass(kw_only=True)
class LegGeometry:
    """Dimensions of the legs."""

    # Distance from the hip pitch axis to the ankle with a straight knee.
    length: float = bounded(0.0, above=0.0, unit="m", of="")
    # Above the sole.
    ankle_height: float = bounded(0.0, above=0.0, unit="m", of="")
    com_above_hip: float = 0.0  # vertical, in the nominal posture [m]
    # Lateral distance of the hip pitch axes.
    hip_width: float = bounded(0.0, above=0.0, unit="m", of="")


@dataclass(frozen=True, eq=False, kw_only=True)
class PointMassModel:
    """A linear inverted pendulum with two soles and legs of limited reach."""

    mass: float  # [kg]
    com_height: float  # of the CoM above the soles [m]
    step_width: float  # between the sole centres, standing [m]
    sole: Array  # (n, 2) corners of either sole, in its own frame [m]
    # Part (k, 2) [m] of either sole where the ankle holds the CoP; None: all.
    held: Array | None = None
    legs: LegGeometry
    reach: ReachabilityParams  # reachability regions of the swing foot
    detour: SwingDetourParams  # path of the swing foot past the stance leg
    # Least distance [m] of the soles: the shapes of the feet keep clear.
    sole_clearance: float = 0.0
    ground: Ground | None = None  # None: unlimited level ground

    @property
    def cop_area(self) -> Array:
        """Part (k, 2) [m] of either sole that the CoP can be in, when alone."""
        return self.sole if self.held is None else self.held

    @property
    def is_uneven(self) -> bool:
        """True if feet may stand at different heights, or tilted."""
        return self.ground is not None and not self.ground.is_level

    @cached_property
    def omega(self) -> float:
        """Natural frequency [rad/s] (Nadia paper, below Eq. 1)."""
        return natural_frequency(self.com_height)
