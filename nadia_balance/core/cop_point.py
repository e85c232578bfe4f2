"""Where in a sole the CoP reference goes, given the length of the step."""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.polygon import centroid, project, shrink
from nadia_balance.core.walking import Array, FootPose, Side


@dataclass(kw_only=True)
class CopPointParams:
    """One CoP point, from the sole's centroid: x forward, y to the left.

    x = clamp(offset_x + step_length_factor * step length, min_x, max_x), and
    y is offset_inside towards the other foot.
    """

    offset_x: float = 0.0  # [m]
    offset_inside: float = 0.0  # [m]
    step_length_factor: float = 0.0  # [-]
    min_x: float = 0.0  # [m]
    max_x: float = 0.0  # [m]

    def validate(self) -> None:
        """Raises ValueError if a field is not finite or the range is empty."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise ValueError(f"{name} = {value}: must be finite")
        if self.min_x > self.max_x:
            raise ValueError(
                f"min_x = {self.min_x}: must be <= max_x = {self.max_x}"
            )


@dataclass(frozen=True, eq=False)
class Sole:
    """A sole and the part of it that the CoP reference may use.

    `corners` (k, 2) and `inner` (m, 2) [m] counter-clockwise, `centroid` (2,),
    all in the sole frame.
    """

    corners: Array
    inner: Array
    centroid: Array

    @classmethod
    def with_margin(cls, corners: Array, margin: float) -> "Sole":
        """Keeps the CoP `margin` [m] away from the edge of the sole.

        Raises:
            ValueError: the margin leaves nothing of the sole.
        """
        try:
            inner = shrink(corners, margin)
        except ValueError:
            raise ValueError(
                f"cop.margin = {margin}: must leave some of the sole"
            ) from None
        return cls(corners, inner, centroid(corners))

    def step_length(self, foot: FootPose, other: FootPose) -> float:
        """Returns how far [m] `other` is in front of `foot`, toe to toe."""
        c, s = math.cos(foot.yaw), math.sin(foot.yaw)
        x, y, _ = other.p_WF - foot.p_WF
        turn = other.yaw - foot.yaw
        toes = self.corners @ np.array([math.cos(turn), -math.sin(turn)])
        return float(c * x + s * y + toes.max() - self.corners[:, 0].max())

    def cop_point(
        self, params: CopPointParams, side: Side, step_length: float
    ) -> Array:
        """Returns the CoP point (2,) [m] in the sole frame of `side`."""
        x = params.offset_x + params.step_length_factor * step_length
        x = min(max(x, params.min_x), params.max_x)
        offset = np.array([x, -side.sign * params.offset_inside])
        return project(self.centroid + offset, self.inner)
