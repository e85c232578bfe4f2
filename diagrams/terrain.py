"""The ground, and the controller's model of it."""

from dataclasses import replace
from pathlib import Path

from nadia_balance.core.body.ground import (
    Ground,
    GroundError,
    Region,
    believed,
    check_friction,
    check_ground,
    standing_on,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import ContactSchedule, FootPoses, Side
from nadia_balance.parameters.bounds import bounded, check, parameters, require
from nadia_balance.parameters.scaling import NADIA, Size
from nadia_balance.parameters.yaml_reader import load_typed

FLAT = "flat"
# The courses of the package, by name: files of regions.
COURSES = {
    path.stem: path
    for path in sorted((Path(__file__).parent / "courses").glob("*.yaml"))
}


@parameters
class Terrain:
    """Ground of convex regions, for the plant and for the controller."""

    name: str = bounded(
        FLAT,
        doc='"flat": level ground everywhere; a course; or a YAML file with '
        "`regions`",
    )
    rise: float | None = bounded(
        None,
        above=0.0,
        most=0.5,
        unit="m",
        doc="height of a step of courses that have one; null: as in the file",
    )
    seed: int = bounded(0, least=0, doc="of the error")
    margin: float = bounded(
        0.02,
        least=0.0,
        most=0.2,
        unit="m",
        doc="from a sole to the edge of its region, for the controller",
    )
    error: GroundError = bounded(
        GroundError, doc="of the controller's model of the regions"
    )
    seen: bool = bounded(
        True, doc="false: the controller's model is flat ground"
    )

    def validate_more(self) -> None:
        """Checks that the error has an effect.

        Raises:
            ValueError: it has none, as the ground is not seen.
        """
        require(
            self.seen or self.error == GroundError(),
            f"terrain.error = {self.error}: must not be given with "
            "seen = False",
        )

    def ground(self, sole: Array, size: Size = NADIA) -> Ground | None:
        """Returns the true ground; None: flat.

        Args:
            sole: corners (n, 2) [m] of either sole.
            size: the robot's lengths [m], to which courses are scaled.

        Returns:
            The regions, scaled to the robot.

        Raises:
            ValueError: the course or file does not exist, or has no rise, or
                regions are not convex, upside down, too small, or overlap.
        """
        if self.name == FLAT:
            require(
                self.rise is None,
                f"terrain.rise = {self.rise}: must be null on flat ground",
            )
            return None
        ground = Ground(self._regions(size), sole, self.margin)
        check_ground(ground)
        return ground

    def known(self, truth: Ground | None, start: Array) -> Ground | None:
        """Returns the controller's model of the ground, with its error.

        Args:
            truth: the true ground.
            start: the robot's place (2,) [m] in W, whose region has no error.

        Returns:
            The ground as the controller takes it to be; None: flat.
        """
        if truth is None or not self.seen:
            return None
        return (
            truth
            if self.error == GroundError()
            else Ground(
                believed(truth.regions, self.error, self.seed, start),
                truth.sole,
                truth.margin,
            )
        )

    def _regions(self, size: Size) -> tuple[Region, ...]:
        path = COURSES.get(self.name, Path(self.name))
        require(
            path.is_file(),
            f"terrain.name = {self.name!r}: must be a YAML file, or one of "
            f"{', '.join((FLAT, *COURSES))}",
        )
        file = load_typed(RegionFile, f"terrain {self.name}", filename=path)
        check(file)
        require(bool(file.regions), f"terrain {self.name}: must have regions")
        along = leg = 1.0
        if file.along:
            along = getattr(size, file.along) / getattr(NADIA, file.along)
            leg = size.leg / NADIA.leg
        up = leg
        if self.rise is not None:
            if file.rise is None:
                raise ValueError(
                    f"terrain.rise = {self.rise}: must be null, as {self.name} "
                    "has no rise of its own"
                )
            up = self.rise / file.rise
        return tuple(
            replace(
                region,
                vertices=[[along * x, leg * y] for x, y in region.vertices],
                height=up * region.height,
            )
            for region in file.regions
        )


def check_start(
    ground: Ground | None, feet: FootPoses, friction: float
) -> None:
    """Checks that a robot can start on the true ground.

    Args:
        ground: the true ground; None: flat.
        feet: the soles at the start.
        friction: coefficient [-] that the controller counts on.

    Raises:
        ValueError: the ground under a foot is not one level region at z = 0,
            or a region is too steep for the friction.
    """
    if ground is None or ground.is_level:
        return
    check_friction(ground, friction)
    for side in Side:
        for foot in standing_on(ground, feet)[side], feet[side]:
            require(
                foot.p_WF[2] == 0.0 and foot.normal[2] == 1.0,
                f"{side.value} foot at the start: its region must be "
                "level, at height 0, and known to be so",
            )


def foot_beside(ground: Ground | None, schedule: ContactSchedule) -> str:
    """Returns the name of a stance foot that is not on one region.

    Args:
        ground: the true ground; None: flat.
        schedule: which feet stand, and where.

    Returns:
        Such as "left foot beside its region"; "" if each is on one.
    """
    return next(
        (
            f"{side.value} foot beside its region"
            for side in filter(schedule.in_contact, Side)
            if ground and ground.region_under(schedule.feet[side]) is None
        ),
        "",
    )


@parameters
class RegionFile:
    """The contents of a YAML file of regions."""

    along: str = bounded(
        "",
        one_of=("", "leg", "tread"),
        doc="for a robot of Nadia's size: x scales with this length of a "
        "robot, y and heights with its leg; empty: as it is, for all",
    )
    rise: float | None = bounded(
        None,
        above=0.0,
        unit="m",
        doc="height of its steps, which `terrain.rise` replaces",
    )
    regions: list[Region] = bounded(list, doc="of the ground")
