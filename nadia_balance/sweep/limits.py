"""The limits that follow from the rows of a sweep, a record for each cell.

Beside each limit stand those of the papers' figures, and of any controller.
"""

import csv
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from nadia_balance.core.walking.mechanisms import (
    ATLAS_MECHANISMS,
    MECHANISMS,
    MOST,
    NAMED,
)
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import (
    AT,
    STANDING,
    Scenario,
    load_scenario,
)
from nadia_balance.diagrams.simulation import walk_to_push
from nadia_balance.diagrams.terrain import FLAT
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.robot.params import MODELS
from nadia_balance.sweep.lipm_limit import LipmLimit
from nadia_balance.sweep.run_trial import limit_from
from nadia_balance.sweep.search import SearchParams, Sweep, limit
from nadia_balance.sweep.trials import (
    BLOCK,
    LARGEST_PUSH,
    Cell,
    Identity,
    Row,
    Rows,
    Situation,
    results_of,
)
from nadia_balance.systems.hardware import Imperfections

LIMITS = "limits.csv"  # its lines are the records
BEGIN = 0.5  # ratio of the first push to the limit with the hips [-]
# First push of a robot that stands, of unknown limit, over sqrt(g z) [-].
BEGIN_STANDING = 0.2
# The paper's; those of any controller, without and with angular momentum, and
# with a CoM that falls at each touchdown.
OTHERS = ("paper", "limit", "with_hips", "falling")
# Columns of a row; a record has the worst at the largest recovered push.
WORST = (
    "max_torso_tilt_deg",
    "max_pelvis_tilt_deg",
    "com_sag_m",
    "positive_power_w",
)

# The limit of a cell: its Cell, the number of `trials`, its Limit, OTHERS
# [m/s], and WORST; None where nothing is known.
Record = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """A figure of a paper, with the conditions as flags of a sweep.

    Attributes:
        robot: a model's name.
        scenario_name: of every gait.
        at: moments of the push.
        directions: a count, or degrees.
        mechanisms: names of NAMED.
        paper: name of its curves.
        figures: CSV in the robot's folder.
        unit_speed: velocity change of the CoM per unit there [m/s].
    """

    robot: str
    scenario_name: str
    at: str
    directions: str
    mechanisms: str
    paper: str
    figures: str
    unit_speed: float = 1.0

    def curves(self, scenario: str) -> dict[str, dict[float, float]]:
        """The curves of a gait.

        Args:
            scenario: its name.

        Returns:
            Velocities [m/s] by mechanisms and direction [deg] in [0, 360).
        """
        text = (MODELS / self.robot / self.figures).read_text(encoding="utf-8")
        lines = (line for line in text.splitlines() if not line.startswith("#"))
        curves: dict[str, dict[float, float]] = {}
        for row in csv.DictReader(lines):
            if row.pop("scenario", scenario) == scenario:
                direction = float(row.pop("direction"))
                for mechanisms, value in row.items():
                    curves.setdefault(mechanisms, {})[direction] = (
                        float(value) * self.unit_speed
                    )
        return curves

    def largest(self, mechanisms: str) -> dict[Cell, float]:
        """The pushes of the paper's last curves, in every gait.

        Args:
            mechanisms: of the cells, whatever the paper's are.

        Returns:
            Pushes [m/s] by cell.
        """
        return {
            Cell(gait, self.at, mechanisms, direction): delta_v
            for gait in self.scenario_name.split(",")
            for direction, delta_v in [*self.curves(gait).values()][-1].items()
        }


PROTOCOLS = {
    "nadia_fig10": Protocol(
        robot="nadia",
        scenario_name="push",
        at=AT,
        directions="12",
        mechanisms=",".join(MECHANISMS),
        paper="the Nadia paper's, Fig. 10",
        figures="nadia_fig10.csv",
    ),
    "atlas_fig6": Protocol(
        robot="atlas",
        scenario_name="atlas_forward_fast,atlas_forward_slow,"
        "atlas_in_place_fast,atlas_in_place_slow",
        at="right swing 50 %",
        directions="0,30,45,90,135,150,180,210,225,240,270,300,315,330",
        mechanisms=",".join(ATLAS_MECHANISMS),
        paper="the Atlas paper's, Fig. 6",
        figures="atlas_fig6.csv",
        unit_speed=0.981,  # forces over the weight, for 0.1 s
    ),
}


