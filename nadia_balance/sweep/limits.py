"""The limits that follow from the rows of a sweep, a record for each cell.

Beside each limit stand those of the papers' figures, and of any controller.
"""

import csv
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nadia_balance.core.walking import mechanisms as switches
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import AT, STANDING, Scenario
from nadia_balance.diagrams.simulation import walk_to_push
from nadia_balance.robot.model import MODELS, load_robot
from nadia_balance.sweep.lipm_limit import LipmLimit
from nadia_balance.sweep.run_trial import limit_from
from nadia_balance.sweep.search import SearchParams, Sweep, limit
from nadia_balance.sweep.trials import MOST, Cell, Rows, Situation, results_of

LIMITS = "limits.csv"  # its lines are the records
BEGIN = 0.5  # ratio of the first push to the limit with the hips [-]
# First push of a robot that stands, of unknown limit, over sqrt(g z) [-].
BEGIN_STANDING = 0.2
# The paper's; those of any controller, without and with angular momentum, and
# with a CoM that falls at each touchdown.
OTHERS = ("paper", "limit", "with_hips", "falling")
# Columns of a row; a record has the worst at the largest recovered push.
WORST = (
    *("max_torso_tilt_deg", "max_pelvis_tilt_deg", "com_sag_m"),
    "positive_power_w",
)

# The limit of a cell: its Cell, the number of `trials`, its Limit, OTHERS
# [m/s], and WORST; None where nothing is known.
Record = dict[str, Any]

# By the name of the mechanisms: direction [deg] in [0, 360) -> velocity [m/s].
Curves = dict[str, dict[float, float]]


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """A figure of a paper, with the conditions as flags of a sweep."""

    robot: str
    scenario_name: str  # of every gait
    at: str
    directions: str
    mechanisms: str
    paper: str  # name of its curves
    figures: str  # CSV in the robot's folder
    unit_speed: float = 1.0  # velocity change of the CoM per unit there [m/s]

    def curves(self, scenario: str) -> Curves:
        """The curves [m/s] of a gait."""
        text = (MODELS / self.robot / self.figures).read_text(encoding="utf-8")
        lines = (line for line in text.splitlines() if not line.startswith("#"))
        curves: Curves = {}
        for row in csv.DictReader(lines):
            if row.pop("scenario", scenario) != scenario:
                continue
            direction = float(row.pop("direction"))
            for mechanisms, value in row.items():
                curve = curves.setdefault(mechanisms, {})
                curve[direction] = float(value) * self.unit_speed
        return curves

    def largest(self, mechanisms: str) -> dict[Cell, float]:
        """Pushes [m/s] of the paper's last curves, as those of `mechanisms`."""
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
        mechanisms=",".join(switches.MECHANISMS),
        paper="the Nadia paper's, Fig. 10",
        figures="nadia_fig10.csv",
    ),
    "atlas_fig6": Protocol(
        robot="atlas",
        scenario_name="atlas_forward_fast,atlas_forward_slow,"
        "atlas_in_place_fast,atlas_in_place_slow",
        at="right swing 50 %",
        directions="0,30,45,90,135,150,180,210,225,240,270,300,315,330",
        mechanisms=",".join(switches.ATLAS_MECHANISMS),
        paper="the Atlas paper's, Fig. 6",
        figures="atlas_fig6.csv",
        unit_speed=0.981,  # forces over the weight, for 0.1 s
    ),
}


def protocol_of(robot: str, situation: Situation) -> Protocol | None:
    """Returns the figure with this `robot` and `situation`, if any."""
    for one in PROTOCOLS.values():
        gaits = one.scenario_name.split(",")
        if one.robot == robot and situation in [(g, one.at) for g in gaits]:
            return one
    return None


@dataclass(frozen=True)
class LimitTable:
    """The limits of one robot, and what they are compared with."""

    identity: dict  # of the sweep
    situations: list[Situation]  # those of the paper come first
    mechanisms: list[str]  # fewer before more
    records: list[Record]  # every cell of these and the directions
    assumptions: list[str]  # of the limits of any controller

    def title(self, mechanisms: str) -> str:
        """The words for these mechanisms, or for the policy."""
        return self.identity.get("controller", mechanisms).split(" ")[0]

    def protocol(self, situation: Situation) -> Protocol | None:
        """The paper's figure of a situation, if any."""
        return protocol_of(self.identity["robot"], situation)

    def of(self, mechanisms: str, situation: Situation) -> list[Record]:
        """The records of all directions."""
        wanted = *situation, mechanisms
        return [r for r in self.records if Cell.of(r)[:3] == wanted]


