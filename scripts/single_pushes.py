"""Pushes the robot once a run, at a share of the limits that a sweep found.

Direction, moment, side, length and body of each are drawn; with --directions or
--at, each of these is pushed.  The size is the share of the limit in that
direction, at the sweep's moment.  With a paper's figure as limits, all of its
pushes are made, in every gait.  The same flags go on after Ctrl-C.

Example:
    python scripts/single_pushes.py --pushes 40 --out envelopes/random
"""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.push import Moment, Push
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.diagrams.scenario import AT, STANDING, Scenario
from nadia_balance.results.folder import appearing
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import command_line, envelope
from nadia_balance.sweep.limits import LIMITS, PROTOCOLS, known_limits
from nadia_balance.sweep.report import outcomes, table
from nadia_balance.sweep.search import Sweep
from nadia_balance.sweep.trials import TRIALS, Cell, Results, Rows, Trial

LENGTHS = 0.05, 0.4  # of a push at random [s]
FAILURES = "failures.md"


@dataclass(kw_only=True)
class SinglePushes(Sweep):
    """A sweep whose cells have one push each, a share of a known limit."""

    share: float  # of the limits [-]
    known_limits: dict[Cell, float]  # of a sweep [m/s]
    drawn: dict[Cell, Push]  # body and length at random; empty: no such

    def cells(self) -> list[Cell]:
        """Returns the cell of each push."""
        return list(self.drawn) or super().cells()

    def curve(self, scenario: str) -> dict[float, float]:
        """Returns direction [deg] -> limit [m/s], for pushes in right swings.

        Raises ValueError: no limit is of the scenario and these mechanisms.
        """
        wanted = scenario, *self.mechanisms
        known = {c: v for c, v in self.known_limits.items() if c[::2] == wanted}
        if not known:
            raise ValueError(f"limits: must have some of {', '.join(wanted)}")
        first = next(iter(known)).at
        return {c.direction_deg: v for c, v in known.items() if c.at == first}

    def attempts(self, cell: Cell, results: Results) -> list[Trial]:
        """Returns the only trial of a `cell`, unless it has results.

        Limits between directions are interpolated; mirrored for a left swing.
        """
        left = False
        if cell.at != STANDING:
            left = Moment.parse(cell.at).swing is Side.LEFT
        seen = -cell.direction_deg if left else cell.direction_deg
        known = zip(*self.curve(cell.scenario).items(), strict=True)
        delta_v = self.share * float(np.interp(seen, *known, period=360.0))
        return [] if results else [(round(delta_v, 3), 0)]

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """Returns the scenario of a push, which is zero."""
        scenario = super().walk(cell, replica)
        if push := self.drawn.get(cell):  # not that of the identity
            (zero,) = scenario.pushes
            zero.body, zero.duration = push.body, push.duration
        return scenario

    def identity(self) -> dict:
        """Returns the JSON data that all trials of one folder share."""
        return super().identity() | {"share": self.share}


def drawn(name: str, scenario: Scenario, most: str, count: int) -> dict:
    """Returns the body and length of `count` pushes, by their cells.

    They are drawn by the seed of the `scenario`, which has this `name`: uniform
    in direction, in the time of the gait, in side, body and length.
    """
    rng, gait = np.random.default_rng(scenario.seed), scenario.gait
    robot = load_robot(scenario.robot, scenario.fidelity)
    period = scenario.controller.control_period
    ticks = math.ceil(LENGTHS[0] / period), round(LENGTHS[1] / period) + 1
    pushes: dict[Cell, Push] = {}
    for _ in range(count):
        side, direction = rng.choice(list(Side)), rng.uniform(0.0, 360.0)
        time = rng.uniform(0.0, gait.transfer_duration + gait.swing_duration)
        fraction, phase = time / gait.transfer_duration, Phase.TRANSFER
        if fraction >= 1.0:
            time -= gait.transfer_duration
            fraction, phase = time / gait.swing_duration, Phase.SWING
        at = str(Moment(phase, side, round(fraction, 2)))
        pushes[Cell(name, at, most, round(direction, 3))] = Push(
            body=str(rng.choice([robot.pelvis_body, robot.torso_body])),
            delta_v=0.0,
            duration=round(period * int(rng.integers(*ticks)), 9),
            at=at,
        )
    return pushes


