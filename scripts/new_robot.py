"""Makes a robot folder of anybody's URDF or MJCF, and sees whether it walks."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import sys
from pathlib import Path

import numpy as np

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import simulate
from nadia_balance.results.folder import appearing, prepare_folder
from nadia_balance.results.measurements import joint_speed_ratio, torque_ratio
from nadia_balance.robot.model import FIDELITIES, RobotModel, load_robot
from nadia_balance.robot.reach import margins, reach_within, too_weak
from nadia_balance.scripts import command_line

# Twenty seconds of steps, with standing before and after them.
WALK = "{duration: 22.0, gait: {num_steps: 20}}"
NAMES = "pelvis", "torso", "left_foot", "right_foot"
MADE = "robot.urdf", "robot.yaml"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    parser = _parser()
    args = parser.parse_args(argv)
    with parser.refusing():
        for root in args.package_root or []:
            if not root.is_dir():
                raise ValueError(f"package-root = {root}: must be a folder")
        args.file.stat()  # the error names it as the user did
        source = args.file.resolve()
        for path in (args.out / name for name in MADE):
            if path.resolve() == source:
                raise ValueError(f"out = {args.out}: must not be that of FILE")
            if path.exists() and not args.force:
                raise ValueError(f"{path}: exists; --force overwrites it")
        known = args.out.exists()
        folder = prepare_folder(args.out)
    try:
        with appearing(folder) as drafts:
            with parser.refusing():
                _make(args, drafts)
            if (meshes := drafts / "meshes").exists():
                (folder / "meshes").mkdir(exist_ok=True)
                for mesh in meshes.iterdir():
                    mesh.replace(folder / "meshes" / mesh.name)
                meshes.rmdir()
    finally:
        if not known and not any(folder.iterdir()):
            folder.rmdir()
    command_line.say(f"wrote {folder}/{{{', '.join(MADE)}}}")
    if args.no_walk:
        return command_line.DONE
    return _walk(str(folder / "robot.yaml"), args.fidelity)


def _make(args: argparse.Namespace, folder: Path) -> None:
    """Makes the robot in `folder` and says how; ValueError: it cannot be."""
    try:
        from nadia_balance.new_robot.make import make_robot
    except ImportError as error:
        install = "pip install 'nadia_balance[robots]'"
        raise ValueError(f"{error.name} is missing: {install}") from None
    given = {"package_roots": args.package_root or [], "fix": args.fix or []}
    given["named"] = {name: getattr(args, name) for name in NAMES}
    notes = make_robot(args.file, folder, armature=args.armature, **given)
    command_line.say(*notes.lines())
    try:
        made = load_robot(str(folder / "robot.yaml"), args.fidelity)
    except ValueError as error:
        words = str(error).replace(str(folder), str(args.out))
        raise ValueError(words) from None
    command_line.say(_fit_reach(made, folder), *too_weak(made))


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
    codes = "0 it walks, 1 not, 2 bad input, 4 cannot write, 130 Ctrl-C."
    parser = command_line.CommandLine(__file__, __doc__, codes)
    parser.add_argument("file", type=Path, help="a URDF or an MJCF")
    add, path = parser.add_argument, command_line.place
    add("--out", type=path, required=True, help="the folder")
    add("--force", action="store_true", help="overwrite a robot in it")
    about = "weld the joints of these names; may come several times"
    add("--fix", action="append", metavar="REGEX", help=about)
    several = {"action": "append", "type": path, "metavar": "DIR"}
    about = "has the packages of package://; so do the folders above FILE"
    add("--package-root", **several, help=about)
    about = "an MJCF or URDF with the rotor inertias, by joint names"
    add("--armature", type=path, metavar="FILE", help=about)
    which = {"choices": FIDELITIES, "default": "realistic"}
    add("--fidelity", **which, help="of the walk")
    add("--no-walk", action="store_true", help="make the folder only")
    add = parser.add_argument_group("names").add_argument
    for name in NAMES:
        flag = f"--{name.replace('_', '-')}"
        add(flag, metavar="LINK", help="default: it is found")
    return parser


def _walk(robot: str, fidelity: str) -> int:
    """Simulates walking in place and prints the result; returns the code."""
    which = {"robot": robot, "fidelity": fidelity}
    scenario = load_scenario("walk_in_place", text=WALK, **which)
    try:
        diagram = HumanoidDiagram(scenario)
    except ValueError as error:  # it may be too small for the parameters
        command_line.say(f"DID NOT WALK: {error}")
        return command_line.FAILED
    run = simulate(diagram, scenario.duration)
    found = run.summary
    loads = torque_ratio(run.logs), joint_speed_ratio(run.logs)
    failed = "" if found["recovered"] else f": {found['reason']}"
    command_line.say(
        f"{'DID NOT WALK' if failed else 'WALKED'}: {found['steps_taken']} "
        f"steps in place, max ICP error {1e3 * found['max_icp_error_m']:.1f} "
        f"mm, max torque {100 * found['max_torque_ratio']:.0f} %{failed}",
        *margins(diagram.robot, *np.max(loads, axis=1, initial=0.0)),
    )
    return command_line.FAILED if failed else command_line.DONE


if __name__ == "__main__":
    sys.exit(main())
