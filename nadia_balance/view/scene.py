"""Meshcat: its scene, shapes in it, and what of a closed loop uses it.

A recording stores transforms and properties, and contains every object from
its start on.  An object is therefore set once, and after that only moved, shown
and hidden, always with the time of the frame.
"""

import math

import numpy as np
from pydrake import geometry
from pydrake.geometry import Meshcat, MeshcatParams, Rgba
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody import plant as mbp
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import FootPose
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.wiring import connect
from nadia_balance.view.live_controls import LiveControls

FRAMES_PER_SECOND = 32.0
PERIOD = 1.0 / FRAMES_PER_SECOND  # of frames [s]
ROBOT, GHOST = "/drake/robot", "/drake/ghost"  # as it is, as estimated
CONTROLS = "live_controls"  # name of the LiveControls system
# Lights of the default scene: intensity and new position.  Ambient and fill
# light are strong because the point lights fade with distance.
_LIGHTS = {
    "AmbientLight": (1.3, None),
    "FillLight": (1.9, [4.0, 1.0, 6.0]),
    "PointLightNegativeX": (2.0, None),
    "PointLightPositiveX": (2.0, None),
}
_GHOST = palette.rgba(palette.ICP, 0.3)
_CAMERA, _TARGET = [3.3, 1.9, 1.75], [0.25, 0.0, 0.72]
_FLOOR, _CELL = 15.0, 0.5  # half size, grid [m]
LINE = 0.012  # width of outlines and of the grid [m]


def start_meshcat(port: int | None = None) -> tuple[Meshcat, str]:
    """Returns a Meshcat, and a message if the `port` is busy.

    Then, or without a `port`, it has the first free one from 7000 on.

    Raises ValueError: `port` is not in [1024, 65535].
    """
    # Drake aborts for lower ports, and uses port - 65536 for higher ones.
    if port is not None and not 1024 <= port <= 65535:
        raise ValueError(f"port = {port}: must be in [1024, 65535]")
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port)), ""
    except RuntimeError:
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        return meshcat, f"port {port} is busy: using {meshcat.port()}"


def add_robot_view(
    builder: DiagramBuilder, scene_graph, meshcat, **looks: object
) -> None:
    """Adds a MeshcatVisualizer of visual shapes, if `looks` name no other."""
    looks = {"prefix": ROBOT, "role": geometry.Role.kIllustration} | looks
    looks["publish_period"] = PERIOD
    params = geometry.MeshcatVisualizerParams(**looks)
    add = geometry.MeshcatVisualizer.AddToBuilder
    add(builder, scene_graph, meshcat, params)


def add_ghost(
    builder: DiagramBuilder,
    robot: RobotModel,
    state: OutputPort,
    meshcat: Meshcat,
) -> mbp.MultibodyPlant:
    """Adds the translucent shapes of a `robot` at an estimated `state` [q, v].

    The builder's diagram must not outlive the plant that is returned.
    """
    scene_graph = builder.AddNamedSystem("ghost", geometry.SceneGraph())
    plant = mbp.MultibodyPlant(0.0)
    source = plant.RegisterAsSourceForSceneGraph(scene_graph)
    robot.add_to(plant)
    plant.Finalize()
    poses = builder.AddSystem(MultibodyPositionToGeometryPose(plant, True))
    builder.Connect(state, poses.get_input_port())
    port = scene_graph.get_source_pose_port(source)
    builder.Connect(poses.get_output_port(), port)
    looks = {"role": geometry.Role.kProximity, "default_color": _GHOST}
    add_robot_view(builder, scene_graph, meshcat, prefix=GHOST, **looks)
    return plant


def set_scene(meshcat: Meshcat) -> None:
    """Sets floor, lights, sky and an oblique camera."""
    for light, (intensity, position) in _LIGHTS.items():
        path = f"/Lights/{light}/<object>"
        meshcat.SetProperty(path, "intensity", intensity)
        if position is not None:
            meshcat.SetProperty(path, "position", position)
    sky = "/Background/<object>"
    meshcat.SetProperty(sky, "top_color", palette.rgb(palette.SKY_TOP))
    meshcat.SetProperty(sky, "bottom_color", palette.rgb(palette.SKY_BOTTOM))
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Grid", "visible", False)
    _add_floor(meshcat)
    # A narrow field of view reduces perspective distortion.
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=40.0))
    meshcat.SetCameraPose(_CAMERA, _TARGET)


