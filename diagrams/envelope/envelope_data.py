"""The envelope that the trials of a sweep trace, from their rows alone."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

from diagrams.envelope.limit_search import (
    Limit,
    SearchParams,
    limit,
)
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT, References, references
from diagrams.mechanisms import MECHANISMS
from nadia_balance.robot import load_robot

ORDER = tuple(MECHANISMS)  # fewer before more
# Of directions [deg], relative to the heading of the stance foot.
WORDS = {0.0: "forward", 90.0: "left", 180.0: "backward", 270.0: "right"}
NO_ANSWER = ("error", "crashed", "hung")  # outcomes, no fault of the robot
# Before a figure: the search goes on; nothing larger was tried.
UNSURE, AT_LEAST = "~", ">="
TOLERANCE = 0.03  # what counts as no less, where limits are finer [m/s]
_ROUNDING = 1e-9

Limits = dict[float, Limit]  # direction [deg] in [0, 360) -> limit
Key = tuple[str, Moment, float]  # mechanisms, moment, direction [deg]


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """The limits of one robot, by mechanisms, moment and direction."""

    robot: str
    scenario: str
    plant: str
    search: SearchParams
    rows: Sequence[dict]  # the trials, as read_trials gives them
    limits: dict[Key, Limit]

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Those that were tried, fewer before more."""
        found = {mechanisms for mechanisms, _, _ in self.limits}
        return tuple(sorted(found, key=ORDER.index))

    @property
    def moments(self) -> tuple[Moment, ...]:
        """Those that were tried; the one of the references comes first."""
        found = {moment for _, moment, _ in self.limits}
        return tuple(sorted(found, key=lambda m: (m != MOMENT, m)))

    @property
    def directions(self) -> tuple[float, ...]:
        """Those that were tried [deg], in [0, 360)."""
        return tuple(sorted({direction for _, _, direction in self.limits}))

    @property
    def missing(self) -> list[Key]:
        """Those whose search has more to try, or has not begun."""
        return [
            (name, moment, direction)
            for name in self.mechanisms
            for moment in self.moments
            for direction in self.directions
            if (found := self.limits.get((name, moment, direction))) is None
            or not found.complete
        ]

    @property
    def tolerance(self) -> float:
        """So much less counts as no less: the edge is ragged [m/s]."""
        return max(TOLERANCE, self.search.resolution)

    def known(self, moment: Moment) -> References:
        """What the limits at this moment can be compared with."""
        return references(self.robot, self.scenario, moment)

    def words(self, velocity: float) -> str:
        """A velocity [m/s] with as many decimals as tell two limits apart."""
        text = f"{self.search.resolution:.6f}".rstrip("0")
        decimals = max(2, len(text.partition(".")[2]))
        return f"{velocity:.{decimals}f}"

    def limit_words(self, limit: Limit) -> str:
        """The largest recovered push [m/s], and how sure it is."""
        return f"{mark([limit])}{self.words(limit.recovered)}"

    def curve(self, mechanisms: str, moment: Moment) -> Limits:
        """The limits around the robot; no entry where nothing was tried."""
        return {
            direction: self.limits[mechanisms, moment, direction]
            for direction in self.directions
            if (mechanisms, moment, direction) in self.limits
        }


@dataclass(frozen=True, kw_only=True)
class Loss:
    """More mechanisms, and yet a smaller push that is recovered from."""

    moment: Moment
    direction_deg: float
    fewer: str
    more: str
    by_fewer: Limit
    by_more: Limit

    @property
    def final(self) -> bool:
        """Both limits are complete."""
        return self.by_fewer.complete and self.by_more.complete


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
    names = [field.name for field in fields(SearchParams)]
    search = SearchParams(**{name: identity[name] for name in names})
    return Envelope(
        robot=rows[0]["robot"],
        scenario=rows[0]["scenario"],
        plant=rows[0]["plant"],
        search=search,
        rows=rows,
        limits={
            key: limit(results, search)
            for key, results in _results(rows, search).items()
        },
    )


def losses(envelope: Envelope) -> list[Loss]:
    """Returns where more mechanisms recover less, by more than the tolerance.

    Of several sets of fewer mechanisms, the best one is compared with.
    """
    found, enough = [], envelope.tolerance + _ROUNDING
    for moment in envelope.moments:
        for direction in envelope.directions:
            tried = [
                (name, envelope.limits[name, moment, direction])
                for name in envelope.mechanisms
                if (name, moment, direction) in envelope.limits
            ]
            for i, (more, least) in enumerate(tried[1:], start=1):
                fewer, best = max(tried[:i], key=lambda t: t[1].recovered)
                if best.recovered - least.recovered > enough:
                    found.append(
                        Loss(
                            moment=moment,
                            direction_deg=direction,
                            fewer=fewer,
                            more=more,
                            by_fewer=best,
                            by_more=least,
                        )
                    )
    return found


def characteristic_speed(robot: str) -> float | None:
    """Returns sqrt(g z) [m/s] of the robot's CoM height z.

    None if the robot cannot be loaded: results outlive the files of a robot.
    """
    try:
        model = load_robot(robot)
    except (ValueError, OSError):
        return None
    return model.omega * model.com_height


def _results(
    rows: Sequence[dict], search: SearchParams
) -> dict[Key, dict[tuple[int, int], bool]]:
    """What each cell's search has seen: (level, replica) -> recovered."""
    found: dict[Key, dict[tuple[int, int], bool]] = {}
    for row in rows:
        moment = Moment.parse(row["phase"])
        key = row["mechanisms"], moment, row["direction_deg"]
        trial = round(row["delta_v"] / search.resolution), row["replica"]
        cell = found.setdefault(key, {})
        cell[trial] = row["outcome"] == "recovered"
    return found
