"""Meshcat: its scene, shapes in it, and what of a closed loop uses it.

A recording stores transforms and properties, and contains every object from
its start on.  An object is therefore set once, and after that only moved, shown
and hidden, always with the time of the frame.
"""

import math
from typing import Any, cast

import numpy as np
from pydrake.geometry import (
    Cylinder,
    Meshcat,
    MeshcatCone,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    Role,
    SceneGraph,
    Shape,
)
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
)
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import FootPose
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.wiring import connect
from nadia_balance.view.live_controls import LiveControls

FRAMES_PER_SECOND = 32.0
PERIOD = 1.0 / FRAMES_PER_SECOND  # of frames [s]
ROBOT, GHOST = "/drake/robot", "/drake/ghost"  # as it is, as estimated
CONTROLS = "live_controls"  # name of the LiveControls system


def _linear(color: str) -> list[float]:
    """Linear red, green and blue, and the opacity 1."""
    return [*(part**2.2 for part in palette.rgb(color)), 1.0]


# Changes of the default scene.  Ambient and fill light are strong because the
# point lights fade with distance.
_PROPERTIES: tuple[tuple[str, str, Any], ...] = (
    ("/Lights/AmbientLight/<object>", "intensity", 1.3),
    ("/Lights/FillLight/<object>", "intensity", 1.9),
    ("/Lights/FillLight/<object>", "position", [4.0, 1.0, 6.0]),
    ("/Lights/PointLightNegativeX/<object>", "intensity", 2.0),
    ("/Lights/PointLightPositiveX/<object>", "intensity", 2.0),
    ("/Background/<object>", "top_color", [*palette.rgb(palette.SKY_TOP)]),
    (
        "/Background/<object>",
        "bottom_color",
        [*palette.rgb(palette.SKY_BOTTOM)],
    ),
    ("/Axes", "visible", False),
    ("/Grid", "visible", False),
)
# What a dark page changes: path, property, its value by day and by night.
# Meshcat takes the colour of a mesh as linear, that of the sky as sRGB.
NIGHT: list[tuple[str, str, list[float], list[float]]] = [
    *(
        (
            "/Background/<object>",
            name,
            [*palette.rgb(day)],
            [*palette.rgb(night)],
        )
        for name, day, night in (
            ("top_color", palette.SKY_TOP, palette.NIGHT_TOP),
            ("bottom_color", palette.SKY_BOTTOM, palette.NIGHT_BOTTOM),
        )
    ),
    *(
        (path, "color", _linear(day), _linear(night))
        for path, day, night in (
            ("/Floor/plane", palette.FLOOR, palette.NIGHT_FLOOR),
            ("/Floor/grid", palette.GRID, palette.NIGHT_GRID),
        )
    ),
]
_CAMERA: Any = [3.3, 1.9, 1.75]  # in W [m]
_TARGET: Any = [0.25, 0.0, 0.72]  # in W [m]
_FLOOR, _CELL = 15.0, 0.5  # half size, grid [m]
LINE = 0.012  # width of outlines and of the grid [m]
DASH = 0.03  # length of a dash, and of the gap after it [m]


def start_meshcat(port: int | None = None) -> tuple[Meshcat, str]:
    """Starts a Meshcat.

    Args:
        port: port of its page, by default the first free one from 7000 on,
            which is also taken if the port is busy.

    Returns:
        The Meshcat, and a message if the port is busy.

    Raises:
        ValueError: `port` is not in [1024, 65535].
    """
    # Drake aborts for lower ports, and uses port - 65536 for higher ones.
    require(
        port is None or 1024 <= port <= 65535,
        f"port = {port}: must be in [1024, 65535]",
    )
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port)), ""
    except RuntimeError:
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        return meshcat, f"port {port} is busy: using {meshcat.port()}"


def add_robot_view(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
    prefix: str = ROBOT,
    role: Role = Role.kIllustration,
    **looks: Any,
) -> None:
    """Adds a MeshcatVisualizer, by default of visual shapes.

    Args:
        builder: builder of the diagram.
        scene_graph: scene graph of the robot, in the builder.
        meshcat: where it is drawn.
        prefix: path of the shapes in Meshcat.
        role: of the shapes that are drawn.
        **looks: other MeshcatVisualizerParams.
    """
    MeshcatVisualizer.AddToBuilder(
        builder,
        scene_graph,
        meshcat,
        MeshcatVisualizerParams(
            publish_period=PERIOD, prefix=prefix, role=role, **looks
        ),
    )


