"""Deviations of the robot from the model and measurements of its controller."""

from dataclasses import dataclass

from nadia_balance.core.math.bounds import bounded


@dataclass(kw_only=True)
class Imperfections:
    """Errors of measurements, ground and model; none by default.

    Noise is white and Gaussian with these standard deviations, sampled in each
    control tick.
    """

    joint_noise: float = bounded(0.0, least=0.0, most=0.1, unit="rad")
    joint_speed_noise: float = bounded(0.0, least=0.0, most=10.0, unit="rad/s")
    # Noise of the position, and of linear and angular velocity.
    pelvis_noise: float = bounded(0.0, least=0.0, most=0.1, unit="m")
    pelvis_speed_noise: float = bounded(0.0, least=0.0, most=1.0, unit="m/s")
    # Delay from measurement to controller, a multiple of its period; the
    # controller knows it, as from time stamps.
    delay: float = bounded(0.0, least=0.0, most=0.1, unit="s")
    # Ratio of all friction coefficients to those of the models.
    friction_ratio: float = bounded(1.0, above=0.0, most=2.0)
    # Ratio of the torso's mass and inertia to those of the controller's model.
    torso_mass_ratio: float = bounded(1.0, above=0.1, most=3.0)

    @property
    def has_noise(self) -> bool:
        """True if measurements have noise."""
        noise = self.joint_noise, self.joint_speed_noise, self.pelvis_noise
        return max(*noise, self.pelvis_speed_noise) > 0.0
