"""Ground of convex planar regions, and the footsteps on them."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from nadia_balance.core.body.reachability import (
    ReachabilityParams,
    base_region,
    in_world,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    area,
    clip_all,
    contains,
    convex_hull,
    halfspaces,
    intersection,
    project,
)
from nadia_balance.core.walking.state import (
    UPRIGHT,
    FootPose,
    FootPoses,
    Footstep,
    Immutable,
    Side,
)
from nadia_balance.parameters.bounds import (
    bounded,
    check,
    check_number,
    parameters,
    require,
)

_OVERLAP = 1e-6  # shared area up to which regions only touch [m^2]
_ROUNDING = 1e-6  # tolerance of a sole on an edge [m]
_TURN = math.pi / 12.0  # spacing of the yaws at which a sole is tried [rad]
_KEPT = 32  # yaws whose footholds are kept


# No @parameters: slots would refuse what is computed once.
@dataclass(kw_only=True)
class Region:
    """A convex part of a plane, whose obstacles have no footholds."""

    name: str = bounded("", doc="a name of its own")
    vertices: list[list[float]] = bounded(
        list, doc="corners [x, y] in W from above, in m"
    )
    height: float = bounded(0.0, doc="at the mean of the vertices, in m")
    normal: list[float] = bounded(
        lambda: [0.0, 0.0, 1.0], doc="upward normal [x, y, z] in W"
    )
    obstacle: bool = bounded(False, doc="true without footholds")

    def validate_more(self) -> None:
        """Checks corners and normal.

        Raises:
            ValueError: the region is not valid; the message has its name.
        """
        name = f"(region {self.name!r})"
        require(
            all(len(corner) == 2 for corner in self.vertices),
            f"vertices = {self.vertices} {name}: must be [x, y] each",
        )
        require(
            bool(self.vertices)
            and 3 <= len(self.polygon) == len(self.vertices),
            f"vertices = {self.vertices} {name}: must be convex, with 3 "
            "or more corners",
        )
        require(
            len(self.normal) == 3 and self.normal[2] > 0.0,
            f"normal = {self.normal} {name}: must be [x, y, z] with z > 0, "
            "or the region is upside down",
        )

    @cached_property
    def polygon(self) -> Array:
        """The corners (n, 2) [m], counter-clockwise."""
        return convex_hull(np.array(self.vertices, dtype=float))

    @cached_property
    def unit_normal(self) -> Array:
        """The unit normal (3,)."""
        return np.array(self.normal) / math.hypot(*self.normal)

    @property
    def is_level(self) -> bool:
        """True if the normal is vertical."""
        return bool(self.unit_normal[2] == 1.0)

    def heights(self, points: Array) -> Array:
        """Heights of the plane: height - ((p - mean) . n_xy) / n_z.

        Args:
            points: points p (n, 2) in W [m].

        Returns:
            Heights (n,) in W [m].
        """
        x, y, z = self.unit_normal.tolist()
        return np.asarray(
            self.height - (points - self.polygon.mean(axis=0)) @ [x / z, y / z]
        )

    def between(self, polygon: Array, lowest: float, highest: float) -> Array:
        """The part of a polygon where the plane is between two heights.

        Args:
            polygon: vertices (n, 2) in W [m].
            lowest: height in W [m].
            highest: height in W [m].

        Returns:
            Vertices (k, 2) in W [m]; (0, 2) if no area is left.
        """
        x, y, z = self.unit_normal.tolist()
        slope = np.array([-x / z, -y / z])
        at_origin = float(self.heights(np.zeros((1, 2)))[0])
        return clip_all(
            polygon,
            A=np.array([slope, -slope]),
            b=np.array([highest - at_origin, at_origin - lowest]),
        )

    def footholds(self, sole: Array, yaw: float, margin: float) -> Array:
        """The sole centres with the whole sole on the region.

        It is the Minkowski difference of the region and the sole, which has the
        tilt of the plane, shrunk by the margin.

        Args:
            sole: corners (k, 2) in its own frame [m].
            yaw: of the sole in W [rad].
            margin: least distance of the sole to the edges [m].

        Returns:
            Vertices (n, 2) in W [m], seen from above; (0, 2) if it does not
            fit.
        """
        corners = FootPose(yaw=yaw, normal=self.unit_normal).outline(sole)
        A, b = halfspaces(self.polygon)
        return clip_all(
            self.polygon, A, b - (A @ corners.T).max(axis=1) - margin
        )


@dataclass(frozen=True, eq=False)
class Ground(Immutable):
    """All regions, with the sole (n, 2) [m] and its margin to their edges."""

    regions: tuple[Region, ...]
    sole: Array
    margin: float = 0.02  # [m]

    def __post_init__(self) -> None:
        require(len(self.regions) > 0, "regions = (): must be at least one")
        check_number("margin", self.margin, least=0.0, unit="m")
        for region in self.regions:
            check(region)

    @cached_property
    def is_level(self) -> bool:
        """True if all regions but obstacles are level, at z = 0."""
        return all(
            region.obstacle or (region.height == 0.0 and region.is_level)
            for region in self.regions
        )

    def footholds(self, yaw: float) -> tuple[Array, ...]:
        """The footholds of all regions.

        Args:
            yaw: of the sole in W [rad].

        Returns:
            A polygon (n, 2) in W [m] for each region; (0, 2) where the sole
            does not fit.
        """
        return self._footholds(yaw)

    @cached_property
    def _footholds(self) -> Callable[[float], tuple[Array, ...]]:
        """The `footholds` by yaw: a foot that stands has another each tick."""

        def calc(yaw: float) -> tuple[Array, ...]:
            return tuple(
                np.empty((0, 2))
                if region.obstacle
                else region.footholds(self.sole, yaw, self.margin)
                for region in self.regions
            )

        return lru_cache(_KEPT)(calc)

    def allows(self, foot: FootPose) -> bool:
        """Whether a sole is on a single region, with the margin.

        Args:
            foot: pose of the sole in W.

        Returns:
            True if its centre is a foothold.
        """
        return any(
            len(part) > 0 and contains(foot.p_WF[:2], part, _ROUNDING)
            for part in self.footholds(foot.yaw)
        )

    def nearest(self, point: Array, yaw: float) -> Array | None:
        """Minimises |p - point| subject to p being a foothold.

        Args:
            point: point (2,) in W [m].
            yaw: of the sole in W [rad].

        Returns:
            The foothold p (2,) in W [m]; None if there is none.
        """
        return _closest(point, self.footholds(yaw))

    def footholds_at(self, foot: FootPose) -> Array:
        """The footholds of the region that a foot is on, or is nearest to.

        Args:
            foot: pose of the sole in W.

        Returns:
            A polygon (n, 2) in W [m]; (0, 2) if the sole fits on no region.
        """
        p = foot.p_WF[:2]
        return min(
            [part for part in self.footholds(foot.yaw) if len(part)],
            key=lambda part: math.dist(project(p, part), p),
            default=np.empty((0, 2)),
        )

    def footholds_within(
        self, polygon: Array, yaw: float, lowest: float, highest: float
    ) -> Iterator[tuple[int, Array]]:
        """The footholds within a polygon and between two heights.

        Args:
            polygon: vertices (n, 2) in W [m].
            yaw: of the sole in W [rad].
            lowest: height in W [m].
            highest: height in W [m].

        Yields:
            The index of a region, and its part (k, 2) in W [m] that is not
            empty.
        """
        for index, hold in enumerate(self.footholds(yaw)):
            part = intersection(polygon, hold) if len(hold) else hold
            part = self.regions[index].between(part, lowest, highest)
            if len(part):
                yield index, part

    def region_under(self, foot: FootPose) -> Region | None:
        """The region that a sole stands on.

        Args:
            foot: pose of the sole in W; it is tilted as the region is.

        Returns:
            The region that contains the whole sole, or None.
        """
        for region in self.regions:
            if region.obstacle or not contains(
                foot.p_WF[:2], region.polygon, _ROUNDING
            ):
                continue
            outline = replace(foot, normal=region.unit_normal).outline(
                self.sole
            )
            if all(contains(p, region.polygon, _ROUNDING) for p in outline):
                return region
        return None

    def pose(self, point: Array, yaw: float, height: float) -> FootPose:
        """The sole on the plane of its region.

        Args:
            point: centre of the sole (2,) in W [m].
            yaw: of the sole in W [rad].
            height: of a level sole in W [m], where there is no region.

        Returns:
            Pose of the sole in W.
        """
        foot = FootPose(np.append(point, height), yaw)
        region = self.region_under(foot)
        if region is None:
            return foot
        return FootPose(
            p_WF=np.append(point, region.heights(point[None])),
            yaw=yaw,
            normal=UPRIGHT if region.is_level else region.unit_normal,
        )


def standing_on(ground: Ground, feet: FootPoses) -> FootPoses:
    """Feet with the heights and normals of their regions.

    Args:
        ground: the regions.
        feet: poses in W.

    Returns:
        Poses in W.

    Raises:
        ValueError: a foot is not on a single region.
    """
    for side in Side:
        feet = feet.with_foot(
            side,
            _on_region(ground, feet[side], f"{side.value} foot at the start"),
        )
    return feet


def steps_on(
    ground: Ground,
    steps: Iterable[Footstep],
    feet: FootPoses,
    reach: ReachabilityParams | None,
) -> tuple[Footstep, ...]:
    """Steps with the heights and normals of their regions.

    Args:
        ground: the regions.
        steps: steps on level ground.
        feet: where the feet stand, in W.
        reach: if it is given, each step is moved to the nearest foothold within
            reach of its stance foot.

    Returns:
        The steps.

    Raises:
        ValueError: a step is not on a single region, or there is no foothold
            within reach, or the ground has a hole wider than the reach.
    """
    placed = []
    for number, step in enumerate(steps, start=1):
        name = f"step {number} ({step.side.value})"
        if reach is None:
            pose = _on_region(ground, step.pose, name)
        else:
            pose = _within_reach(
                ground,
                step,
                region=in_world(
                    base_region(reach), feet[step.side.other], step.side
                ),
                longest=reach.length_forward,
                name=name,
            )
        feet = feet.with_foot(step.side, pose)
        placed.append(replace(step, pose=pose))
    return tuple(placed)


def _within_reach(
    ground: Ground, step: Footstep, region: Array, longest: float, name: str
) -> FootPose:
    """Returns the nearest foothold in the region (n, 2); raises ValueError."""
    placed = moved_to(ground, step, [region])
    goal = ground.nearest(step.pose.p_WF[:2], step.pose.yaw)
    if placed is None or goal is None:
        raise ValueError(
            f"{name}: must fit on a region within reach of the other foot; "
            f"{_beside(ground, step.pose)}"
        )
    x, y, _ = placed.pose.p_WF.tolist()
    width = math.dist(goal, (x, y))
    require(
        width <= longest,
        f"{name}: from x = {x:.3f}, y = {y:.3f} m a hole of "
        f"{width:.3f} m, between footholds, must be within the "
        f"reach of {longest:.3f} m",
    )
    return placed.pose


def moved_to(
    ground: Ground,
    step: Footstep,
    within: Iterable[Array],
    height: float = 0.0,
    rise: float = math.inf,
) -> Footstep | None:
    """Minimises the distance to a step's foothold subject to what is allowed.

    Args:
        ground: the regions.
        step: whose foothold is moved.
        within: polygons (n, 2) in W [m]; the first that contains a foothold
            counts.
        height: of the other foot in W [m].
        rise: largest difference of the foothold's height to `height` [m].

    Returns:
        The moved step; None if no polygon contains a foothold.
    """
    p, yaw = step.pose.p_WF, step.pose.yaw
    for polygon in within:
        parts = ground.footholds_within(
            polygon, yaw, lowest=height - rise, highest=height + rise
        )
        point = _closest(p[:2], (part for _, part in parts))
        if point is not None:
            return replace(step, pose=ground.pose(point, yaw, float(p[2])))
    return None


def _closest(point: Array, parts: Iterable[Array]) -> Array | None:
    """Returns the point (2,) of polygons closest to `point`; None if empty."""
    return min(
        [project(point, part) for part in parts if len(part)],
        key=lambda p: math.dist(p, point),
        default=None,
    )


def _on_region(ground: Ground, foot: FootPose, name: str) -> FootPose:
    """Returns the foot on its region; raises ValueError with the `name`."""
    if ground.region_under(foot) is None:
        raise ValueError(f"{name}: {_beside(ground, foot)}")
    return ground.pose(foot.p_WF[:2], foot.yaw, 0.0)


def _beside(ground: Ground, foot: FootPose) -> str:
    """Returns the foot's position and the nearest foothold, as a message."""
    x, y, _ = foot.p_WF.tolist()
    point = ground.nearest(foot.p_WF[:2], foot.yaw)
    message = f"the sole at x = {x:.3f}, y = {y:.3f} m must be on one region"
    if point is None:
        return f"{message}, and fits on none"
    region = ground.region_under(ground.pose(point, foot.yaw, 0.0))
    name = "" if region is None else f", on {region.name!r}"
    return (
        f"{message}; the nearest foothold is x = {point[0]:.3f}, "
        f"y = {point[1]:.3f} m{name}, {math.dist(point, (x, y)):.3f} m away"
    )


