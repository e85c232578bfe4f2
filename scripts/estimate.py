"""Estimates a robot's state from a log of its sensors, and draws it."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import contextlib
import itertools
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from pydrake.systems.analysis import Simulator

from nadia_balance.core.estimation.gaps import bridged
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.diagrams.scenario import SENSORS
from nadia_balance.parameters.bounds import require
from nadia_balance.results.estimation import lost_at, measure_estimate
from nadia_balance.results.folder import appearing, new_folder
from nadia_balance.results.log import Log
from nadia_balance.results.npz import read_npz
from nadia_balance.results.plots.style import RC
from nadia_balance.results.plots.time_series import draw_estimate
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.scripts import command_line
from nadia_balance.systems.estimation import StateEstimator

SENSED = "imu", "joints", "foot_forces"
UNITS = 0.3  # error of a force at first, above which it has another unit [-]
FILES = "estimate.npz", "estimate.png"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        The exit code of --help.
    """
    parser = _parser()
    args = parser.parse_args(argv)
    with contextlib.ExitStack() as stack:
        with parser.refusing():
            robot, sensors = load_robot(args.robot), load_sensors(args.sensors)
            log = read_sensed(args.log, robot)
            period = float(log["t"][-1]) / (len(log["t"]) - 1)
            estimator = StateEstimator(
                robot=robot,
                sensors=sensors,
                period=period,
                q=None,
                height=None if args.uneven else 0.0,
            )
            folder = stack.enter_context(
                new_folder(args.out, "estimate", FILES)
            )
            log = estimated(log, estimator, period)
        _write(folder, log, {"robot": args.robot, "mechanisms": args.log.name})
    errors = (measure_estimate(log) if "state" in log else None) or {}
    lost = lost_at(log)
    command_line.say(
        *(f"{name}: {value:.4g}" for name, value in errors.items()),
        *([] if lost is None else [f"ESTIMATOR LOST at {lost:.2f} s"]),
        f"wrote {folder}/{{{', '.join(FILES)}}}",
    )
    return command_line.DONE if lost is None else command_line.FAILED


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 estimated, 1 lost, 2 bad input, 4 cannot write, 130 Ctrl-C.",
    )
    parser.add_argument(
        "log", type=command_line.place, help="npz or CSV, see docs/sensors.md"
    )
    parser.add_argument(
        "--robot", default="nadia", help="(%(default)s) or a robot.yaml"
    )
    parser.add_argument(
        "--sensors",
        choices=SENSORS[1:],
        default="consumer",
        help="how wrong they are (%(default)s)",
    )
    parser.add_argument("--uneven", action="store_true", help="rough ground")
    parser.add_argument(
        "--out", type=command_line.place, help="folder for the results"
    )
    return parser


def _write(folder: Path, log: Log, run: dict[str, Any]) -> None:
    """Writes FILES; the title of the plot tells of the `run`."""
    with appearing(folder) as drafts, mpl.rc_context(cast(Any, RC)):
        np.savez(drafts / FILES[0], **cast(Any, log))
        cast(
            Any, draw_estimate(log, run | {"pushes": [], "fell_at": None})
        ).savefig(drafts / FILES[1])


def read_sensed(path: Path, robot: RobotModel) -> dict[str, Array]:
    """Reads what sensors have told.

    Args:
        path: of an npz or a CSV, see docs/sensors.md.
        robot: whose sensors they are.

    Returns:
        `t` (n,) from 0 [s], SENSED and, if it is there, `state`.

    Raises:
        ValueError: one is missing, not of its size, or has a gap that is told
            by row and time.
    """
    names = robot.control_plant().GetPositionNames(False, False)[7:]
    try:
        require(path.stat().st_size > 0, "it is empty")
        if path.suffix == ".csv":
            log = _read_csv(path, names)
        elif path.suffix == ".npz":
            log = _read_npz(path)
        else:
            raise ValueError("by its name it is neither")
        return _checked(log, len(names), robot.mass)
    except command_line.BROKEN as error:
        raise ValueError(
            f"log = {path}: must be a CSV or npz as in docs/sensors.md "
            f"({error})"
        ) from None


