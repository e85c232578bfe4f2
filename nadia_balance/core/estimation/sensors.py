"""Errors of the sensors, as data sheets give them."""

from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import bounded


@dataclass(kw_only=True)
class SensorParams:
    """IMU, joint encoders and foot force sensors of a robot.

    A white noise of density N has the standard deviation N / sqrt(T) in a mean
    over the time T.  Biases are drawn once a run, with these standard
    deviations per axis, and walk as a Wiener process.
    """

    gyro_noise: float = bounded(0.0, least=0.0, most=0.1)  # [rad/s/sqrt(Hz)]
    gyro_bias: float = bounded(0.0, least=0.0, most=0.5)  # [rad/s]
    gyro_walk: float = bounded(0.0, least=0.0, most=0.1)  # [rad/s/sqrt(s)]
    gyro_range: float = bounded(35.0, above=0.0)  # [rad/s]
    # Errors of the specific force a - g, and its range.
    force_noise: float = bounded(0.0, least=0.0, most=1.0)  # [m/s^2/sqrt(Hz)]
    force_bias: float = bounded(0.0, least=0.0, most=5.0)  # [m/s^2]
    force_walk: float = bounded(0.0, least=0.0, most=1.0)  # [m/s^2/sqrt(s)]
    force_range: float = bounded(157.0, above=0.0)  # [m/s^2]
    imu_body: str = ""  # empty: the pelvis
    imu_position: list[float] = field(default_factory=lambda: [0.0] * 3)  # [m]
    imu_rpy_deg: list[float] = field(default_factory=lambda: [0.0] * 3)
    # White noise of joint angles and speeds, a new sample each tick.
    joint_noise: float = bounded(0.0, least=0.0, most=0.1)  # [rad]
    joint_speed_noise: float = bounded(0.0, least=0.0, most=10.0)  # [rad/s]
    # Errors of a foot force: white noise as a share of the reading, and an
    # offset as a share of the robot's weight.
    load_noise: float = bounded(0.0, least=0.0, most=1.0)
    load_bias: float = bounded(0.0, least=0.0, most=1.0)
    # Delay from measurement to controller, which knows it [s].
    delay: float = bounded(0.0, least=0.0, most=0.1)

    @property
    def imu_range(self) -> Array:
        """Largest values (9,) that an Imu tells: rate, force, latest rate."""
        ranges = self.gyro_range, self.force_range, self.gyro_range
        return np.repeat(ranges, 3)

    def validate_more(self) -> None:
        """Raises ValueError if the IMU's pose has not three numbers each."""
        for name in ("imu_position", "imu_rpy_deg"):
            if len(value := getattr(self, name)) != 3:
                raise ValueError(f"{name} = {value}: must be three numbers")
