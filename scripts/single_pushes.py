"""Pushes the robot once a run, at a share of the limits that a sweep found.

Direction, moment, side, length and body of each are drawn; with --directions or
--at, each of these is pushed.  The size is the share of the limit in that
direction, at the sweep's moment.  With a paper's figure as limits, and without
--pushes, all of its pushes are made, in every gait.  The same flags go on after
Ctrl-C.

Example:
    python scripts/single_pushes.py --pushes 40 --out envelopes/random
"""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nadia_balance.core.walking.mechanisms import MOST
from nadia_balance.core.walking.push import Moment, Push
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.diagrams.own_blocks import parsed_blocks
from nadia_balance.diagrams.scenario import AT, STANDING, Scenario
from nadia_balance.parameters.bounds import check_number, require
from nadia_balance.results.folder import appearing
from nadia_balance.results.versions import CHECKOUT
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import command_line, envelope
from nadia_balance.sweep.limits import LIMITS, PROTOCOLS, Protocol, known_limits
from nadia_balance.sweep.report import outcomes, table
from nadia_balance.sweep.search import Sweep
from nadia_balance.sweep.trials import (
    TRIALS,
    Cell,
    Identity,
    Results,
    Rows,
    Trial,
    digest,
)

LENGTHS = 0.05, 0.4  # of a push at random [s]
MOST_PUSHES = 100_000
FAILURES = "failures.md"
FAILURE_COLUMNS = (
    "m/s",
    "deg",
    "at",
    "body",
    "s",
    "scenario",
    "outcome",
    "first wrong",
)


def default_limits(checkout: Path = CHECKOUT) -> Path:
    """Where limits are, if nobody says so.

    Args:
        checkout: in which the package may be.

    Returns:
        The results of the checkout; without one, the name of the paper's
        figure, which is in the package.
    """
    results = checkout / "docs" / "results" / "fig10"
    return results if results.exists() else Path("nadia_fig10")


@dataclass(kw_only=True)
class SinglePushes(Sweep):
    """A sweep whose cells have one push each, a share of a known limit.

    Attributes:
        share: of the limits [-].
        known_limits: of a sweep, or of a paper [m/s].
        drawn: body and length at random; empty: no such.
    """

    share: float
    known_limits: dict[Cell, float]
    drawn: dict[Cell, Push]

    def cells(self) -> list[Cell]:
        """The cell of each push.

        Returns:
            Those drawn, or those of the sweep.
        """
        return list(self.drawn) or super().cells()

    def curve(self, scenario: str, at: str) -> dict[float, float]:
        """The limits of a gait at a moment.

        They are those of the first moment if none is known at this one, and
        mirrored if its swing foot is the other one.

        Args:
            scenario: its name.
            at: the moment.

        Returns:
            Direction [deg] -> limit [m/s].

        Raises:
            ValueError: no limit is of the scenario and these mechanisms.
        """
        key = (scenario, *self.mechanisms)
        limits = {c: v for c, v in self.known_limits.items() if c[::2] == key}
        others = sorted({", ".join(c[::2]) for c in self.known_limits})
        require(
            len(limits) > 0,
            f"limits: must have some of {', '.join(key)}, not only of "
            f"{'; '.join(others)}",
        )
        moments = [cell.at for cell in limits]
        moment = at if at in moments else moments[0]
        sign = 1.0 if _swing_of(moment) is _swing_of(at) else -1.0
        return {
            sign * cell.direction_deg: limit
            for cell, limit in limits.items()
            if cell.at == moment
        }

    def attempts(self, cell: Cell, results: Results) -> list[Trial]:
        """The only trial of a cell, unless it has results.

        Limits between directions are interpolated.

        Args:
            cell: of the push.
            results: of its trials until now.

        Returns:
            The trial, or none.
        """
        if results:
            return []
        curve = self.curve(cell.scenario, cell.at)
        limit = np.interp(
            cell.direction_deg, [*curve], [*curve.values()], period=360.0
        )
        return [(round(self.share * float(limit), 3), 0)]

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """The scenario of a push, which is zero.

        Args:
            cell: of the push.
            replica: from 0 on.

        Returns:
            A scenario of its own.
        """
        scenario = super().walk(cell, replica)
        push = self.drawn.get(cell)
        if push:  # not that of the identity
            (zero,) = scenario.pushes
            zero.body, zero.duration = push.body, push.duration
        return scenario

    def identity(self) -> Identity:
        """What all trials of a folder share.

        Returns:
            JSON, without the cells.
        """
        limits = repr(sorted(self.known_limits.items()))
        return super().identity() | {
            "share": self.share,
            "limits": digest([limits.encode()]),
        }


