"""A sweep: the cells of the envelope, and the scenario of each trial."""

import contextlib
import copy
from dataclasses import asdict, dataclass, field

from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.mechanisms import MECHANISMS, NAMED
from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import versions
from nadia_balance.scripts.envelope_sweep import fingerprint
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
)

PROTOCOL = 5  # version of search, judgement of trials and names of cells
PLANTS = ("humanoid", "lipm")
LONGEST = 1e6  # longest timeout; more overflows [s]
HEADROOM = 0.16  # distance of the first push below a known limit [m/s]
AT = "right swing 25 %"  # of the Nadia paper's Fig. 10


@dataclass(kw_only=True)
class Sweep:
    """Scenarios with one push each, and all variations of the push."""

    scenarios: dict[str, Scenario]  # by name, all of one robot
    plant: str = "humanoid"  # or lipm
    directions: tuple[float, ...] = (0.0,)  # each in [0, 360) [deg]
    at: tuple[str, ...] = (AT,)  # as Moment writes it
    mechanisms: tuple[str, ...] = tuple(MECHANISMS)
    search: SearchParams = field(default_factory=SearchParams)
    timeout: float = 600.0  # wall time after which a trial counts as hung [s]
    # Known limits [m/s]; the search begins slightly below them.
    known_limits: dict[Cell, float] = field(default_factory=dict)

    def validate(self) -> None:
        """Raises ValueError that names field, value and what is allowed."""
        check(self.search)
        self._validate_scenarios()
        if not 0.0 < self.timeout <= LONGEST:
            raise ValueError(
                f"timeout = {self.timeout}: must be in (0, {LONGEST:g}] s"
            )
        for name, words, allowed in (
            ("plant", (self.plant,), PLANTS),
            ("mechanisms", self.mechanisms, NAMED),
        ):
            for word in [word for word in words if word not in allowed]:
                choice = ", ".join(allowed)
                raise ValueError(f"{name} = {word!r}: must be one of {choice}")
        for angle in self.directions:
            if not 0.0 <= angle < 360.0:
                raise ValueError(
                    f"directions = {angle}: must be in [0, 360) degrees"
                )
        for name, values in (
            ("scenario_name", tuple(self.scenarios)),
            ("directions", self.directions),
            ("at", self.at),
            ("mechanisms", self.mechanisms),
        ):
            if not values or len(set(values)) < len(values):
                text = ", ".join(map(str, values))
                raise ValueError(
                    f"{name} = {text!r}: must name at least one, and each "
                    "only once"
                )
        for cell in self.cells():
            if cell.direction_deg == self.directions[0]:
                check(self.walk(cell, replica=0))

    def _validate_scenarios(self) -> None:
        for name, scenario in self.scenarios.items():
            check(scenario)
            if (number := len(scenario.pushes)) != 1:
                raise ValueError(
                    f"scenario_name = {name!r}: must have exactly one push, "
                    f"has {number}"
                )
        for name in ("robot", "seed", "engine"):
            given = {getattr(s, name) for s in self.scenarios.values()}
            if len(given) > 1:
                raise ValueError(
                    f"{name} = {', '.join(map(str, sorted(given)))}: must be "
                    "the same in all scenarios"
                )

    def cells(self) -> list[Cell]:
        """Returns all cells, by situation, mechanisms and direction."""
        return [
            Cell(mechanisms, Situation(scenario, at), direction)
            for scenario in self.scenarios
            for at in self.at
            for mechanisms in self.mechanisms
            for direction in self.directions
        ]

    def first(self, cell: Cell) -> float:
        """Where the search of `cell` begins [m/s]; 0 if nothing is known."""
        return max(self.known_limits.get(cell, 0.0) - HEADROOM, 0.0)

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """Returns the scenario of a trial, with a zero push.

        Replica 0 is the scenario of push.py with the same flags; other replicas
        have other seeds, which shift the start slightly, and in odd ones the
        push begins one control period later.
        """
        scenario = copy.deepcopy(self.scenarios[cell.situation.scenario])
        scenario.description, scenario.mechanisms = "", cell.mechanisms
        scenario.seed += replica
        push, period = scenario.pushes[0], scenario.controller.control_period
        if self.plant == "lipm":
            period = scenario.lipm_period
        push.delta_v, push.force, push.direction_deg = 0.0, None, 0.0
        push.at = cell.situation.at
        push.delay += (replica % 2) * period
        return scenario

    @property
    def common(self) -> Scenario:
        """A scenario with the robot, engine and seed of all scenarios."""
        return next(iter(self.scenarios.values()))

    def identity(self) -> dict:
        """Returns the JSON data that all sweeps of one folder share.

        Cells are left out, so that more of them can be added to a folder.
        """
        return {
            "protocol": PROTOCOL,
            "robot": self.common.robot,
            "scenario": ",".join(self.scenarios),
            "plant": self.plant,
            **asdict(self.search),
            "seed": self.common.seed,
            "parameters": fingerprint.parameters_hash(*self.scenarios.values()),
            **fingerprint.this_code(),
            **versions(self.common.engine),
            "robot_files": fingerprint.robot_hash(self.common.robot),
        }


def moment_of(text: str) -> Moment:
    """Returns a point of the gait; times in seconds are not supported.

    Raises:
        ValueError: `text` is not like "right swing 25 %".
    """
    with contextlib.suppress(ValueError):
        if (moment := Moment.parse(text)).phase:
            return moment
    raise ValueError(f'at = {text!r}: must be like "{AT}", from 0 to 100 %')
