"""Whether the robot does as well on the left as on the right."""

from collections.abc import Iterator
from dataclasses import replace

from diagrams.envelope.envelope_data import Envelope
from diagrams.envelope.limit_search import Limit
from diagrams.envelope.limit_tables import direction_words
from diagrams.envelope.markdown import table
from diagrams.envelope.moment import Moment

# Direction of the push in a right step [deg], its limit, and the mirrored one.
Pair = tuple[float, Limit, Limit]

_HEAD = ["worst pair", "mechanisms", "right [m/s]", "left [m/s]", "difference"]


def mirror_section(envelope: Envelope) -> str:
    """The limits that differ most from those of the mirrored push, if any.

    Mirrored is the other foot's swing or transfer, and the push that goes as
    much to the right as this one to the left.  Limits that are still searched
    for are not compared.
    """
    rows = [
        _worst(envelope, name, moment)
        for name in envelope.mechanisms
        for moment in envelope.moments
        if moment.side == "right" and any(_pairs(envelope, name, moment))
    ]
    return table(_HEAD, rows) if rows else ""


def _pairs(
    envelope: Envelope, mechanisms: str, moment: Moment
) -> Iterator[Pair]:
    """Those of which both limits are complete."""
    other = envelope.curve(mechanisms, replace(moment, side="left"))
    for direction, limit in envelope.curve(mechanisms, moment).items():
        # Directions have six decimals.
        mirrored = other.get(round(-direction % 360.0, 6) % 360.0)
        if mirrored and limit.complete and mirrored.complete:
            yield direction, limit, mirrored


def _worst(envelope: Envelope, mechanisms: str, moment: Moment) -> list[str]:
    pairs = _pairs(envelope, mechanisms, moment)
    direction, right, left = max(pairs, key=_difference)
    return [
        f"{direction_words(direction)}, {moment}",
        f"`{mechanisms}`",
        envelope.limit_words(right),
        envelope.limit_words(left),
        f"{100.0 * _difference((direction, right, left)):.0f} %",
    ]


def _difference(pair: Pair) -> float:
    """Of the two limits, as a share of the larger one."""
    _, right, left = pair
    small, large = sorted((right.recovered, left.recovered))
    return (large - small) / large if large else 0.0
