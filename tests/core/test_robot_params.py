"""robot.yaml's values are checked before anything is built from them."""

import math

import pytest

from nadia_balance.core.com_height import LegGeometry
from nadia_balance.core.robot_params import RobotParams, SoleParams
from nadia_balance.core.whole_body_params import WholeBodyQpParams


def valid(**changes) -> RobotParams:
    sole = SoleParams(x_min=-0.1, x_max=0.1, half_width=0.05, z=-0.1)
    legs = LegGeometry(length=0.8, ankle_height=0.1, hip_width=0.2)
    fields = {"com_height": 0.9, "step_width": 0.25}
    fields |= {"sole": sole, "legs": legs}
    return RobotParams(**(fields | changes))


def sole(**changes) -> SoleParams:
    return SoleParams(**({"x_max": 0.1, "half_width": 0.05} | changes))


def test_accepts_what_is_in_range():
    valid().validate()


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"com_height": math.nan}, "com_height = nan: must be"),
        ({"com_height": -0.9}, "com_height = -0.9: must be"),
        ({"step_width": 0.0}, "step_width = 0.0: must be"),
        ({"max_joint_speed": math.inf}, "max_joint_speed = inf: must be"),
        ({"posture": {"KNEE": math.nan}}, "posture.KNEE = nan: must be"),
        ({"sole": sole(z=math.nan)}, "sole.z = nan: must be"),
        ({"sole": sole(half_width=-0.05)}, "sole.half_width = -0.05: must be"),
        ({"sole": sole(x_min=0.2)}, "sole.x_max = 0.1: must be > sole.x_min"),
        ({"legs": LegGeometry()}, "legs.length = 0.0: must be > 0 m"),
        ({"whole_body": WholeBodyQpParams(friction=0.0)}, "friction = 0.0"),
    ],
)
def test_refuses_what_is_not_by_field_and_value(changes, message):
    with pytest.raises(ValueError, match=message):
        valid(**changes).validate()
