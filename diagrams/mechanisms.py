"""What a robot may use to recover, by name: the columns of Fig. 10."""

import copy
import math
from dataclasses import dataclass

from nadia_balance.capture_point_controller import ControllerParams


@dataclass(frozen=True)
class Mechanism:
    """Which adaptations are on, besides ankles and hips."""

    step: bool = False
    swing: bool = False
    transfer: bool = False
    cross_over: bool = False


MECHANISMS = {
    "icp_only": Mechanism(),
    "step": Mechanism(step=True),
    "step_swing": Mechanism(step=True, swing=True),
    "step_swing_transfer": Mechanism(step=True, swing=True, transfer=True),
    "all_with_cross_over": Mechanism(
        step=True, swing=True, transfer=True, cross_over=True
    ),
}
AS_IN_PARAMETERS = "custom"  # whatever the controller's parameters say


def with_mechanism(params: ControllerParams, name: str) -> ControllerParams:
    """Returns a copy of `params` that has what `name` has, and no more."""
    params = copy.deepcopy(params)
    if name == AS_IN_PARAMETERS:
        return params
    mechanism = MECHANISMS[name]
    timing, adjuster = params.timing_adapter, params.step_adjuster
    timing.swing, timing.transfer = mechanism.swing, mechanism.transfer
    adjuster.enabled = mechanism.step
    if not mechanism.step:  # where the feet go is given: only time can help
        params.walking_state_machine.patience = math.inf
    adjuster.reachability.cross_over = mechanism.cross_over
    return params
