"""The fields of robot.yaml: the parameters of a robot."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from nadia_balance.core.body.model import (
    JointDriveParams,
    JointImpedanceParams,
    LegGeometry,
)
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.body.swing_detour import SwingDetourParams
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.parameters.bounds import bounded, check, parameters, require
from nadia_balance.parameters.scaling import Size
from nadia_balance.parameters.yaml_reader import load_typed

# The folder `models` of a checkout or an installation.  `import models` would
# also find a user's folder of that name.
MODELS = (Path(__file__).parents[1] / "models").resolve()


@parameters
class SoleParams:
    """The rectangle of either sole in the frame of its foot body."""

    x_min: float = bounded(0.0, doc="x of the heel, in m")
    x_max: float = bounded(0.0, doc="x of the toe, in m")
    half_width: float = bounded(
        0.0, doc="half of the width", above=0.0, unit="m", of=""
    )
    z: float = bounded(0.0, doc="z of the ground, in m")

    def validate_more(self) -> None:
        """Checks the length.

        Raises:
            ValueError: the toe is not in front of the heel.
        """
        require(
            self.x_max > self.x_min,
            f"x_max = {self.x_max}: must be > x_min = {self.x_min} m",
        )


# Fields of a robot.yaml that nothing can take the place of.
REQUIRED = (
    "name",
    "urdf",
    "pelvis_body",
    "torso_body",
    "left_foot_body",
    "right_foot_body",
    "step_width",
)


@parameters
class RobotParams:
    """Parameters that a URDF lacks; bodies and joints have their URDF names."""

    name: str = bounded("", doc="name of the robot")
    urdf: str = bounded("", doc="its description, relative to robot.yaml")
    pelvis_body: str = bounded("", doc="link that is the floating base")
    torso_body: str = bounded("", doc="link that is kept upright")
    left_foot_body: str = bounded("", doc="link with the left sole")
    right_foot_body: str = bounded("", doc="link with the right sole")
    sole: SoleParams = bounded(SoleParams, doc="sole of either foot")
    com_height: float = bounded(
        0.0,
        doc="height of the CoM above the soles, standing",
        above=0.0,
        unit="m",
        of="",
    )
    step_width: float = bounded(
        0.0,
        doc="distance between the sole centres, standing",
        above=0.0,
        unit="m",
    )
    posture: dict[str, float] = bounded(
        dict, doc="angles of joints, standing, in rad; 0 of all others"
    )
    legs: LegGeometry = bounded(LegGeometry, doc="lengths of the legs")
    reachability: ReachabilityParams = bounded(
        ReachabilityParams, doc="where the swing foot can step"
    )
    swing_detour: SwingDetourParams = bounded(
        SwingDetourParams, doc="how the swing foot passes the stance leg"
    )
    max_joint_speed: float = bounded(
        math.inf,
        doc="velocity limit of joints that have none in the URDF",
        above=0.0,
        finite=False,
        unit="rad/s",
    )
    drives: JointDriveParams | None = bounded(
        JointDriveParams,
        doc="drives of the joints; null: ideal ones, with full torque at any "
        "speed, without lag",
    )
    impedance: JointImpedanceParams = bounded(
        JointImpedanceParams,
        doc="what the drives add to the torques, if the sensors have noise",
    )
    self_collisions: bool = bounded(
        True,
        doc="false: links of the robot pass through each other, but for its "
        "legs",
    )
    whole_body: WholeBodyQpParams = bounded(
        WholeBodyQpParams,
        doc="values of the robot for the parameters of the controller of that "
        "name",
    )

    @property
    def size(self) -> Size:
        """The size that scales Nadia's values to parameters not given here."""
        return Size(
            leg=self.legs.length + self.legs.ankle_height,
            sole_length=self.sole.x_max - self.sole.x_min,
            sole_width=2.0 * self.sole.half_width,
        )

    def validate_more(self) -> None:
        """Checks what has no default.

        Raises:
            ValueError: the robot has no name, or no URDF.
        """
        for name, value in ("name", self.name), ("urdf", self.urdf):
            require(value != "", f"{name} = '': must not be empty")


def load_sensors(name: str) -> SensorParams:
    """Reads sensors of models/sensors/sensors.yaml, and checks them.

    Args:
        name: of the sensors in that file.

    Returns:
        Their parameters.

    Raises:
        ValueError: there are no such sensors.
    """
    sensors = load_typed(
        SensorParams,
        "sensors",
        filename=MODELS / "sensors" / "sensors.yaml",
        child_name=name,
    )
    check(sensors, "sensors")
    return sensors


# Ideal robots take any load at once, and their links pass through each other:
# a layer of the controller's parameters, and of the robot's (see idealised).
IDEAL_WHOLE_BODY: dict[str, Any] = {"loading_time": 0.0, "avoidance": None}


def idealised(params: RobotParams) -> RobotParams:
    """The same robot with ideal drives and no limits on feet and loading.

    Args:
        params: of a realistic robot.

    Returns:
        Parameters of one whose arms pass through the rest of it.
    """
    return replace(
        params,
        drives=None,
        self_collisions=False,
        swing_detour=replace(
            params.swing_detour,
            max_speed=math.inf,
            max_descent=math.inf,
            max_braking=math.inf,
            settling=0.0,
        ),
        whole_body=replace(
            params.whole_body,
            loading_time=IDEAL_WHOLE_BODY["loading_time"],
            avoidance=IDEAL_WHOLE_BODY["avoidance"],
        ),
    )
