"""Estimates a robot's state from a log of its sensors, and draws it."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import contextlib
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.scenario import SENSORS
from nadia_balance.results.estimation import lost_at, measure_estimate
from nadia_balance.results.folder import appearing, new_folder
from nadia_balance.results.log import Log
from nadia_balance.results.plots.style import RC
from nadia_balance.results.plots.time_series import draw_estimate
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.scripts import command_line
from nadia_balance.systems.estimation import StateEstimator

SENSED = "imu", "joints", "foot_forces"
FILES = "estimate.npz", "estimate.png"
_CSV = {"delimiter": ",", "names": True, "deletechars": ""}
_CSV |= {"encoding": "utf-8-sig"}  # a spreadsheet's


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    codes = "0 estimated, 1 lost, 2 bad input, 4 cannot write, 130 Ctrl-C."
    parser = command_line.CommandLine(__file__, __doc__, codes)
    path, add = command_line.place, parser.add_argument
    add("log", type=path, help="npz or CSV, see docs/sensors.md")
    add("--robot", default="nadia", help="(%(default)s) or a robot.yaml")
    pick = {"choices": SENSORS[1:], "default": "consumer"}
    add("--sensors", **pick, help="how wrong they are (%(default)s)")
    add("--uneven", action="store_true", help="rough ground")
    add("--out", type=path, help="folder for the results")
    args = parser.parse_args(argv)
    with contextlib.ExitStack() as held:
        with parser.refusing():
            robot, sensors = load_robot(args.robot), load_sensors(args.sensors)
            log = read_sensed(args.log, robot)
            period = float(log["t"][-1]) / (len(log["t"]) - 1)
            height = None if args.uneven else 0.0
            q = standing(log["joints"][0], robot)
            block = StateEstimator(robot, sensors, period, q, height)
            folder = held.enter_context(new_folder(args.out, "estimate", FILES))
            log = estimated(log, block, period)
        what = {"robot": args.robot, "mechanisms": args.log.name}
        with appearing(folder) as drafts, mpl.rc_context(RC):
            np.savez(drafts / FILES[0], **log)
            figure = draw_estimate(log, what | {"pushes": [], "fell_at": None})
            figure.savefig(drafts / FILES[1])
    found = (measure_estimate(log) if "state" in log else None) or {}
    lost = lost_at(log)
    command_line.say(
        *(f"{name}: {value:.4g}" for name, value in found.items()),
        *([] if lost is None else [f"ESTIMATOR LOST at {lost:.2f} s"]),
        f"wrote {folder}/{{{', '.join(FILES)}}}",
    )
    return command_line.DONE if lost is None else command_line.FAILED


def read_sensed(path: Path, robot: RobotModel) -> dict[str, np.ndarray]:
    """Returns `t` (n,) from 0, SENSED and, if it is there, `state` of a log.

    Raises ValueError: one is missing, not of its size, or `t` is uneven.
    """
    joints = robot.control_plant().GetPositionNames(False, False)[7:]
    imu = [f"{of}_{axis}" for of in ("gyro", "force") for axis in "xyz"]
    speeds = [f"{joint}_speed" for joint in joints]
    columns = imu, [*joints, *speeds], ["left_force", "right_force"]
    sizes = dict(zip(SENSED, (9, 2 * len(joints), 2), strict=True))
    try:
        if not path.stat().st_size:
            raise ValueError("it is empty")
        if path.suffix == ".csv":
            table = np.genfromtxt(path, **_CSV)
            parts = [np.array([table[c] for c in of]).T for of in columns]
            log = dict(zip(SENSED, parts, strict=True)) | {"t": table["t"]}
        elif path.suffix != ".npz":
            raise ValueError("by its name it is neither")
        else:
            with np.load(path, allow_pickle=False) as data:
                names = {"t", *SENSED, *({"state"} & {*data})}
                log = {name: data[name].astype(float) for name in names}
        t = log["t"] = log["t"] - log["t"][0]
        log["imu"] = np.hstack((log["imu"], log["imu"][:, :3]))[:, :9]
        for name, size in (sizes | {"state": 13 + sizes["joints"]}).items():
            if name in log and log[name].shape != (len(t), size):
                raise ValueError(f"{name} must be ({len(t)}, {size})")
        if not 0.0 < np.ptp(np.diff(t)) + t[1] < 1.02 * t[1]:
            raise ValueError("t must rise in equal steps")
        if log["imu"][0, 5] < 0.0:
            raise ValueError("force_z must be 9.81 m/s^2 while it stands")
    except command_line.BROKEN as error:
        what = f"a CSV or npz as in docs/sensors.md ({error})"
        raise ValueError(f"log = {path}: must be {what}") from None
    return log


def standing(joints: np.ndarray, robot: RobotModel) -> np.ndarray:
    """Positions (nq,) with these joint angles, level soles about W's origin."""
    plant = robot.control_plant()
    own, n = plant.CreateDefaultContext(), plant.num_positions() - 7
    q = np.array([1.0, *np.zeros(6), *joints[:n]])
    plant.SetPositions(own, q)
    left, right = (
        plant.GetFrameByName(foot).CalcPoseInWorld(own) @ robot.X_FootSole[side]
        for side, foot in robot.foot_bodies.items()
    )
    middle = 0.5 * (left.translation() + right.translation())
    X_WB = RigidTransform(left.rotation(), middle).inverse()
    q[:7] = *X_WB.rotation().ToQuaternion().wxyz(), *X_WB.translation()
    return q


def estimated(log: Log, block: StateEstimator, period: float) -> Log:
    """Returns `log` with the estimates; ValueError: as the estimator raises."""
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    told = {"estimated_state": [], "estimate_covariance": []}
    try:
        for i in range(len(log["t"])):
            for name in SENSED:
                block.GetInputPort(name).FixValue(context, log[name][i])
            for name, rows in told.items():
                rows.append(block.GetOutputPort(name).Eval(context))
            simulator.AdvanceTo((i + 1) * period)
    except RuntimeError as error:
        raise ValueError(str(error)) from None
    return {**log, **{name: np.array(rows) for name, rows in told.items()}}


if __name__ == "__main__":
    sys.exit(main())
