"""The table of a sweep's limits: one record for each cell, from the rows."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.core.walking.push import Moment
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts.envelope_sweep import protocols
from nadia_balance.scripts.envelope_sweep.physical import (
    References,
    physical_limits,
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

ORDER = tuple(NAMED)  # fewer mechanisms before more
# Marks of a limit: search not complete; no larger push was decided.
UNSURE, AT_LEAST = "~", ">="


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

    @property
    def situation(self) -> Situation:
        """The gait and its moment."""
        return Situation(self.scenario, self.at)


@dataclass(frozen=True, kw_only=True)
class LimitTable:
    """The limits of one robot, and what they are compared with."""

    identity: dict  # of the sweep
    rows: list[dict]  # its trials
    records: list[Record]  # every cell of these three:
    situations: list[Situation]  # those of the paper come first
    mechanisms: list[str]  # fewer before more
    directions: list[float]  # [deg], in [0, 360)
    references: dict[Situation, References]
    assumptions: list[str]  # of the limits of any controller
    scale: Scale | None  # None if the robot does not exist any more

    @property
    def protocol(self) -> protocols.Protocol | None:
        """The paper's figure with reference limits, if any."""
        return protocols.protocol_of(self.identity["robot"], self.situations[0])

    @property
    def undecided(self) -> list[Record]:
        """Cells without a limit, because no trial was decided."""
        return [r for r in self.records if r.trials and r.recovered is None]

    def of(self, mechanisms: str, situation: Situation) -> list[Record]:
        """The records of all directions."""
        return [
            record
            for record in self.records
            if (record.mechanisms, record.situation) == (mechanisms, situation)
        ]

    def curve(
        self, mechanisms: str, situation: Situation
    ) -> dict[float, Record]:
        """The limits by direction [deg]; those without one are left out."""
        return {
            record.direction_deg: record
            for record in self.of(mechanisms, situation)
            if record.recovered is not None
        }

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
    tried = dict.fromkeys(mechanisms, directions)
    references = {
        situation: _references(identity, situation, tried, scenario_file)
        for situation in situations
    }
    cells = [
        Cell(name, situation, direction)
        for situation, name, direction in itertools.product(
            situations, mechanisms, directions
        )
    ]
    return LimitTable(
        identity=identity,
        rows=rows,
        records=[
            _record(cell, rows, limits.get(cell), references[cell.situation])
            for cell in cells
        ],
        situations=situations,
        mechanisms=mechanisms,
        directions=directions,
        references=references,
        assumptions=sorted({r.assumptions for r in references.values()} - {""}),
        scale=scale_of(robot),
    )


def _rank(robot: str, situation: Situation) -> tuple:
    moment = Moment.parse(situation.at)
    phase, swing = moment.phase, moment.swing
    unknown = protocols.protocol_of(robot, situation) is None
    when = phase and phase.value, swing.value, moment.fraction
    return unknown, situation.scenario, *when


def _references(identity: dict, situation: Situation, *args) -> References:
    robot, plant = identity["robot"], identity["plant"]
    try:
        known = physical_limits(robot, plant, situation, *args)
    except (ValueError, OSError) as error:
        print(f"{situation}: no limit to compare with, {error}")
        known = References()
    if protocol := protocols.protocol_of(robot, situation):
        known = known._replace(paper=protocol.curves(situation.scenario))
    return known


def _record(
    cell: Cell, rows: list[dict], found: Limit | None, known: References
) -> Record:
    rows = [row for row in rows if cell_of(row) == cell]
    none = {"recovered": None, "failed": None, "complete": False}
    limits = vars(found) if found else none
    best = [row for row in rows if row["delta_v"] == limits["recovered"]]

    def worst(name: str) -> float | None:
        values = [row[name] for row in best if recovered(row)]
        return max((v for v in values if v is not None), default=None)

    return Record(
        **cell.situation._asdict(),
        mechanisms=cell.mechanisms,
        direction_deg=cell.direction_deg,
        trials=len(rows),
        **limits,
        **{
            name: getattr(known, name)
            .get(cell.mechanisms, {})
            .get(cell.direction_deg)
            for name in ("paper", "limit", "with_hips")
        },
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
