"""A sweep: its cells, the scenario of each trial, and what both depend on."""

import ast
import copy
import functools
import hashlib
import itertools
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

from pydrake.common.yaml import yaml_dump_typed

import nadia_balance
from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import versions
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts.envelope_sweep.search import (
    Attempt,
    Results,
    SearchParams,
    next_attempts,
)

HEADROOM = 0.16  # distance of the first push below a known limit [m/s]
AT = "right swing 25 %"  # of the Nadia paper's Fig. 10

PACKAGE = Path(nadia_balance.__file__).parent
# Files on which a row depends; not reports and plots.
FOLDERS = (
    *("", "analysis", "core/**", "diagrams", "engines", "models/*"),
    *("results", "robot", "systems", "view"),
)
TRIAL_FILES = ("search.py", "sweep.py", "trial.py")

# Name of the gait's scenario, and when the push begins, as Moment writes it.
Situation = tuple[str, str]


class Cell(NamedTuple):
    """Conditions of one limit to find, named as the columns of a row."""

    scenario: str  # its name
    at: str  # when the push begins, as Moment writes it
    mechanisms: str  # a name of NAMED
    direction_deg: float  # 0 forward, 90 left, in [0, 360) [deg]


@dataclass(kw_only=True)
class Sweep:
    """Scenarios with one push each, and all variations of the push."""

    scenarios: dict[str, Scenario]  # by name, all of one robot
    plant: str = "humanoid"  # or lipm
    controller: str = ""  # file of a policy in the place of our controller
    directions: tuple[float, ...] = (0.0,)  # each in [0, 360) [deg]
    at: tuple[str, ...] = (AT,)  # as Moment writes it
    mechanisms: tuple[str, ...] = tuple(MECHANISMS)
    search: SearchParams = field(default_factory=SearchParams)
    # Known limits [m/s]; the search begins slightly below them.
    known_limits: dict[Cell, float] = field(default_factory=dict)

    def validate(self) -> None:
        """Raises ValueError that names field, value and what is allowed."""
        check(self.search)
        for name, scenario in self.scenarios.items():
            given = scenario.robot, scenario.seed, scenario.engine
            shared = self.one.robot, self.one.seed, self.one.engine
            if len(scenario.pushes) != 1 or given != shared:
                raise ValueError(
                    f"scenario_name = {name!r}: must have one push, and the "
                    "robot, seed and engine of the other scenarios"
                )
        for cell in self.cells():
            if cell.direction_deg == self.directions[0]:
                check(self.walk(cell, replica=0))

    @property
    def one(self) -> Scenario:
        """A scenario with the robot, engine and seed of all scenarios."""
        return next(iter(self.scenarios.values()))

    def cells(self) -> list[Cell]:
        """Returns all cells, by situation, mechanisms and direction."""
        several = self.scenarios, self.at, self.mechanisms, self.directions
        return [Cell(*one) for one in itertools.product(*several)]

    def attempts(self, cell: Cell, results: Results) -> list[Attempt]:
        """Returns the trials of a `cell` that are to be made next."""
        first = self.known_limits.get(cell, 0.0) - HEADROOM
        return next_attempts(results, self.search, max(first, 0.0))

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

    def identity(self) -> dict:
        """Returns the JSON data that all trials of one folder share.

        Cells are left out, so that more of them can be added to a folder.
        """
        # The walks, without what differs between the cells.
        walks = (self.walk(Cell(n, "", "", 0.0), 0) for n in self.scenarios)
        common = [yaml_dump_typed(walk).encode() for walk in walks]
        return {
            "robot": self.one.robot,
            "scenario": ",".join(self.scenarios),
            "plant": self.plant,
            **asdict(self.search),
            "seed": self.one.seed,
            "parameters": digest(common),
            **of_process(self.one, self.controller),
        }


def of_process(scenario: Scenario, controller: str = "") -> dict[str, str]:
    """Returns versions and hashes: this process' code, robot and policy."""
    file = Path(controller)
    policy = f"{file.name} {digest([file.read_bytes()])}" if controller else ""
    return {
        **versions(scenario.engine),
        **({"controller": policy} if controller else {}),
        "code": _first_hash(),
        "robot_files": robot_hash(scenario.robot),
    }


@functools.cache  # the files may change later
def _first_hash() -> str:
    return code_hash(PACKAGE)


def code_hash(package: Path = PACKAGE) -> str:
    """Returns a hash (16 hex digits) of the code that trials use.

    Comments and docstrings do not count; the hash depends on Python's version.
    """
    parts = []
    for path in code_files(package):
        parts.append(path.relative_to(package).as_posix().encode())
        text = path.read_bytes()
        parts.append(without_words(text) if path.suffix == ".py" else text)
    return digest(parts)


def code_files(package: Path) -> list[Path]:
    """Returns the files in `package` that trials use, in order."""
    paths = {package / "scripts/envelope_sweep" / name for name in TRIAL_FILES}
    for folder in FOLDERS:
        for ending in ("py", "yaml", "urdf"):
            paths.update(package.glob(f"{folder}/*.{ending}".lstrip("/")))
    return sorted(paths)


@functools.cache
def without_words(text: bytes) -> bytes:
    """Returns Python code without docstrings and comments."""
    tree = ast.parse(text)
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            del node.body[0]
    return ast.dump(tree).encode()


def robot_hash(name: str) -> str:
    """Returns a hash (16 hex digits) of a robot's files, not of their paths.

    Raises ValueError or FileNotFoundError: a file is invalid or missing.
    """
    robot = load_robot(name)
    params = yaml_dump_typed(robot.params).encode()
    return digest([params, robot.urdf.read_bytes()])


def digest(parts: Iterable[bytes]) -> str:
    """Returns a hash (16 hex digits) of the parts and their order."""
    whole = hashlib.sha256()
    for part in parts:
        whole.update(hashlib.sha256(part).digest())
    return whole.hexdigest()[:16]