def protocol_of(robot: str, situation: Situation) -> Protocol | None:
    """The figure of a paper with these conditions.

    Args:
        robot: a model's name.
        situation: gait and moment of the push.

    Returns:
        The figure, if there is one.
    """
    scenario, at = situation
    return next(
        (
            protocol
            for protocol in PROTOCOLS.values()
            if (protocol.robot, protocol.at) == (robot, at)
            and scenario in protocol.scenario_name.split(",")
        ),
        None,
    )


@dataclass(frozen=True)
class LimitTable:
    """The limits of one robot, and what they are compared with.

    Attributes:
        identity: of the sweep.
        situations: those of the paper come first.
        mechanisms: fewer before more.
        records: every cell of these and the directions.
        assumptions: of the limits of any controller.
        protocols: figures of a paper, by situation.
        walk: commands and ground of the scenarios, if flags changed them.
        beside: limits of another sweep [m/s], by cell.
        beside_title: its name.
    """

    identity: Identity
    situations: list[Situation]
    mechanisms: list[str]
    records: list[Record]
    assumptions: list[str]
    protocols: dict[Situation, Protocol] = field(default_factory=dict)
    walk: dict[str, str] = field(default_factory=dict)
    beside: dict[Cell, float] = field(default_factory=dict)
    beside_title: str = ""

    def title(self, mechanisms: str) -> str:
        """The words for these mechanisms, or for a controller of another's.

        Args:
            mechanisms: a name of NAMED.

        Returns:
            That name, with the user's blocks; or the name of the policy's file
            or the controller's class.
        """
        title = str(self.identity.get("controller", mechanisms)).split(" ")[0]
        blocks = [
            f"{name.removeprefix(BLOCK)}={text.split(' ')[0]}"
            for name, text in self.identity.items()
            if name.startswith(BLOCK)
        ]
        return ", ".join([title, *blocks])

    def of_beside(
        self, mechanisms: str, situation: Situation
    ) -> dict[float, float]:
        """The limits of the other sweep.

        Args:
            mechanisms: a name of NAMED.
            situation: gait and moment of the push.

        Returns:
            Limits [m/s] by direction [deg].
        """
        return {
            cell.direction_deg: limit
            for cell, limit in self.beside.items()
            if cell[:3] == (*situation, mechanisms)
        }

    def of(self, mechanisms: str, situation: Situation) -> list[Record]:
        """The records of all directions.

        Args:
            mechanisms: a name of NAMED.
            situation: gait and moment of the push.

        Returns:
            The records, by direction.
        """
        return [
            one
            for one in self.records
            if Cell.of(one)[:3] == (*situation, mechanisms)
        ]


def mark(records: Iterable[Record]) -> str:
    """Marks what is not sure.

    Args:
        records: of which something is told.

    Returns:
        `~` if a search has not ended, or knows no push that failed.
    """
    is_sure = all(r["complete"] and r["failed"] is not None for r in records)
    return "" if is_sure else "~"


def limit_table(
    rows: Rows, scenarios: dict[str, Scenario], beside: Path | None = None
) -> LimitTable:
    """The limits that follow from the rows of a sweep.

    Args:
        rows: of the sweep.
        scenarios: by name, those of the rows.
        beside: folder of another sweep, to compare with.

    Returns:
        The limits, also of cells without a trial.

    Raises:
        ValueError: as limits_of.
    """
    groups = rows.by_cell()
    protocols = {
        situation: protocol
        for situation in {cell[:2] for cell in groups}
        if (protocol := protocol_of(rows.identity["robot"], situation))
        and _walks_as_published(scenarios[situation[0]], situation[0])
    }
    situations = sorted(
        {cell[:2] for cell in groups},
        key=lambda one: (one not in protocols, one),
    )
    tried = {cell.mechanisms for cell in groups}
    mechanisms = [name for name in NAMED if name in tried]
    directions = sorted({cell.direction_deg for cell in groups})
    # Blocks of the user's may do more than the mechanisms that are on.
    has_own = any(
        key == "controller" or key.startswith(BLOCK) for key in rows.identity
    )
    records, assumptions = [], set()
    for situation in situations:
        limits = limits_of(scenarios[situation[0]], situation)
        assumptions |= {limit.assumptions for limit in limits[:1]}
        for name in mechanisms:
            allowed = NAMED[MOST if has_own else name]
            on = [replace(limit, on=allowed) for limit in limits]
            cells = [Cell(*situation, name, one) for one in directions]
            records += [
                _record(
                    cell,
                    rows=groups.get(cell, []),
                    search=SearchParams.of(rows.identity),
                    limits=on,
                    protocol=protocols.get(situation),
                )
                for cell in cells
            ]
    return LimitTable(
        identity=rows.identity,
        situations=situations,
        mechanisms=mechanisms,
        records=records,
        assumptions=sorted(assumptions),
        protocols=protocols,
        walk=_walk_of(scenarios[situations[0][0]]),
        beside=known_limits(beside) if beside else {},
        beside_title=_title_of(beside, rows.identity) if beside else "",
    )


