"""The largest pushes that a robot recovers from, as lines for a terminal."""

from diagrams.envelope.envelope_data import (
    AT_LEAST,
    NO_ANSWER,
    UNSURE,
    Envelope,
    mark,
)
from diagrams.envelope.moment import Moment


def table_lines(envelope: Envelope) -> list[str]:
    """Returns a table for each moment, and what must be said of them all."""
    lines = []
    for moment in envelope.moments:
        lines += ["", f"largest recovered push [m/s], {moment}"]
        lines += _table(envelope, moment)
    marks = {mark([limit]) for limit in envelope.limits.values()}
    if UNSURE in marks:
        lines.append(f"{UNSURE} the search is not complete")
    if AT_LEAST in marks:
        lines.append(f"{AT_LEAST} nothing larger was tried")
    odd = sum(row["outcome"] in NO_ANSWER for row in envelope.rows)
    if odd:
        lines.append(
            f"{odd} of {len(envelope.rows)} trials did not run to their end "
            f"({', '.join(NO_ANSWER)}): see `reason` in trials.csv"
        )
    return [*lines, ""]


def _table(envelope: Envelope, moment: Moment) -> list[str]:
    columns = [["direction", *(f"{a:g}" for a in envelope.directions)]]
    for name in envelope.mechanisms:
        curve = envelope.curve(name, moment)
        cells = [
            envelope.limit_words(curve[direction])
            if direction in curve
            else "-"
            for direction in envelope.directions
        ]
        columns.append([name, *cells])
    widths = [max(map(len, column)) for column in columns]
    return [
        "  ".join(map(str.rjust, line, widths))
        for line in zip(*columns, strict=True)
    ]
