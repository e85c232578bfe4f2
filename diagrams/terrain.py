"""The ground, and the controller's model of it."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from nadia_balance.core.body import ground as core
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking import state as walking
from nadia_balance.parameters.bounds import bounded, check
from nadia_balance.parameters.scaling import NADIA, Size
from nadia_balance.parameters.yaml_reader import load_typed

Ground = core.Ground | None  # None: flat
FLAT = "flat"
# The courses of the package, by name: files of regions.
_FILES = sorted((Path(__file__).parent / "courses").glob("*.yaml"))
COURSES = {path.stem: path for path in _FILES}


@dataclass(kw_only=True)
class Terrain:
    """Ground of convex regions, for the plant and for the controller."""

    # "flat": level ground everywhere; a course; or a YAML file with `regions`.
    name: str = FLAT
    # Height of a step of courses that have one; None: as in the file.
    rise: float | None = bounded(None, above=0.0, most=0.5, unit="m")
    seed: int = bounded(0, least=0)  # of the error
    # Distance from a sole to the edge of its region, for the controller.
    margin: float = bounded(0.02, least=0.0, most=0.2, unit="m")
    error: core.GroundError = field(default_factory=core.GroundError)
    # False: the controller's model is flat ground.
    seen: bool = True

    def validate_more(self) -> None:
        """Raises ValueError if the error would have no effect."""
        if not self.seen and self.error != core.GroundError():
            why = "must not be given with seen = False"
            raise ValueError(f"terrain.error = {self.error}: {why}")

    def ground(self, sole: Array, size: Size = NADIA) -> Ground:
        """The true ground for soles (n, 2) [m] of a robot of that `size`.

        Raises ValueError: the course or file does not exist, or has no rise, or
        regions are not convex, upside down, too small, or overlap.
        """
        if self.name == FLAT:
            return None
        ground = core.Ground(self._regions(size), sole, self.margin)
        for region in ground.regions:
            check(region)
        core.check_ground(ground)
        return ground

    def known(self, truth: Ground, start: Array) -> Ground:
        """The controller's model of the ground, with its error.

        The region at the robot's `start` (2,) [m] has none.
        """
        if truth is None or not self.seen:
            return None
        if self.error == core.GroundError():
            return truth
        regions = core.believed(truth.regions, self.error, self.seed, start)
        return core.Ground(regions, truth.sole, truth.margin)

    def _regions(self, size: Size) -> tuple[core.Region, ...]:
        path = COURSES.get(self.name, Path(self.name))
        if not path.is_file():
            which = f"a YAML file, or one of {', '.join((FLAT, *COURSES))}"
            raise ValueError(f"terrain.name = {self.name!r}: must be {which}")
        file = load_typed(RegionFile, f"terrain {self.name}", filename=path)
        check(file)
        along = leg = 1.0
        if file.along:
            along = getattr(size, file.along) / getattr(NADIA, file.along)
            leg = size.leg / NADIA.leg
        up = leg
        if self.rise is not None:
            if file.rise is None:
                why = f"must be null, as {self.name} has no rise of its own"
                raise ValueError(f"terrain.rise = {self.rise}: {why}")
            up = self.rise / file.rise
        return tuple(
            replace(
                region,
                vertices=[[along * x, leg * y] for x, y in region.vertices],
                height=up * region.height,
            )
            for region in file.regions
        )


def check_start(ground: Ground, feet: walking.FootPoses, friction: float):
    """Checks that a robot can start on the true `ground` with these `feet`.

    Raises ValueError: the ground under a foot is not one level region at z = 0,
    or a region is too steep for the `friction` coefficient [-].
    """
    if ground is None or ground.is_level:
        return
    core.check_friction(ground, friction)
    for side in walking.Side:
        for foot in core.standing_on(ground, feet)[side], feet[side]:
            if foot.p_WF[2] != 0.0 or foot.normal[2] != 1.0:
                why = "region must be level, at height 0, and known to be so"
                raise ValueError(f"{side.value} foot at the start: its {why}")


def foot_beside(ground: Ground, schedule: walking.ContactSchedule) -> str:
    """Names a stance foot that is not on one region; empty if none is."""
    if ground is not None:
        for side in filter(schedule.in_contact, walking.Side):
            if ground.region_under(schedule.feet[side]) is None:
                return f"{side.value} foot beside its region"
    return ""


@dataclass(kw_only=True)
class RegionFile:
    """The contents of a YAML file of regions."""

    # For a robot of Nadia's size: x scales with this length of a robot, y and
    # heights with its leg (core/math/bounds.py).  Empty: as it is, for all.
    along: str = bounded("", one_of=("", "leg", "tread"))
    # Height of its steps, which `terrain.rise` replaces.
    rise: float | None = bounded(None, above=0.0, unit="m")
    regions: list[core.Region] = field(default_factory=list)
