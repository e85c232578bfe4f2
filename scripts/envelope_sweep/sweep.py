"""A sweep: the cells of the envelope, and the scenario of each trial."""

import copy
from dataclasses import asdict, dataclass, field

from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.mechanisms import MECHANISMS, NAMED
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import versions
from nadia_balance.scripts.envelope_sweep import fingerprint
from nadia_balance.scripts.envelope_sweep.search import Cell, SearchParams

PROTOCOL = 5  # version of search, judgement of trials and names of cells
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
        refused = []
        for name, scenario in self.scenarios.items():
            check(scenario)
            if (number := len(scenario.pushes)) != 1:
                rule = f"have exactly one push, has {number}"
                refused.append(("scenario_name", repr(name), rule))
        for name in ("robot", "seed", "engine"):
            given = {getattr(s, name) for s in self.scenarios.values()}
            if len(given) > 1:
                values = ", ".join(map(str, sorted(given)))
                refused.append((name, values, "be the same in all scenarios"))
        if not 0.0 < self.timeout <= LONGEST:
            rule = f"be in (0, {LONGEST:g}] s"
            refused.append(("timeout", str(self.timeout), rule))
        for word in self.mechanisms:
            if word not in NAMED:
                rule = f"be one of {', '.join(NAMED)}"
                refused.append(("mechanisms", repr(word), rule))
        for name, several in (
            ("scenario_name", tuple(self.scenarios)),
            ("directions", self.directions),
            ("at", self.at),
            ("mechanisms", self.mechanisms),
        ):
            if not several or len(set(several)) < len(several):
                values = repr(", ".join(map(str, several)))
                rule = "name at least one, and each only once"
                refused.append((name, values, rule))
        for name, value, rule in refused:
            raise ValueError(f"{name} = {value}: must {rule}")
        for cell in self.cells():
            if cell.direction_deg == self.directions[0]:
                check(self.walk(cell, replica=0))

    def cells(self) -> list[Cell]:
        """Returns all cells, by situation, mechanisms and direction."""
        return [
            Cell(scenario, at, mechanisms, direction)
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
        scenario = copy.deepcopy(self.scenarios[cell.scenario])
        scenario.description, scenario.mechanisms = "", cell.mechanisms
        scenario.seed += replica
        push, period = scenario.pushes[0], scenario.controller.control_period
        if self.plant == "lipm":
            period = scenario.lipm_period
        push.delta_v, push.force, push.direction_deg = 0.0, None, 0.0
        push.at = cell.at
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
