"""The table of a sweep's limits: one record for each cell, from the rows.

Beside each limit stand the paper's, and that of any controller.
"""

import copy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from nadia_balance.analysis.lipm_limit import LipmLimit
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import walk_to_push
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts.envelope_sweep.protocols import (
    Curves,
    Protocol,
    protocol_of,
)
from nadia_balance.scripts.envelope_sweep.rows import (
    cell_of,
    recovered,
    search_of,
)
from nadia_balance.scripts.envelope_sweep.search import (
    Attempt,
    Cell,
    Limit,
    Situation,
    limit,
)
from nadia_balance.scripts.envelope_sweep.trial import limit_from

ORDER = tuple(NAMED)  # fewer mechanisms before more
AROUND = tuple(15.0 * i for i in range(24))  # directions of a picture [deg]
# Marks of a limit: search not complete; no larger push was decided.
UNSURE, AT_LEAST = "~", ">="


class References(NamedTuple):
    """Curves to compare limits with, in one situation; empty if unknown."""

    limit: Curves = {}  # of any controller, without angular momentum
    with_hips: Curves = {}  # of any controller, with angular momentum
    assumptions: str = ""  # of `limit`
    paper: Curves = {}


class Scale(NamedTuple):
    """Mass and speed that make a push dimensionless."""

    mass: float  # [kg]
    speed: float  # sqrt(g z), z the height of the CoM [m/s]


@dataclass(frozen=True, kw_only=True)
class Record:
    """The limit of a cell; None where nothing is known."""

    scenario: str
    at: str
    mechanisms: str
    direction_deg: float
    trials: int
    recovered: float | None  # see search.Limit [m/s]
    failed: float | None  # [m/s]
    complete: bool
    # The limits of the References.
    paper: float | None  # [m/s]
    limit: float | None  # [m/s]
    with_hips: float | None  # [m/s]
    # Motion of the body at the largest recovered push, its worst replica.
    torso_deg: float | None
    pelvis_deg: float | None
    com_sag_m: float | None
    power_w: float | None


@dataclass(frozen=True, kw_only=True)
class LimitTable:
    """The limits of one robot, and what they are compared with."""

    identity: dict  # of the sweep
    rows: list[dict]  # its trials
    records: list[Record]  # every cell of the next two and the directions
    situations: list[Situation]  # those of the paper come first
    mechanisms: list[str]  # fewer before more
    references: dict[Situation, References]
    scale: Scale | None  # None if the robot does not exist any more

    @property
    def protocol(self) -> Protocol | None:
        """The paper's figure with reference limits, if any."""
        return protocol_of(self.identity["robot"], self.situations[0])

    @property
    def assumptions(self) -> list[str]:
        """Assumptions of the limits of any controller, as text."""
        return sorted({r.assumptions for r in self.references.values()} - {""})

    def of(self, mechanisms: str, situation: Situation) -> list[Record]:
        """The records of all directions."""
        wanted = (*situation, mechanisms)
        return [
            record
            for record in self.records
            if (record.scenario, record.at, record.mechanisms) == wanted
        ]

    def words(self, velocity: float) -> str:
        """A velocity [m/s] with the decimals of the search's resolution."""
        text = f"{self.identity['resolution']:.6f}".rstrip("0")
        decimals = max(2, len(text.partition(".")[2]))
        return f"{velocity:.{decimals}f}"


def mark(records: Iterable[Record]) -> str:
    """Returns the mark of a number made of these limits, such as their mean.

    `~` if the search of one is not complete, otherwise `>=` if no failed push
    of one is known, otherwise "".
    """
    records = list(records)
    if not all(record.complete for record in records):
        return UNSURE
    return AT_LEAST if any(r.failed is None for r in records) else ""


def found_limits(
    identity: dict, rows: Iterable[dict]
) -> dict[Cell, Limit | None]:
    """Returns the limits of all cells; None if no trial was decided."""
    results: dict[Cell, dict[Attempt, bool | None]] = {}
    for row in rows:
        attempt = row["delta_v"], row["replica"]
        results.setdefault(cell_of(row), {})[attempt] = recovered(row)
    search = search_of(identity)
    return {cell: limit(seen, search) for cell, seen in results.items()}


def limit_table(
    identity: dict, rows: list[dict], scenario_file: Path
) -> LimitTable:
    """Returns the limits that follow from the rows of a sweep.

    The limits of any controller are of the scenarios in `scenario_file`.  A
    situation whose scenario or robot does not exist any more has none.

    Raises:
        ValueError: no trial, or no decided one.
    """
    if all(recovered(row) is None for row in rows):
        why = f": {rows[0]['reason']}" if rows else ""
        raise ValueError(
            f"no limit: of {len(rows)} trials none was decided{why}"
        )
    robot, limits = identity["robot"], found_limits(identity, rows)
    mechanisms = sorted({cell.mechanisms for cell in limits}, key=ORDER.index)
    situations = sorted(
        {cell.situation for cell in limits}, key=lambda s: _rank(robot, s)
    )
    directions = sorted({cell.direction_deg for cell in limits})
    references = {
        situation: _references(
            identity, situation, mechanisms, directions, scenario_file
        )
        for situation in situations
    }
    records = [
        _record(cell, rows, limits.get(cell), references[situation])
        for situation in situations
        for name in mechanisms
        for direction in directions
        for cell in [Cell(*situation, name, direction)]
    ]
    return LimitTable(
        identity=identity,
        rows=rows,
        records=records,
        situations=situations,
        mechanisms=mechanisms,
        references=references,
        scale=scale_of(robot),
    )


