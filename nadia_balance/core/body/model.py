"""What a controller knows of a robot: a point mass, its legs, its drives."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.body.swing_detour import SwingDetourParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import natural_frequency
from nadia_balance.core.walking.state import FootPose
from nadia_balance.parameters.bounds import bounded, parameters


@parameters
class LegGeometry:
    """Dimensions of the legs."""

    length: float = bounded(
        0.0,
        above=0.0,
        unit="m",
        of="",
        doc="distance from the hip pitch axis to the ankle with a straight "
        "knee",
    )
    ankle_height: float = bounded(
        0.0, above=0.0, unit="m", of="", doc="of the ankle above the sole"
    )
    com_above_hip: float = bounded(
        0.0, doc="of the CoM, vertical, in the nominal posture, in m"
    )
    hip_ahead: float = bounded(
        0.0,
        doc="of the hip pitch axis in front of the ankle, in the nominal "
        "posture, when the CoM is over the sole's centre, in m",
    )
    hip_width: float = bounded(
        0.0,
        above=0.0,
        unit="m",
        of="",
        doc="lateral distance of the hip pitch axes",
    )


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

    @property
    def froude_speed(self) -> float:
        """The speed sqrt(g z) of Froude number 1, z the CoM's height [m/s]."""
        return self.omega * self.com_height

    def foot_at(self, point: Array, nominal: FootPose) -> FootPose:
        """The foot that stands on the ground at a point.

        Args:
            point: centre of the sole (2,) in W [m].
            nominal: pose whose yaw it has; on flat ground, also whose height.

        Returns:
            The pose, with the height and the normal of the ground.
        """
        height = float(nominal.p_WF[2])
        if self.ground is None:
            return FootPose(np.append(point, height), nominal.yaw)
        return self.ground.pose(point, nominal.yaw, height)


@parameters
class MotorParams:
    """A kind of motor with its gear, in place of what the URDF says of it."""

    joints: list[str] = bounded(list, doc="the joints that it drives")
    max_torque: float | None = bounded(
        None, above=0.0, unit="N m", doc="largest torque; null: of the URDF"
    )
    max_speed: float | None = bounded(
        None,
        above=0.0,
        unit="rad/s",
        doc="speed without load; null: the URDF's velocity limit",
    )
    corner_speed: float | None = bounded(
        None,
        above=0.0,
        below=1.0,
        doc="share of the speed limit with the full torque; null: of `drives`",
    )


@parameters
class JointDriveParams:
    """Parameters of all drives; other torque and speed limits: see URDF."""

    bandwidth: float = bounded(
        40.0, above=0.0, unit="Hz", doc="of the torque, a first-order lag"
    )
    corner_speed: float = bounded(
        0.5,
        above=0.0,
        below=1.0,
        doc="share of the speed limit up to which the full torque is "
        "available; above it the torque limit decreases linearly to 0 at the "
        "speed limit",
    )
    max_torque_rate: float = bounded(
        50.0,
        above=0.0,
        unit="1/s",
        of="",
        doc="largest rate of a commanded torque, in shares of its limit",
    )
    motors: dict[str, MotorParams] = bounded(
        dict, doc="kinds of motors by name; a joint has one at most"
    )

    @property
    def lag(self) -> float:
        """Lag [s] of a slowly changing torque."""
        return 1.0 / (2.0 * math.pi * self.bandwidth)


@parameters
class JointImpedanceParams:
    """Stiffness and damping of the drives about the motion that the QP expects.

    Each joint has kp = I stiffness^2 and kd = I damping, with its apparent
    inertia I while the robot is in the air, the least there is: the stiffness
    is that of a mass on a spring with this natural frequency.
    """

    stiffness: float = bounded(
        30.0, doc="natural frequency of the stiffness", least=0.0, unit="1/s"
    )
    damping: float = bounded(
        60.0, doc="rate at which a deviation decays", least=0.0, unit="1/s"
    )


def torque_limits(
    speed: Array, max_torque: Array, max_speed: Array, corner_speed: Array
) -> Array:
    """The torques of drives within max_torque and the torque-speed line.

    The line bounds driving, not braking torques: it falls from max_torque at
    corner_speed max_speed to 0 at max_speed.

    Args:
        speed: speeds (n,) of n drives [rad/s].
        max_torque: torque limits (n,) [N m].
        max_speed: speed limits (n,) [rad/s].
        corner_speed: shares (n,) of the speed limits with the full torque [-].

    Returns:
        The least and the largest torque (2, n) [N m].
    """
    # In place for speed: called in every step of the plant.
    limits = np.empty((2, speed.size))
    np.add(max_speed, speed, out=limits[0])
    np.subtract(max_speed, speed, out=limits[1])
    limits /= (1.0 - corner_speed) * max_speed
    np.minimum(np.maximum(limits, 0.0, out=limits), 1.0, out=limits)
    limits *= max_torque
    np.negative(limits[0], out=limits[0])
    return limits


def lag_share(bandwidth: float, period: float) -> float:
    """The step response 1 - exp(-2 pi bandwidth period) of the torque.

    Args:
        bandwidth: of 3 dB, of the first-order lag [Hz].
        period: time since the step [s].

    Returns:
        Share of the step [-].
    """
    return -math.expm1(-2.0 * math.pi * bandwidth * period)
