"""Makes a robot folder of anybody's URDF or MJCF, and sees whether it walks.

Examples:
    python scripts/new_robot.py robot.urdf --out my_robot
    python scripts/new_robot.py robot.urdf --out my_robot --fix ".*_finger_.*"
    python scripts/simulate.py --robot my_robot/robot.yaml \
        --scenario_name walk_in_place
"""

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import run_info, simulate
from nadia_balance.new_robot import Named, Notes
from nadia_balance.results.measurements import joint_speed_ratio, torque_ratio
from nadia_balance.results.summary import summarize
from nadia_balance.robot.margins import margins
from nadia_balance.robot.model import FIDELITIES, RobotModel, load_robot
from nadia_balance.robot.reach import reach_within
from nadia_balance.scripts import command_line

# Twenty seconds of steps, with standing before and after them.
WALK = "{duration: 22.0, gait: {num_steps: 20}}"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    parser = _parser()
    args = parser.parse_args(argv)
    named = Named(**{f.name: getattr(args, f.name) for f in fields(Named)})
    robot = args.out / "robot.yaml"
    with parser.refusing():
        roots = args.package_root or []
        for root in roots:
            if not root.is_dir():
                raise ValueError(f"package-root = {root}: must be a folder")
        if robot.exists() and not args.force:
            raise ValueError(f"{robot}: exists; --force overwrites it")
        notes = _make_robot(
            args.file,
            args.out,
            fix=args.fix or [],
            package_roots=roots,
            armature=args.armature,
            named=named,
        )
        command_line.say(*notes.lines())
        command_line.say(
            _fit_reach(load_robot(str(robot), args.fidelity), args.out)
        )
    command_line.say(f"wrote {args.out}/{{robot.urdf, robot.yaml}}")
    if args.no_walk:
        return command_line.DONE
    return _walk(str(robot), args.fidelity)


def _fit_reach(robot: RobotModel, folder: Path) -> str:
    """Writes the reach of the legs into `folder`; returns a line about it."""
    from nadia_balance.new_robot.write import write_reach

    before = robot.point_mass.reach
    reach, missed = reach_within(robot)
    if reach == before and not missed:
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


def _make_robot(*args, **options) -> Notes:
    """Calls make_robot, whose dependencies are the extra `robots`."""
    try:
        from nadia_balance.new_robot.make import make_robot
    except ImportError as error:
        raise ValueError(
            f"{error.name} is missing: pip install 'nadia_balance[robots]'"
        ) from None
    return make_robot(*args, **options)


_FLAGS: command_line.Flags = {
    "out": {"type": command_line.place, "required": True, "help": "the folder"},
    "force": {"action": "store_true", "help": "overwrite a robot.yaml in it"},
    "fix": {
        "action": "append",
        "metavar": "REGEX",
        "help": "weld the joints of these names; may come several times",
    },
    "package-root": {
        "action": "append",
        "type": command_line.place,
        "metavar": "DIR",
        "help": "has the packages of package://; so do the folders above FILE",
    },
    "armature": {
        "type": command_line.place,
        "metavar": "FILE",
        "help": "an MJCF or URDF with the rotor inertias, by joint names",
    },
    "fidelity": {
        "choices": FIDELITIES,
        "default": "realistic",
        "help": "of the walk",
    },
    "no-walk": {"action": "store_true", "help": "make the folder only"},
}


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        prog="new_robot.py",
        description=__doc__.partition("\n")[0],
        epilog="Exit code: 0 it walks in place (or --no-walk), 1 it does not, "
        "2 bad input.",
    )
    parser.add_argument("file", type=Path, help="a URDF or an MJCF")
    for flag, options in _FLAGS.items():
        parser.add_argument(f"--{flag}", **options)
    group = parser.add_argument_group("names", "Default: they are found.")
    for field in fields(Named):
        joint = field.name in ("hip_pitch", "knee", "ankle_pitch")
        group.add_argument(
            f"--{field.name.replace('_', '-')}",
            default="",
            metavar="JOINT,JOINT" if joint else "LINK",
            help="of both legs" if joint else None,
        )
    return parser


def _walk(robot: str, fidelity: str) -> int:
    """Simulates walking in place and prints the result; returns the exit code.

    The robot may be too small for the parameters of the scenario.
    """
    scenario = load_scenario(
        "walk_in_place", text=WALK, robot=robot, fidelity=fidelity
    )
    try:
        diagram = HumanoidDiagram(scenario)
    except ValueError as error:
        command_line.say(f"DID NOT WALK: {error}")
        return command_line.FAILED
    run = simulate(diagram, scenario.duration)
    info = run_info(scenario, run, "humanoid", "walk_in_place")
    found, log = summarize(run, info), run.logs
    walked = found["recovered"]
    command_line.say(
        f"{'WALKED' if walked else 'DID NOT WALK'}: {found['steps_taken']} "
        f"steps in place, max ICP error {1e3 * found['max_icp_error_m']:.1f} "
        f"mm, max torque {100 * found['max_torque_ratio']:.0f} %"
        + ("" if walked else f": {found['reason']}")
    )
    loads = torque_ratio(log), joint_speed_ratio(log)
    largest = np.max(loads, axis=1, initial=0.0)
    command_line.say(*margins(diagram.robot, *largest))
    return command_line.DONE if walked else command_line.FAILED


if __name__ == "__main__":
    sys.exit(main())