def _rank(robot: str, situation: Situation) -> tuple:
    moment = Moment.parse(situation.at)
    phase, swing = moment.phase, moment.swing
    unknown = protocol_of(robot, situation) is None
    when = phase and phase.value, swing.value, moment.fraction
    return unknown, situation.scenario, *when


def _record(
    cell: Cell, rows: list[dict], found: Limit | None, known: References
) -> Record:
    rows = [row for row in rows if cell_of(row) == cell]
    found = found or Limit(None, None, False)
    best = [
        row
        for row in rows
        if row["delta_v"] == found.recovered and recovered(row)
    ]

    def worst(name: str) -> float | None:
        values = (row[name] for row in best)
        return max((v for v in values if v is not None), default=None)

    def beside(curves: Curves) -> float | None:
        return curves.get(cell.mechanisms, {}).get(cell.direction_deg)

    return Record(
        **cell._asdict(),
        trials=len(rows),
        **found._asdict(),
        paper=beside(known.paper),
        limit=beside(known.limit),
        with_hips=beside(known.with_hips),
        torso_deg=worst("max_torso_tilt_deg"),
        pelvis_deg=worst("max_pelvis_tilt_deg"),
        com_sag_m=worst("com_sag_m"),
        power_w=worst("positive_power_w"),
    )


def scale_of(robot: str) -> Scale | None:
    """Returns the scale of a robot; None if it cannot be loaded."""
    try:
        model = load_robot(robot).point_mass
    except (ValueError, OSError):
        return None
    return Scale(model.mass, model.omega * model.com_height)


# The largest push that any controller can recover from.


def _references(identity: dict, situation: Situation, *args) -> References:
    robot, plant = identity["robot"], identity["plant"]
    try:
        known = physical_limits(robot, plant, situation, *args)
    except (ValueError, OSError) as error:
        print(f"{situation}: no limit to compare with, {error}")
        known = References()
    if protocol := protocol_of(robot, situation):
        known = known._replace(paper=protocol.curves(situation.scenario))
    return known


def physical_limits(
    robot: str,
    plant: str,
    situation: Situation,
    mechanisms: list[str],
    directions: list[float],
    scenario_file: Path,
) -> References:
    """Returns the limits of all mechanisms in the directions [deg].

    Those of the last mechanisms are also of AROUND.  The scenario is that of
    the file, or of the package without it.

    Raises:
        ValueError, OSError: the scenario or the robot does not exist any more.
    """
    file = scenario_file if scenario_file.is_file() else None
    scenario = load_scenario(situation.scenario, file, robot=robot)
    limits = limits_of(scenario, situation, plant)
    angles = dict.fromkeys(mechanisms, set(directions))
    angles[mechanisms[-1]] = {*directions, *AROUND}
    limit, with_hips = (_curves(one, angles) for one in limits)
    return References(limit, with_hips, limits[0].assumptions)


def _curves(limit: LipmLimit, directions: Mapping[str, set[float]]) -> Curves:
    curves: Curves = {}
    for name, angles in directions.items():
        one = replace(limit, on=NAMED[name])
        curves[name] = {d: one.largest_push(d).delta_v for d in sorted(angles)}
    return curves


def limits_of(
    scenario: Scenario, situation: Situation, plant: str
) -> tuple[LipmLimit, LipmLimit]:
    """Returns the limits without and with the hips, before the push.

    The state is that of the point mass at the start of the push, the model that
    of `plant`: of the robot in the scenario's fidelity, or the simulated point
    mass.

    Raises:
        ValueError: the push is not within the walk.
    """
    scenario = copy.deepcopy(scenario)
    push = scenario.pushes[0]
    push.at, push.delta_v, push.force = situation.at, 0.0, None
    diagram = LipmDiagram(scenario)
    context, run = walk_to_push(diagram, scenario.duration, lambda _: False)
    if not run.until:
        raise ValueError(f"at = {push.at!r}: must be in the walk")
    robot = diagram.robot
    if plant == "humanoid":
        robot = load_robot(scenario.robot, scenario.fidelity)
    limit = limit_from(
        diagram, context, model=robot.point_mass, push_duration=push.duration
    )
    kappa = scenario.controller.balance.max_kappa
    return limit, replace(limit, kappa=kappa)


def limit_lines(
    scenario: Scenario,
    situation: Situation,
    plant: str,
    directions: Iterable[float],
) -> list[str]:
    """Returns a table of limits for the terminal, with their assumptions."""
    limits = limits_of(scenario, situation, plant)
    values = {
        f"{direction:g}": [
            one.largest_push(direction).delta_v for one in limits
        ]
        for direction in directions
    }
    columns = zip(*values.values(), strict=True)
    values["mean"] = [sum(column) / len(column) for column in columns]
    return [
        f"largest push that a point mass can recover from [m/s], {situation}, "
        f"{scenario.mechanisms}",
        "direction [deg]    CoP only    with momentum",
        *(f"{d:>15}  {a:10.2f}  {b:15.2f}" for d, (a, b) in values.items()),
        f"assumes {limits[-1].assumptions}",
        "",
    ]
