"""Writes run.mcap, for Foxglove, into the folder of a run."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import contextlib
import io
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.geometry import Ellipsoid, Rgba, Role, Sphere
from pydrake.math import RigidTransform

from nadia_balance.palette import COP, FLOOR, ICP, ICP_REFERENCE, rgba
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import load_tree
from nadia_balance.results.folder import appearing, new_folder
from nadia_balance.results.log import VIEWS, Log
from nadia_balance.results.npz import read_npz
from nadia_balance.results.versions import other_version
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.scripts import command_line

FILE, EVERY = "run.mcap", 8  # ticks from picture to picture
POINTS = {"icp": ICP, "icp_reference": ICP_REFERENCE, "ecmp_command": COP}


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        0; bad input exits.
    """
    parser = command_line.CommandLine(
        __file__, __doc__, "0 written, 2 bad input, 4 cannot write, 130 Ctrl-C."
    )
    parser.add_argument("run", type=command_line.place, help="its folder")
    run = parser.parse_args(argv).run
    with contextlib.ExitStack() as stack:
        with parser.refusing():
            _require_foxglove()
            require(
                not (run / FILE).exists(),
                f"run = {str(run)!r}: must be a folder without {FILE}",
            )
            log, columns, robot = read_run(run)
            stack.enter_context(new_folder(run, "", [FILE]))
        with appearing(run) as drafts:
            (drafts / FILE).write_bytes(mcap_of(log, columns, robot))
    command_line.say(f"wrote {run / FILE}")
    return command_line.DONE


def _require_foxglove() -> None:
    try:
        import foxglove  # noqa: F401
    except ImportError as error:
        raise ValueError(
            f"{error.name} is missing: pip install 'nadia_balance[mcap]'"
        ) from None


def read_run(run: Path) -> tuple[Log, dict[str, list[str]], RobotModel]:
    """Reads the folder of a run.

    Args:
        run: the folder.

    Returns:
        The log, the names of its signals' columns, and the robot.

    Raises:
        ValueError: a file is missing or broken, or of another robot.
    """
    try:
        tree = load_tree((run / "scenario.yaml").read_text("utf-8"))
        (scenario,) = dict(tree).values()
        robot = load_robot(scenario["robot"], scenario["fidelity"])
        log = read_npz(run / "log.npz")
        return log, _columns(log, robot), robot
    except (OSError, *command_line.BROKEN) as error:
        raise ValueError(
            f"run = {str(run)!r}: must be the folder of a run, with log.npz, "
            f"scenario.yaml ({error}{other_version(run)})"
        ) from None


def _columns(log: Log, robot: RobotModel) -> dict[str, list[str]]:
    """Names of the columns of each signal; ValueError: of another robot."""
    states = robot.control_plant().GetStateNames(False)
    joints = log.get("actuator_names", ())
    names: dict[str, Any] = {
        **{name: view.get_fields() for name, view in VIEWS.items()},
        "icp": "xy",
        "momentum_rate": "xyz",
        "state": states,
        "estimated_state": states,
        "actuation": joints,
        "torques": joints,
    }
    columns = {}
    for name, values in log.items():
        if values.ndim == 2 and len(values) == len(log["t"]):
            numbered = [f"column_{i}" for i in range(values.shape[1])]
            columns[name] = [str(one) for one in names.get(name, numbered)]
            require(
                len(columns[name]) == len(numbered),
                f"{name} has {len(numbered)} columns",
            )
    return columns


def mcap_of(
    log: Log, columns: Mapping[str, list[str]], robot: RobotModel
) -> bytes:
    """Makes a file with a topic of JSON for each signal, and `/scene`.

    Times are those of the log; what is not finite is null.

    Args:
        log: of a run.
        columns: names of the columns of each signal.
        robot: of the run.

    Returns:
        The bytes of the file.
    """
    import foxglove

    context, file = foxglove.Context(), io.BytesIO()
    topics = {
        name: foxglove.Channel(
            f"/{name}",
            schema={
                "title": name,
                "type": "object",
                "properties": dict.fromkeys(names, {"type": "number"}),
            },
            context=context,
        )
        for name, names in columns.items()
    }
    scene = foxglove.channels.SceneUpdateChannel("/scene", context=context)
    pictures = scenes(log, robot)
    with foxglove.open_mcap(file, context=context):
        for row, time in enumerate(log["t"]):
            nanoseconds = round(1e9 * time)
            for name, topic in topics.items():
                values = log[name][row]
                values = np.where(np.isfinite(values), values, None)
                topic.log(
                    dict(zip(columns[name], values, strict=True)),
                    log_time=nanoseconds,
                )
            if row % EVERY == 0:
                scene.log(next(pictures), log_time=nanoseconds)
    return file.getvalue()


def scenes(log: Log, robot: RobotModel) -> Iterator[Any]:
    """Draws every eighth row, in W.

    Ellipsoids of the robot are exact, other shapes their oriented boxes; ICP,
    its reference and the commanded CoP are balls at z = 0.

    Args:
        log: of a run.
        robot: of the run.

    Yields:
        A SceneUpdate.
    """
    from foxglove import messages

    diagram, plant, graph = robot.control_diagram()
    root = diagram.CreateDefaultContext()
    inspector: Any = graph.model_inspector()
    context = plant.GetMyMutableContextFromRoot(root)
    query: Any = graph.get_query_output_port().Eval(
        graph.GetMyContextFromRoot(root)
    )
    for row in range(0, len(log["t"]), EVERY):
        boxes: list[dict[str, Any]] = []
        balls = [
            _look(
                RigidTransform(cast(Any, [*log[name][row, :2], 0.0])),
                size=[0.03] * 3,
                color=rgba(color),
            )
            for name, color in POINTS.items()
            if name in log
        ]
        if "state" in log:
            plant.SetPositions(
                context, cast(Any, log["state"][row, : plant.num_positions()])
            )
            for shape in inspector.GetAllGeometryIds(Role.kIllustration):
                box = inspector.GetObbInGeometryFrame(shape)
                properties = inspector.GetIllustrationProperties(shape)
                is_round = isinstance(
                    inspector.GetShape(shape), Ellipsoid | Sphere
                )
                (balls if is_round else boxes).append(
                    _look(
                        query.GetPoseInWorld(shape) @ box.pose(),
                        2.0 * box.half_width(),
                        properties.GetPropertyOrDefault(
                            "phong", "diffuse", rgba(FLOOR)
                        ),
                    )
                )
        yield messages.SceneUpdate(
            entities=[
                messages.SceneEntity(
                    frame_id="W",
                    id="run",
                    spheres=[messages.SpherePrimitive(**one) for one in balls],
                    cubes=[messages.CubePrimitive(**one) for one in boxes],
                )
            ]
        )


def _look(X_WS: RigidTransform, size: Any, color: Rgba) -> dict[str, Any]:
    """Pose, size (3,) [m] and colour of a shape S, as messages."""
    from foxglove import messages

    p, wxyz = X_WS.translation(), X_WS.rotation().ToQuaternion().wxyz()
    return {
        "pose": messages.Pose(
            position=messages.Vector3(x=p[0], y=p[1], z=p[2]),
            orientation=messages.Quaternion(
                w=wxyz[0], x=wxyz[1], y=wxyz[2], z=wxyz[3]
            ),
        ),
        "size": messages.Vector3(x=size[0], y=size[1], z=size[2]),
        "color": messages.Color(
            r=color.r(), g=color.g(), b=color.b(), a=color.a()
        ),
    }


if __name__ == "__main__":
    sys.exit(main())
