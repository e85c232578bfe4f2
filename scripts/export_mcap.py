"""Writes run.mcap, for Foxglove, into the folder of a run."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import contextlib
import io
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.geometry import Ellipsoid, Role, Sphere
from pydrake.math import RigidTransform

from nadia_balance.palette import COP, FLOOR, ICP, ICP_REFERENCE, rgba
from nadia_balance.parameters.yaml_reader import load_tree
from nadia_balance.results.folder import appearing, new_folder
from nadia_balance.results.log import _VIEWS, Log
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.scripts import command_line

FILE, EVERY = "run.mcap", 8  # ticks from picture to picture
POINTS = {"icp": ICP, "icp_reference": ICP_REFERENCE, "ecmp_command": COP}
_COLOR = "phong", "diffuse", rgba(FLOOR)  # property and default


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    codes = "0 written, 2 bad input, 4 cannot write, 130 Ctrl-C."
    parser = command_line.CommandLine(__file__, __doc__, codes)
    parser.add_argument("run", type=command_line.place, help="its folder")
    run = parser.parse_args(argv).run
    with contextlib.ExitStack() as held:
        with parser.refusing():
            try:
                import foxglove  # noqa: F401
            except ImportError as error:
                how = "pip install 'nadia_balance[mcap]'"
                raise ValueError(f"{error.name} is missing: {how}") from None
            found = read_run(run)
            held.enter_context(new_folder(run, "", [FILE]))
        with appearing(run) as drafts:
            (drafts / FILE).write_bytes(mcap_of(*found))
    command_line.say(f"wrote {run / FILE}")
    return command_line.DONE


def read_run(run: Path) -> tuple[Log, dict[str, list[str]], RobotModel]:
    """Returns the log, the names of its signals' columns, and the robot.

    Raises ValueError: a file is missing or broken, or of another robot.
    """
    try:
        text = (run / "scenario.yaml").read_text("utf-8")
        (given,) = dict(load_tree(text)).values()
        robot = load_robot(given["robot"], given["fidelity"])
        with np.load(io.BytesIO((run / "log.npz").read_bytes())) as data:
            log = dict(data)
        states = robot.control_plant().GetStateNames(False)
        joints = log.get("actuator_names", ())
        known = {name: view.get_fields() for name, view in _VIEWS.items()}
        known |= {"icp": "xy", "momentum_rate": "xyz"}
        known |= {"state": states, "estimated_state": states}
        known |= {"actuation": joints, "torques": joints}
        columns = {}
        for name, values in log.items():
            if values.ndim == 2 and len(values) == len(log["t"]):
                usual = [f"column_{i}" for i in range(values.shape[1])]
                columns[name] = [str(one) for one in known.get(name, usual)]
                if len(columns[name]) != len(usual):
                    raise ValueError(f"{name} has {len(usual)} columns")
        return log, columns, robot
    except (OSError, *command_line.BROKEN) as error:
        what = f"the folder of a run, with log.npz, scenario.yaml ({error})"
        raise ValueError(f"run = {str(run)!r}: must be {what}") from None


def mcap_of(log: Log, columns: dict, robot: RobotModel) -> bytes:
    """Returns a file with a topic of JSON for each signal, and `/scene`.

    Times are those of the log; what is not finite is null.
    """
    import foxglove

    here, file = {"context": foxglove.Context()}, io.BytesIO()
    topics = {}
    for name, names in columns.items():
        kind = {"properties": dict.fromkeys(names, {"type": "number"})}
        kind |= {"title": name, "type": "object"}
        topics[name] = foxglove.Channel(f"/{name}", schema=kind, **here)
    scene = foxglove.channels.SceneUpdateChannel("/scene", **here)
    pictures = scenes(log, robot)
    with foxglove.open_mcap(file, **here):
        for row, time in enumerate(log["t"]):
            at = {"log_time": round(1e9 * time)}
            for name, topic in topics.items():
                values = log[name][row]
                values = np.where(np.isfinite(values), values, None)
                topic.log(dict(zip(columns[name], values, strict=True)), **at)
            if row % EVERY == 0:
                scene.log(next(pictures), **at)
    return file.getvalue()


def scenes(log: Log, robot: RobotModel) -> Iterator:
    """Yields a SceneUpdate of every eighth row, in W.

    Ellipsoids of the robot are exact, other shapes their oriented boxes; ICP,
    its reference and the commanded CoP are balls at z = 0.
    """
    from foxglove import messages

    def looks(X_WS: RigidTransform, size, color) -> dict:
        w, x, y, z = X_WS.rotation().ToQuaternion().wxyz()
        turn = messages.Quaternion(w=w, x=x, y=y, z=z)
        place, size = (
            messages.Vector3(**dict(zip("xyz", xyz, strict=True)))
            for xyz in (X_WS.translation(), size)
        )
        color = messages.Color(**dict(zip("rgba", color.rgba, strict=True)))
        pose = messages.Pose(position=place, orientation=turn)
        return {"pose": pose, "size": size, "color": color}

    diagram, plant, graph = robot.control_diagram()
    root, seen = diagram.CreateDefaultContext(), graph.model_inspector()
    own = plant.GetMyMutableContextFromRoot(root)
    query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(root))
    for row in range(0, len(log["t"]), EVERY):
        balls, boxes = [], []
        for name in filter(log.__contains__, POINTS):
            X_WP = RigidTransform([*log[name][row, :2], 0.0])
            balls.append(looks(X_WP, [0.03] * 3, rgba(POINTS[name])))
        if "state" in log:
            plant.SetPositions(own, log["state"][row, : plant.num_positions()])
            for one in seen.GetAllGeometryIds(Role.kIllustration):
                box = seen.GetObbInGeometryFrame(one)
                X_WB = query.GetPoseInWorld(one) @ box.pose()
                color = seen.GetIllustrationProperties(one)
                color = color.GetPropertyOrDefault(*_COLOR)
                is_round = isinstance(seen.GetShape(one), Ellipsoid | Sphere)
                look = looks(X_WB, 2.0 * box.half_width(), color)
                (balls if is_round else boxes).append(look)
        spheres = [messages.SpherePrimitive(**ball) for ball in balls]
        cubes = [messages.CubePrimitive(**box) for box in boxes]
        shapes = {"spheres": spheres, "cubes": cubes}
        entity = messages.SceneEntity(frame_id="W", id="run", **shapes)
        yield messages.SceneUpdate(entities=[entity])


if __name__ == "__main__":
    sys.exit(main())
