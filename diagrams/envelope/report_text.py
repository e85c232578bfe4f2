"""The text of tables.md: what was done, and what came out."""

import textwrap
from collections.abc import Iterator, Sequence

from diagrams.envelope.envelope_data import (
    AT_LEAST,
    ORDER,
    UNSURE,
    Envelope,
)
from diagrams.envelope.limit_tables import LimitTables, direction_words
from diagrams.envelope.mirror_section import mirror_section
from diagrams.envelope.references import MOMENT, ROBOT, SCENARIO
from diagrams.envelope.trial_tables import (
    capturability_section,
    losses_section,
    outcomes_section,
)
from diagrams.plots.envelope_style import PLANTS

_MOST_LISTED = 12  # cells

_MEANING = {
    "icp_only": "ankles and hips: feedback of the capture point (ICP)",
    "step": "and where the swing foot lands",
    "step_swing": "and a shorter swing",
    "step_swing_transfer": "and a shorter transfer of the weight",
    "all_with_cross_over": "and steps that cross the legs",
}

_PROTOCOL = """\
In scenario `{scenario}` the robot is pushed once, and the size of the push is
the change of velocity [m/s] that it gives to the robot's whole mass. The
largest recovered push is the largest multiple of {resolution:g} m/s from which,
as from every smaller one that was tried, she recovered {replicas}; nothing
above {largest:g} m/s was tried."""

_REPLICAS = """\
in at least {required} of {replicas} replicas, which differ in the start, by up
to 10 µm, and in the time of the push, by a control period"""

_DEFINITIONS = """\
Recovered means: she took as many more steps as the scenario asks for (as a
rule eight; fewer if the run was too short for them), the error of the capture
point came back below 5 cm, torques and joint speeds were within their limits,
and nothing but the feet touched the ground, nor one leg the other. Directions
are relative to the heading of the stance foot. `right swing 25 %` is when a
quarter of the right foot's swing has passed; left is then inward, toward the
stance foot."""

_RECOVERED = f"""\
* *recovered*: the largest recovered push; *fails at*: the smallest that is not.
  *Worst* is the smallest over the directions.
* `{UNSURE}`: the search is not complete; more trials may change the figure.
  `{AT_LEAST}`: nothing larger was tried; it may be more, and so may what is
  relative to it."""

_REFERENCES = """\
* *paper*: Griffin et al. 2023, Fig. 10: a push of 0.1 s at the pelvis, stepping
  in place, swing 0.7 s, transfer 0.3 s.
* *limit*: the best that any controller could do on a linear inverted pendulum
  of 1.0 m with feet of 0.24 m x 0.12 m, the same swing and transfer, shortened
  to 0.4 s and 0.05 s at the least, in up to four steps. A robot has angular
  momentum, other measures, and other shortest times (see `scenario.yaml`), so
  it may go beyond."""

_NO_REFERENCES = f"""\
* There is a *paper* and a *limit* to compare with for the robot {ROBOT} in
  scenario `{SCENARIO}`, pushed at {MOMENT} only."""

_MIRROR = """\
A push in a left step, and the same push mirrored in a right one: of the pairs
whose limits are complete the one that differs most, as a share of the larger
limit, a row for each mechanisms."""

_SPEED = """\
* *sqrt(g z)* = {speed:.3f} m/s, where z is the height of the robot's centre of
  mass."""

_NO_SPEED = """\
* The robot {robot} cannot be loaded here. So sqrt(g z), of the height z of
  its centre of mass, is not known, and no result is given relative to it."""

_RATES = """\
What the controller's N-step capture regions said, beside how the trial ended;
trials without an answer are left out.

* *end of the push*: the moment that the push is over.
* *first touchdown*: the first one after that, if there is one.
* *every touchdown*: all of them after the push.

Only the first two are one prediction a trial. The touchdowns of a trial are not
independent, and there are more of them if she recovered, so that over *every
touchdown* the share of *capturable* that was wrong comes out too small."""


