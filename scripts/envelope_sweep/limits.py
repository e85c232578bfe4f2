"""The push-recovery envelope, computed from the rows of a sweep's trials."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

from nadia_balance.analysis.lipm_limit import LOST
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

ORDER = tuple(NAMED)  # fewer mechanisms before more
# Marks of a limit: search not complete; no larger push was decided.
UNSURE, AT_LEAST = "~", ">="

Limits = dict[float, Limit]  # direction [deg] in [0, 360) -> limit


class References(NamedTuple):
    """Reference curves by the name of the mechanisms; empty if unknown."""

    paper: Curves
    limit: Curves  # of any controller, without angular momentum
    with_hips: Curves  # of any controller, with angular momentum


def paper_curves(robot: str, situation: Situation) -> Curves:
    """Returns the paper's curves for this robot and situation, if any."""
    protocol = protocol_of(robot, situation)
    return protocol.curves(situation.scenario) if protocol else {}


@dataclass(frozen=True, kw_only=True)
class Physical:
    """The limits of any controller in one situation (analysis.lipm_limit)."""

    limit: Curves
    with_hips: Curves
    assumptions: str  # of `limit`


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """The limits of one robot, by mechanisms, situation and direction."""

    robot: str
    plant: str
    search: SearchParams
    rows: Sequence[dict]  # the trials of read_trials
    limits: dict[Cell, Limit]
    physical: Mapping[Situation, Physical] = field(default_factory=dict)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """The mechanisms that were tried, fewer before more."""
        return tuple(
            sorted({cell.mechanisms for cell in self.limits}, key=ORDER.index)
        )

    @property
    def situations(self) -> tuple[Situation, ...]:
        """The situations that were tried; those of the paper come first."""
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
        """The paper's figure with reference limits, if any."""
        return protocol_of(self.robot, self.situations[0])

    @property
    def directions(self) -> tuple[float, ...]:
        """The directions that were tried [deg], in [0, 360)."""
        return tuple(sorted({cell.direction_deg for cell in self.limits}))

    @property
    def cells(self) -> list[Cell]:
        """All cells of these mechanisms, situations and directions."""
        return [
            Cell(name, situation, direction)
            for name in self.mechanisms
            for situation in self.situations
            for direction in self.directions
        ]

    @property
    def missing(self) -> list[Cell]:
        """The cells whose search is not complete, or has not begun."""
        return [
            cell
            for cell in self.cells
            if cell not in self.limits or not self.limits[cell].complete
        ]

    @property
    def undecided(self) -> set[Cell]:
        """The cells without a limit, because no trial was decided."""
        return {cell_of(row) for row in self.rows}.difference(self.limits)

    def known(self, situation: Situation) -> References:
        """The reference curves of this situation."""
        paper = paper_curves(self.robot, situation)
        if (physical := self.physical.get(situation)) is None:
            return References(paper, {}, {})
        return References(paper, physical.limit, physical.with_hips)

    @property
    def unit(self) -> str:
        """The unit of the paper's figure, m/s without one."""
        return self.protocol.unit if self.protocol else "m/s"

    @property
    def unit_speed(self) -> float:
        """The change of velocity [m/s] of one unit."""
        return self.protocol.unit_speed if self.protocol else 1.0

    def words(self, velocity: float) -> str:
        """A velocity [m/s] with the decimals of the search's resolution."""
        text = f"{self.search.resolution:.6f}".rstrip("0")
        decimals = max(2, len(text.partition(".")[2]))
        return f"{velocity:.{decimals}f}"

    def limit_words(self, limit: Limit, unit: float = 1.0) -> str:
        """The largest recovered push [m/s / unit], with its mark."""
        return f"{mark([limit])}{self.words(limit.recovered / unit)}"

    def curve(self, mechanisms: str, situation: Situation) -> Limits:
        """The limits by direction; directions without trials are left out."""
        return {
            direction: self.limits[cell]
            for direction in self.directions
            if (cell := Cell(mechanisms, situation, direction)) in self.limits
        }


def mark(limits: Iterable[Limit]) -> str:
    """Returns the mark of a number made of these limits, such as their mean.

    `~` if the search of one is not complete, otherwise `>=` if no failed push
    of one is known, otherwise "".
    """
    limits = list(limits)
    if not all(limit.complete for limit in limits):
        return UNSURE
    return AT_LEAST if any(limit.failed is None for limit in limits) else ""


def envelope_of(identity: dict, rows: Sequence[dict]) -> Envelope:
    """Returns the envelope of the trials of one file (see read_trials).

    A cell without a decided trial has no limit.

    Raises:
        ValueError: no trial, or no decided one.
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
    """Mass and speed that make a push dimensionless."""

    mass: float  # [kg]
    speed: float  # sqrt(g z), z the height of the CoM [m/s]


def scale_of(robot: str) -> Scale | None:
    """Returns the scale of a robot.

    None if it cannot be loaded: the robot of old results may not exist.
    """
    try:
        model = load_robot(robot).point_mass
    except (ValueError, OSError):
        return None
    return Scale(model.mass, model.omega * model.com_height)


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Numbers of predictions of the trials' outcome, and of false ones."""

    capturable: int  # predicted capturable in 0 to N steps
    false_capturable: int  # of these, the robot did not recover
    lost: int  # predicted lost
    false_lost: int  # of these, the robot recovered


def confusion(rows: Iterable[Mapping]) -> dict[str, Rates]:
    """Returns the false predictions of the point-mass limit, by instant.

    Each row is a trial: a mapping with `outcome`, `predicted_at_push` (None if
    the push did not end) and `predicted_at_touchdowns`, such as "2;1;0".
    Undecided trials and those without a result are left out.  The touchdowns of
    one trial are not independent, and recovered trials have more of them.
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
