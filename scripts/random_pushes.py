"""Pushes the robot at random, at a share of the limits that a sweep found.

Direction, moment, side, length and body (pelvis, torso) of each push are drawn.
Its size is the share of the limit in its direction, which is for the moment of
the sweep.  The same flags go on after Ctrl-C.

Example:
    python scripts/random_pushes.py --pushes 40 --out envelopes/random
"""

import nadia_balance.scripts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from nadia_balance.core.walking.push import Moment, Push
from nadia_balance.core.walking.vocabulary import MECHANISMS, Phase, Side
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.results.folder import appearing
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import command_line, envelope
from nadia_balance.scripts.sweep import Cell, Results, Rows, Trial, limits
from nadia_balance.scripts.sweep.report import outcomes, table
from nadia_balance.scripts.sweep.search import AT, Sweep

LENGTHS = 0.05, 0.4  # of a push [s]
FAILURES = "failures.md"


@dataclass(kw_only=True)
class RandomPushes(Sweep):
    """A sweep whose cells have one push each, all of them different."""

    pushes: dict[Cell, Push] = field(default_factory=dict)
    share: float = 0.6  # of the limits [-]

    def cells(self) -> list[Cell]:
        """Returns the cell of each push."""
        return list(self.pushes)

    def attempts(self, cell: Cell, results: Results) -> list[Trial]:
        """Returns the only trial of a `cell`, unless it has results."""
        return [] if results else [(self.pushes[cell].delta_v or 0.0, 0)]

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """Returns the scenario of a push, which is zero."""
        scenario = super().walk(cell, replica)
        if push := self.pushes.get(cell):  # not that of the identity
            (zero,) = scenario.pushes
            zero.body, zero.duration = push.body, push.duration
        return scenario

    def identity(self) -> dict:
        """Returns the JSON data that all trials of one folder share."""
        return super().identity() | {"share": self.share}


def drawn(
    scenario: Scenario, known: dict[Cell, float], count: int, share: float
) -> dict[Cell, Push]:
    """Returns `count` pushes, drawn by the seed of the `scenario`.

    They are uniform in direction, in the time of the gait, in side, body and
    length.  Between the directions of the `known` limits [m/s] of right swings
    these are interpolated; a left swing has their mirror image.
    """
    rng, gait = np.random.default_rng(scenario.seed), scenario.gait
    robot = load_robot(scenario.robot, scenario.fidelity)
    period, most = scenario.controller.control_period, list(MECHANISMS)[-1]
    ticks = math.ceil(LENGTHS[0] / period), round(LENGTHS[1] / period) + 1
    wanted = ("push", AT, most)
    curve = {c.direction_deg: v for c, v in known.items() if c[:3] == wanted}
    if not curve:
        raise ValueError(f"limits: must have some of {', '.join(wanted)}")
    pushes: dict[Cell, Push] = {}
    for _ in range(count):
        side, direction = rng.choice(list(Side)), rng.uniform(0.0, 360.0)
        time = rng.uniform(0.0, gait.transfer_duration + gait.swing_duration)
        fraction, phase = time / gait.transfer_duration, Phase.TRANSFER
        if fraction >= 1.0:
            time -= gait.transfer_duration
            fraction, phase = time / gait.swing_duration, Phase.SWING
        at = str(Moment(phase, side, round(fraction, 2)))
        seen = direction if side is Side.RIGHT else -direction
        limit = np.interp(seen, *zip(*curve.items(), strict=True), period=360.0)
        pushes[Cell("push", at, most, round(direction, 3))] = Push(
            body=str(rng.choice([robot.pelvis_body, robot.torso_body])),
            delta_v=round(share * float(limit), 3),
            duration=round(period * int(rng.integers(*ticks)), 9),
            at=at,
        )
    return pushes


def failures_text(sweep: RandomPushes, rows: Rows) -> str:
    """Returns the page of each push that failed.

    A trial ends at the first figure that excludes a recovery: its reason.
    """
    failed = []
    for row in rows.all:
        if row["outcome"] != "recovered":
            push = sweep.pushes[Cell.of(row)]
            size = f"{row['delta_v']:.3f}", f"{row['direction_deg']:g}"
            where = row["at"], push.body, f"{push.duration:g}"
            failed.append((*size, *where, row["outcome"], row["reason"]))
    head = "m/s", "deg", "at", "body", "s", "outcome", "first wrong"
    title = f"# Pushes at random, at {sweep.share:g} of the limits"
    about = f"{outcomes(rows)}; code `{rows.identity['code']}`."
    return "\n\n".join([title, about, table(head, failed)]) + "\n"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code."""
    codes = "0 done, 1 the workers failed, 2 bad input, 4 cannot write, "
    parser = command_line.CommandLine(__file__, __doc__, codes + "130 Ctrl-C.")
    add, shown = parser.add_argument, "(%(default)s)"
    add("--pushes", type=int, default=1000, help=shown)
    share = {"type": command_line.finite, "default": 0.6}
    add("--share", **share, help=f"of the limits {shown}")
    folder = {"type": command_line.place, "metavar": "FOLDER"}
    about = f"with a {limits.LIMITS} {shown}"
    add("--limits", **folder, default="docs/results/fig10", help=about)
    add("--seed", type=int, default=0, help=shown)
    envelope.running_flags(add, "envelopes/random")
    parser.set_defaults(out=Path("envelopes/random"))
    args = parser.parse_args(argv)
    with parser.refusing():
        if not 1 <= args.pushes <= 100_000 or not 0.0 < args.share <= 3.0:
            why = "must be in [1, 100000] and (0, 3]"
            given = f"pushes = {args.pushes}, share = {args.share}"
            raise ValueError(f"{given}: {why}")
        scenario = load_scenario("push", seed=args.seed)
        known = limits.known_limits(Path(args.limits))
        pushes = drawn(scenario, known, args.pushes, args.share)
        what = {"scenarios": {"push": scenario}, "share": args.share}
        sweep = RandomPushes(pushes=pushes, **what)

    def report(rows: Rows) -> int:
        with appearing(rows.folder) as drafts:
            text = failures_text(sweep, rows)
            (drafts / FAILURES).write_text(text, encoding="utf-8")
        command_line.say(outcomes(rows), f"wrote {rows.folder}/{FAILURES}")
        return command_line.DONE

    return envelope.carry_out(parser, args, argv, sweep, report)


if __name__ == "__main__":
    sys.exit(main())
