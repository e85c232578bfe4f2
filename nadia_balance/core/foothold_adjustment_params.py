"""Parameters of the foothold adjustment by capture regions."""

import math
from dataclasses import dataclass, field

from nadia_balance.core.capture_region import usable_foot
from nadia_balance.core.reach_rules import ReachRulesParams
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import Array, Footstep

NOT_NEGATIVE = (
    "foot_front",
    "foot_back",
    "foot_inside",
    "foot_outside",
    "dead_band",
    "margin",
    "sole_clearance",
    "freeze_time",
    "settling_time",
    "return_time",
)


@dataclass(kw_only=True)
class CaptureRegionStepAdjusterParams:
    """Where the capture region moves a foothold, and when it does."""

    enabled: bool = True  # false: every foothold stays where it was to be
    num_steps: int = 3  # N, as far as so many are queued [-]
    reachability: ReachabilityParams = field(default_factory=ReachabilityParams)
    rules: ReachRulesParams = field(default_factory=ReachRulesParams)
    # The CoP is not counted on so near the sole's front, back, inner and
    # outer edge [m].
    foot_front: float = 0.02
    foot_back: float = 0.05
    foot_inside: float = 0.02
    foot_outside: float = 0.03
    # The foot may take its load so much later than planned: the ICP may be
    # short of the foothold when the foot lands, and catch up in transfer [s].
    waiting_time: float = 0.5
    # The weight arrives on the foot at the end of the transfer, not at once.
    transfer_aware: bool = False
    # The CoP may leave the centre of the feet that are still to land.
    finite_foot: bool = False
    # The steps to come are counted on to last no longer than this, as when
    # their timing is adapted; infinite: as long as they are queued.  The more
    # they promise, the more of the recovery is put off until then.  [s]
    shortest_transfer: float = math.inf
    shortest_swing: float = math.inf
    dead_band: float = 0.01  # the foothold moves by so much, or not at all [m]
    margin: float = 0.03  # so deep into the capture region, if possible [m]
    sole_clearance: float = 0.005  # between the soles [m]
    freeze_time: float = 0.05  # no change so shortly before touchdown [s]
    settling_time: float = 0.01  # nor so early in a swing [s]
    # Back to the foothold that was to be, when the region has covered it for
    # so long without a break [s].
    return_time: float = 0.05

    def validate(self) -> None:
        """Raises ValueError if a field, here or below, is out of range."""
        if not 1 <= self.num_steps <= 10:
            raise ValueError(
                f"num_steps = {self.num_steps}: must be in [1, 10]"
            )
        for name in NOT_NEGATIVE:
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and >= 0")
        if not 0.0 < self.waiting_time <= 5.0:
            raise ValueError(
                f"waiting_time = {self.waiting_time}: must be in (0, 5] s"
            )
        for name in ("shortest_transfer", "shortest_swing"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"{name} = {value}: must be > 0 s")
        self.reachability.validate()
        self.rules.validate()

    def usable_foot(self, sole: Array) -> Array:
        """Returns the part (n, 2) [m] of the sole that has the CoP.

        Both in the sole frame with y toward the swing side.
        """
        return usable_foot(
            sole,
            self.foot_front,
            self.foot_back,
            self.foot_inside,
            self.foot_outside,
        )

    def transfer_duration(self, step: Footstep) -> float:
        """How long [s] the transfer before the swing of `step` will last."""
        return min(step.transfer_duration, self.shortest_transfer)

    def duration(self, step: Footstep) -> float:
        """How long [s] `step` will last: transfer and swing."""
        swing = min(step.swing_duration, self.shortest_swing)
        return self.transfer_duration(step) + swing
