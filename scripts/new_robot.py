"""Makes a robot folder of anybody's URDF or MJCF, and sees whether it walks."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import sys
from pathlib import Path

import numpy as np

from nadia_balance.core.walking.mechanisms import MOST
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import STANDING, load_scenario
from nadia_balance.diagrams.simulation import simulate
from nadia_balance.parameters.bounds import require
from nadia_balance.results.folder import appearing, prepare_folder
from nadia_balance.results.measurements import joint_speed_ratio, torque_ratio
from nadia_balance.robot.model import FIDELITIES, RobotModel, load_robot
from nadia_balance.robot.reach import margins, reach_within, too_weak
from nadia_balance.scripts import command_line
from nadia_balance.sweep.run_trial import run_trial
from nadia_balance.sweep.search import SearchParams, Sweep, limit
from nadia_balance.sweep.trials import Row, results_of

# Twenty seconds of steps, with standing before and after them.
WALK = "{duration: 22.0, gait: {num_steps: 20}}"
NAMES = "pelvis", "torso", "left_foot", "right_foot"
MADE = "robot.urdf", "robot.yaml"
# Resolution and first size of the standing push, over sqrt(g z): 3 runs.
COARSE, FIRST = 0.1, 0.3  # [-]


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Makes the robot's folder and simulates a walk.

    Args:
        argv: command line; by default the program's.

    Returns:
        The exit code of --help.
    """
    parser = _parser()
    args = parser.parse_args(argv)
    with parser.refusing():
        _check_paths(args)
        is_new = not args.out.exists()
        folder = prepare_folder(args.out)
    try:
        with appearing(folder) as drafts:
            with parser.refusing():
                _make(args, drafts)
            _replace_meshes(drafts / "meshes", folder / "meshes")
    finally:
        if is_new and not any(folder.iterdir()):
            folder.rmdir()
    command_line.say(f"wrote {folder}/{{{', '.join(MADE)}}}")
    return (
        command_line.DONE
        if args.no_walk
        else _walk(str(folder / "robot.yaml"), args.fidelity)
    )


def _check_paths(args: argparse.Namespace) -> None:
    """Refuses folders that are missing, and files that would be lost."""
    for root in args.package_root or []:
        require(root.is_dir(), f"package-root = {root}: must be a folder")
    args.file.stat()  # the error names it as the user did
    for path in (args.out / name for name in MADE):
        require(
            path.resolve() != args.file.resolve(),
            f"out = {args.out}: must not be that of FILE",
        )
        require(
            args.force or not path.exists(),
            f"{path}: exists; --force overwrites it",
        )


def _replace_meshes(drafts: Path, folder: Path) -> None:
    if drafts.exists():
        folder.mkdir(exist_ok=True)
        for mesh in drafts.iterdir():
            mesh.replace(folder / mesh.name)
        drafts.rmdir()


def _make(args: argparse.Namespace, folder: Path) -> None:
    """Makes the robot in `folder` and says how; ValueError: it cannot be."""
    try:
        from nadia_balance.new_robot.make import make_robot
    except ImportError as error:
        raise ValueError(
            f"{error.name} is missing: pip install 'nadia_balance[robots]'"
        ) from None
    command_line.say(
        *make_robot(
            args.file,
            folder,
            fix=args.fix or [],
            package_roots=args.package_root or [],
            armature=args.armature,
            named={name: getattr(args, name) for name in NAMES},
        ).lines()
    )
    try:
        robot = load_robot(str(folder / "robot.yaml"), args.fidelity)
    except ValueError as error:
        raise ValueError(
            str(error).replace(str(folder), str(args.out))
        ) from None
    command_line.say(_fit_reach(robot, folder), *too_weak(robot))


