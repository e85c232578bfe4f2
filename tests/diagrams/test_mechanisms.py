"""Oracle: the columns of the Nadia paper's Fig. 10, by hand."""

import pytest
from pydrake.common.yaml import yaml_dump_typed

from diagrams.mechanisms import AS_IN_PARAMETERS, MECHANISMS, with_mechanism
from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.mechanisms import Mechanisms, mechanisms_of

COLUMNS = {
    "icp_only": Mechanisms(False, False, False, False),
    "step": Mechanisms(True, False, False, False),
    "step_swing": Mechanisms(True, True, False, False),
    "step_swing_transfer": Mechanisms(True, True, True, False),
    "all_with_cross_over": Mechanisms(True, True, True, True),
}


def test_the_names_are_those_of_the_columns():
    assert list(COLUMNS) == list(MECHANISMS)


@pytest.mark.parametrize("name", COLUMNS)
def test_a_name_switches_what_its_column_has(name):
    """Oracle: the table above; all else, and the original, stay."""
    params = ControllerParams(control_period=0.004)
    params.step_adjuster.margin = 0.02
    before = yaml_dump_typed(params)
    found = with_mechanism(params, name)
    assert COLUMNS[name] == mechanisms_of(
        found.timing_adapter, found.step_adjuster
    )
    assert yaml_dump_typed(params) == before
    assert found.step_adjuster.margin == 0.02
    assert found.walking_state_machine == params.walking_state_machine
    assert found.control_period == 0.004


def test_custom_is_what_the_parameters_say():
    """Oracle: the parameters, copied."""
    params = ControllerParams()
    params.timing_adapter.transfer = False
    found = with_mechanism(params, AS_IN_PARAMETERS)
    assert yaml_dump_typed(found) == yaml_dump_typed(params)
    assert found.timing_adapter is not params.timing_adapter