def check_ground(ground: Ground) -> None:
    """Checks regions against each other, and against the sole.

    Args:
        ground: the regions.

    Raises:
        ValueError: regions overlap, or have no name of their own, or the sole
            does not fit on one.
    """
    names = [region.name for region in ground.regions]
    for name in names:
        require(
            name != "" and names.count(name) == 1,
            f"regions.name = {name!r}: must be given, once",
        )
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
        shared = area(intersection(one.polygon, other.polygon))
        require(
            shared <= _OVERLAP,
            f"regions {one.name!r} and {other.name!r}, at heights "
            f"{one.height:g} and {other.height:g} m: must not overlap, "
            f"but share {shared:.2g} m^2 seen from above",
        )


def check_friction(ground: Ground, friction: float) -> None:
    """Checks the slopes of regions.

    Args:
        ground: the regions.
        friction: coefficient of friction [-].

    Raises:
        ValueError: a region is too steep.
    """
    for region in ground.regions:
        x, y, z = region.normal
        slope = math.hypot(x, y) / z
        require(
            region.obstacle or slope < friction,
            f"region {region.name!r}: must be tilted by less than "
            f"{math.degrees(math.atan(friction)):.1f} deg, as friction is "
            f"{friction:g}, but is by "
            f"{math.degrees(math.atan(slope)):.1f} deg",
        )


