"""Ground of convex planar regions, and the footsteps on them."""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from nadia_balance.core.body import reachability
from nadia_balance.core.math import polygon as convex
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking import state as walking
from nadia_balance.parameters.bounds import bounded

_OVERLAP = 1e-6  # shared area up to which regions only touch [m^2]
_ROUNDING = 1e-6  # tolerance of a sole on an edge [m]
_TURN = math.pi / 12.0  # spacing of the yaws at which a sole is tried [rad]


@dataclass(kw_only=True)
class Region:
    """A convex part of a plane; `vertices` are its corners from above.

    `height` is that at the mean of the vertices.  Obstacles have no footholds.
    """

    name: str = ""
    vertices: list[list[float]] = field(default_factory=list)  # [x, y] in W [m]
    height: float = 0.0  # [m]
    normal: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    obstacle: bool = False

    def validate_more(self) -> None:
        """Raises ValueError, with the name, if the region is not valid."""
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
        return convex.convex_hull(np.array(self.vertices, dtype=float))

    @cached_property
    def unit_normal(self) -> Array:
        """The unit normal (3,)."""
        return np.array(self.normal) / math.hypot(*self.normal)

    @property
    def slope(self) -> float:
        """The slope: tangent of the tilt [-]."""
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

    def between(self, polygon: Array, lowest: float, highest: float) -> Array:
        """Returns the part of `polygon` (n, 2) [m] between two heights [m]."""
        x, y, z = self.unit_normal.tolist()
        slope = np.array([-x / z, -y / z])
        at_origin = float(self.heights(np.zeros((1, 2)))[0])
        limits = np.array([highest - at_origin, at_origin - lowest])
        return convex.clip_all(polygon, np.array([slope, -slope]), limits)

    def footholds(self, sole: Array, yaw: float, margin: float) -> Array:
        """Returns the polygon (n, 2) [m] of sole centres, seen from above.

        It is the Minkowski difference of the region and the sole, which has the
        tilt of the plane and the `yaw` [rad], shrunk by `margin` [m]; `sole`
        (k, 2) [m] in its own frame.  (0, 2) if the sole does not fit.
        """
        foot = walking.FootPose(yaw=yaw, normal=self.unit_normal)
        corners = foot.outline(sole)
        A, b = convex.halfspaces(self.polygon)
        farthest = (A @ corners.T).max(axis=1)
        return convex.clip_all(self.polygon, A, b - farthest - margin)


@dataclass(frozen=True, eq=False)
class Ground(walking.Immutable):
    """All regions, with the sole (n, 2) [m] and its margin to their edges."""

    regions: tuple[Region, ...]
    sole: Array
    margin: float = 0.02  # [m]

    @cached_property
    def is_level(self) -> bool:
        """True if all regions but obstacles are level, at z = 0."""
        held = (region for region in self.regions if not region.obstacle)
        return all(r.height == 0.0 and r.is_level for r in held)

    @cached_property
    def _known(self) -> dict[float, tuple[Array, ...]]:
        return {}

    def footholds(self, yaw: float) -> tuple[Array, ...]:
        """Returns the foothold polygon of each region for this `yaw` [rad].

        Polygons (n, 2) [m] in W; (0, 2) where the sole does not fit.
        """
        if yaw not in self._known:
            self._known[yaw] = tuple(
                np.empty((0, 2))
                if region.obstacle
                else region.footholds(self.sole, yaw, self.margin)
                for region in self.regions
            )
        return self._known[yaw]

    def allows(self, foot: walking.FootPose) -> bool:
        """True if the sole is on a single region, with the margin."""
        parts = (part for part in self.footholds(foot.yaw) if len(part))
        return any(convex.contains(foot.p_WF[:2], p, _ROUNDING) for p in parts)

    def nearest(self, point: Array, yaw: float) -> Array | None:
        """Returns the foothold (2,) [m] closest to `point` (2,), or None."""
        return _closest(point, self.footholds(yaw))

    def footholds_within(
        self, polygon: Array, yaw: float, lowest: float, highest: float
    ) -> Iterator[tuple[int, Array]]:
        """Yields the footholds within `polygon` (n, 2) [m] in W, by region.

        Each is the index of a region, and the part (k, 2) [m] of its footholds
        for this `yaw` [rad] at heights from `lowest` to `highest` [m].
        """
        for index, hold in enumerate(self.footholds(yaw)):
            part = convex.intersection(polygon, hold) if len(hold) else hold
            part = self.regions[index].between(part, lowest, highest)
            if len(part):
                yield index, part

    def region_under(self, foot: walking.FootPose) -> Region | None:
        """Returns the region that contains the whole sole on it, or None."""
        for region in self.regions:
            within = region.polygon, _ROUNDING
            if region.obstacle or not convex.contains(foot.p_WF[:2], *within):
                continue
            lies = replace(foot, normal=region.unit_normal)
            if all(
                convex.contains(p, *within) for p in lies.outline(self.sole)
            ):
                return region
        return None

    def pose(self, point: Array, yaw: float, height: float) -> walking.FootPose:
        """Returns the sole at `point` (2,) [m], on the plane of its region.

        Without a region, the sole is level at `height` [m].
        """
        foot = walking.FootPose(np.append(point, height), yaw)
        if (region := self.region_under(foot)) is None:
            return foot
        p_WF = np.append(point, region.heights(point[None]))
        if region.is_level:
            return walking.FootPose(p_WF, yaw)
        return walking.FootPose(p_WF, yaw, region.unit_normal)


