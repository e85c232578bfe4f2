"""How the trials of an envelope ended, and what was predicted of them."""

from collections import Counter

from diagrams.envelope.confusion import ALL, Rates, confusion
from diagrams.envelope.envelope_data import NO_ANSWER, Envelope, losses
from diagrams.envelope.limit_tables import direction_words
from diagrams.envelope.markdown import NOTHING, table

OUTCOMES = {
    "recovered": "recovered",
    "fell": "fell, or went down past saving",
    "failed": "stayed upright, but did not recover as defined above",
    "error": "the simulation stopped with an error",
    "crashed": "the process died",
    "hung": "the process was stopped because it took too long",
}
_MOST_REASONS = 10


def losses_section(envelope: Envelope) -> str:
    """Where more mechanisms recover less than fewer, beyond the tolerance."""
    if len(envelope.mechanisms) == 1:
        return "Only one set of mechanisms was tried.\n"
    found, enough = losses(envelope), f"{envelope.tolerance:g} m/s"
    if not found:
        return f"No: nowhere by more than {enough}.\n"
    rows = [
        [
            f"{direction_words(loss.direction_deg)}, {loss.moment}",
            f"`{loss.more}` {envelope.limit_words(loss.by_more)}",
            f"`{loss.fewer}` {envelope.limit_words(loss.by_fewer)}",
            envelope.words(loss.by_more.recovered - loss.by_fewer.recovered),
            "yes" if loss.final else "no",
        ]
        for loss in found
    ]
    head = ["where", "more [m/s]", "fewer [m/s]", "difference", "complete"]
    number = "Once" if len(found) == 1 else f"{len(found)} times"
    return f"{number}, by more than {enough}:\n\n{table(head, rows)}"


def outcomes_section(envelope: Envelope) -> str:
    """How many trials ended in which way, by mechanisms."""
    rows = envelope.rows
    counts = Counter((row["outcome"], row["mechanisms"]) for row in rows)
    outcomes = list(OUTCOMES)
    outcomes += sorted({row["outcome"] for row in rows} - set(OUTCOMES))
    lines = []
    for outcome in outcomes:
        cells = [counts[outcome, name] for name in envelope.mechanisms]
        meaning = OUTCOMES.get(outcome, outcome)
        lines.append([meaning, *map(str, [*cells, sum(cells)])])
    lines = [line for line in lines if line[-1] != "0"]
    head = ["outcome", *(f"`{name}`" for name in envelope.mechanisms), "all"]
    return table(head, lines) + _reservations(envelope) + _broken(envelope)


def capturability_section(envelope: Envelope) -> str:
    """How often the capture regions were wrong, and when."""
    head = [
        "mechanisms",
        "when",
        "predicted capturable",
        "of them did not recover",
        "predicted lost",
        "of them recovered",
    ]
    lines = []
    for found in confusion(envelope.rows):
        name = found.mechanisms
        name = name if name == ALL else f"`{name}`"
        lines += [
            [name, "end of the push", *_rates(found.at_push)],
            [name, "first touchdown", *_rates(found.at_first_touchdown)],
            [name, "every touchdown", *_rates(found.at_touchdowns)],
        ]
    return table(head, lines)


def _rates(rates: Rates) -> list[str]:
    return [
        str(rates.capturable),
        _share(rates.false_capturable, rates.false_capturable_rate),
        str(rates.lost),
        _share(rates.false_lost, rates.false_lost_rate),
    ]


def _share(count: int, rate: float | None) -> str:
    return NOTHING if rate is None else f"{count} ({100.0 * rate:.1f} %)"


def _reservations(envelope: Envelope) -> str:
    """Why less was asked of trials that recovered; empty if it was not."""
    reasons = Counter(
        row["reason"]
        for row in envelope.rows
        if row["outcome"] == "recovered" and row["reason"]
    )
    return _reasons("Recovered with a reservation:", reasons)


def _broken(envelope: Envelope) -> str:
    """Why trials gave no answer; empty if all did."""
    reasons = Counter(
        f"{row['outcome']}: {row['reason']}"
        for row in envelope.rows
        if row["outcome"] in NO_ANSWER
    )
    title = "Trials without an answer count as not recovered:"
    return _reasons(title, reasons)


def _reasons(title: str, reasons: Counter[str]) -> str:
    """The most frequent ones below a title; empty if there are none."""
    if not reasons:
        return ""
    lines = [f"* {n} x {r}" for r, n in reasons.most_common(_MOST_REASONS)]
    if (more := len(reasons) - _MOST_REASONS) > 0:
        lines.append(f"* and {more} other reasons")
    return f"\n{title}\n\n" + "".join(f"{line}\n" for line in lines)