@parameters
class GroundError:
    """Bounds of the random errors in the controller's knowledge of regions."""

    height: float = bounded(
        0.0, least=0.0, most=0.2, unit="m", doc="error of the height"
    )
    tilt_deg: float = bounded(
        0.0, least=0.0, most=20.0, unit="deg", doc="error of the tilt"
    )
    place: float = bounded(
        0.0, least=0.0, most=0.5, unit="m", doc="error along x, and along y"
    )


def believed(
    regions: tuple[Region, ...], error: GroundError, seed: int, start: Array
) -> tuple[Region, ...]:
    """The regions with random errors.

    Args:
        regions: the true ones.
        error: bounds of the errors.
        seed: of the random numbers.
        start: the robot's place (2,) in W [m]; the region there has no error.

    Returns:
        The regions that the controller is given.
    """
    if error == GroundError():
        return regions
    rng = np.random.default_rng(seed)
    return tuple(
        region
        if contains(start, region.polygon)
        else _with_error(region, error, rng.uniform(-1.0, 1.0, 5))
        for region in regions
    )


def _with_error(region: Region, error: GroundError, shares: Array) -> Region:
    """Returns the region with these shares (5,) of the largest errors.

    The normal n is turned by an angle a about a horizontal axis k, in any
    direction: n cos(a) + k x n sin(a) + k (k . n) (1 - cos(a)).
    """
    up, dx, dy, tilt, direction = shares.tolist()
    angle = tilt * math.radians(error.tilt_deg)
    axis = np.array(
        [math.cos(math.pi * direction), math.sin(math.pi * direction), 0.0]
    )
    normal = region.unit_normal
    turned = (
        math.cos(angle) * normal
        + math.sin(angle) * np.cross(axis, normal)
        + (1.0 - math.cos(angle)) * axis.dot(normal) * axis
    )
    du, dv = dx * error.place, dy * error.place
    return replace(
        region,
        vertices=[[u + du, v + dv] for u, v in region.vertices],
        normal=turned.tolist(),
        height=region.height + up * error.height,
    )
