"""The fields of robot.yaml: what the controller needs to know of a robot."""

import math
from dataclasses import dataclass, field

from nadia_balance.core.com_height import LegGeometry
from nadia_balance.core.whole_body_params import WholeBodyQpParams


@dataclass(kw_only=True)
class SoleParams:
    """The rectangle of either sole in the frame of its foot body."""

    x_min: float = 0.0  # heel [m]
    x_max: float = 0.0  # toe [m]
    half_width: float = 0.0  # [m]
    z: float = 0.0  # [m]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise ValueError(f"sole.{name} = {value}: must be finite")
        if not self.half_width > 0.0:
            raise ValueError(
                f"sole.half_width = {self.half_width}: must be > 0 m"
            )
        if not self.x_max > self.x_min:
            raise ValueError(
                f"sole.x_max = {self.x_max}: must be > "
                f"sole.x_min = {self.x_min} m"
            )


@dataclass(kw_only=True)
class RobotParams:
    """All that a URDF cannot say; bodies and joints by their URDF names."""

    name: str = ""
    urdf: str = ""  # relative to robot.yaml
    pelvis_body: str = ""  # the floating base
    torso_body: str = ""
    left_foot_body: str = ""
    right_foot_body: str = ""
    sole: SoleParams = field(default_factory=SoleParams)
    com_height: float = 0.0  # of the CoM above the soles, standing [m]
    step_width: float = 0.0  # between the sole centres, standing [m]
    posture: dict[str, float] = field(default_factory=dict)  # [rad]
    legs: LegGeometry = field(default_factory=LegGeometry)
    max_joint_speed: float = 20.0  # runs are checked against it [rad/s]
    whole_body: WholeBodyQpParams = field(default_factory=WholeBodyQpParams)

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
        for name in ("com_height", "step_width", "max_joint_speed"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and > 0")
        for joint, angle in self.posture.items():
            if not math.isfinite(angle):
                raise ValueError(f"posture.{joint} = {angle}: must be finite")
        self.sole.validate()
        self.legs.validate()
        self.whole_body.validate()