def _swing_of(at: str) -> Side:
    """The swing foot; of a robot that stands, the right one."""
    return Side.RIGHT if at == STANDING else Moment.parse(at).swing


def drawn(
    scenarios: Mapping[str, Scenario], mechanisms: str, plant: str, count: int
) -> dict[Cell, Push]:
    """Draws pushes at random.

    They are uniform in direction, in the time of the gait, in side, body and
    length, by the seed of the scenarios, whose gaits take turns.

    Args:
        scenarios: by name, all of one robot and seed.
        mechanisms: of the cells.
        plant: of the sweep, of whose periods a push lasts a whole number.
        count: number of pushes.

    Returns:
        Body and length of each push, by its cell.
    """
    one = next(iter(scenarios.values()))
    rng: Any = np.random.default_rng(one.seed)
    robot = load_robot(one.robot, one.fidelity)
    period = one.period(plant)
    shortest = math.ceil(LENGTHS[0] / period)
    longest = round(LENGTHS[1] / period) + 1
    pushes: dict[Cell, Push] = {}
    for i in range(count):
        name = [*scenarios][i % len(scenarios)]
        gait = scenarios[name].gait
        side, direction = rng.choice(list(Side)), rng.uniform(0.0, 360.0)
        time = rng.uniform(0.0, gait.transfer_duration + gait.swing_duration)
        fraction, phase = time / gait.transfer_duration, Phase.TRANSFER
        if fraction >= 1.0:
            time -= gait.transfer_duration
            fraction, phase = time / gait.swing_duration, Phase.SWING
        at = str(Moment(phase, side, round(fraction, 2)))
        pushes[Cell(name, at, mechanisms, round(direction, 3))] = Push(
            body=str(rng.choice([robot.pelvis_body, robot.torso_body])),
            delta_v=0.0,
            duration=round(period * int(rng.integers(shortest, longest)), 9),
            at=at,
        )
    return pushes


def failures_text(sweep: SinglePushes, rows: Rows) -> str:
    """Lists each push that failed.

    A trial ends at the first figure that excludes a recovery: its reason.

    Args:
        sweep: the pushes.
        rows: of their trials.

    Returns:
        The text of the page.
    """
    failed, cells = [], set(sweep.cells())
    for row in sorted(rows.all, key=Cell.of):
        # A folder may have more: of a call for more pushes.
        if row["outcome"] != "recovered" and Cell.of(row) in cells:
            (push,) = sweep.walk(Cell.of(row), replica=0).pushes
            failed.append(
                [
                    f"{row['delta_v']:.3f}",
                    f"{row['direction_deg']:g}",
                    row["at"],
                    push.body or "base",
                    f"{push.duration:g}",
                    row["scenario"],
                    row["outcome"],
                    row["reason"],
                ]
            )
    parts = [
        f"# Single pushes, at {sweep.share:g} of the limits",
        f"{outcomes(rows)}; commit `{rows.identity.get('commit', '')}`.",
        *([table(FAILURE_COLUMNS, failed)] if failed else []),
    ]
    return "\n\n".join(parts) + "\n"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        The exit code of --help.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 done, 1 workers or a block failed, 2 bad input, 4 cannot write, "
        "130 Ctrl-C.",
    )
    _push_flags(parser)
    command_line.scenario_flags(parser, name="push")
    envelope.running_flags(
        parser.add_argument_group("running"), "envelopes/single"
    )
    parser.set_defaults(out=Path("envelopes/single"))
    args = parser.parse_args(argv)
    with parser.refusing():
        sweep = sweep_from(args)

    def report(rows: Rows) -> int:
        with appearing(rows.folder) as drafts:
            (drafts / FAILURES).write_text(
                failures_text(sweep, rows), encoding="utf-8"
            )
        command_line.say(outcomes(rows), f"wrote {rows.folder}/{FAILURES}")
        return command_line.DONE

    return envelope.carry_out(
        parser=parser, args=args, argv=argv, sweep=sweep, report=report
    )


