"""What a robot may use to recover, by name: the columns of Fig. 10."""

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


def switch(params: ControllerParams, name: str) -> None:
    """Switches on in `params` what the mechanism `name` has, and no more."""
    if name == AS_IN_PARAMETERS:
        return
    mechanism = MECHANISMS[name]
    params.step_adjuster.enabled = mechanism.step
    params.reachability.cross_over = mechanism.cross_over
    params.timing_adapter.swing = mechanism.swing
    params.timing_adapter.transfer = mechanism.transfer
