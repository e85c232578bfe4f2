"""Flags of a sweep on the command line."""

import argparse
import contextlib
import math
from pathlib import Path

from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.scripts.command_line import (
    Flags,
    add_flags,
    finite,
    scenario_flags,
    scenario_from,
)
from nadia_balance.scripts.envelope_sweep.protocols import PROTOCOLS
from nadia_balance.scripts.envelope_sweep.search import SearchParams
from nadia_balance.scripts.envelope_sweep.sweep import AT, Sweep

MOST_DIRECTIONS = 72  # largest count of directions
DEFAULT = "nadia_fig10"  # key of PROTOCOLS
QUICK = {  # used with the last mechanisms of the protocol
    "directions": "8",
    "resolution": 0.1,
    "stride": 4,
    "replicas": 1,
}


def sweep_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of scenario, cells and search."""
    search, default = SearchParams(), PROTOCOLS[DEFAULT]
    quick = ", ".join(f"--{name} {value}" for name, value in QUICK.items())
    flags: Flags = {
        "protocol": {
            "choices": PROTOCOLS,
            "default": DEFAULT,
            "help": "the paper's figure whose scenarios, moment, directions "
            "and mechanisms are tried unless given (default: %(default)s)",
        },
        "quick": {
            "action": "store_true",
            "help": f"unless given: {quick}, and the most mechanisms alone",
        },
        "directions": {
            "help": 'degrees from the stance heading, such as "0,30,90" (0 '
            'forward, 90 left; "90," for one), or how many all around '
            f"(default: {default.directions})"
        },
        "at --phases": {
            "help": "when the push begins, with commas (default: "
            f"{AT.replace('%', '%%')})"
        },
        "resolution": {
            "type": finite,
            "help": f"of the limit (default: {search.resolution}) [m/s]",
        },
        "stride": {
            "type": int,
            "help": "of the march upward, in resolutions (default: "
            f"{search.stride})",
        },
        "replicas": {
            "type": int,
            "help": "of a push at the limit; four in five must be recovered "
            f"from (default: {search.replicas})",
        },
        "largest": {
            "type": finite,
            "help": f"no push is larger (default: {search.largest}) [m/s]",
        },
    }
    about = "--mechanisms and --scenario_name may name several, with commas "
    about += "(default: those of the protocol)."
    add_flags(parser, "sweep", flags, about)
    scenario_flags(parser, name=default.scenario_name)


def sweep_from(args: argparse.Namespace) -> Sweep:
    """Returns the checked sweep of the flags.

    Raises:
        ValueError: a flag is invalid; names it and what is allowed.
        FileNotFoundError: the scenario file does not exist.
    """
    protocol = PROTOCOLS[args.protocol]
    names = "scenario_name", "at", "directions", "mechanisms"
    defaults = {name: getattr(protocol, name) for name in names}
    if args.quick:
        most = protocol.mechanisms.rpartition(",")[2]
        defaults |= QUICK | {"mechanisms": most}
    given = {name: x for name, x in vars(args).items() if x is not None}
    asked = defaults | given
    search = {
        name: asked[name] for name in vars(SearchParams()) if name in asked
    }
    sweep = Sweep(
        scenarios={
            name: _scenario(args, name)
            for name in _words(asked["scenario_name"])
        },
        plant=args.plant,
        directions=directions(asked["directions"]),
        at=tuple(map(_moment, _words(asked["at"]))),
        mechanisms=tuple(_words(asked["mechanisms"])),
        search=SearchParams(**search),
        timeout=args.timeout,
    )
    sweep.validate()
    return sweep


def _scenario(args: argparse.Namespace, name: str) -> Scenario:
    """Returns the scenario `name`, with its own mechanisms."""
    one = {"scenario_name": name, "mechanisms": None}
    scenario = scenario_from(argparse.Namespace(**{**vars(args), **one}))
    if scenario.robot.endswith((".yaml", ".yml")):
        # Trials may run in another folder.
        scenario.robot = str(Path(scenario.robot).resolve())
    return scenario


def directions(text: str) -> tuple[float, ...]:
    """Returns the directions [deg] listed in `text`, or as many as its count.

    Raises:
        ValueError: `text` is neither a list nor a count.
    """
    if text.strip().isdecimal():
        count = int(text)
        if not 1 <= count <= MOST_DIRECTIONS:
            raise ValueError(
                f"directions = {text!r}: as a count must be in "
                f'[1, {MOST_DIRECTIONS}]; one direction is "{text.strip()},"'
            )
        return tuple(round(i * 360.0 / count, 6) for i in range(count))
    found = []
    for word in _words(text):
        with contextlib.suppress(ValueError):
            if math.isfinite(angle := float(word)):
                found.append(round(angle, 6) % 360.0)
                continue
        raise ValueError(
            f'directions = {word!r}: must be degrees, such as "0,30,90", or '
            "how many"
        )
    return tuple(found)


def _moment(text: str) -> str:
    """A point of the gait, as Moment writes it; no time in seconds."""
    with contextlib.suppress(ValueError):
        if (moment := Moment.parse(text)).phase:
            return str(moment)
    raise ValueError(f'at = {text!r}: must be like "{AT}", from 0 to 100 %')


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