def _push_flags(parser: command_line.CommandLine) -> None:
    group = parser.add_argument_group("pushes")
    group.add_argument(
        "--share",
        type=command_line.finite,
        default=0.6,
        help="of the limits (%(default)s)",
    )
    group.add_argument(
        "--limits",
        type=command_line.place,
        metavar="FOLDER",
        default=default_limits(),
        help=f"with a {LIMITS}, or one of {', '.join(PROTOCOLS)} "
        "(docs/results/fig10, without a checkout nadia_fig10)",
    )
    group.add_argument(
        "--pushes",
        type=int,
        help="at random (1000, or all of a paper's figure)",
    )
    group.add_argument("--directions", help="not at random, as of envelope.py")
    group.add_argument("--at", help="not at random, as of envelope.py")


def sweep_from(args: argparse.Namespace) -> SinglePushes:
    """The sweep of the flags.

    Args:
        args: those of the parser.

    Returns:
        The sweep, checked.

    Raises:
        ValueError: names the invalid flag.
    """
    figure = PROTOCOLS.get(str(args.limits))
    count = _random_pushes(args, figure)
    values = {
        "scenario_name": "push",
        "directions": "12",
        "at": AT,
        "mechanisms": MOST,
        **(asdict(figure) if figure else {}),
    }
    mechanisms = args.mechanisms or values["mechanisms"].split(",")[-1]
    values |= {name: x for name, x in vars(args).items() if x is not None}
    scenarios = {
        name: envelope.scenario_of(args, name)
        for name in envelope.words("scenario_name", values)
    }
    sweep = SinglePushes(
        share=args.share,
        drawn=drawn(scenarios, mechanisms, args.plant, count) if count else {},
        scenarios=scenarios,
        plant=args.plant,
        controller=command_line.controller_of(args),
        contract=command_line.contract_of(args),
        blocks=parsed_blocks(args.block or ()),
        directions=envelope.directions(values),
        at=envelope.moments(values),
        mechanisms=(mechanisms,),
        known_limits=_limits_of(
            args.limits,
            figure,
            robot=next(iter(scenarios.values())).robot,
            mechanisms=mechanisms,
        ),
    )
    sweep.validate()
    for cell in sweep.cells():
        sweep.curve(cell.scenario, cell.at)
    return sweep


def _random_pushes(args: argparse.Namespace, figure: Protocol | None) -> int:
    """The number of pushes at random; 0: all are given.

    Raises ValueError: a flag is out of range, or has no effect.
    """
    count = 1000 if args.pushes is None else args.pushes
    check_number("pushes", count, least=1, most=MOST_PUSHES)
    check_number("share", args.share, above=0.0, most=3.0)
    has_place = args.directions is not None or args.at is not None
    if args.pushes is None:
        return 0 if figure or has_place else count
    require(
        not has_place, f"pushes = {count}: must not come with directions or at"
    )
    return count


def _limits_of(
    limits: Path, figure: Protocol | None, robot: str, mechanisms: str
) -> dict[Cell, float]:
    """Limits [m/s] of a folder or a figure; ValueError: of another robot."""
    of_robot = figure.robot if figure else robot
    if (limits / TRIALS).exists():
        of_robot = Rows.read(limits).identity["robot"]
    require(
        of_robot == robot,
        f"limits = '{limits}': must be of {robot}, not of {of_robot}",
    )
    return figure.largest(mechanisms) if figure else known_limits(limits)


if __name__ == "__main__":
    sys.exit(main())
