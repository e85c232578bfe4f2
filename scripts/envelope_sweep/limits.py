"""The envelope that the trials of a sweep trace, from their rows alone."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

from nadia_balance.core.capturability import LOST
from nadia_balance.core.mechanisms import MECHANISMS
from nadia_balance.core.push import Moment
from nadia_balance.robot import MODELS, load_robot
from nadia_balance.scripts.envelope_sweep.plan import AT, SCENARIO
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    Limit,
    SearchParams,
    limit,
)

ROBOT = "nadia"  # that there are references for
ORDER = tuple(MECHANISMS)  # fewer before more
NO_ANSWER = ("error", "crashed", "hung")  # outcomes, no fault of the robot
# Before a figure: the search goes on; nothing larger was tried.
UNSURE, AT_LEAST = "~", ">="

Curve = dict[float, float]  # direction [deg] in [0, 360) -> velocity [m/s]
Limits = dict[float, Limit]  # direction [deg] in [0, 360) -> limit


class References(NamedTuple):
    """Curves by the name of the mechanisms; empty where there is none."""

    paper: dict[str, Curve]  # Nadia, Fig. 10
    limit: dict[str, Curve]  # of any controller


def references(robot: str, scenario: str, at: str) -> References:
    """Returns what a robot's pushes at a moment can be compared with."""
    if (robot, scenario, at) != (ROBOT, SCENARIO, AT):
        return References({}, {})
    return References(_read("nadia_fig10.csv"), _read("lipm_limit.csv"))


def _read(name: str) -> dict[str, Curve]:
    text = (MODELS / ROBOT / name).read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    curves: dict[str, Curve] = {}
    for row in csv.DictReader(lines):
        direction = float(row.pop("direction"))
        for mechanisms, value in row.items():
            curves.setdefault(mechanisms, {})[direction] = float(value)
    return curves


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """The limits of one robot, by mechanisms, moment and direction."""

    robot: str
    scenario: str
    plant: str
    search: SearchParams
    rows: Sequence[dict]  # the trials, as read_trials gives them
    limits: dict[Cell, Limit]

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Those that were tried, fewer before more."""
        return tuple(
            sorted({cell.mechanisms for cell in self.limits}, key=ORDER.index)
        )

    @property
    def moments(self) -> tuple[str, ...]:
        """Those that were tried; the one of the references comes first."""
        return tuple(sorted({cell.at for cell in self.limits}, key=_rank))

    @property
    def directions(self) -> tuple[float, ...]:
        """Those that were tried [deg], in [0, 360)."""
        return tuple(sorted({cell.direction_deg for cell in self.limits}))

    @property
    def cells(self) -> list[Cell]:
        """All that there are of those."""
        return [
            Cell(name, at, direction)
            for name in self.mechanisms
            for at in self.moments
            for direction in self.directions
        ]

    @property
    def missing(self) -> list[Cell]:
        """Those whose search has more to try, or has not begun."""
        return [
            cell
            for cell in self.cells
            if cell not in self.limits or not self.limits[cell].complete
        ]

    def known(self, at: str) -> References:
        """What the limits at this moment can be compared with."""
        return references(self.robot, self.scenario, at)

    def words(self, velocity: float) -> str:
        """A velocity [m/s] with as many decimals as tell two limits apart."""
        text = f"{self.search.resolution:.6f}".rstrip("0")
        decimals = max(2, len(text.partition(".")[2]))
        return f"{velocity:.{decimals}f}"

    def limit_words(self, limit: Limit) -> str:
        """The largest recovered push [m/s], and how sure it is."""
        return f"{mark([limit])}{self.words(limit.recovered)}"

    def curve(self, mechanisms: str, at: str) -> Limits:
        """The limits around the robot; no entry where nothing was tried."""
        return {
            direction: self.limits[cell]
            for direction in self.directions
            if (cell := Cell(mechanisms, at, direction)) in self.limits
        }


def _rank(at: str) -> tuple:
    moment = Moment.parse(at)
    phase, swing = moment.phase, moment.swing
    return at != AT, phase and phase.value, swing.value, moment.fraction


def mark(limits: Iterable[Limit]) -> str:
    """What stands before a figure of these limits, such as their mean.

    That is `~` if the search for one goes on, or else `>=` if nothing larger
    was tried of one, or else nothing.
    """
    limits = list(limits)
    if not all(limit.complete for limit in limits):
        return UNSURE
    return AT_LEAST if any(limit.failed is None for limit in limits) else ""


def envelope_of(identity: dict, rows: Sequence[dict]) -> Envelope:
    """Returns the envelope of the trials of one file, as read_trials gives it.

    Raises:
        ValueError: there is no trial.
    """
    if not rows:
        raise ValueError("rows = []: must have at least one trial")
    search = SearchParams(
        **{f.name: identity[f.name] for f in fields(SearchParams)}
    )
    results: dict[Cell, dict[tuple[int, int], bool]] = {}
    for row in rows:
        cell = Cell(row["mechanisms"], row["at"], row["direction_deg"])
        trial = round(row["delta_v"] / search.resolution), row["replica"]
        recovered = row["outcome"] == "recovered"
        results.setdefault(cell, {})[trial] = recovered
    return Envelope(
        robot=rows[0]["robot"],
        scenario=rows[0]["scenario"],
        plant=rows[0]["plant"],
        search=search,
        rows=rows,
        limits={cell: limit(seen, search) for cell, seen in results.items()},
    )


def characteristic_speed(robot: str) -> float | None:
    """Returns sqrt(g z) [m/s] of the robot's CoM height z.

    None if the robot cannot be loaded: results outlive the files of a robot.
    """
    try:
        model = load_robot(robot).point_mass
    except (ValueError, OSError):
        return None
    return model.omega * model.com_height


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Predictions of the trials' outcome, and how many were false."""

    capturable: int  # predicted: in 0 to N steps
    false_capturable: int  # of them, of a trial that did not recover
    lost: int  # predicted
    false_lost: int  # of them, of a trial that recovered


def confusion(rows: Iterable[Mapping]) -> dict[str, Rates]:
    """Returns how often the capture regions were wrong, and when.

    Each row is a trial: a mapping with `outcome`, `predicted_at_push` (None if
    the push did not end) and `predicted_at_touchdowns`, such as "2;1;0".
    Trials without an answer are left out.  The touchdowns of one trial depend
    on each other, and a trial that recovered has more of them than another.
    """
    told: dict[str, list[tuple[int, bool]]] = {
        "end of the push": [],
        "first touchdown": [],
        "every touchdown": [],
    }
    for row in rows:
        if row["outcome"] in NO_ANSWER:
            continue
        recovered, push = (
            row["outcome"] == "recovered",
            row["predicted_at_push"],
        )
        landings = [
            int(n) for n in row["predicted_at_touchdowns"].split(";") if n
        ]
        steps = ([] if push is None else [push], landings[:1], landings)
        for found, predicted in zip(told.values(), steps, strict=True):
            found += [(n, recovered) for n in predicted]
    return {when: _rates(found) for when, found in told.items()}


def _rates(predictions: Sequence[tuple[int, bool]]) -> Rates:
    capturable = [recovered for n, recovered in predictions if n != LOST]
    lost = [recovered for n, recovered in predictions if n == LOST]
    return Rates(
        capturable=len(capturable),
        false_capturable=capturable.count(False),
        lost=len(lost),
        false_lost=lost.count(True),
    )
