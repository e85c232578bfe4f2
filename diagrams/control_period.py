"""The same controller at another control period."""

from dataclasses import replace

from nadia_balance.capture_point_controller import ControllerParams


def at_control_period(
    params: ControllerParams, period: float
) -> ControllerParams:
    """Returns `params` for ticks of `period` [s] that do the same in time.

    What is counted in ticks lasts as long as before, but for rounding, and at
    least one tick.  What is done by a share in each tick gets the share that
    is done by then: 1 - (1 - share)^ratio, of the new period to the old one.
    """
    ratio = period / params.control_period
    machine, timing = params.walking_state_machine, params.timing_adapter
    adjuster = params.step_adjuster
    return replace(
        params,
        control_period=period,
        walking_state_machine=replace(
            machine, contact_ticks=_ticks(machine.contact_ticks, ratio)
        ),
        timing_adapter=replace(
            timing,
            swing_discount=_share(timing.swing_discount, ratio),
            transfer_discount=_share(timing.transfer_discount, ratio),
        ),
        step_adjuster=replace(
            adjuster, return_ticks=_ticks(adjuster.return_ticks, ratio)
        ),
    )


def _ticks(number: int, ratio: float) -> int:
    return max(round(number / ratio), 1)


def _share(share: float, ratio: float) -> float:
    return 1.0 - (1.0 - share) ** ratio
