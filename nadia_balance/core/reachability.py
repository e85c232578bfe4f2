"""Where the swing foot can be put (Nadia paper, Sec. IV and V)."""

import math
from dataclasses import dataclass


@dataclass(kw_only=True)
class ReachabilityParams:
    """The base region: a quarter ellipse on each side of (0, width_nominal).

    In the sole frame of the stance foot, x forward, y toward the swing side
    (Nadia paper, Fig. 5 and Sec. VII).
    """

    length_forward: float = 1.0  # l_max [m]
    length_backward: float = 1.0  # l_min [m]
    width_min: float = 0.125  # w_min [m]
    width_max: float = 0.8  # w_max [m]
    width_nominal: float = 0.25  # w_nom [m]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value}: must be > 0 m")
        if not self.width_min < self.width_nominal < self.width_max:
            raise ValueError(
                f"width_nominal = {self.width_nominal}: must be between "
                f"width_min = {self.width_min} and "
                f"width_max = {self.width_max} m"
            )

    def in_base_region(self, x: float, y: float) -> bool:
        """True if the foot can be put at x forward, y to the swing side [m]."""
        length = self.length_forward if x > 0.0 else self.length_backward
        out = y - self.width_nominal
        width = (
            self.width_max - self.width_nominal
            if out > 0.0
            else self.width_nominal - self.width_min
        )
        return (x / length) ** 2 + (out / width) ** 2 <= 1.0 + 1e-9

    def describe(self) -> str:
        """The region in words, for error messages."""
        return (
            f"[{-self.length_backward}, {self.length_forward}] m forward, "
            f"[{self.width_min}, {self.width_max}] m out (ellipse)"
        )
