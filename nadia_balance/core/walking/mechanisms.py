"""The mechanisms of recovery that can be switched on and off."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array


@dataclass(frozen=True)
class Mechanisms:
    """Switches of the recovery mechanisms besides ankles and hips."""

    step: bool  # foothold adjustment
    swing: bool  # adjustment of swing durations
    transfer: bool  # adjustment of transfer durations
    cross_over: bool  # cross-over steps in the foothold adjustment

    def as_vector(self) -> Array:
        """The switches as a signal of Drake.

        Returns:
            1 for on and 0 for off, in the order of the fields (4,).
        """
        return np.array(astuple(self), dtype=float)

    @classmethod
    def from_vector(cls, vector: Array) -> Mechanisms:
        """The inverse of `as_vector`.

        Args:
            vector: a number for each field, in their order (4,).

        Returns:
            The switches: a number above 0.5 is on.
        """
        return cls(*(vector > 0.5).tolist())


# The columns of the Nadia paper's Fig. 10, in order of more mechanisms.
MECHANISMS = {
    "icp_only": Mechanisms(False, False, False, False),
    "step": Mechanisms(True, False, False, False),
    "step_swing": Mechanisms(True, True, False, False),
    "step_swing_transfer": Mechanisms(True, True, True, False),
    "all_with_cross_over": Mechanisms(True, True, True, True),
}

# The lines of the Atlas paper's Fig. 6, for the Atlas paper's controller.
ATLAS_MECHANISMS = {
    "feedback": Mechanisms(False, False, False, False),
    "feedback_step": Mechanisms(True, False, False, False),
    "feedback_timing": Mechanisms(False, True, False, False),
    "feedback_step_timing": Mechanisms(True, True, False, False),
}
NAMED = MECHANISMS | ATLAS_MECHANISMS
