"""The flags that say what a sweep tries, and the sweep that they mean."""

import argparse
import contextlib
import math
from pathlib import Path

from pydrake.common.yaml import yaml_load_data

from diagrams.command_line import finite, scenario_from
from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import SCENARIO
from diagrams.envelope.sweep_plan import Sweep
from diagrams.mechanisms import MECHANISMS
from diagrams.scenario import Scenario

PHASE = "right swing 25 %"
# Of that scenario, if all pushes are then: just enough for its eight steps.
# Its own duration leaves time for them after any moment of a step. [s]
DURATION = 12.6
MOST_DIRECTIONS = 72  # that a count may ask for
QUICK = {
    "directions": "8",
    "mechanisms": "all_with_cross_over",
    "resolution": 0.1,
    "stride": 4,
    "replicas": 1,
}


def sweep_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags that choose the cells and how finely to search."""
    search = SearchParams()
    group = parser.add_argument_group(
        "sweep", "--mechanisms may name several, with commas (default: all)."
    )
    group.add_argument(
        "--quick", action="store_true", help=f"unless given: {_quick_words()}"
    )
    group.add_argument(
        "--directions",
        help='degrees from the stance heading, such as "0,30,90" (0 forward, '
        '90 left; "90," for one), or how many all around (default: 12)',
    )
    group.add_argument(
        "--phases",
        default=PHASE,
        help="when the push begins, with commas (default: right swing 25 %%, "
        f"for which {DURATION} s of the scenario {SCENARIO} are enough)",
    )
    group.add_argument(
        "--resolution",
        type=finite,
        help=f"of the limit (default: {search.resolution}) [m/s]",
    )
    group.add_argument(
        "--stride",
        type=int,
        help=f"of the march upward, in resolutions (default: {search.stride})",
    )
    group.add_argument(
        "--replicas",
        type=int,
        help="of a push; four in five must be recovered from "
        f"(default: {search.replicas})",
    )
    group.add_argument(
        "--largest",
        type=finite,
        help=f"no push is larger (default: {search.largest}) [m/s]",
    )


def sweep_from(args: argparse.Namespace) -> Sweep:
    """Returns the sweep that the flags ask for, checked.

    Raises:
        ValueError: a flag has no meaning; it is named, with what is allowed.
        FileNotFoundError: there is no such scenario file.
    """
    args = argparse.Namespace(**vars(args))
    if args.quick:
        for name, value in QUICK.items():
            if getattr(args, name) is None:
                setattr(args, name, value)
    asked = {
        name: getattr(args, name)
        for name in ("resolution", "stride", "replicas", "largest")
        if getattr(args, name) is not None
    }
    sweep = Sweep(
        scenario=_scenario(args),
        scenario_name=args.scenario_name,
        plant=args.plant,
        directions=directions(args.directions or "12"),
        moments=moments(args.phases),
        mechanisms=tuple(_words(args.mechanisms or ",".join(MECHANISMS))),
        search=SearchParams(**asked),
        timeout=args.timeout,
    )
    sweep.validate()
    return sweep


def directions(text: str) -> tuple[float, ...]:
    """Returns the directions in `text`, or so many as it says [deg].

    Raises:
        ValueError: it is neither.
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


def moments(text: str) -> tuple[Moment, ...]:
    """Returns the moments in `text`.

    Raises:
        ValueError: one is not like "right swing 25 %".
    """
    found = []
    for word in _words(text):
        try:
            found.append(Moment.parse(word))
        except ValueError:
            raise ValueError(
                f'phases = {word!r}: must be like "{PHASE}", from 0 to 100 %'
            ) from None
    return tuple(found)


def _scenario(args: argparse.Namespace) -> Scenario:
    """The scenario itself; that a sweep has many mechanisms is not its."""
    scenario = scenario_from(
        argparse.Namespace(**{**vars(args), "mechanisms": None})
    )
    text = yaml_load_data(args.scenario_text or "{}")
    ours = args.scenario_file is None and args.scenario_name == SCENARIO
    timed = args.duration is not None or "duration" in text
    if ours and not timed and moments(args.phases) == moments(PHASE):
        scenario.duration = DURATION
    if scenario.robot.endswith((".yaml", ".yml")):
        # Trials may run elsewhere.
        scenario.robot = str(Path(scenario.robot).resolve())
    return scenario


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _quick_words() -> str:
    return ", ".join(f"--{name} {value}" for name, value in QUICK.items())
