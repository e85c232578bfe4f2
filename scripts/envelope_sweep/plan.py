"""Plan of a sweep: the cells of the envelope, and the scenario of a trial."""

import argparse
import ast
import contextlib
import copy
import functools
import hashlib
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

import nadia_balance
from nadia_balance.core.bounds import check
from nadia_balance.core.mechanisms import MECHANISMS, NAMED
from nadia_balance.core.push import Moment
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import versions
from nadia_balance.robot import MODELS, RobotModel, load_robot
from nadia_balance.scripts.command_line import (
    finite,
    scenario_flags,
    scenario_from,
)
from nadia_balance.scripts.envelope_sweep.protocols import PROTOCOLS
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
    Trial,
)

PROTOCOL = 5  # version of search, judgement of trials and names of cells
PLANTS = ("humanoid", "lipm")
LONGEST = 1e6  # longest timeout; more overflows [s]
MOST_DIRECTIONS = 72  # largest count of directions
DEFAULT = "nadia_fig10"  # key of PROTOCOLS
AT = PROTOCOLS[DEFAULT].at
QUICK = {  # used with the last mechanisms of the protocol
    "directions": "8",
    "resolution": 0.1,
    "stride": 4,
    "replicas": 1,
}


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
        if not 0.0 < self.timeout <= LONGEST:
            raise ValueError(
                f"timeout = {self.timeout}: must be in (0, {LONGEST:g}] s"
            )
        for name, words, allowed in (
            ("plant", (self.plant,), PLANTS),
            ("mechanisms", self.mechanisms, NAMED),
        ):
            for word in words:
                if word not in allowed:
                    raise ValueError(
                        f"{name} = {word!r}: must be one of "
                        f"{', '.join(allowed)}"
                    )
        for angle in self.directions:
            if not 0.0 <= angle < 360.0:
                raise ValueError(
                    f"directions = {angle}: must be in [0, 360) degrees"
                )
        for name in ("directions", "at", "mechanisms"):
            values = getattr(self, name)
            if not values:
                raise ValueError(f"{name} = '': must name at least one")
            for value in values:
                if values.count(value) > 1:
                    raise ValueError(
                        f"{name} = {value}: must be given only once"
                    )
        for cell in self.cells():
            if cell.direction_deg == self.directions[0]:
                check(self.walk(cell, replica=0))

    def cells(self) -> list[Cell]:
        """Returns all cells, by situation, mechanisms and direction."""
        return [
            Cell(mechanisms, Situation(scenario, at), direction)
            for scenario in self.scenarios
            for at in self.at
            for mechanisms in self.mechanisms
            for direction in self.directions
        ]

    def delta_v(self, trial: Trial) -> float:
        """The size of the push [m/s], rounded to nine decimals."""
        return round(trial.level * self.search.resolution, 9)

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
    def robot(self) -> str:
        """The robot of all scenarios."""
        return next(iter(self.scenarios.values())).robot

    @property
    def engine(self) -> str:
        """The physics engine of all scenarios."""
        return next(iter(self.scenarios.values())).engine

    @property
    def seed(self) -> int:
        """The seed of all scenarios."""
        return next(iter(self.scenarios.values())).seed

    def identity(self) -> dict:
        """Returns the JSON data that all sweeps of one file share.

        Cells are left out, so that more of them can be added to a file.
        """
        return {
            "protocol": PROTOCOL,
            "robot": self.robot,
            "scenario": ",".join(self.scenarios),
            "plant": self.plant,
            **asdict(self.search),
            "seed": self.seed,
            "parameters": parameters_hash(*self.scenarios.values()),
            **this_code(),
            **versions(self.engine),
            "robot_files": robot_hash(self.robot),
        }


def parameters_hash(*scenarios: Scenario) -> str:
    """Returns a hash (16 hex digits) of the parameters of all trials.

    It covers `scenarios` and their robot, without the seed, the mechanisms, and
    size, direction and time of the push, which a sweep varies.

    Raises:
        ValueError: the robot is unknown or invalid.
        FileNotFoundError: a file of the robot is missing.
    """
    robot, texts = load_robot(scenarios[0].robot), []
    for common in map(copy.deepcopy, scenarios):
        common.description, common.robot, common.seed = "", robot.name, 0
        common.mechanisms = ""
        for push in common.pushes:
            push.delta_v, push.force = 0.0, None
            push.direction_deg, push.at = 0, ""
        texts.append(yaml_dump_typed(common).encode())
    return _digest([*texts, *_files(robot)])


def robot_hash(name: str) -> str:
    """Returns a hash (16 hex digits) of a robot's files, not of their paths.

    Raises:
        ValueError: the robot is unknown or invalid.
        FileNotFoundError: a file of the robot is missing.
    """
    return _digest(_files(load_robot(name)))


@functools.cache  # the files may change later
def this_code() -> dict[str, str]:
    """Returns the versions and the hash of the code of this process."""
    return {**versions(), "code": code_hash()}


def code_hash(
    package: Path = Path(nadia_balance.__file__).parent,
    others: Path = MODELS.parent,
) -> str:
    """Returns a hash (16 hex digits) of the code that trials use.

    Comments and docstrings do not count; the hash depends on Python's version.
    `package` is the folder of nadia_balance, `others` that of diagrams, models
    and scripts: the checkout, or nadia_balance in an installation.
    """
    places = [
        *((package, folder) for folder in ("", "core", "systems", "results")),
        *((others, folder) for folder in ("diagrams", "models/*")),
    ]
    paths = {
        path.relative_to(root).as_posix(): path
        for root, folder in places
        for ending in ("py", "yaml", "urdf")
        for path in root.glob(f"{folder}/*.{ending}".lstrip("/"))
    }
    for name in TRIAL_FILES:
        paths[name] = others / "scripts" / "envelope_sweep" / name
    return _digest(
        part
        for name, path in sorted(paths.items())
        for part in (name.encode(), without_words(path))
    )