def add_ghost(
    builder: DiagramBuilder,
    robot: RobotModel,
    state: OutputPort,
    meshcat: Meshcat,
) -> MultibodyPlant:
    """Adds the translucent shapes of a robot at an estimated state.

    Args:
        builder: builder of the diagram.
        robot: robot to show.
        state: port of its state [q, v], in the builder.
        meshcat: where it is drawn.

    Returns:
        The plant of the shapes, which must outlive the builder's diagram.
    """
    scene_graph: Any = builder.AddNamedSystem("ghost", SceneGraph())
    plant = MultibodyPlant(0.0)
    source = plant.RegisterAsSourceForSceneGraph(scene_graph)
    robot.add_to(plant)
    plant.Finalize()
    poses = builder.AddSystem(MultibodyPositionToGeometryPose(plant, True))
    builder.Connect(state, poses.get_input_port())
    builder.Connect(
        poses.get_output_port(), scene_graph.get_source_pose_port(source)
    )
    add_robot_view(
        builder,
        scene_graph,
        meshcat,
        prefix=GHOST,
        role=Role.kProximity,
        default_color=palette.rgba(palette.ICP, 0.3),
    )
    return plant


def set_scene(meshcat: Meshcat) -> None:
    """Sets floor, lights, sky and an oblique camera.

    Args:
        meshcat: scene to change.
    """
    for path, name, value in _PROPERTIES:
        meshcat.SetProperty(path, name, value)
    _add_floor(meshcat)
    # A narrow field of view reduces perspective distortion.
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=40.0))
    meshcat.SetCameraPose(_CAMERA, _TARGET)


def move_floor(meshcat: Meshcat, p_W: Array) -> None:
    """Moves the floor below a point, by whole cells of its grid.

    Args:
        meshcat: scene with a floor (see set_scene).
        p_W: the point, (3,) in W [m].
    """
    x, y = _CELL * np.round(p_W[:2] / _CELL)
    meshcat.SetTransform("/Floor", transform([x, y, 0.0]))


def _add_floor(meshcat: Meshcat) -> None:
    """Adds a floor and its grid, just below the soles and all drawings."""
    size, half = _FLOOR, 0.5 * LINE
    ticks = np.arange(-size, size + half, _CELL)
    lines = [
        *((x - half, x + half, -size, size) for x in ticks),
        *((-size, size, y - half, y + half) for y in ticks),
    ]
    # Each is one mesh of rectangles (x_min, x_max, y_min, y_max) at height z.
    for name, rectangles, z, color in (
        ("plane", [(-size, size, -size, size)], -0.004, palette.FLOOR),
        ("grid", lines, -0.001, palette.GRID),
    ):
        x0, x1, y0, y1 = np.transpose(rectangles)
        xy = np.array([[x0, x1, x1, x0], [y0, y0, y1, y1]])  # (2, 4, n)
        corners = np.vstack([xy.reshape(2, -1), np.full(xy[0].size, z)])
        a, b, c, d = np.arange(xy[0].size, dtype=np.int32).reshape(4, -1)
        meshcat.SetTriangleMesh(
            path=f"/Floor/{name}",
            vertices=cast(Any, corners),
            faces=cast(Any, np.hstack([[a, b, c], [a, c, d]])),
            rgba=palette.rgba(color),
        )


class Drawing:
    """The objects at and under one Meshcat path; hidden until shown."""

    def __init__(self, meshcat: Meshcat, path: str):
        """Hides the objects.

        Args:
            meshcat: where they are drawn.
            path: path of the objects.
        """
        self._meshcat, self._path = meshcat, path
        self.show(False, None)

    def show(self, visible: bool, time: float | None) -> None:
        """Shows or hides the objects.

        Args:
            visible: whether they are shown.
            time: time from which on they are [s]; None: not in a recording.
        """
        self._meshcat.SetProperty(self._path, "visible", visible, time)

    def place(self, X_W: RigidTransform | None, time: float) -> None:
        """Shows the objects at a pose.

        Args:
            X_W: pose in W; None hides them.
            time: time from which on they are there [s].
        """
        if X_W is not None:
            self._meshcat.SetTransform(self._path, X_W, time)
        self.show(X_W is not None, time)


def add_marker(
    meshcat: Meshcat, path: str, shape: Shape, color: str, opacity: float = 0.99
) -> Drawing:
    """Adds a small object that is seen through the robot.

    Args:
        meshcat: where it is drawn.
        path: path of the object.
        shape: shape of the object.
        color: colour, written #rrggbb.
        opacity: < 1.

    Returns:
        The object, hidden.
    """
    # Transparent objects are painted after all opaque ones.
    meshcat.SetObject(path, shape, palette.rgba(color, opacity))
    meshcat.SetProperty(f"{path}/<object>", "material.depthTest", False)
    meshcat.SetProperty(f"{path}/<object>", "renderOrder", 1.0)
    return Drawing(meshcat, path)