def _title_of(beside: Path, identity: Identity) -> str:
    """Returns the name of the other sweep, with what is not the same in it."""
    theirs = Rows.read(beside).identity
    others = [
        {"robot_files": "other robot files"}.get(name, str(theirs[name]))
        for name in ("plant", "robot_files")
        if name in theirs and theirs[name] != identity.get(name)
    ]
    name = beside.resolve().name
    return f"beside: {name}" + (f" ({', '.join(others)})" if others else "")


def _walks_as_published(scenario: Scenario, name: str) -> bool:
    """True if its steps, ground and commands are those of the name."""
    published = load_scenario(name, robot=scenario.robot)
    return all(
        getattr(scenario, part) == getattr(published, part)
        for part in ("gait", "terrain", "commands", "random_commands")
    )


def _walk_of(scenario: Scenario) -> dict[str, str]:
    """Returns what flags can change of its walk, by the field's name."""
    commands = "; ".join(
        f"{row.forward:g} {row.left:g} {row.turn:g} from {row.time:g} s"
        for row in scenario.commands
    )
    terrain = scenario.terrain.name
    walk = {"commands": commands, "terrain": "" if terrain == FLAT else terrain}
    return {name: text for name, text in walk.items() if text}


def _record(
    cell: Cell,
    rows: list[Row],
    search: SearchParams,
    limits: Sequence[LipmLimit],
    protocol: Protocol | None,
) -> Record:
    recovery = limit(results_of(rows), search)
    paper = protocol.curves(cell.scenario) if protocol else {}
    pushes = [one.largest_push(cell.direction_deg) for one in limits]
    return {
        **cell._asdict(),
        "trials": len(rows),
        **recovery._asdict(),
        **dict.fromkeys(OTHERS),
        "paper": paper.get(cell.mechanisms, {}).get(cell.direction_deg),
        **dict(zip(OTHERS[1:], pushes, strict=False)),
        **worst_at(recovery.recovered, rows, WORST),
    }


def worst_at(
    delta_v: float | None, rows: Iterable[Row], columns: Iterable[str]
) -> Row:
    """The largest measurements of the recoveries from a push.

    Args:
        delta_v: the push [m/s].
        rows: of one cell.
        columns: names of the measurements.

    Returns:
        The largest by name, None where nothing was measured.
    """
    best = [
        row
        for row in rows
        if row["delta_v"] == delta_v and row["outcome"] == "recovered"
    ]
    return {
        name: max(
            (row[name] for row in best if row[name] is not None), default=None
        )
        for name in columns
    }


def limits_of(
    scenario: Scenario, situation: Situation
) -> tuple[LipmLimit, ...]:
    """The limits of a perfect point mass at its push, in Drake.

    Args:
        scenario: of the gait; uneven ground is taken as flat.
        situation: its name, and the moment of the push.

    Returns:
        Those of OTHERS but the paper; none for a robot that stands: which foot
        it will lift is not known.

    Raises:
        ValueError: the push is not within the walk.
    """
    if situation[1] == STANDING:
        return ()
    robot = load_robot(scenario.robot, scenario.fidelity)
    scenario = (
        _on_level_ground(scenario, robot)
        .changed(
            engine="drake", sensors="perfect", imperfections=Imperfections()
        )
        .with_push(delta_v=0.0, at=situation[1])
    )
    push = replace(scenario.pushes[0], point=None)
    diagram = LipmDiagram(scenario.changed(pushes=[push]))
    context, run = walk_to_push(diagram)
    require(run.until, f"at = {push.at!r}: must be in the walk")
    limit = limit_from(
        diagram, context, model=robot.point_mass, push_duration=push.duration
    )
    params = scenario.controller
    with_hips = replace(limit, kappa=params.balance.max_kappa)
    return (
        limit,
        with_hips,
        replace(with_hips, fall=params.com_height.max_velocity),
    )


