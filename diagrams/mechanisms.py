"""What a robot may use to recover, by name: the columns of Fig. 10."""

import copy

from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.mechanisms import (
    Mechanisms,
    switched_adjuster,
    switched_timing,
)

MECHANISMS = {
    "icp_only": Mechanisms(),
    "step": Mechanisms(step=True),
    "step_swing": Mechanisms(step=True, swing=True),
    "step_swing_transfer": Mechanisms(step=True, swing=True, transfer=True),
    "all_with_cross_over": Mechanisms(
        step=True, swing=True, transfer=True, cross_over=True
    ),
}
AS_IN_PARAMETERS = "custom"  # whatever the controller's parameters say


def with_mechanism(params: ControllerParams, name: str) -> ControllerParams:
    """Returns a copy of `params` that has what `name` has, and no more."""
    params = copy.deepcopy(params)
    if name != AS_IN_PARAMETERS:
        on = MECHANISMS[name]
        params.timing_adapter = switched_timing(params.timing_adapter, on)
        params.step_adjuster = switched_adjuster(params.step_adjuster, on)
    return params
