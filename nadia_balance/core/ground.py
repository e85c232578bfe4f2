"""Ground of convex planar regions, and where on them a sole can be put."""

import itertools
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.polygon import (
    area,
    clip_all,
    contains,
    convex_hull,
    halfspaces,
    intersection,
    project,
)
from nadia_balance.core.walking import Array, FootPose, Immutable

_OVERLAP = 1e-6  # regions that share less than this meet at an edge [m^2]
_ROUNDING = 1e-6  # a sole so far out is on the edge [m]
_TURN = math.pi / 12.0  # between the yaws at which a sole is tried [rad]


@dataclass(kw_only=True)
class Region:
    """A convex piece of a plane; `vertices` are its corners from above.

    The plane is at `height` in the middle of the vertices, and across `normal`.
    No foot is ever put on an obstacle.
    """

    name: str = ""
    vertices: list[list[float]] = field(default_factory=list)  # [x, y] in W [m]
    height: float = 0.0  # [m]
    normal: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    obstacle: bool = False

    def validate_more(self) -> None:
        """Raises ValueError if this is no region; the message has its name."""
        corners, of = self.vertices, f"(region {self.name!r})"
        if any(len(corner) != 2 for corner in corners):
            raise ValueError(f"vertices = {corners} {of}: must be [x, y] each")
        if not corners or not 3 <= len(self.polygon) == len(corners):
            raise ValueError(
                f"vertices = {corners} {of}: must be convex, with 3 or more "
                "corners"
            )
        if len(self.normal) != 3 or not self.normal[2] > 0.0:
            raise ValueError(
                f"normal = {self.normal} {of}: must be [x, y, z] with z > 0, "
                "or the region is upside down"
            )

    @cached_property
    def polygon(self) -> Array:
        """The corners (n, 2) [m], counter-clockwise."""
        return convex_hull(np.array(self.vertices, dtype=float))

    @cached_property
    def unit_normal(self) -> Array:
        """(3,), of length 1."""
        return np.array(self.normal) / math.hypot(*self.normal)

    @property
    def slope(self) -> float:
        """Its rise by length, the tangent of its tilt [-]."""
        x, y, z = self.normal
        return math.hypot(x, y) / z

    @property
    def is_level(self) -> bool:
        """True if the normal is vertical."""
        return bool(self.unit_normal[2] == 1.0)

    def heights(self, points: Array) -> Array:
        """Returns the heights (n,) [m] of the plane at `points` (n, 2) [m]."""
        x, y, z = self.unit_normal.tolist()
        offsets = points - self.polygon.mean(axis=0)
        return np.asarray(self.height - offsets @ [x / z, y / z])

    def footholds(self, sole: Array, yaw: float, margin: float) -> Array:
        """Returns where the centre of a sole may be, (n, 2) [m] from above.

        That is, the region minus the sole (Minkowski difference), which has the
        tilt of the plane and is turned by `yaw` [rad], minus a `margin` [m];
        `sole` (k, 2) [m] in its own frame.  (0, 2) if it fits nowhere.
        """
        foot = FootPose(yaw=yaw, normal=self.unit_normal)
        corners = foot.outline(sole)
        A, b = halfspaces(self.polygon)
        farthest = (A @ corners.T).max(axis=1)
        return clip_all(self.polygon, A, b - farthest - margin)


