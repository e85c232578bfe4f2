"""Errors of the sensors, as data sheets give them."""

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import bounded, parameters, require

SAMPLE = 0.001  # of the gyro's latest rate [s]


@parameters
class SensorParams:
    """IMU, joint encoders and foot force sensors, if any, of a robot.

    A white noise of density N has the standard deviation N / sqrt(T) in a mean
    over the time T.  Biases are drawn once a run, with these standard
    deviations per axis, and walk as a Wiener process.
    """

    gyro_noise: float = bounded(
        0.0,
        least=0.0,
        most=0.1,
        doc="density of the angular velocity's noise, in rad/s/sqrt(Hz)",
    )
    gyro_bias: float = bounded(
        0.0,
        least=0.0,
        most=0.5,
        doc="deviation of the angular velocity's bias, in rad/s",
    )
    gyro_walk: float = bounded(
        0.0, least=0.0, most=0.1, doc="walk of this bias, in rad/s/sqrt(s)"
    )
    gyro_range: float = bounded(
        35.0, above=0.0, doc="largest angular velocity of an axis, in rad/s"
    )
    force_noise: float = bounded(
        0.0,
        least=0.0,
        most=1.0,
        doc="density of the noise of the specific force a - g, in "
        "m/s^2/sqrt(Hz)",
    )
    force_bias: float = bounded(
        0.0,
        least=0.0,
        most=5.0,
        doc="deviation of the specific force's bias, in m/s^2",
    )
    force_walk: float = bounded(
        0.0, least=0.0, most=1.0, doc="walk of this bias, in m/s^2/sqrt(s)"
    )
    force_range: float = bounded(
        157.0, above=0.0, doc="largest specific force of an axis, in m/s^2"
    )
    imu_body: str = bounded("", doc="link of the IMU; empty: the pelvis")
    imu_position: list[float] = bounded(
        lambda: [0.0] * 3, doc="place of the IMU in the link's frame, in m"
    )
    imu_rpy_deg: list[float] = bounded(
        lambda: [0.0] * 3,
        doc="roll, pitch, yaw of the IMU in the link's frame, in degrees",
    )
    joint_noise: float = bounded(
        0.0,
        least=0.0,
        most=0.1,
        doc="white noise of joint angles, a new sample each tick, in rad",
    )
    joint_speed_noise: float = bounded(
        0.0,
        least=0.0,
        most=10.0,
        doc="white noise of joint speeds, a new sample each tick, in rad/s",
    )
    load_noise: float = bounded(
        0.0,
        least=0.0,
        most=1.0,
        doc="white noise of a foot force, as a share of the reading",
    )
    load_bias: float = bounded(
        0.0,
        least=0.0,
        most=1.0,
        doc="offset of a foot force, as a share of the robot's weight",
    )
    foot_forces: str = bounded(
        "measured",
        one_of=("measured", "estimated"),
        doc="measured by sensors in the feet, or estimated from the joints' "
        "torques (see FootForceEstimator)",
    )
    delay: float = bounded(
        0.0,
        least=0.0,
        most=0.1,
        doc="from measurement to controller, which knows it, in s",
    )

    @property
    def imu_range(self) -> Array:
        """Largest values (9,) that an Imu tells: rate, force, latest rate."""
        return np.repeat(
            (self.gyro_range, self.force_range, self.gyro_range), 3
        )

    def validate_more(self) -> None:
        """Checks the pose of the IMU.

        Raises:
            ValueError: it has not three numbers each.
        """
        for name, numbers in (
            ("imu_position", self.imu_position),
            ("imu_rpy_deg", self.imu_rpy_deg),
        ):
            require(
                len(numbers) == 3, f"{name} = {numbers}: must be three numbers"
            )