def add_arrow(meshcat: Meshcat, path: str, color: str) -> Drawing:
    """Adds an arrow along its z axis that points at its origin.

    Args:
        meshcat: where it is drawn.
        path: path of the arrow.
        color: colour, written #rrggbb.

    Returns:
        The arrow, hidden.
    """
    shaft, head, gap = 0.41, 0.14, 0.2  # lengths [m]
    # A cone opens along z from its tip; the arrow's tip points along z.
    for part, shape, X in (
        (
            "shaft",
            Cylinder(0.02, shaft),
            transform([0.0, 0.0, -gap - head - 0.5 * shaft]),
        ),
        (
            "head",
            MeshcatCone(head, 0.05, 0.05),
            transform([0.0, 0.0, -gap], RotationMatrix.MakeXRotation(math.pi)),
        ),
    ):
        meshcat.SetObject(f"{path}/{part}", shape, palette.rgba(color))
        meshcat.SetTransform(f"{path}/{part}", X)
    return Drawing(meshcat, path)


def add_polygon(
    meshcat: Meshcat,
    path: str,
    corners: Array,
    color: Rgba,
    filled: bool = True,
    outlined: bool = False,
    dashed: bool = False,
) -> Drawing:
    """Adds a convex polygon.

    The outline is LINE wide, within the polygon.  A filled polygon is painted
    twice there, which makes a transparent outline darker.

    Args:
        meshcat: where it is drawn.
        path: path of the polygon.
        corners: corners (n, 3) [m], counter-clockwise.
        color: colour and opacity.
        filled: whether it is filled.
        outlined: whether it has an outline.
        dashed: whether that is of dashes.

    Returns:
        The polygon, hidden.
    """
    if dashed:
        corners = _with_points_between(corners)
    count = len(corners)
    i = np.arange(count, dtype=np.int32)
    fan = np.stack([0 * i[2:], i[1:-1], i[2:]])
    i = i[:: 1 + dashed]
    j = (i + 1) % count
    edges = np.hstack([[i, j, j + count], [i, j + count, i + count]])
    meshcat.SetTriangleMesh(
        path=path,
        vertices=cast(Any, np.vstack([corners, _inset(corners)]).T),
        faces=cast(Any, np.hstack([fan] * filled + [edges] * outlined)),
        rgba=color,
    )
    # Objects that are painted later, but lie lower, must stay visible.
    if color.a() < 1.0:
        meshcat.SetProperty(f"{path}/<object>", "material.depthWrite", False)
    return Drawing(meshcat, path)


def _with_points_between(corners: Array) -> Array:
    """Points (k, 3) with the corners (n, 3), DASH apart; k is even."""
    points = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = 2 * max(
            round(0.5 * float(np.linalg.norm(end - start)) / DASH), 1
        )
        shares = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
        points.append(start + shares * (end - start))
    return np.concatenate(points)


def _inset(corners: Array) -> Array:
    """The corners (n, 3), moved by LINE from both of their edges."""
    edges = np.roll(corners[:, :2], -1, axis=0) - corners[:, :2]
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    after = edges[:, ::-1] * [-1.0, 1.0] / np.maximum(lengths, 1e-9)
    before = np.roll(after, 1, axis=0)  # both point inwards
    cosine = np.sum(before * after, axis=1, keepdims=True)
    inset = corners.copy()
    # Sharp corners, and those of nearly no polygon, move by 2 LINE at most.
    inset[:, :2] += LINE * (before + after) / np.maximum(1.0 + cosine, 0.5)
    return inset


def at_height(polygon: Array, z: float) -> Array:
    """Returns the points of a polygon with a height.

    Args:
        polygon: points (n, 2) [m].
        z: height [m].

    Returns:
        The points (n, 3) [m].
    """
    return np.column_stack([polygon, np.full(len(polygon), z)])


def sole_transform(pose: FootPose, height: float = 0.0) -> RigidTransform:
    """Returns X_WF of a level sole.

    Args:
        pose: pose of the sole.
        height: by which it is lifted [m].

    Returns:
        The pose of the sole in W.
    """
    return transform(
        pose.p_WF + [0.0, 0.0, height],
        RotationMatrix(RollPitchYaw(0.0, 0.0, pose.yaw)),
    )


def transform(p: Any, R: RotationMatrix | None = None) -> RigidTransform:
    """Returns a pose.

    Args:
        p: position, three numbers [m].
        R: orientation; by default that of the frame itself.

    Returns:
        The pose.
    """
    return RigidTransform(RotationMatrix() if R is None else R, p)