def _on_level_ground(scenario: Scenario, robot: RobotModel) -> Scenario:
    """The scenario on flat ground, if any of its grounds is not level."""
    grounds = (
        scenario.terrain.ground(robot.sole, robot.params.size),
        scenario.point_mass(robot).ground,
    )
    if all(ground is None or ground.is_level for ground in grounds):
        return scenario
    return scenario.changed(terrain=replace(scenario.terrain, name=FLAT))


def first_pushes(sweep: Sweep) -> dict[Cell, float]:
    """The push with which the search of each cell begins.

    It is `BEGIN` times the limit with hips; of a robot that stands,
    `BEGIN_STANDING` sqrt(g z).

    Args:
        sweep: its cells and scenarios.

    Returns:
        Pushes [m/s].

    Raises:
        ValueError: the push is not within the walk.
    """
    limits = {
        situation: limits_of(sweep.scenarios[situation[0]], situation)
        for situation in dict.fromkeys(cell[:2] for cell in sweep.cells())
    }
    model = load_robot(sweep.one.robot).point_mass
    first = {}
    for cell in sweep.cells():
        first[cell] = BEGIN_STANDING * model.froude_speed
        if limits[cell[:2]]:
            limit = replace(limits[cell[:2]][1], on=NAMED[cell.mechanisms])
            first[cell] = BEGIN * limit.largest_push(cell.direction_deg)
    return first


def check_beside(
    folder: Path | None, identity: Identity, cells: Collection[Cell]
) -> None:
    """Checks a sweep that another one is compared with.

    The robot may have been changed since, or its files copied.

    Args:
        folder: of that sweep; None: there is none.
        identity: of the other one.
        cells: of the other one.

    Raises:
        ValueError: it has no limits, or those of another robot, or none of
            these cells.
    """
    if folder is None:
        return
    shared = known_limits(folder, "beside").keys() & cells
    theirs = Rows.read(folder).identity
    require(
        any(
            name in theirs and theirs[name] == identity.get(name)
            for name in ("robot", "robot_files")
        ),
        f"beside = {str(folder)!r}: must be of {identity['robot']}, not of "
        f"{theirs['robot']}",
    )
    mechanisms = max({cell.mechanisms for cell in cells}, key=[*NAMED].index)
    require(
        any(cell.mechanisms == mechanisms for cell in shared),
        f"beside = {str(folder)!r}: must have a limit of the same scenario, "
        f"moment and direction, with {mechanisms}",
    )


def known_limits(folder: Path, field: str = "limits") -> dict[Cell, float]:
    """The limits that a sweep has found.

    Args:
        folder: of the sweep.
        field: that names it, for the error.

    Returns:
        Limits [m/s] by cell; 0 where none is known.

    Raises:
        ValueError: it has no such limits.csv.
        OSError: it cannot be read.
    """
    limits = {}
    try:
        with open(folder / LIMITS, encoding="utf-8", newline="") as file:
            for line in csv.DictReader(file):
                angle = float(line["direction_deg"])
                limit = float(line["recovered"] or 0.0)
                if not (0.0 <= angle < 360.0 and 0.0 <= limit <= LARGEST_PUSH):
                    raise ValueError
                limits[Cell.of(line | {"direction_deg": angle})] = limit
        if not limits:
            raise ValueError
    except (
        FileNotFoundError,
        NotADirectoryError,
        csv.Error,
        KeyError,
        TypeError,
        ValueError,
    ):
        raise ValueError(
            f"{field} = {str(folder)!r}: must have a {LIMITS}"
        ) from None
    return limits