def move_floor(meshcat: Meshcat, p_W: np.ndarray) -> None:
    """Moves the floor below `p_W` (3,) [m], by whole cells of its grid."""
    x, y = _CELL * np.round(p_W[:2] / _CELL)
    meshcat.SetTransform("/Floor", RigidTransform([x, y, 0.0]))


def _add_floor(meshcat: Meshcat) -> None:
    """Adds a floor and its grid, just below the soles and all drawings."""
    size, half = _FLOOR, 0.5 * LINE
    ticks = np.arange(-size, size + half, _CELL)
    lines = [(x - half, x + half, -size, size) for x in ticks]
    lines += [(-size, size, y - half, y + half) for y in ticks]
    # Each is one mesh of rectangles (x_min, x_max, y_min, y_max) at height z.
    for name, rectangles, z, color in (
        ("plane", [(-size, size, -size, size)], -0.004, palette.FLOOR),
        ("grid", lines, -0.001, palette.GRID),
    ):
        x0, x1, y0, y1 = np.transpose(rectangles)
        xy = np.array([[x0, x1, x1, x0], [y0, y0, y1, y1]])  # (2, 4, n)
        corners = np.vstack([xy.reshape(2, -1), np.full(xy[0].size, z)])
        a, b, c, d = np.arange(xy[0].size, dtype=np.int32).reshape(4, -1)
        triangles = np.hstack([[a, b, c], [a, c, d]])
        look = palette.rgba(color)
        meshcat.SetTriangleMesh(f"/Floor/{name}", corners, triangles, look)


class Drawing:
    """The objects at and under one Meshcat path; hidden until shown."""

    def __init__(self, meshcat: Meshcat, path: str):
        """Hides the `path`; a time of None is not in a recording."""
        self._meshcat, self._path = meshcat, path
        self.show(False, None)

    def show(self, visible: bool, time: float | None) -> None:
        """Shows or hides the objects from `time` [s] on."""
        self._meshcat.SetProperty(self._path, "visible", visible, time)

    def place(self, X_W: RigidTransform | None, time: float) -> None:
        """Shows the objects at the pose X_W; None hides them."""
        if X_W is not None:
            self._meshcat.SetTransform(self._path, X_W, time)
        self.show(X_W is not None, time)


def add_marker(meshcat: Meshcat, path: str, shape, color: str) -> Drawing:
    """Adds a small object that is seen through the robot."""
    # Transparent objects are painted after all opaque ones.
    meshcat.SetObject(path, shape, palette.rgba(color, 0.99))
    seen_through = f"{path}/<object>"
    meshcat.SetProperty(seen_through, "material.depthTest", False)
    meshcat.SetProperty(seen_through, "renderOrder", 1.0)
    return Drawing(meshcat, path)


def add_arrow(meshcat: Meshcat, path: str, color: str) -> Drawing:
    """Adds an arrow along its z axis that points at its origin."""
    shaft, head, gap = 0.41, 0.14, 0.2  # lengths [m]
    # A cone opens along z from its tip; the arrow's tip points along z.
    over = RotationMatrix.MakeXRotation(math.pi)
    middle = [0.0, 0.0, -gap - head - 0.5 * shaft]
    tip = RigidTransform(over, [0.0, 0.0, -gap])
    for part, shape, X in (
        ("shaft", geometry.Cylinder(0.02, shaft), RigidTransform(middle)),
        ("head", geometry.MeshcatCone(head, 0.05, 0.05), tip),
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
) -> Drawing:
    """Adds a convex polygon with `corners` (n, 3) [m], counterclockwise.

    The outline is LINE wide, within the polygon.  A filled polygon is painted
    twice there, which makes a transparent outline darker.
    """
    count = len(corners)
    i = np.arange(count, dtype=np.int32)
    fan = np.stack([0 * i[2:], i[1:-1], i[2:]])
    j = np.roll(i, -1)
    edges = np.hstack([[i, j, j + count], [i, j + count, i + count]])
    points = np.vstack([corners, _inset(corners)]).T
    triangles = np.hstack([fan] * filled + [edges] * outlined)
    meshcat.SetTriangleMesh(path, points, triangles, color)
    # Objects that are painted later, but lie lower, must stay visible.
    if color.a() < 1.0:
        meshcat.SetProperty(f"{path}/<object>", "material.depthWrite", False)
    return Drawing(meshcat, path)