def standing_on(ground: Ground, feet: walking.FootPoses) -> walking.FootPoses:
    """Returns the feet with the heights and normals of their regions.

    Raises ValueError: a foot is not on a single region.
    """
    for side in walking.Side:
        what = f"{side.value} foot at the start"
        feet = feet.with_foot(side, _on_region(ground, feet[side], what))
    return feet


def steps_on(
    ground: Ground,
    steps: Iterable[walking.Footstep],
    feet: walking.FootPoses,
    reach: reachability.ReachabilityParams | None,
) -> tuple[walking.Footstep, ...]:
    """Returns the steps with the heights and normals of their regions.

    If a `reach` is given, each is moved to the nearest foothold within reach of
    its stance foot, the first at `feet`.

    Raises ValueError: a step is not on a single region, or there is no foothold
    within reach, or the ground has a hole wider than the reach.
    """
    found = []
    for number, step in enumerate(steps, start=1):
        what = f"step {number} ({step.side.value})"
        placed: walking.Footstep | None
        if reach is None:
            placed = replace(step, pose=_on_region(ground, step.pose, what))
        else:
            base = reachability.base_region(reach)
            stance = feet[step.side.other]
            within = reachability.in_world(base, stance, step.side)
            placed = moved_to(ground, step, [within])
        if placed is None:
            raise ValueError(
                f"{what}: must fit on a region within reach of the other foot; "
                f"{_beside(ground, step.pose)}"
            )
        if reach is not None:
            x, y, _ = placed.pose.p_WF.tolist()
            goal = ground.nearest(step.pose.p_WF[:2], step.pose.yaw)
            assert goal is not None
            if (wide := math.dist(goal, (x, y))) > reach.length_forward:
                raise ValueError(
                    f"{what}: from x = {x:.3f}, y = {y:.3f} m a hole of "
                    f"{wide:.3f} m, between footholds, must be within the "
                    f"reach of {reach.length_forward:.3f} m"
                )
        feet = feet.with_foot(step.side, placed.pose)
        found.append(placed)
    return tuple(found)


def moved_to(
    ground: Ground,
    step: walking.Footstep,
    within: Iterable[Array],
    height: float = 0.0,
    rise: float = math.inf,
) -> walking.Footstep | None:
    """Returns the step at the nearest foothold in the first feasible polygon.

    Polygons (n, 2) [m] in W, in order; None if none contains a foothold that is
    at most `rise` [m] above or below `height` [m].
    """
    p, yaw = step.pose.p_WF, step.pose.yaw
    for polygon in within:
        levels = yaw, height - rise, height + rise
        parts = ground.footholds_within(polygon, *levels)
        point = _closest(p[:2], (part for _, part in parts))
        if point is not None:
            return replace(step, pose=ground.pose(point, yaw, float(p[2])))
    return None


