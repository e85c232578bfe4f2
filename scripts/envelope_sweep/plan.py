"""What a sweep tries: the cells of the envelope, and how it is pushed there."""

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

PROTOCOL = 5  # how limits are searched, trials judged, and cells named
PLANTS = ("humanoid", "lipm")
LONGEST = 1e6  # that one can wait for a process, more overflows [s]
MOST_DIRECTIONS = 72  # that a count may ask for
DEFAULT = "nadia_fig10"  # of PROTOCOLS
AT = PROTOCOLS[DEFAULT].at
QUICK = {  # with the most mechanisms of the protocol
    "directions": "8",
    "resolution": 0.1,
    "stride": 4,
    "replicas": 1,
}


@dataclass(kw_only=True)
class Sweep:
    """Scenarios with one push each, and all the ways to give it."""

    scenarios: dict[str, Scenario]  # by name, all of one robot
    plant: str = "humanoid"  # or lipm
    directions: tuple[float, ...] = (0.0,)  # each in [0, 360) [deg]
    at: tuple[str, ...] = (AT,)  # in Moment's own spelling
    mechanisms: tuple[str, ...] = tuple(MECHANISMS)
    search: SearchParams = field(default_factory=SearchParams)
    timeout: float = 600.0  # after which a trial counts as hung, wall time [s]
    # What is known of limits [m/s], to begin a little below them.
    known_limits: dict[Cell, float] = field(default_factory=dict)

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
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
        """The size of the push [m/s], as short as it can be written."""
        return round(trial.level * self.search.resolution, 9)

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """Returns the scenario of a trial, with a push of nothing.

        Replica 0 is just what the flags of push.py ask for; each other one
        starts a little elsewhere (its seed), and every second one is pushed
        one control period later.
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
        """What moves the robot, in all scenarios."""
        return next(iter(self.scenarios.values())).engine

    @property
    def seed(self) -> int:
        """The seed of all scenarios."""
        return next(iter(self.scenarios.values())).seed

    def identity(self) -> dict:
        """Returns what two sweeps must share to be in one file, as plain JSON.

        Cells are not in it: more of them may be added to a file later.
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
    """Returns 16 hex digits for all that is the same in every trial.

    That is `scenarios` and their robot, without the seed, the mechanisms, and
    how hard, which way and when the push is: a sweep sets these itself.

    Raises:
        ValueError: the robot is unknown or makes no sense.
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
    """Returns 16 hex digits for the files of a robot, wherever they are.

    Raises:
        ValueError: the robot is unknown or makes no sense.
        FileNotFoundError: a file of the robot is missing.
    """
    return _digest(_files(load_robot(name)))


@functools.cache  # later there may be another
def this_code() -> dict[str, str]:
    """Returns what a row depends on, apart from its scenario and its robot."""
    return {**versions(), "code": code_hash()}


def code_hash(
    package: Path = Path(nadia_balance.__file__).parent,
    others: Path = MODELS.parent,
) -> str:
    """Returns 16 hex digits for the files that trials use.

    Comments and docstrings are not in them; other versions of Python have
    other ones.  `package` is the folder of nadia_balance, `others` that of
    diagrams, models and scripts: a checkout's, or again nadia_balance.
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
    """Returns a file as it is; of Python code only what is carried out."""
    if path.suffix != ".py":
        return path.read_bytes()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            del node.body[0]
    return ast.dump(tree).encode()


# Of this package, what a row depends on; reports and plots are free to change.
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
    """Adds the flags of scenario, cells, and how finely to search."""
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
    """Returns the sweep that the flags ask for, checked.

    Raises:
        ValueError: a flag has no meaning; it is named, with what is allowed.
        FileNotFoundError: there is no such scenario file.
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
    """That a sweep has many names and mechanisms is not the scenario's."""
    one = {"scenario_name": name, "mechanisms": None}
    scenario = scenario_from(argparse.Namespace(**{**vars(args), **one}))
    if scenario.robot.endswith((".yaml", ".yml")):
        # Trials may run elsewhere.
        scenario.robot = str(Path(scenario.robot).resolve())
    return scenario


def directions(text: str) -> tuple[float, ...]:
    """Returns the directions in `text`, or so many as it says [deg].

    Raises:
        ValueError: it is neither.
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
    """Returns the moments in `text`, each in Moment's own spelling.

    Raises:
        ValueError: one is not like "right swing 25 %".
    """
    return tuple(str(moment_of(word)) for word in _words(text))


def moment_of(text: str) -> Moment:
    """Returns a point of the gait; limits at a mere time are not searched.

    Raises:
        ValueError: `text` is not like "right swing 25 %".
    """
    with contextlib.suppress(ValueError):
        if (moment := Moment.parse(text)).phase:
            return moment
    raise ValueError(f'at = {text!r}: must be like "{AT}", from 0 to 100 %')


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