def _read_csv(path: Path, joints: Sequence[str]) -> dict[str, Array]:
    columns = {
        "imu": [
            f"{part}_{axis}" for part in ("gyro", "force") for axis in "xyz"
        ],
        "joints": [*joints, *(f"{joint}_speed" for joint in joints)],
        "foot_forces": ["left_force", "right_force"],
    }
    encoding = "utf-8-sig"  # a spreadsheet's
    with open(path, encoding=encoding) as file:
        header = [name.strip() for name in file.readline().split(",")]
    for name in "t", *itertools.chain(*columns.values()):
        require(
            name in header,
            f"it has no column {name}; it begins with {', '.join(header[:4])}",
        )
    table = np.genfromtxt(
        path,
        delimiter=",",
        names=True,
        deletechars="",
        replace_space=" ",
        encoding=encoding,
        ndmin=1,  # also of a single row
    )
    return {
        "t": table["t"],
        **{
            name: np.array([table[column] for column in part]).T
            for name, part in columns.items()
        },
    }


def _read_npz(path: Path) -> dict[str, Array]:
    log = read_npz(path)
    for name in "t", *SENSED:
        require(
            name in log, f"it has no {name}; it has {', '.join([*log][:4])}"
        )
    return {
        name: log[name].astype(float)
        for name in {"t", *SENSED, *({"state"} & {*log})}
    }


def _checked(
    log: dict[str, Array], num_joints: int, mass: float
) -> dict[str, Array]:
    """Completes the IMU, and bridges short gaps.

    Raises ValueError: a bad log, also one that does not begin with a robot of
    this `mass` [kg] that stands, in our units.
    """
    t = log.pop("t")
    if log["imu"].shape[1:] == (6,):
        log["imu"] = np.hstack((log["imu"], log["imu"][:, :3]))
    sizes = {
        "imu": 9,
        "joints": 2 * num_joints,
        "foot_forces": 2,
        "state": 13 + 2 * num_joints,
    }
    for name, size in sizes.items():
        require(
            name not in log or log[name].shape == (len(t), size),
            f"{name} must be ({len(t)}, {size})",
        )
    log = bridged(t, log)
    first = {name: values[:10].mean(axis=0) for name, values in log.items()}
    force = first["imu"][3:6]
    specific = float(np.linalg.norm(force))
    require(
        force[2] >= 0.0 and abs(specific / GRAVITY - 1.0) <= UNITS,
        f"force_x, force_y, force_z = {force.round(2).tolist()} at first: must "
        "be 9.81 m/s^2 together, upward, while it stands",
    )
    angles = np.abs(log["joints"][:, :num_joints]).max()
    require(
        angles <= 2.0 * math.pi,
        f"joints reach {angles:.3g}: must be angles in rad",
    )
    load = first["foot_forces"].sum()
    require(
        abs(load / (mass * GRAVITY) - 1.0) <= UNITS,
        f"left_force and right_force are {load:.4g} N at first: must be its "
        f"weight, {mass * GRAVITY:.4g} N, while it stands",
    )
    return log


def estimated(
    log: dict[str, Array], estimator: StateEstimator, period: float
) -> dict[str, Array]:
    """Estimates the state at each tick of a log.

    Args:
        log: `t` and SENSED.
        estimator: of the robot; it begins with the first row.
        period: of the log [s].

    Returns:
        The log with the estimates and their covariances.

    Raises:
        ValueError: as the estimator raises.
    """
    simulator = Simulator(estimator)
    context = simulator.get_mutable_context()
    states, covariances = [], []
    try:
        for i in range(len(log["t"])):
            for name in SENSED:
                estimator.GetInputPort(name).FixValue(context, log[name][i])
            states.append(
                estimator.GetOutputPort("estimated_state").Eval(context)
            )
            covariances.append(
                estimator.GetOutputPort("estimate_covariance").Eval(context)
            )
            simulator.AdvanceTo((i + 1) * period)
    except RuntimeError as error:
        raise ValueError(str(error)) from None
    return {
        **log,
        "estimated_state": np.array(states),
        "estimate_covariance": np.array(covariances),
    }


if __name__ == "__main__":
    sys.exit(main())
