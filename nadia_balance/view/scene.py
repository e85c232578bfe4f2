"""Meshcat: its scene, and the parts of a closed loop that use it."""

import numpy as np
from pydrake import geometry
from pydrake.geometry import Meshcat, MeshcatParams, SceneGraph
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.multibody import plant as mbp
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

from nadia_balance import palette
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.wiring import connect
from nadia_balance.view.live_controls import LiveControls

FRAMES_PER_SECOND = 32.0
ROBOT = "/drake/robot"  # path of the robot in the scene
CONTROLS = "live_controls"  # name of the LiveControls system
# Lights of the default scene: intensity and new position.  Ambient and fill
# light are strong because the point lights fade with distance.
_LIGHTS = {
    "AmbientLight": (1.3, None),
    "FillLight": (1.9, [4.0, 1.0, 6.0]),
    "PointLightNegativeX": (2.0, None),
    "PointLightPositiveX": (2.0, None),
}
_CAMERA, _TARGET = [3.3, 1.9, 1.75], [0.25, 0.0, 0.72]
_FLOOR, _CELL, _LINE = 15.0, 0.5, 0.012  # half size, grid, line width [m]


def start_meshcat(port: int | None = None) -> tuple[Meshcat, str]:
    """Returns a Meshcat, and a message if the `port` is busy.

    Then, or without a `port`, it has the first free one from 7000 on.

    Raises ValueError: `port` is not in [1024, 65535].
    """
    if port is None:
        return Meshcat(MeshcatParams(host="localhost")), ""
    # Drake aborts for lower ports, and uses port - 65536 for higher ones.
    if not 1024 <= port <= 65535:
        raise ValueError(f"port = {port}: must be in [1024, 65535]")
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port)), ""
    except RuntimeError:
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        return meshcat, f"port {port} is busy: using {meshcat.port()}"


def add_robot_view(
    builder: DiagramBuilder, scene_graph: SceneGraph, meshcat: Meshcat
) -> None:
    """Adds a MeshcatVisualizer of the robot's visual shapes only."""
    params = geometry.MeshcatVisualizerParams(
        role=geometry.Role.kIllustration,
        prefix=ROBOT,
        publish_period=1.0 / FRAMES_PER_SECOND,
    )
    geometry.MeshcatVisualizer.AddToBuilder(
        builder, scene_graph, meshcat, params
    )


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
    size, half = _FLOOR, 0.5 * _LINE
    ticks = np.arange(-size, size + half, _CELL)
    lines = [(x - half, x + half, -size, size) for x in ticks]
    lines += [(-size, size, y - half, y + half) for y in ticks]
    floor = [(-size, size, -size, size)]
    # Each is one mesh of rectangles (x_min, x_max, y_min, y_max) at height z.
    for name, rectangles, z, color in (
        ("plane", floor, -0.004, palette.FLOOR),
        ("grid", lines, -0.001, palette.GRID),
    ):
        corners = [
            p
            for x0, x1, y0, y1 in rectangles
            for p in ((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))
        ]
        a, b, c, d = 4 * np.arange(len(rectangles)) + np.arange(4)[:, None]
        triangles = np.hstack([[a, b, c], [a, c, d]]).astype(np.int32)
        rgba, path = palette.rgba(color), f"/Floor/{name}"
        meshcat.SetTriangleMesh(path, np.transpose(corners), triangles, rgba)


def add_mechanisms(
    builder: DiagramBuilder,
    on: Mechanisms,
    push: PushSource,
    meshcat: Meshcat | None,
) -> OutputPort:
    """Adds the source of `mechanisms`: constant, or LiveControls."""
    if meshcat is None:
        source = ConstantVectorSource(on.as_vector())
        return builder.AddNamedSystem("mechanisms", source).get_output_port()
    controls = builder.AddNamedSystem(CONTROLS, LiveControls(meshcat, on))
    connect(builder, controls, push, "live_push")
    return controls.GetOutputPort("mechanisms")


def add_mouse(
    builder: DiagramBuilder,
    plant: mbp.MultibodyPlant,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
) -> OutputPort | None:
    """Adds Drake's pushes with the mouse; returns the port of their forces.

    The port is not connected; None before Drake 1.57, which has no mouse.
    """
    if not hasattr(VisualizationConfig, "mouse_interaction_stiffness"):
        return None
    config = VisualizationConfig(
        publish_illustration=False,
        publish_proximity=False,
        publish_inertia=False,
        publish_contacts=False,
    )
    where = {"plant": plant, "scene_graph": scene_graph, "meshcat": meshcat}
    lcm = DrakeLcm("memq://null")
    ApplyVisualizationConfig(config, builder, lcm=lcm, **where)
    applied = plant.GetInputPort("applied_spatial_force")
    spring, index = builder.connection_map()[plant, applied.get_index()]
    forces = spring.get_output_port(index)
    builder.Disconnect(forces, applied)
    return forces


def connect_forces(
    builder: DiagramBuilder, engine: System, *forces: OutputPort | None
) -> None:
    """Applies the sum of the `forces` that are not None to the `engine`."""
    ports = [port for port in forces if port is not None]
    source = ports[0]
    if len(ports) > 1:
        both = builder.AddSystem(
            mbp.ExternallyAppliedSpatialForceMultiplexer(len(ports))
        )
        for i, port in enumerate(ports):
            builder.Connect(port, both.get_input_port(i))
        source = both.get_output_port()
    builder.Connect(source, engine.GetInputPort("applied_spatial_force"))
