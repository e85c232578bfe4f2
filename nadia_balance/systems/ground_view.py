"""The regions of the ground, drawn into Meshcat."""

import numpy as np
from pydrake.geometry import Meshcat

from nadia_balance import palette
from nadia_balance.core.ground import Ground, Region
from nadia_balance.core.walking import FootPose
from nadia_balance.systems.overlay import Drawing

_ABOVE = 0.0005  # height above the floor, below all other drawings [m]


class _Surface(Drawing):
    """One region, filled."""

    def __init__(
        self, meshcat: Meshcat, path: str, region: Region, alpha: float
    ):
        corners = region.polygon
        heights = region.heights(corners) + _ABOVE
        fan = [[0, i, i + 1] for i in range(1, len(corners) - 1)]
        meshcat.SetTriangleMesh(
            path,
            np.column_stack([corners, heights]).T,
            np.array(fan, dtype=np.int32).T,
            palette.rgba(palette.GROUND, alpha),
        )
        super().__init__(meshcat, path)

    def show(self, visible: bool, time: float | None) -> None:
        self._show(visible, time)


class GroundView:
    """Draws all regions; the region of the next step is darker."""

    def __init__(self, meshcat: Meshcat, path: str, ground: Ground):
        """Adds the regions below `path`, without obstacles."""
        self._ground = ground
        self._in_use = {}
        for i, region in enumerate(ground.regions):
            if not region.obstacle:
                _Surface(meshcat, f"{path}/{i}", region, 0.5).show(True, None)
                self._in_use[region.name] = _Surface(
                    meshcat, f"{path}/in_use_{i}", region, 0.6
                )

    def draw(self, foothold: FootPose, time: float) -> None:
        """Highlights the region of the next `foothold` from `time` [s] on."""
        region = self._ground.region_under(foothold)
        for name, surface in self._in_use.items():
            surface.show(region is not None and name == region.name, time)
