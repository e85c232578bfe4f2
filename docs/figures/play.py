"""Writes a page on which a reader moves the ICP and sees the capture regions.

Nadia stands on its left foot.  The page has no formula of the controller: what
it shows is computed here, by the controller's functions, for a grid of ICPs
and times, and interpolated there.  It opens from its file, offline.

Example:
    python docs/figures/play.py --out docs/play.html
"""

import argparse
import base64
import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from drawing import right_swing
from nadia_balance import palette
from nadia_balance.balance_controller import ControllerParams
from nadia_balance.core.body.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    in_world,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    one_step_region,
)
from nadia_balance.core.steps.foothold_adjustment import (
    Landing,
    adjust_foothold,
    unadjusted,
)
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import Adjustment, FootPoses
from nadia_balance.results.folder import appearing
from nadia_balance.scripts import command_line
from nadia_paper import MODEL, NOMINAL, SOLE, STANCE, SWING, USABLE

PARAMS = CaptureRegionStepAdjusterParams()
# The grid: ICPs x and y [m], times until touchdown [s]; with crossed legs or
# without.
X = np.arange(-25, 31) / 50.0
Y = np.arange(-25, 21) / 50.0
TIMES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
CROSSING = (False, True)
LATER = 0.4, 0.1  # swing and transfer of all later steps [s]
_SETS = "step_swing_transfer", "all_with_cross_over"
_REACHES = BASE, FORWARD, BACKWARD
_DIGITS = 5  # behind the point, of lengths [m]


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Writes the page; bad input exits.

    Args:
        argv: command line; by default the program's.

    Returns:
        The exit code 0.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__ or "",
        "0 written, 1 disk failed, 2 bad input, 130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--out",
        type=command_line.place,
        default=Path("play.html"),
        help="the page (default: %(default)s)",
    )
    args = parser.parse_args(argv)
    template = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    page = template.replace("{{data}}", json.dumps(table()))
    with appearing(args.out.absolute().parent) as drafts:
        (drafts / args.out.name).write_text(page, encoding="utf-8")
    command_line.say(f"wrote {args.out}")
    return command_line.DONE


def table() -> dict[str, Any]:
    """Computes all that the page knows.

    Returns:
        Polygons (n, 2) [m] in W; the grid; `generators`, the points whose hull
        is C_1, by time, each at the ICPs (0, 0), (1, 0) and (0, 1), as they
        are affine in it; `offsets` D_1, ..., D_N and `regions` without and
        with crossed legs; `footholds`, x and y [mm] as 16-bit integers,
        little-endian in base64, by crossing, time, y and x of the ICP, and
        `reaches`, bytes, the number of the region in which each is.
    """
    geometries = [geometry(crossing) for crossing in CROSSING]
    adjustments = [
        adjustment(swing, time, icp=np.array([x, y]))
        for swing, time, y, x in itertools.product(geometries, TIMES, Y, X)
    ]
    footholds = np.array([one.pose.p_WF[:2] for one in adjustments])
    reaches = [_REACHES.index(one.region or BASE) for one in adjustments]
    return {
        "omega": MODEL.omega,
        "sole": _numbers(STANCE.to_world(SOLE)),
        "nominal": _numbers(NOMINAL.p_WF[:2]),
        "usable": _numbers(geometries[0].foot),
        "regions": [
            {name: _numbers(part) for name, part in one.regions.items()}
            for one in geometries
        ],
        "offsets": [
            [_numbers(offsets) for offsets in one.offsets] for one in geometries
        ],
        "generators": [_generators(time) for time in TIMES],
        "times": TIMES,
        "x": _numbers(X),
        "y": _numbers(Y),
        "footholds": _packed(np.rint(1000.0 * footholds), "<i2"),
        "reaches": _packed(np.array(reaches), "u1"),
        "colors": {
            "icp": palette.ICP,
            "push": palette.PUSH,
            "left": palette.LEFT,
            "right": palette.RIGHT,
            "reach": palette.REACH,
            "captures": palette.CAPTURE_REGIONS,
        },
    }


def geometry(crossing: bool) -> SwingGeometry:
    """The right swing of a robot that stands on its left foot, at the origin.

    Args:
        crossing: whether legs may cross.

    Returns:
        Its polygons.
    """
    return SwingGeometry(
        SCHEDULE, PARAMS, MODEL, on=MECHANISMS[_SETS[crossing]]
    )


def adjustment(swing: SwingGeometry, time: float, icp: Array) -> Adjustment:
    """Where the controller puts the right foot.

    Args:
        swing: polygons of the swing.
        time: until touchdown [s].
        icp: ICP (2,) [m].

    Returns:
        The adjusted foothold, and the region in which it is.
    """
    return adjust_foothold(
        unadjusted(SCHEDULE),
        Landing(swing, icp, touchdown=(time, time + PARAMS.waiting_time)),
        PARAMS,
        period=ControllerParams().control_period,
    )


def _packed(values: Array, kind: str) -> str:
    """Integers of this kind of numpy's, in base64."""
    return base64.b64encode(values.astype(kind).tobytes()).decode()


def _generators(time: float) -> list[list[list[float]]]:
    """Points (3, 2), at three ICPs, for each CoP and each time of C_1."""
    foot = in_world(USABLE, STANCE, SWING)
    return [
        [
            _numbers(
                one_step_region(
                    icp=np.array(icp),
                    foot=corner[None],
                    omega=MODEL.omega,
                    touchdown=(touchdown, touchdown),
                )[0]
            )
            for icp in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        ]
        for touchdown in (time, time + PARAMS.waiting_time)
        for corner in foot
    ]


def _numbers(values: Array) -> Any:
    """As they are in the page."""
    return np.round(values, _DIGITS).tolist()


SCHEDULE = right_swing(
    FootPoses(STANCE, NOMINAL),
    [NOMINAL, STANCE] * 2,
    swing=LATER[0],
    transfer=LATER[1],
)


if __name__ == "__main__":
    sys.exit(main())
