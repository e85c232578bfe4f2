"""What the robot may use to recover, besides its ankles and hips."""

from dataclasses import dataclass, replace

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.time_adjustment import TimingAdapterParams


@dataclass(frozen=True)
class Mechanisms:
    """Which of them are on; as a vector, 1 or 0 in this order."""

    step: bool = False  # where the foot lands
    swing: bool = False  # how long a swing lasts
    transfer: bool = False  # how long a transfer lasts
    cross_over: bool = False  # whether a step may cross the legs


def mechanisms_of(
    timing: TimingAdapterParams, adjuster: CaptureRegionStepAdjusterParams
) -> Mechanisms:
    """Returns what is on in these parameters."""
    return Mechanisms(
        adjuster.enabled,
        timing.swing,
        timing.transfer,
        adjuster.reachability.cross_over,
    )


def switched_timing(
    params: TimingAdapterParams, on: Mechanisms
) -> TimingAdapterParams:
    """Returns `params` with what is `on`, and no more."""
    return replace(params, swing=on.swing, transfer=on.transfer)


def switched_adjuster(
    params: CaptureRegionStepAdjusterParams, on: Mechanisms
) -> CaptureRegionStepAdjusterParams:
    """Returns `params` with what is `on`, and no more."""
    reach = replace(params.reachability, cross_over=on.cross_over)
    return replace(params, enabled=on.step, reachability=reach)
