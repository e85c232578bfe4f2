"""How often the capture regions were wrong about how a trial would end."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from diagrams.mechanisms import MECHANISMS
from nadia_balance.core.capturability import LOST

ALL = "all"  # the trials of all mechanisms together

RECOVERED = "recovered"
JUDGED = (RECOVERED, "fell", "failed")  # other outcomes are no answer


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Predictions of the trials' outcome, and how many were false."""

    capturable: int  # predicted: in 0 to N steps
    false_capturable: int  # of them, of a trial that did not recover
    lost: int  # predicted
    false_lost: int  # of them, of a trial that recovered

    @property
    def predictions(self) -> int:
        """How many there are."""
        return self.capturable + self.lost

    @property
    def false_capturable_rate(self) -> float | None:
        """Share of what was predicted capturable; None if nothing was."""
        return _share(self.false_capturable, self.capturable)

    @property
    def false_lost_rate(self) -> float | None:
        """Share of what was predicted lost; None if nothing was."""
        return _share(self.false_lost, self.lost)


@dataclass(frozen=True, kw_only=True)
class Confusion:
    """The rates of the trials with some mechanisms."""

    mechanisms: str  # their name, or `all`
    trials: int  # that recovered, fell or failed
    left_out: int  # that crashed, hung or stopped: nothing is known of them
    at_push: Rates  # one prediction a trial, when the push ends
    at_touchdowns: Rates  # one for each touchdown after it


def confusion(rows: Iterable[Mapping]) -> tuple[Confusion, ...]:
    """Returns the rates for each mechanism that has trials, and for all.

    Each row is a trial: a mapping with `mechanisms`, `outcome`,
    `predicted_at_push` (a whole number, -1 for lost; None or "" if the push
    did not end) and `predicted_at_touchdowns` ("2;1;0", or the numbers).  The
    mechanisms are in the order of the paper's Fig. 10, then `all`.
    """
    rows = list(rows)
    names = {row["mechanisms"] for row in rows}
    order = [name for name in MECHANISMS if name in names]
    order += sorted(names.difference(MECHANISMS))
    groups = [[r for r in rows if r["mechanisms"] == name] for name in order]
    return (
        *(_of(name, g) for name, g in zip(order, groups, strict=True)),
        _of(ALL, rows),
    )


def _of(name: str, rows: Sequence[Mapping]) -> Confusion:
    judged = [row for row in rows if row["outcome"] in JUDGED]
    at_push, at_touchdowns = [], []
    for row in judged:
        recovered = row["outcome"] == RECOVERED
        push = row["predicted_at_push"]
        if push not in (None, ""):
            at_push.append((int(push), recovered))
        landings = row["predicted_at_touchdowns"] or ()
        if isinstance(landings, str):
            landings = landings.split(";")
        at_touchdowns += [(int(n), recovered) for n in landings]
    return Confusion(
        mechanisms=name,
        trials=len(judged),
        left_out=len(rows) - len(judged),
        at_push=_rates(at_push),
        at_touchdowns=_rates(at_touchdowns),
    )


def _rates(predictions: Sequence[tuple[int, bool]]) -> Rates:
    capturable = [recovered for n, recovered in predictions if n != LOST]
    lost = [recovered for n, recovered in predictions if n == LOST]
    return Rates(
        capturable=len(capturable),
        false_capturable=capturable.count(False),
        lost=len(lost),
        false_lost=lost.count(True),
    )


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None