def without_words(path: Path) -> bytes:
    """Returns a file's bytes; Python code without docstrings and comments."""
    if path.suffix != ".py":
        return path.read_bytes()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            del node.body[0]
    return ast.dump(tree).encode()


# Modules of this package on which a row depends; not reports and plots.
TRIAL_FILES = ("plan.py", "protocols.py", "search.py", "trial.py")


def _files(robot: RobotModel) -> tuple[bytes, bytes]:
    params, urdf = yaml_dump_typed(robot.params), robot.urdf
    return params.encode(), urdf.read_text(encoding="utf-8").encode()


def _digest(parts: Iterable[bytes]) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(hashlib.sha256(part).digest())
    return whole.hexdigest()[:16]


def sweep_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of scenario, cells and search."""
    search, default = SearchParams(), PROTOCOLS[DEFAULT]
    quick = ", ".join(f"--{name} {value}" for name, value in QUICK.items())
    group = parser.add_argument_group(
        "sweep",
        "--mechanisms and --scenario_name may name several, with "
        "commas (default: those of the protocol).",
    )
    group.add_argument(
        "--protocol",
        choices=PROTOCOLS,
        default=DEFAULT,
        help="the paper's figure whose scenarios, moment, directions and "
        "mechanisms are tried unless given (default: %(default)s)",
    )
    group.add_argument(
        "--quick",
        action="store_true",
        help=f"unless given: {quick}, and the most mechanisms alone",
    )
    group.add_argument(
        "--directions",
        help='degrees from the stance heading, such as "0,30,90" (0 forward, '
        '90 left; "90," for one), or how many all around (default: '
        f"{default.directions})",
    )
    group.add_argument(
        "--at",
        "--phases",
        help="when the push begins, with commas (default: "
        f"{AT.replace('%', '%%')})",
    )
    group.add_argument(
        "--resolution",
        type=finite,
        help=f"of the limit (default: {search.resolution}) [m/s]",
    )
    group.add_argument(
        "--stride",
        type=int,
        help=f"of the march upward, in resolutions (default: {search.stride})",
    )
    group.add_argument(
        "--replicas",
        type=int,
        help="of a push at the limit; four in five must be recovered from "
        f"(default: {search.replicas})",
    )
    group.add_argument(
        "--largest",
        type=finite,
        help=f"no push is larger (default: {search.largest}) [m/s]",
    )
    scenario_flags(parser, name=default.scenario_name)
    parser.set_defaults(scenario_name=None)


def sweep_from(args: argparse.Namespace) -> Sweep:
    """Returns the checked sweep of the flags.

    Raises:
        ValueError: a flag is invalid; names it and what is allowed.
        FileNotFoundError: the scenario file does not exist.
    """
    asked = {name: x for name, x in vars(args).items() if x is not None}
    defaults = PROTOCOLS[args.protocol].flags()
    if args.quick:
        most = defaults["mechanisms"].rpartition(",")[2]
        defaults |= QUICK | {"mechanisms": most}
    asked = defaults | asked
    search = {
        name: asked[name] for name in vars(SearchParams()) if name in asked
    }
    sweep = Sweep(
        scenarios={
            name: _scenario(args, name)
            for name in _words(asked["scenario_name"])
        },
        plant=args.plant,
        directions=directions(asked["directions"]),
        at=moments(asked["at"]),
        mechanisms=tuple(_words(asked["mechanisms"])),
        search=SearchParams(**search),
        timeout=args.timeout,
    )
    sweep.validate()
    return sweep


def _scenario(args: argparse.Namespace, name: str) -> Scenario:
    """Returns the scenario `name`, with its own mechanisms."""
    one = {"scenario_name": name, "mechanisms": None}
    scenario = scenario_from(argparse.Namespace(**{**vars(args), **one}))
    if scenario.robot.endswith((".yaml", ".yml")):
        # Trials may run in another folder.
        scenario.robot = str(Path(scenario.robot).resolve())
    return scenario


def directions(text: str) -> tuple[float, ...]:
    """Returns the directions [deg] listed in `text`, or as many as its count.

    Raises:
        ValueError: `text` is neither a list nor a count.
    """
    if text.strip().isdecimal():
        count = int(text)
        if not 1 <= count <= MOST_DIRECTIONS:
            raise ValueError(
                f"directions = {text!r}: as a count must be in "
                f'[1, {MOST_DIRECTIONS}]; one direction is "{text.strip()},"'
            )
        return tuple(round(i * 360.0 / count, 6) for i in range(count))
    found = []
    for word in _words(text):
        with contextlib.suppress(ValueError):
            if math.isfinite(angle := float(word)):
                found.append(round(angle, 6) % 360.0)
                continue
        raise ValueError(
            f'directions = {word!r}: must be degrees, such as "0,30,90", or '
            "how many"
        )
    return tuple(found)


def moments(text: str) -> tuple[str, ...]:
    """Returns the moments in `text`, each as Moment writes it.

    Raises:
        ValueError: one is not like "right swing 25 %".
    """
    return tuple(str(moment_of(word)) for word in _words(text))


def moment_of(text: str) -> Moment:
    """Returns a point of the gait; times in seconds are not supported.

    Raises:
        ValueError: `text` is not like "right swing 25 %".
    """
    with contextlib.suppress(ValueError):
        if (moment := Moment.parse(text)).phase:
            return moment
    raise ValueError(f'at = {text!r}: must be like "{AT}", from 0 to 100 %')


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