def report_text(
    envelope: Envelope, speed: float | None, pictures: Sequence[str]
) -> str:
    """Returns tables.md.

    `speed` is sqrt(g z) [m/s], if it is known; `pictures` are the names of
    those that lie beside it.
    """
    limits = LimitTables(envelope=envelope, speed=speed)
    parts = [
        *_introduction(envelope, pictures),
        *_limits(envelope, limits),
        *_trials(envelope),
    ]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def _introduction(envelope: Envelope, pictures: Sequence[str]) -> Iterator[str]:
    plant = PLANTS.get(envelope.plant, envelope.plant)
    yield f"# Push-recovery envelope: {envelope.robot}, {plant}"
    yield from _missing(envelope)
    yield from (f"![{name.partition('.')[0]}]({name})" for name in pictures)
    yield "## What was done"
    yield _protocol(envelope)
    yield _DEFINITIONS
    yield "Mechanisms to recover by, each with all that come before it:"
    names = ORDER[: ORDER.index(envelope.mechanisms[-1]) + 1]
    yield "\n".join(f"* `{name}`: {_MEANING[name]}" for name in names)
    row = envelope.rows[0]
    yield (
        f"{len(envelope.rows)} trials: nadia_balance {row['nadia_balance']}, "
        f"code `{row['code']}`,\nparameters `{row['parameters']}`, "
        f"Drake {row['drake']}, NumPy {row['numpy']}, Python {row['python']}."
    )


def _protocol(envelope: Envelope) -> str:
    search = envelope.search
    replicas = "in the one trial of it"
    if search.replicas > 1:
        replicas = _REPLICAS.format(
            required=search.required, replicas=search.replicas
        )
    text = _PROTOCOL.format(
        scenario=envelope.scenario,
        resolution=search.resolution,
        replicas=replicas,
        largest=search.largest,
    )
    return textwrap.fill(text, 80)


def _missing(envelope: Envelope) -> Iterator[str]:
    """Says which cells are not complete, if there are any."""
    missing = envelope.missing
    if not missing:
        return
    yield (
        f"**Not complete**: trials are still to come in {len(missing)} of "
        f"{_cells(envelope)} cells. What is said of\nthem is what all trials "
        "so far agree on; more trials may change it."
    )
    lines = [
        f"* `{name}`, {direction_words(direction)}, {moment}"
        for name, moment, direction in missing[:_MOST_LISTED]
    ]
    if (more := len(missing) - _MOST_LISTED) > 0:
        lines.append(f"* and {more} more")
    yield "\n".join(lines)


def _cells(envelope: Envelope) -> int:
    return (
        len(envelope.mechanisms)
        * len(envelope.moments)
        * len(envelope.directions)
    )


def _limits(envelope: Envelope, limits: LimitTables) -> Iterator[str]:
    yield "## Largest recovered pushes"
    yield _columns(envelope, limits.speed)
    if len(envelope.moments) > 1:
        yield "Over all moments and directions:"
        yield limits.over_moments()
    for moment in envelope.moments:
        yield f"### Pushed at {moment}"
        yield limits.summary(moment)
        for name in envelope.mechanisms:
            yield f"`{name}`, {moment}:"
            yield limits.details(name, moment)
    if mirror := mirror_section(envelope):
        yield "## Is the left as good as the right?"
        yield _MIRROR
        yield mirror


def _columns(envelope: Envelope, speed: float | None) -> str:
    """What the columns of the tables mean."""
    known = [m for m in envelope.moments if envelope.known(m)]
    parts = [_RECOVERED]
    if known:
        parts.append(_REFERENCES)
    if len(known) < len(envelope.moments):
        parts.append(_NO_REFERENCES)
    if speed is None:
        parts.append(_NO_SPEED.format(robot=envelope.robot))
    else:
        parts.append(_SPEED.format(speed=speed))
    return "\n".join(parts)


def _trials(envelope: Envelope) -> Iterator[str]:
    yield "## Do more mechanisms ever recover less?"
    yield losses_section(envelope)
    yield "## How the trials ended"
    yield outcomes_section(envelope)
    yield "## How often the capture regions were wrong"
    yield _RATES
    yield capturability_section(envelope)
