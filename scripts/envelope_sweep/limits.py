"""The envelope that the trials of a sweep trace, from their rows alone."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

from nadia_balance.core.capturability import LOST
from nadia_balance.core.mechanisms import NAMED
from nadia_balance.core.push import Moment
from nadia_balance.robot import load_robot
from nadia_balance.scripts.envelope_sweep.protocols import (
    Curves,
    Protocol,
    protocol_of,
)
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    Limit,
    SearchParams,
    Situation,
    limit,
)
from nadia_balance.scripts.envelope_sweep.trials_file import (
    NO_ANSWER,
    UNDECIDED,
    cell_of,
    recovered,
)

ORDER = tuple(NAMED)  # fewer before more
# Before a figure: the search goes on; nothing larger was decided.
UNSURE, AT_LEAST = "~", ">="

Limits = dict[float, Limit]  # direction [deg] in [0, 360) -> limit


class References(NamedTuple):
    """Curves by the name of the mechanisms; empty where there is none."""

    paper: Curves
    limit: Curves  # of any controller, without momentum
    with_hips: Curves  # and with it


def paper_curves(robot: str, situation: Situation) -> Curves:
    """Returns the paper's curves, if its robot was pushed so."""
    protocol = protocol_of(robot, situation)
    return protocol.curves(situation.scenario) if protocol else {}


@dataclass(frozen=True, kw_only=True)
class Physical:
    """The limits of any controller in one situation (core.lipm_limit)."""

    limit: Curves
    with_hips: Curves
    assumptions: str  # of `limit`


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """The limits of one robot, by mechanisms, situation and direction."""

    robot: str
    plant: str
    search: SearchParams
    rows: Sequence[dict]  # the trials, as read_trials gives them
    limits: dict[Cell, Limit]
    physical: Mapping[Situation, Physical] = field(default_factory=dict)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Those that were tried, fewer before more."""
        return tuple(
            sorted({cell.mechanisms for cell in self.limits}, key=ORDER.index)
        )

    @property
    def situations(self) -> tuple[Situation, ...]:
        """Those that were tried; those of the references come first."""
        found = {cell.situation for cell in self.limits}
        return tuple(sorted(found, key=self._rank))

    def _rank(self, situation: Situation) -> tuple:
        moment = Moment.parse(situation.at)
        phase, swing = moment.phase, moment.swing
        unknown = protocol_of(self.robot, situation) is None
        when = phase and phase.value, swing.value, moment.fraction
        return unknown, situation.scenario, *when

    @property
    def protocol(self) -> Protocol | None:
        """The paper's figure that the limits can be compared with, if any."""
        return protocol_of(self.robot, self.situations[0])

    @property
    def directions(self) -> tuple[float, ...]:
        """Those that were tried [deg], in [0, 360)."""
        return tuple(sorted({cell.direction_deg for cell in self.limits}))

    @property
    def cells(self) -> list[Cell]:
        """All that there are of those."""
        return [
            Cell(name, situation, direction)
            for name in self.mechanisms
            for situation in self.situations
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

    @property
    def undecided(self) -> set[Cell]:
        """Those without a limit, as no trial was decided."""
        return {cell_of(row) for row in self.rows}.difference(self.limits)

    def known(self, situation: Situation) -> References:
        """What the limits in this situation can be compared with."""
        paper = paper_curves(self.robot, situation)
        if (physical := self.physical.get(situation)) is None:
            return References(paper, {}, {})
        return References(paper, physical.limit, physical.with_hips)

    @property
    def unit(self) -> str:
        """That of the paper's figure."""
        return self.protocol.unit if self.protocol else "m/s"

    @property
    def unit_speed(self) -> float:
        """How much it changes the velocity [m/s]."""
        return self.protocol.unit_speed if self.protocol else 1.0

    def words(self, velocity: float) -> str:
        """A velocity [m/s] with as many decimals as tell two limits apart."""
        text = f"{self.search.resolution:.6f}".rstrip("0")
        decimals = max(2, len(text.partition(".")[2]))
        return f"{velocity:.{decimals}f}"

    def limit_words(self, limit: Limit, unit: float = 1.0) -> str:
        """The largest recovered push [m/s / unit], and how sure it is."""
        return f"{mark([limit])}{self.words(limit.recovered / unit)}"

    def curve(self, mechanisms: str, situation: Situation) -> Limits:
        """The limits around the robot; no entry where nothing was tried."""
        return {
            direction: self.limits[cell]
            for direction in self.directions
            if (cell := Cell(mechanisms, situation, direction)) in self.limits
        }


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

    A cell in which nothing was decided has no limit.

    Raises:
        ValueError: there is no trial, or none that was decided.
    """
    if not rows:
        raise ValueError("rows = []: must have at least one trial")
    if all(recovered(row) is None for row in rows):
        raise ValueError(
            f"rows: must have a trial that was decided, of {len(rows)}; the "
            f"first is {rows[0]['reason']}"
        )
    search = SearchParams(
        **{f.name: identity[f.name] for f in fields(SearchParams)}
    )
    results: dict[Cell, dict[tuple[int, int], bool | None]] = {}
    for row in rows:
        trial = round(row["delta_v"] / search.resolution), row["replica"]
        results.setdefault(cell_of(row), {})[trial] = recovered(row)
    return Envelope(
        robot=rows[0]["robot"],
        plant=rows[0]["plant"],
        search=search,
        rows=rows,
        limits={
            cell: found
            for cell, seen in results.items()
            if (found := limit(seen, search)) is not None
        },
    )


class Scale(NamedTuple):
    """What a push is measured by."""

    mass: float  # [kg]
    speed: float  # sqrt(g z), z the height of the CoM [m/s]


def scale_of(robot: str) -> Scale | None:
    """Returns the scale of a robot.

    None if it cannot be loaded: results outlive the files of a robot.
    """
    try:
        model = load_robot(robot).point_mass
    except (ValueError, OSError):
        return None
    return Scale(model.mass, model.omega * model.com_height)


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
        if row["outcome"] in (UNDECIDED, *NO_ANSWER):
            continue
        success, push = recovered(row), row["predicted_at_push"]
        landings = [
            int(n) for n in row["predicted_at_touchdowns"].split(";") if n
        ]
        steps = ([] if push is None else [push], landings[:1], landings)
        for found, predicted in zip(told.values(), steps, strict=True):
            found += [(n, success) for n in predicted]
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
