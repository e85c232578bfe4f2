"""The fields of robot.yaml: the parameters of a robot."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import nadia_balance
from nadia_balance.core.body.model import JointDriveParams, LegGeometry
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.body.swing_detour import SwingDetourParams
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.parameters.bounds import bounded, check
from nadia_balance.parameters.scaling import Size
from nadia_balance.parameters.yaml_reader import load_typed

# The folder `models` of a checkout or an installation.  `import models` would
# also find a user's folder of that name.
MODELS = (Path(nadia_balance.__file__).parent / "models").resolve()


@dataclass(kw_only=True)
class SoleParams:
    """The rectangle of either sole in the frame of its foot body."""

    x_min: float = 0.0  # heel [m]
    x_max: float = 0.0  # toe [m]
    half_width: float = bounded(0.0, above=0.0, unit="m", of="")
    z: float = 0.0  # [m]

    def validate_more(self) -> None:
        """Raises ValueError if the toe is not in front of the heel."""
        if not self.x_max > self.x_min:
            must = f"must be > x_min = {self.x_min} m"
            raise ValueError(f"x_max = {self.x_max}: {must}")


@dataclass(kw_only=True)
class RobotParams:
    """Parameters that a URDF lacks; bodies and joints have their URDF names."""

    name: str = ""
    urdf: str = ""  # relative to robot.yaml
    pelvis_body: str = ""  # the floating base
    torso_body: str = ""
    left_foot_body: str = ""
    right_foot_body: str = ""
    sole: SoleParams = bounded(SoleParams)
    # Height of the CoM above the soles, standing [m].
    com_height: float = bounded(0.0, above=0.0, unit="m", of="")
    # Distance between the sole centres, standing [m].
    step_width: float = bounded(0.0, above=0.0, unit="m")
    posture: dict[str, float] = field(default_factory=dict)  # [rad]
    legs: LegGeometry = field(default_factory=LegGeometry)
    reachability: ReachabilityParams = bounded(ReachabilityParams)
    swing_detour: SwingDetourParams = bounded(SwingDetourParams)
    # Velocity limit of joints that have none in the URDF.
    max_joint_speed: float = bounded(
        math.inf, above=0.0, finite=False, unit="rad/s"
    )
    # Null: ideal drives, with full torque at any speed, without lag.
    drives: JointDriveParams | None = bounded(JointDriveParams)
    # False: the robot's links pass through each other, but for its legs.
    self_collisions: bool = True
    # The robot's own values of the controller's parameters of that name.
    whole_body: WholeBodyQpParams = bounded(WholeBodyQpParams)

    @property
    def size(self) -> Size:
        """The size that scales Nadia's values to parameters not given here."""
        leg, sole = self.legs.length + self.legs.ankle_height, self.sole
        return Size(leg, sole.x_max - sole.x_min, 2.0 * sole.half_width)

    def validate_more(self) -> None:
        """Raises ValueError if the robot has no name, or no URDF."""
        for name in ("name", "urdf"):
            if not getattr(self, name):
                raise ValueError(f"{name} = '': must not be empty")


def load_sensors(name: str) -> SensorParams:
    """Returns the sensors `name` of models/sensors/sensors.yaml, checked."""
    file = MODELS / "sensors" / "sensors.yaml"
    found = load_typed(SensorParams, "sensors", filename=file, child_name=name)
    check(found, "sensors")
    return found


# Ideal robots take any load at once, and their links pass through each other.
IDEAL_WHOLE_BODY: dict[str, object] = {"loading_time": 0.0, "avoidance": None}


def idealised(params: RobotParams) -> RobotParams:
    """The same robot with ideal drives and no limits on feet and loading.

    Its arms pass through the rest of it.
    """
    free = dict.fromkeys(("max_speed", "max_descent", "max_braking"), math.inf)
    return replace(
        params,
        drives=None,
        self_collisions=False,
        swing_detour=replace(params.swing_detour, settling=0.0, **free),
        whole_body=replace(params.whole_body, **IDEAL_WHOLE_BODY),
    )
