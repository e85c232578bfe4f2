"""What a sweep tries: the cells of the envelope, and how it is pushed there."""

from dataclasses import dataclass, field

from diagrams.envelope.fingerprints import (
    parameters_hash,
    robot_hash,
    this_code,
)
from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.mechanisms import MECHANISMS
from diagrams.scenario import Scenario

PROTOCOL = 1  # how limits are searched and trials judged
PLANTS = ("humanoid", "lipm")
LONGEST = 1e6  # that one can wait for a process, more overflows [s]


@dataclass(frozen=True)
class Cell:
    """One limit to find."""

    mechanisms: str  # a name of MECHANISMS
    moment: Moment  # when the push begins
    direction_deg: float  # 0 forward, 90 left, in [0, 360) [deg]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One push in one cell."""

    cell: Cell
    level: int  # of the push, in resolutions, from 1 on
    replica: int  # from 0 on


@dataclass(kw_only=True)
class Sweep:
    """A scenario with one push, and all the ways to give it."""

    scenario: Scenario
    scenario_name: str
    plant: str = "humanoid"  # or lipm
    directions: tuple[float, ...] = (0.0,)  # each in [0, 360) [deg]
    moments: tuple[Moment, ...] = (Moment("swing", "right", 0.25),)
    mechanisms: tuple[str, ...] = tuple(MECHANISMS)
    search: SearchParams = field(default_factory=SearchParams)
    timeout: float = 600.0  # after which a trial counts as hung, wall time [s]

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
        self.scenario.validate()
        self.search.validate()
        if (number := len(self.scenario.pushes)) != 1:
            raise ValueError(
                f"scenario_name = {self.scenario_name!r}: must have exactly "
                f"one push, has {number}"
            )
        if self.plant not in PLANTS:
            raise ValueError(
                f"plant = {self.plant!r}: must be one of {', '.join(PLANTS)}"
            )
        if not 0.0 < self.timeout <= LONGEST:
            raise ValueError(
                f"timeout = {self.timeout}: must be in (0, {LONGEST:g}] s"
            )
        for name in self.mechanisms:
            if name not in MECHANISMS:
                raise ValueError(
                    f"mechanisms = {name!r}: must be one of "
                    f"{', '.join(MECHANISMS)}"
                )
        for angle in self.directions:
            if not 0.0 <= angle < 360.0:
                raise ValueError(
                    f"directions = {angle}: must be in [0, 360) degrees"
                )
        for name in ("directions", "moments", "mechanisms"):
            _distinct(name, getattr(self, name))

    def cells(self) -> list[Cell]:
        """Returns all cells, by mechanisms, moment and direction."""
        return [
            Cell(mechanisms, moment, direction)
            for mechanisms in self.mechanisms
            for moment in self.moments
            for direction in self.directions
        ]

    def delta_v(self, trial: Trial) -> float:
        """The size of the push [m/s], as short as it can be written."""
        return round(trial.level * self.search.resolution, 9)

    @property
    def period(self) -> float:
        """Of the control, on this plant [s]."""
        if self.plant == "lipm":
            return self.scenario.lipm_period
        return self.scenario.controller.control_period

    def identity(self) -> dict:
        """Returns what two sweeps must share to be in one file, as plain JSON.

        Cells are not in it: more of them may be added to a file later.
        """
        search = self.search
        return {
            "protocol": PROTOCOL,
            "robot": self.scenario.robot,
            "scenario": self.scenario_name,
            "plant": self.plant,
            "resolution": search.resolution,
            "stride": search.stride,
            "replicas": search.replicas,
            "largest": search.largest,
            "seed": self.scenario.seed,
            "parameters": parameters_hash(self.scenario),
            **this_code(),
            "robot_files": robot_hash(self.scenario.robot),
        }


def _distinct(name: str, values: tuple) -> None:
    if not values:
        raise ValueError(f"{name} = '': must name at least one")
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f"{name} = {value}: must be given only once")
