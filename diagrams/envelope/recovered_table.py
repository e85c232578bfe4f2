"""The largest pushes that a robot recovers from, as lines for a terminal."""

from diagrams.envelope.envelope_data import Envelope
from diagrams.envelope.limit_search import Limit
from diagrams.envelope.moment import Moment

UNSURE = "~"  # before a figure that the search has not confirmed yet
ODD = ("crashed", "hung", "error")  # outcomes that are no fault of the robot


def table_lines(envelope: Envelope) -> list[str]:
    """Returns a table for each moment, and what must be said of them all."""
    lines = []
    for moment in envelope.moments:
        lines += ["", f"largest recovered push [m/s], {moment}"]
        lines += _table(envelope, moment)
    if not all(limit.complete for limit in envelope.limits.values()):
        lines.append(f"{UNSURE} the search is not complete")
    odd = sum(row["outcome"] in ODD for row in envelope.rows)
    if odd:
        lines.append(
            f"{odd} of {len(envelope.rows)} trials did not run to their end "
            f"({', '.join(ODD)}): see `reason` in trials.csv"
        )
    return [*lines, ""]


def _table(envelope: Envelope, moment: Moment) -> list[str]:
    curves = {
        name: envelope.curve(name, moment) for name in envelope.mechanisms
    }
    digits = _digits(envelope.search.resolution)
    lines = ["direction  " + "  ".join(curves)]
    for direction in envelope.directions:
        cells = [
            _cell(curve.get(direction), digits).rjust(len(name))
            for name, curve in curves.items()
        ]
        lines.append(f"{direction:9g}  " + "  ".join(cells))
    return lines


def _cell(limit: Limit | None, digits: int) -> str:
    if limit is None:
        return "-"
    mark = "" if limit.complete else UNSURE
    return f"{mark}{limit.recovered:.{digits}f}"


def _digits(resolution: float) -> int:
    """How many decimals show a resolution, from 1 to 4."""
    return next(
        (n for n in (1, 2, 3) if abs(round(resolution, n) - resolution) < 1e-9),
        4,
    )