class ChangingPolygon:
    """A convex polygon of another shape in every frame, with its outline.

    A recording cannot reshape an object, so each shape is a new object that is
    visible only in its own frames.  Only the last KEPT objects are kept, which
    bounds the memory of a long walk.
    """

    KEPT = 1000
    STILL = 0.005  # smaller motions of the corners are not redrawn [m]

    def __init__(
        self, meshcat: Meshcat, path: str, color: Rgba, filled: bool = True
    ):
        """Begins without a shape.

        Args:
            meshcat: where it is drawn.
            path: path of all shapes.
            color: colour and opacity.
            filled: whether the polygon is filled.
        """
        self._meshcat, self._path = meshcat, path
        self._color, self._filled = color, filled
        self.forget()

    def forget(self) -> None:
        """Removes all shapes."""
        self._meshcat.Delete(self._path)
        self._count, self._corners = 0, np.empty((0, 3))
        self._shown: Drawing | None = None

    def draw(self, polygon: Array, z: float, time: float) -> None:
        """Shows a polygon.

        Args:
            polygon: corners (n, 2) in W [m]; without any it is hidden.
            z: height in W [m].
            time: time from which on it is shown [s].
        """
        corners, old = at_height(polygon, z), self._corners
        if (
            corners.shape == old.shape
            and (abs(corners - old) < self.STILL).all()
        ):
            return
        self._corners = corners
        if self._shown is not None:
            self._shown.show(False, time)
            self._shown = None
        if len(polygon):
            self._count += 1
            self._shown = add_polygon(
                self._meshcat,
                f"{self._path}/{self._count}",
                corners,
                self._color,
                filled=self._filled,
                outlined=True,
            )
            hide_before(self._shown, time)
            self._shown.show(True, time)
            self._meshcat.Delete(f"{self._path}/{self._count - self.KEPT}")


def hide_before(drawing: Drawing, time: float) -> None:
    """Hides a new object in the frames before it is shown.

    Args:
        drawing: the object.
        time: time from which on it is shown [s].
    """
    if time - PERIOD >= 0.0:
        drawing.show(False, time - PERIOD)


def add_mechanisms(
    builder: DiagramBuilder,
    on: Mechanisms,
    push: PushSource,
    meshcat: Meshcat | None,
    limits: Array,
    has_switches: bool = True,
) -> OutputPort:
    """Adds the source of `mechanisms`: constant, or LiveControls.

    Args:
        builder: builder of the diagram.
        on: mechanisms that are on at first.
        push: source of pushes, in the builder, that LiveControls triggers.
        meshcat: where the controls are, if there are any.
        limits: least and most of a velocity command, (2, 3).
        has_switches: whether the user can switch the mechanisms.

    Returns:
        The port of the mechanisms.
    """
    if meshcat is None:
        return builder.AddNamedSystem(
            "mechanisms", ConstantVectorSource(cast(Any, on.as_vector()))
        ).get_output_port()
    controls = builder.AddNamedSystem(
        CONTROLS, LiveControls(meshcat, on, limits, has_switches=has_switches)
    )
    connect(builder, controls, push, "live_push")
    return controls.GetOutputPort("mechanisms")


def add_mouse(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
) -> OutputPort | None:
    """Adds Drake's pushes with the mouse.

    Args:
        builder: builder of the diagram.
        plant: plant that is pushed, in the builder.
        scene_graph: scene graph of the plant, in the builder.
        meshcat: where the mouse is.

    Returns:
        The port of their forces, not connected; None before Drake 1.57, which
        has no mouse.
    """
    if not hasattr(VisualizationConfig, "mouse_interaction_stiffness"):
        return None
    ApplyVisualizationConfig(
        VisualizationConfig(
            publish_illustration=False,
            publish_proximity=False,
            publish_inertia=False,
            publish_contacts=False,
        ),
        builder,
        lcm=DrakeLcm("memq://null"),
        plant=plant,
        scene_graph=scene_graph,
        meshcat=meshcat,
    )
    applied = plant.GetInputPort("applied_spatial_force")
    spring, index = builder.connection_map()[plant, applied.get_index()]
    forces: OutputPort = spring.get_output_port(index)
    builder.Disconnect(forces, applied)
    return forces


def connect_forces(
    builder: DiagramBuilder, engine: System, *forces: OutputPort | None
) -> None:
    """Applies the sum of forces to an engine.

    Args:
        builder: builder of the diagram.
        engine: system with a port `applied_spatial_force`, in the builder.
        *forces: ports of spatial forces, in the builder; None are left out.
    """
    ports = [port for port in forces if port is not None]
    total = builder.AddSystem(
        ExternallyAppliedSpatialForceMultiplexer(len(ports))
    )
    for i, port in enumerate(ports):
        builder.Connect(port, total.get_input_port(i))
    builder.Connect(
        total.get_output_port(), engine.GetInputPort("applied_spatial_force")
    )
