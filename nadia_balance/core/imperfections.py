"""How a robot differs from what its controller believes of it."""

from dataclasses import dataclass

from nadia_balance.core.bounds import bounded


@dataclass(kw_only=True)
class Imperfections:
    """Of what is measured, of the ground, and of the model; none by default.

    Noise is white and Gaussian, with these standard deviations, in each
    control tick anew.
    """

    joint_noise: float = bounded(0.0, least=0.0, most=0.1, unit="rad")
    joint_speed_noise: float = bounded(0.0, least=0.0, most=10.0, unit="rad/s")
    # Of the position, and of both velocities.
    pelvis_noise: float = bounded(0.0, least=0.0, most=0.1, unit="m")
    pelvis_speed_noise: float = bounded(0.0, least=0.0, most=1.0, unit="m/s")
    # From a measurement to the controller; a multiple of its period.  Its
    # length is known, as from time stamps.
    delay: float = bounded(0.0, least=0.0, most=0.1, unit="s")
    # Of all friction coefficients to those of the models.
    friction_ratio: float = bounded(1.0, above=0.0, most=2.0)
    # Of the torso's mass and inertia to what the controller knows.
    torso_mass_ratio: float = bounded(1.0, above=0.1, most=3.0)

    @property
    def of_measurements(self) -> bool:
        """True if what is measured is not what is there, now."""
        return (
            max(
                self.joint_noise,
                self.joint_speed_noise,
                self.pelvis_noise,
                self.pelvis_speed_noise,
                self.delay,
            )
            > 0.0
        )
