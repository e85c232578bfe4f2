import math

import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from nadia_balance.core.whole_body_params import WholeBodyQpParams

BAD = [
    ("momentum_weight", -1.0),
    ("posture_weight", 0.0),
    ("friction", math.nan),
    ("max_effort_ratio", 1.5),
    ("unloading_fraction", 1.1),
    ("unloaded_force", 1.0),
    ("joint_lower_limits", {"LEFT_KNEE_Y": math.inf}),
    ("solver", "mosek"),
]


@pytest.mark.parametrize(("name", "value"), BAD)
def test_refuses_parameters_out_of_range(name, value):
    """Oracle: the message begins with the field that was spoilt."""
    params = WholeBodyQpParams(**{name: value})
    with pytest.raises(ValueError, match=f"^{name}.* must be"):
        params.validate()


def test_the_defaults_are_valid():
    """Oracle: no error."""
    WholeBodyQpParams().validate()


def test_can_be_loaded_from_yaml():
    """Oracle: what was written comes back, the rest keeps its default."""
    params = yaml_load_typed(
        schema=WholeBodyQpParams,
        data="{torso_weight: 7.0, joint_lower_limits: {LEFT_KNEE_Y: 0.1}}",
        defaults=WholeBodyQpParams(),
    )
    assert params == WholeBodyQpParams(
        torso_weight=7.0, joint_lower_limits={"LEFT_KNEE_Y": 0.1}
    )
    again = yaml_load_typed(
        schema=WholeBodyQpParams, data=yaml_dump_typed(params)
    )
    assert again == params
