"""Takes pictures of a run's replay and puts them side by side.

By default the push, and each of the next two steps just before it lands.

Examples:
    python scripts/picture.py --run runs/my_run
    python scripts/picture.py --run runs/my_run --times 3.5 3.9 --out two.png
"""

import argparse
import sys
from pathlib import Path
from zipfile import BadZipFile

from diagrams.command_line import BAD_INPUT, CommandLine, finite
from diagrams.run_folder import read_run
from diagrams.run_log import Log, pushes, steps

_NUM_STEPS = 2  # after the push
_BEFORE = 0.03  # a step lands [s]
_SIGNALS = ("t", "walking_signal", "push_force")
_MISSING = "playwright is missing: pip install 'nadia_balance[docs]'"


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; 0 written, 2 bad input."""
    parser = _parser()
    args = parser.parse_args(argv)
    try:
        _write(args)
    except (ValueError, OSError) as error:
        message = " ".join(str(error).split())
        print(f"{parser.prog}: {message}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = CommandLine(
        prog="picture.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 written, 2 bad input.",
    )
    parser.add_argument(
        "--run", type=Path, required=True, help="folder with its replay.html"
    )
    parser.add_argument("--times", type=finite, nargs="+", help="[s]")
    parser.add_argument("--captions", nargs="+", help="one for each time")
    parser.add_argument(
        "--out", type=Path, help="PNG; by default picture.png in the folder"
    )
    view = parser.add_argument_group("view")
    view.add_argument(
        "--azimuth", type=finite, help="0 from in front, 90 from her left [deg]"
    )
    view.add_argument(
        "--elevation", type=finite, help="above the horizon [deg]"
    )
    view.add_argument("--distance", type=finite, help="of the camera [m]")
    view.add_argument("--width", type=int, help="of each picture [pixels]")
    view.add_argument("--height", type=int, help="of each picture [pixels]")
    return parser


def _write(args: argparse.Namespace) -> None:
    try:
        from diagrams.pictures import View, write_strip
    except ModuleNotFoundError as error:
        raise ValueError(_MISSING) from error
    given = {
        "azimuth_deg": args.azimuth,
        "elevation_deg": args.elevation,
        "distance": args.distance,
        "width_px": args.width,
        "height_px": args.height,
    }
    view = View(**{k: v for k, v in given.items() if v is not None})
    replay = args.run / "replay.html"
    if not replay.is_file():
        raise ValueError(
            f"run = {str(args.run)!r}: must be a folder with a replay.html"
        )
    times = args.times or moments(_log_of(args.run))
    captions = args.captions or [f"{time:.2f} s" for time in times]
    if len(captions) != len(times):
        raise ValueError(
            f"captions = {len(captions)}: must be as many as times, "
            f"{len(times)}"
        )
    out = args.out or args.run / "picture.png"
    if out.suffix != ".png":
        raise ValueError(f"out = {str(out)!r}: must end in .png")
    write_strip(replay, times, captions, view, out)
    print(f"wrote {out}")


def _log_of(run: Path) -> Log:
    """Reads what `moments` needs of the log of a `run`.

    Raises:
        ValueError: the log is not whole.
        OSError: there is none.
    """
    try:
        log, _ = read_run(run)
        return {name: log[name] for name in _SIGNALS}
    except (BadZipFile, EOFError, KeyError, ValueError) as error:
        raise ValueError(
            f"run = {str(run)!r}: must have a whole log.npz and summary.json, "
            f"as --times are not given ({error!r})"
        ) from error


def moments(log: Log) -> list[float]:
    """The end of the last push, and when the next steps are about to land.

    Raises:
        ValueError: nobody was pushed.
    """
    if not (pushed := pushes(log)):
        raise ValueError("times: must be given, as nobody was pushed")
    landings = [s.swing.end for s in steps(log) if s.swing.end > pushed[-1].end]
    return [pushed[-1].end, *(t - _BEFORE for t in landings[:_NUM_STEPS])]


if __name__ == "__main__":
    sys.exit(main())