def failures_text(sweep: SinglePushes, rows: Rows) -> str:
    """Returns the page of each push that failed.

    A trial ends at the first figure that excludes a recovery: its reason.
    """
    failed = []
    for row in sorted(rows.all, key=Cell.of):
        if row["outcome"] != "recovered":
            (push,) = sweep.walk(Cell.of(row), replica=0).pushes
            size = f"{row['delta_v']:.3f}", f"{row['direction_deg']:g}"
            where = row["at"], push.body or "base", f"{push.duration:g}"
            ended = row["scenario"], row["outcome"], row["reason"]
            failed.append((*size, *where, *ended))
    head = "m/s", "deg", "at", "body", "s", "scenario", "outcome", "first wrong"
    title = f"# Single pushes, at {sweep.share:g} of the limits"
    commit = rows.identity.get("commit", "")
    about = f"{outcomes(rows)}; commit `{commit}`."
    parts = [title, about, *([table(head, failed)] if failed else [])]
    return "\n\n".join(parts) + "\n"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code."""
    codes = "0 done, 1 the workers failed, 2 bad input, 4 cannot write, "
    parser = command_line.CommandLine(__file__, __doc__, codes + "130 Ctrl-C.")
    add = parser.add_argument_group("pushes").add_argument
    shown = "(%(default)s)"
    share = {"type": command_line.finite, "default": 0.6}
    add("--share", **share, help=f"of the limits {shown}")
    folder = {"type": command_line.place, "metavar": "FOLDER"}
    about = f"with a {LIMITS}, or one of {', '.join(PROTOCOLS)} {shown}"
    add("--limits", **folder, default="docs/results/fig10", help=about)
    add("--pushes", type=int, default=1000, help=f"at random {shown}")
    for name in ("--directions", "--at"):
        add(name, help="not at random, as of envelope.py")
    command_line.scenario_flags(parser, name="push")
    add = parser.add_argument_group("running").add_argument
    envelope.running_flags(add, "envelopes/single")
    parser.set_defaults(out=Path("envelopes/single"))
    args = parser.parse_args(argv)
    with parser.refusing():
        sweep = sweep_from(args)

    def report(rows: Rows) -> int:
        with appearing(rows.folder) as drafts:
            text = failures_text(sweep, rows)
            (drafts / FAILURES).write_text(text, encoding="utf-8")
        command_line.say(outcomes(rows), f"wrote {rows.folder}/{FAILURES}")
        return command_line.DONE

    return envelope.carry_out(parser, args, argv, sweep, report)


def sweep_from(args: argparse.Namespace) -> SinglePushes:
    """Returns the sweep of the flags; ValueError names an invalid one."""
    if not 1 <= args.pushes <= 100_000 or not 0.0 < args.share <= 3.0:
        given = f"pushes = {args.pushes}, share = {args.share}"
        raise ValueError(f"{given}: must be in [1, 100000] and (0, 3]")
    figure = PROTOCOLS.get(str(args.limits))
    asked = {"scenario_name": "push", "directions": "12", "at": AT}
    asked["mechanisms"] = list(MECHANISMS)[-1]
    asked |= vars(figure) if figure else {}
    of = asked.get("robot")
    most = args.mechanisms or asked["mechanisms"].split(",")[-1]
    asked |= {name: x for name, x in vars(args).items() if x is not None}
    names = envelope.words("scenario_name", asked)
    scenarios = {name: envelope.scenario_of(args, name) for name in names}
    known = figure.largest(most) if figure else known_limits(args.limits)
    if (args.limits / TRIALS).exists():
        of = Rows.read(args.limits).identity["robot"]
    if of not in (None, robot := scenarios[names[0]].robot):
        why = f"must be of {robot}, not of {of}"
        raise ValueError(f"limits = '{args.limits}': {why}")
    drawn_of = names[0], scenarios[names[0]], most, args.pushes
    random = not (figure or args.directions or args.at)
    sweep = SinglePushes(
        share=args.share,
        drawn=drawn(*drawn_of) if random else {},
        scenarios=scenarios,
        plant=args.plant,
        controller=command_line.policy_of(args),
        directions=envelope.directions(asked),
        at=envelope.moments(asked),
        mechanisms=(most,),
        known_limits=known,
    )
    sweep.validate()
    for name in scenarios:
        sweep.curve(name)
    return sweep


if __name__ == "__main__":
    sys.exit(main())
