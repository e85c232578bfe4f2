"""How often the capture regions were wrong about how a trial would end."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from diagrams.envelope.envelope_data import NO_ANSWER
from diagrams.mechanisms import MECHANISMS
from nadia_balance.core.capturability import LOST

ALL = "all"  # the trials of all mechanisms together


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Predictions of the trials' outcome, and how many were false."""

    capturable: int  # predicted: in 0 to N steps
    false_capturable: int  # of them, of a trial that did not recover
    lost: int  # predicted
    false_lost: int  # of them, of a trial that recovered

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
    """The rates of the trials with some mechanisms.

    Trials that crashed, hung or stopped are left out.  The predictions at the
    touchdowns of one trial depend on each other, and a trial that recovered
    has more of them than another one.
    """

    mechanisms: str  # their name, or `all`
    at_push: Rates  # one prediction a trial, when the push ends
    at_first_touchdown: Rates  # one a trial, at the first after that
    at_touchdowns: Rates  # one for each touchdown after the push


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
    at_push, at_first, at_touchdowns = [], [], []
    for row in rows:
        if row["outcome"] in NO_ANSWER:
            continue
        recovered = row["outcome"] == "recovered"
        push = row["predicted_at_push"]
        if push not in (None, ""):
            at_push.append((int(push), recovered))
        landings = row["predicted_at_touchdowns"] or ()
        if isinstance(landings, str):
            landings = landings.split(";")
        predicted = [(int(n), recovered) for n in landings]
        at_first += predicted[:1]
        at_touchdowns += predicted
    return Confusion(
        mechanisms=name,
        at_push=_rates(at_push),
        at_first_touchdown=_rates(at_first),
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
