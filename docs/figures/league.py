"""Writes docs/league.md: the rows of push-v1 that are in docs/league.

Examples:
    python docs/figures/league.py
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import fmean

from nadia_balance.scripts import command_line
from nadia_balance.sweep import push_v1
from nadia_balance.sweep.report import table
from nadia_balance.sweep.row import MeasuredLimit, Row, by_situation, read_row

PAGE = Path(__file__).parents[1] / "league.md"
ROWS = PAGE.with_suffix("")  # the folder of the rows
ABOUT = """\
# League

For whoever asks how much push a controller takes, theirs or another's.

One protocol, `push-v1`, pushes every controller in the same way, on the same
robot, and leaves a row. `python docs/figures/league.py` writes this page from
the rows in [`league`](league), and refuses a row of another protocol, of
another robot, or whose limits do not follow from its trials.

## The protocol

The pelvis is pushed for 0.1 s from twelve directions. In place that is at 25,
50 and 75 % of a right swing, at 50 % of a left transfer, and while it stands.
Walking forward at 0.5 m/s, it is at 25 % of a right swing, after eight steps.
Drives are `realistic`, the engine is Drake. With `ideal` drives, and in
MuJoCo, it is pushed at 25 % of a right swing and standing.

The [search](envelope.md) is that of any envelope: steps of 0.2 m/s up, then
bisected to 0.05, then confirmed by three replicas, which begin 10 µm apart,
every second one a control period later. A robot has recovered if it did not
fall, kept the limits of torque, speed, tilt and landing, touched only the
ground and only with its feet, and goes on as commanded
([verdict](policy.md#how-it-is-judged)).

The robots are Nadia, the G1 and Atlas [of this package](../models/README.md),
file by file, by their sha256. A change of any of this is another protocol with
another name.

The quick variant has four directions, 25 % of a right swing and standing, in
steps of 0.4 m/s, bisected to 0.1, single runs. It is a first look, and has
tables of its own.

## A row of your own

A controller is `module:Class` with [two
ports](own_blocks.md#another-controller-altogether), a [policy's
file](policy.md), or ours with a [block of yours](own_blocks.md):

```console
$ python scripts/envelope.py --protocol push-v1 --quick --robot g1 \\
    --controller examples.null_controller:Springs --who "your name" --out quick
$ python scripts/envelope.py --protocol push-v1 --robot g1 \\
    --block step_adjuster=mine:ErrorStepAdjuster --who "your name" --out row
```

The quick one takes some minutes, the other one hours. After an installation the
program is `nadia-envelope`. In `row` are `row.json`
([schema](row.schema.json)) and `trials.csv`, and a folder for each sweep with
its picture. The same command goes on after Ctrl-C. How to send it:
[CONTRIBUTING](../CONTRIBUTING.md#a-row-of-the-league).
"""
NOTES = """\
Worst: the least limit of all moments in each direction, realistic, in Drake;
mean and least of the directions [m/s]. If a controller does not step, so
that a push in a swing never comes, that moment counts as 0. So does one at
which its own steps land too hard without a push. In our plant FastSAC's come
down at 1.0 m/s, where 0.8 are allowed: its 0 in place means that
its own steps break this rule, not that it falls. With ideal drives no landing
is judged: there it recovers from more than ours.

In the tables of moments are means of the directions: of the push [m/s], and of
its share of what a [point mass](envelope.md) recovers from. At these pushes:
the hardest landing, along the ground [m/s] and over 10 ms [weights], and the
drives' largest power [W]. Last comes what ended it.
"""
TITLES = {push_v1.FULL: "Rows", push_v1.QUICK: "Quick rows"}
NONE = "–"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Writes the page.

    Args:
        argv: the command line; None: that of the process.

    Returns:
        The exit code.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 written, 2 bad input.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(argv)
    with parser.refusing():
        text = page(ROWS)
    PAGE.write_text(text, encoding="utf-8")
    command_line.say(f"wrote {PAGE}")
    return command_line.DONE


def page(folder: Path) -> str:
    """Writes the page of the rows in a folder.

    Args:
        folder: has a folder for each row.

    Returns:
        Markdown.

    Raises:
        ValueError: a row is of another protocol or robot, or is damaged.
        OSError: a row cannot be read.
    """
    rows = {
        path.name: read_row(path)
        for path in sorted(folder.iterdir())
        if path.is_dir()
    }
    parts = [ABOUT, "## What the columns are\n", NOTES]
    for variant, title in TITLES.items():
        for robot in push_v1.ROBOTS:
            chosen = {
                name: row
                for name, row in rows.items()
                if (row.variant, row.robot.name) == (variant, robot)
            }
            if chosen:
                parts += [f"## {title}: {robot}\n", *_of_robot(chosen)]
    return "\n".join(parts)


def _of_robot(rows: dict[str, Row]) -> Iterator[str]:
    """The tables of one robot, the best controller first."""
    names = sorted(rows, key=lambda name: (-_mean_worst(rows[name]), name))
    speed, mass = rows[names[0]].robot.speed, rows[names[0]].robot.mass
    yield f"1 m/s is {mass:.1f} N s, {1.0 / speed:.3f} sqrt(g z).\n"
    head = ["row", "controller", "worst", "least", "N s", "sqrt(g z)", "by"]
    yield table(head, [_worst(name, rows[name]) for name in names]) + "\n"
    for situation in by_situation(rows[names[0]]):
        yield f"{_words(situation)}:\n"
        head = ["row", "push", "least", "share", "landing", "force", "power"]
        lines = [
            [name, *_measured(by_situation(rows[name])[situation])]
            for name in names
        ]
        yield table([*head, "ended by"], lines) + "\n"


def _mean_worst(row: Row) -> float:
    return fmean(row.worst.values())


def _worst(name: str, row: Row) -> list[str]:
    """The cells of a row in the first table of its robot."""
    programs = [f"`{row.controller.name}`"]
    programs += [f"{role} = `{p.name}`" for role, p in row.blocks.items()]
    mean = _mean_worst(row)
    return [
        f"[{name}](league/{name}/row.json)",
        ", ".join(programs),
        f"{mean:.2f}",
        f"{min(row.worst.values()):.2f}",
        f"{mean * row.robot.mass:.1f}",
        f"{mean / row.robot.speed:.3f}",
        row.who or NONE,
    ]


def _words(situation: Sequence[str]) -> str:
    scenario, fidelity, engine, at = situation
    gait = "walking at 0.5 m/s, " if scenario == push_v1.WALKING else ""
    return f"Pushed {gait}{at}; {fidelity}, {engine}"


def _measured(limits: list[MeasuredLimit]) -> Iterator[str]:
    """The cells of a row in the table of a moment."""
    speeds = [one.recovered or 0.0 for one in limits]
    yield f"{fmean(speeds):.2f}"
    yield f"{min(speeds):.2f}"
    for name, digits in (
        ("share", 2),
        ("landing_speed", 2),
        ("landing_force", 1),
        ("power", 0),
    ):
        values = [getattr(one, name) for one in limits]
        numbers = [value for value in values if value is not None]
        yield f"{fmean(numbers):.{digits}f}" if numbers else NONE
    reasons = Counter(
        one.ended_by.partition(":")[0].partition(" of ")[0]
        for one in limits
        if one.ended_by
    )
    yield ", ".join(f"{text} {n}" for text, n in reasons.most_common())


if __name__ == "__main__":
    sys.exit(main())