@dataclass(frozen=True, eq=False)
class Ground(Immutable):
    """All regions, for soles (n, 2) [m] that keep a margin from their edges."""

    regions: tuple[Region, ...]
    sole: Array
    margin: float = 0.02  # [m]

    @cached_property
    def is_level(self) -> bool:
        """True if all that can be stepped on is level, at z = 0."""
        return all(
            region.height == 0.0 and region.is_level
            for region in self.regions
            if not region.obstacle
        )

    @cached_property
    def _known(self) -> dict[float, tuple[Array, ...]]:
        return {}

    def footholds(self, yaw: float) -> tuple[Array, ...]:
        """Returns for each region where a sole of this `yaw` [rad] may be.

        Polygons (n, 2) [m] in W; (0, 2) where it fits nowhere.
        """
        if yaw not in self._known:
            self._known[yaw] = tuple(
                np.empty((0, 2))
                if region.obstacle
                else region.footholds(self.sole, yaw, self.margin)
                for region in self.regions
            )
        return self._known[yaw]

    def allows(self, foot: FootPose) -> bool:
        """True if the sole is on one region, and keeps the margin."""
        return any(
            contains(foot.p_WF[:2], part, _ROUNDING)
            for part in self.footholds(foot.yaw)
            if len(part)
        )

    def nearest(
        self, point: Array, yaw: float, within: Array | None = None
    ) -> Array | None:
        """Returns the foothold (2,) [m] closest to `point` (2,); None: none.

        Of those in the polygon `within` (n, 2) [m], if there is one.
        """
        parts = [part for part in self.footholds(yaw) if len(part)]
        if within is not None:
            parts = [intersection(part, within) for part in parts]
        points = [project(point, part) for part in parts if len(part)]
        return min(points, key=lambda p: math.dist(p, point), default=None)

    def region_under(self, foot: FootPose) -> Region | None:
        """Returns the region that the whole sole is on; None: on none."""
        corners = foot.outline(self.sole)
        for region in self.regions:
            if not region.obstacle and all(
                contains(p, region.polygon, _ROUNDING) for p in corners
            ):
                return region
        return None

    def pose(self, point: Array, yaw: float, height: float) -> FootPose:
        """Returns the sole at `point` (2,) [m], on the plane of its region.

        At `height` [m] and level if there is none.
        """
        foot = FootPose(np.append(point, height), yaw)
        if (region := self.region_under(foot)) is None:
            return foot
        p_WF = np.append(point, region.heights(point[None]))
        if region.is_level:
            return FootPose(p_WF, yaw)
        return FootPose(p_WF, yaw, region.unit_normal)


def check_ground(ground: Ground) -> None:
    """Checks the regions with each other, and that soles fit on them.

    Raises:
        ValueError: names the region, and says what it must be.
    """
    names = [region.name for region in ground.regions]
    for name in names:
        if not name or names.count(name) > 1:
            raise ValueError(f"regions.name = {name!r}: must be given, once")
    for region in ground.regions:
        yaws = np.arange(0.0, math.pi, _TURN).tolist()
        if not region.obstacle and not any(
            len(region.footholds(ground.sole, yaw, ground.margin))
            for yaw in yaws
        ):
            length, width = np.ptp(ground.sole, axis=0)
            raise ValueError(
                f"region {region.name!r}: must be larger than the sole, "
                f"{length:.2f} m x {width:.2f} m, by margin = "
                f"{ground.margin} m on each side"
            )
    for one, other in itertools.combinations(ground.regions, 2):
        shared = area(intersection(one.polygon, other.polygon))
        if shared > _OVERLAP:
            raise ValueError(
                f"regions {one.name!r} and {other.name!r}, at heights "
                f"{one.height:g} and {other.height:g} m: must not overlap, "
                f"but share {shared:.2g} m^2 seen from above"
            )


def check_friction(ground: Ground, friction: float) -> None:
    """Checks that a force up through a sole is within the cone of `friction`.

    Raises:
        ValueError: names the region that is too steep.
    """
    for region in ground.regions:
        if not region.obstacle and region.slope >= friction:
            tilt, most = (math.atan(s) for s in (region.slope, friction))
            raise ValueError(
                f"region {region.name!r}: must be tilted by less than "
                f"{math.degrees(most):.1f} deg, as friction is {friction:g}, "
                f"but is by {math.degrees(tilt):.1f} deg"
            )


@dataclass(kw_only=True)
class GroundError:
    """How wrong the controller is about each region, at most, at random."""

    height: float = bounded(0.0, least=0.0, most=0.2, unit="m")
    tilt_deg: float = bounded(0.0, least=0.0, most=20.0, unit="deg")
    place: float = bounded(0.0, least=0.0, most=0.5, unit="m")


def believed(
    regions: tuple[Region, ...], error: GroundError, seed: int
) -> tuple[Region, ...]:
    """Returns the regions as the controller knows them; the same for a seed.

    It knows the one about the origin of W, where the robot stands at first.
    """
    if error == GroundError():
        return regions
    rng = np.random.default_rng(seed)
    found = []
    for region in regions:
        if contains(np.zeros(2), region.polygon):
            found.append(region)
            continue
        up, dx, dy, tilt_x, tilt_y = rng.uniform(-1.0, 1.0, 5).tolist()
        slope = math.tan(math.radians(error.tilt_deg))
        x, y, z = region.normal
        found.append(
            Region(
                name=region.name,
                vertices=[
                    [u + dx * error.place, v + dy * error.place]
                    for u, v in region.vertices
                ],
                height=region.height + up * error.height,
                normal=[x + tilt_x * slope * z, y + tilt_y * slope * z, z],
                obstacle=region.obstacle,
            )
        )
    return tuple(found)