def _fit_reach(robot: RobotModel, folder: Path) -> str:
    """Writes the reach of the legs into `folder`; returns a line about it."""
    from nadia_balance.new_robot.make import write_reach

    reach, missed = reach_within(robot)
    if reach == robot.point_mass.reach and not missed:
        return "guessed: the legs get to every corner of that reach"
    write_reach(folder, reach)
    if missed:
        return (
            f"unknown: how far it can step: of {', '.join(sorted(missed))}, "
            "not all is within the legs' reach, however short"
        )
    return (
        f"guessed: reach cut down to {reach.length_forward:.2f} m forward, "
        f"{reach.width_max:.2f} m out, {reach.width_forward:.2f} and "
        f"{reach.width_backward:.2f} m across, by inverse kinematics"
    )


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 it walks, 1 not, 2 bad input, 4 cannot write, 130 Ctrl-C.",
    )
    parser.add_argument(
        "file", type=command_line.place, help="a URDF or an MJCF"
    )
    parser.add_argument(
        "--out", type=command_line.place, required=True, help="the folder"
    )
    parser.add_argument(
        "--force", action="store_true", help="overwrite a robot in it"
    )
    parser.add_argument(
        "--fix",
        action="append",
        metavar="REGEX",
        help="weld the joints of these names; may come several times",
    )
    parser.add_argument(
        "--package-root",
        action="append",
        type=command_line.place,
        metavar="DIR",
        help="has the packages of package://; so do the folders above FILE",
    )
    parser.add_argument(
        "--armature",
        type=command_line.place,
        metavar="FILE",
        help="an MJCF or URDF with the rotor inertias, by joint names",
    )
    parser.add_argument(
        "--fidelity",
        choices=FIDELITIES,
        default="realistic",
        help="of the walk",
    )
    parser.add_argument(
        "--no-walk", action="store_true", help="make the folder only"
    )
    names = parser.add_argument_group("names")
    for name in NAMES:
        names.add_argument(
            f"--{name.replace('_', '-')}",
            metavar="LINK",
            help="default: it is found",
        )
    return parser


def _walk(robot: str, fidelity: str) -> int:
    """Simulates walking in place and prints the result; returns the code."""
    scenario = load_scenario(
        "walk_in_place", text=WALK, robot=robot, fidelity=fidelity
    )
    try:
        diagram = HumanoidDiagram(scenario)
    except ValueError as error:  # it may be too small for the parameters
        command_line.say(f"DID NOT WALK: {error}")
        return command_line.FAILED
    run = simulate(diagram, scenario.duration)
    if run.interrupted:
        raise KeyboardInterrupt
    summary = run.summary
    failed = "" if summary["recovered"] else f": {summary['reason']}"
    command_line.say(
        f"{'DID NOT WALK' if failed else 'WALKED'}: {summary['steps_taken']} "
        f"steps in place, max ICP error "
        f"{1e3 * summary['max_icp_error_m']:.1f} mm, max torque "
        f"{100 * summary['max_torque_ratio']:.0f} %{failed}",
        *margins(
            diagram.robot,
            np.max(torque_ratio(run.logs), axis=0, initial=0.0),
            np.max(joint_speed_ratio(run.logs), axis=0, initial=0.0),
        ),
    )
    if failed:
        return command_line.FAILED
    command_line.say(_standing_push(diagram.robot, robot, fidelity))
    return command_line.DONE


def _standing_push(model: RobotModel, robot: str, fidelity: str) -> str:
    """Searches the push from which it recovers as it stands; tells it."""
    mass = model.point_mass
    speed = mass.froude_speed
    sweep = Sweep(
        scenarios={
            "push": load_scenario("push", robot=robot, fidelity=fidelity)
        },
        at=(STANDING,),
        mechanisms=(MOST,),
        search=SearchParams(resolution=COARSE * speed, stride=1, replicas=1),
    )
    (cell,) = sweep.cells()
    sweep.first[cell] = FIRST * speed
    rows: list[Row] = []
    while batch := sweep.attempts(cell, results_of(rows)):
        rows.append(run_trial(sweep, cell, *batch[0]))
        if rows[-1]["reason"] == "interrupted":
            raise KeyboardInterrupt
    largest = limit(results_of(rows), sweep.search)
    reason = next(
        (row["reason"] for row in rows if row["delta_v"] == largest.failed), ""
    )
    delta_v = largest.recovered or 0.0
    above = (
        "and nothing larger was tried"
        if largest.failed is None
        else f"not from {largest.failed:.2f}: {reason}"
    )
    return (
        f"standing, pushed forward for 0.1 s: recovers from {delta_v:.2f} m/s "
        f"({delta_v * mass.mass:.3g} N s), {above}"
    )


if __name__ == "__main__":
    sys.exit(main())