def limit_table(rows: Rows, scenarios: dict[str, Scenario]) -> LimitTable:
    """The limits by the rows of these scenarios; ValueError: as limits_of."""
    groups = rows.by_cell()
    situations = sorted(
        {cell[:2] for cell in groups},
        key=lambda one: (protocol_of(rows.identity["robot"], one) is None, one),
    )
    tried = {cell.mechanisms for cell in groups}
    mechanisms = [name for name in switches.NAMED if name in tried]
    records, assumptions = [], set()
    for one in situations:
        limits = limits_of(scenarios[one[0]], one)
        if limits:
            assumptions.add(limits[0].assumptions)
        for name in mechanisms:
            on = [replace(limit, on=switches.NAMED[name]) for limit in limits]
            for direction in sorted({cell.direction_deg for cell in groups}):
                cell = Cell(*one, name, direction)
                trials = groups.get(cell, [])
                records.append(_record(cell, rows.identity, trials, on))
    found = situations, mechanisms, records, sorted(assumptions)
    return LimitTable(rows.identity, *found)


def _record(cell: Cell, identity: dict, rows: list[dict], limits) -> Record:
    names = vars(SearchParams())
    search = SearchParams(**{name: identity[name] for name in names})
    found = limit(results_of(rows), search)
    best = [row for row in rows if row["delta_v"] == found.recovered]

    def worst(name: str) -> float | None:
        values = [row[name] for row in best if row["outcome"] == "recovered"]
        return max((v for v in values if v is not None), default=None)

    protocol = protocol_of(identity["robot"], cell[:2])
    paper = protocol.curves(cell.scenario) if protocol else {}
    others = [paper.get(cell.mechanisms, {}).get(cell.direction_deg)]
    others += [limit.largest_push(cell.direction_deg) for limit in limits]
    others += [None] * (len(OTHERS) - len(others))
    return {
        **cell._asdict(),
        "trials": len(rows),
        **found._asdict(),
        **dict(zip(OTHERS, others, strict=True)),
        **{name: worst(name) for name in WORST},
    }


def limits_of(
    scenario: Scenario, situation: Situation
) -> tuple[LipmLimit, ...]:
    """Returns the limits of a point mass at its push, see OTHERS.

    None for a robot that stands: which foot it will lift is not known.

    Raises ValueError: the push is not within the walk.
    """
    if situation[1] == STANDING:
        return ()
    robot = load_robot(scenario.robot, scenario.fidelity)
    true = scenario.terrain.ground(robot.sole, robot.params.size)
    known = scenario.point_mass(robot).ground
    if not all(ground is None or ground.is_level for ground in (true, known)):
        flat = replace(scenario.terrain, name="flat")
        scenario = scenario.changed(terrain=flat)
    scenario = scenario.changed(engine="drake", sensors="perfect")
    scenario = scenario.with_push(delta_v=0.0, at=situation[1])
    push = scenario.pushes[0]
    diagram = LipmDiagram(scenario)
    context, run = walk_to_push(diagram)
    if not run.until:
        raise ValueError(f"at = {push.at!r}: must be in the walk")
    more = {"model": robot.point_mass, "push_duration": push.duration}
    limit = limit_from(diagram, context, **more)
    params = scenario.controller
    with_hips = replace(limit, kappa=params.balance.max_kappa)
    falling = replace(with_hips, fall=params.com_height.max_velocity)
    return limit, with_hips, falling


def first_pushes(sweep: Sweep) -> dict[Cell, float]:
    """Returns the first push of each cell, `BEGIN` times the limit with hips.

    Raises ValueError: the push is not within the walk.
    """
    limits: dict[Situation, tuple[LipmLimit, ...]] = {}
    model = load_robot(sweep.one.robot).point_mass
    speed = model.omega * model.com_height  # sqrt(g z)
    first = {}
    for cell in sweep.cells():
        if (one := cell[:2]) not in limits:
            limits[one] = limits_of(sweep.scenarios[one[0]], one)
        if not limits[one]:
            first[cell] = BEGIN_STANDING * speed
            continue
        limit = replace(limits[one][1], on=switches.NAMED[cell.mechanisms])
        first[cell] = BEGIN * limit.largest_push(cell.direction_deg)
    return first


def known_limits(folder: Path) -> dict[Cell, float]:
    """Limits [m/s] of a sweep's limits.csv; ValueError or OSError: none."""
    found = {}
    try:
        with open(folder / LIMITS, encoding="utf-8", newline="") as file:
            for line in csv.DictReader(file):
                angle = float(line["direction_deg"])
                limit = float(line["recovered"] or 0.0)
                if not (0.0 <= angle < 360.0 and 0.0 <= limit <= MOST):
                    raise ValueError
                found[Cell.of(line | {"direction_deg": angle})] = limit
    except (csv.Error, KeyError, TypeError, ValueError):
        found = {}  # of one that is no sweep's, nothing is known
    if not found:
        raise ValueError(f"limits = {str(folder)!r}: must have a {LIMITS}")
    return found