def _inset(corners: Array) -> Array:
    """The corners (n, 3), moved by LINE from both of their edges."""
    edges = np.roll(corners[:, :2], -1, axis=0) - corners[:, :2]
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    after = edges[:, ::-1] * [-1.0, 1.0] / np.maximum(lengths, 1e-9)
    before = np.roll(after, 1, axis=0)  # both point inwards
    # Sharp corners, and those of nearly no polygon, move by 2 LINE at most.
    cosine = np.sum(before * after, axis=1, keepdims=True)
    inset = corners.copy()
    inset[:, :2] += LINE * (before + after) / np.maximum(1.0 + cosine, 0.5)
    return inset


def at_height(polygon: Array, z: float) -> Array:
    """The points (n, 2) with this z, (n, 3) [m]."""
    return np.column_stack([polygon, np.full(len(polygon), z)])


def sole_transform(pose: FootPose, height: float = 0.0) -> RigidTransform:
    """X_WF of a level sole, lifted by a `height` [m]."""
    p_W = pose.p_WF + [0.0, 0.0, height]
    return RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw), p_W)


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
        self._meshcat, self._path, self._color = meshcat, path, color
        self._filled = filled
        self.forget()

    def draw(self, polygon: Array, z: float, time: float) -> None:
        """Shows `polygon` (n, 2) [m] of W at z [m]; an empty one hides it."""
        corners, old = at_height(polygon, z), self._corners
        alike = corners.shape == old.shape
        if alike and (abs(corners - old) < self.STILL).all():
            return
        self._corners = corners
        if self._shown is not None:
            self._shown.show(False, time)
            self._shown = None
        if len(polygon):
            self._count += 1
            path = f"{self._path}/{self._count}"
            new = self._meshcat, path, corners, self._color
            self._shown = add_polygon(*new, self._filled, True)
            hide_before(self._shown, time)
            self._shown.show(True, time)
            self._meshcat.Delete(f"{self._path}/{self._count - self.KEPT}")

    def forget(self) -> None:
        """Removes all shapes."""
        self._meshcat.Delete(self._path)
        self._count, self._corners = 0, np.empty((0, 3))
        self._shown: Drawing | None = None


def hide_before(drawing: Drawing, time: float) -> None:
    """Hides a new object in frames before `time` [s]."""
    if (before := time - PERIOD) >= 0.0:
        drawing.show(False, before)


def add_mechanisms(
    builder: DiagramBuilder,
    on: Mechanisms,
    push: PushSource,
    meshcat: Meshcat | None,
    limits: Array,
) -> OutputPort:
    """Adds the source of `mechanisms`: constant, or LiveControls.

    `limits` (2, 3) are least and most of a velocity command.
    """
    if meshcat is None:
        source = ConstantVectorSource(on.as_vector())
        return builder.AddNamedSystem("mechanisms", source).get_output_port()
    controls = LiveControls(meshcat, on, limits)
    builder.AddNamedSystem(CONTROLS, controls)
    connect(builder, controls, push, "live_push")
    return controls.GetOutputPort("mechanisms")


def add_mouse(builder, plant, scene_graph, meshcat) -> OutputPort | None:
    """Adds Drake's pushes with the mouse; returns the port of their forces.

    The port is not connected; None before Drake 1.57, which has no mouse.
    """
    if not hasattr(VisualizationConfig, "mouse_interaction_stiffness"):
        return None
    kinds = "illustration proximity inertia contacts".split()
    config = VisualizationConfig(**{f"publish_{kind}": False for kind in kinds})
    where = {"plant": plant, "scene_graph": scene_graph, "meshcat": meshcat}
    where["lcm"] = DrakeLcm("memq://null")
    ApplyVisualizationConfig(config, builder, **where)
    applied = plant.GetInputPort("applied_spatial_force")
    spring, index = builder.connection_map()[plant, applied.get_index()]
    forces = spring.get_output_port(index)
    builder.Disconnect(forces, applied)
    return forces


def connect_forces(builder: DiagramBuilder, engine: System, *forces) -> None:
    """Applies the sum of the ports `forces`, if not None, to the `engine`."""
    ports = [port for port in forces if port is not None]
    total = mbp.ExternallyAppliedSpatialForceMultiplexer(len(ports))
    builder.AddSystem(total)
    for i, port in enumerate(ports):
        builder.Connect(port, total.get_input_port(i))
    to = engine.GetInputPort("applied_spatial_force")
    builder.Connect(total.get_output_port(), to)