def _closest(point: Array, parts: Iterable[Array]) -> Array | None:
    """Returns the point (2,) of polygons closest to `point`; None if empty."""
    points = [convex.project(point, part) for part in parts if len(part)]
    return min(points, key=lambda p: math.dist(p, point), default=None)


def _on_region(
    ground: Ground, foot: walking.FootPose, what: str
) -> walking.FootPose:
    """Returns the foot on its region; raises ValueError about `what`."""
    if ground.region_under(foot) is None:
        raise ValueError(f"{what}: {_beside(ground, foot)}")
    return ground.pose(foot.p_WF[:2], foot.yaw, 0.0)


def _beside(ground: Ground, foot: walking.FootPose) -> str:
    """Returns the foot's position and the nearest foothold, as a message."""
    x, y, _ = foot.p_WF.tolist()
    point = ground.nearest(foot.p_WF[:2], foot.yaw)
    where = f"the sole at x = {x:.3f}, y = {y:.3f} m must be on one region"
    if point is None:
        return f"{where}, and fits on none"
    region = ground.region_under(ground.pose(point, foot.yaw, 0.0))
    name = "" if region is None else f", on {region.name!r}"
    away = math.dist(point, (x, y))
    return (
        f"{where}; the nearest foothold is x = {point[0]:.3f}, "
        f"y = {point[1]:.3f} m{name}, {away:.3f} m away"
    )


def check_ground(ground: Ground) -> None:
    """Raises ValueError if regions overlap, or soles do not fit on one."""
    names = [region.name for region in ground.regions]
    for name in names:
        if not name or names.count(name) > 1:
            raise ValueError(f"regions.name = {name!r}: must be given, once")
    for region in ground.regions:
        if not region.obstacle and not any(
            len(region.footholds(ground.sole, yaw, ground.margin))
            for yaw in np.arange(0.0, math.pi, _TURN).tolist()
        ):
            length, width = np.ptp(ground.sole, axis=0)
            raise ValueError(
                f"region {region.name!r}: must be larger than the sole, "
                f"{length:.2f} m x {width:.2f} m, by margin = "
                f"{ground.margin} m on each side"
            )
    for one, other in itertools.combinations(ground.regions, 2):
        shared = convex.area(convex.intersection(one.polygon, other.polygon))
        if shared > _OVERLAP:
            raise ValueError(
                f"regions {one.name!r} and {other.name!r}, at heights "
                f"{one.height:g} and {other.height:g} m: must not overlap, "
                f"but share {shared:.2g} m^2 seen from above"
            )


def check_friction(ground: Ground, friction: float) -> None:
    """Raises ValueError if a region is too steep for this `friction`."""
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
    """Bounds of the random errors in the controller's knowledge of regions."""

    height: float = bounded(0.0, least=0.0, most=0.2, unit="m")
    tilt_deg: float = bounded(0.0, least=0.0, most=20.0, unit="deg")
    place: float = bounded(0.0, least=0.0, most=0.5, unit="m")


def believed(
    regions: tuple[Region, ...], error: GroundError, seed: int, start: Array
) -> tuple[Region, ...]:
    """Returns the regions with random errors, determined by `seed`.

    The region at the robot's `start` (2,) [m] has no error.
    """
    if error == GroundError():
        return regions
    rng = np.random.default_rng(seed)
    found = []
    for region in regions:
        if convex.contains(start, region.polygon):
            found.append(region)
            continue
        up, dx, dy, tilt_x, tilt_y = rng.uniform(-1.0, 1.0, 5).tolist()
        slope = math.tan(math.radians(error.tilt_deg))
        x, y, z = region.normal
        du, dv = dx * error.place, dy * error.place
        wrong = replace(
            region,
            vertices=[[u + du, v + dv] for u, v in region.vertices],
            normal=[x + tilt_x * slope * z, y + tilt_y * slope * z, z],
            height=region.height + up * error.height,
        )
        found.append(wrong)
    return tuple(found)
