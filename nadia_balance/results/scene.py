"""The scene in Meshcat: floor, light and camera."""

import numpy as np
from pydrake.geometry import (
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from nadia_balance import palette

FRAMES_PER_SECOND = 32.0
ROBOT = "/drake/robot"  # path of the robot in the scene

_MIN_PORT, _MAX_PORT = 1024, 65535
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

    Without a `port`, or if it is busy, Meshcat uses the first free port from
    7000 on.

    Raises:
        ValueError: `port` is not in [1024, 65535].
    """
    if port is None:
        return Meshcat(MeshcatParams(host="localhost")), ""
    if not _MIN_PORT <= port <= _MAX_PORT:
        # Drake aborts for lower ports, and uses port - 65536 for higher ones.
        raise ValueError(
            f"port = {port}: must be in [{_MIN_PORT}, {_MAX_PORT}]"
        )
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port)), ""
    except RuntimeError:
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        return meshcat, f"port {port} is busy: using {meshcat.port()}"


def add_robot_view(
    builder: DiagramBuilder, scene_graph: SceneGraph, meshcat: Meshcat
) -> MeshcatVisualizer:
    """Adds a MeshcatVisualizer of the robot's visual shapes only."""
    return MeshcatVisualizer.AddToBuilder(
        builder,
        scene_graph,
        meshcat,
        MeshcatVisualizerParams(
            role=Role.kIllustration,
            prefix=ROBOT,
            publish_period=1.0 / FRAMES_PER_SECOND,
        ),
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
    _add_rectangles(meshcat, "/Floor/plane", floor, -0.004, palette.FLOOR)
    _add_rectangles(meshcat, "/Floor/grid", lines, -0.001, palette.GRID)


def _add_rectangles(
    meshcat: Meshcat,
    path: str,
    rectangles: list[tuple[float, float, float, float]],
    z: float,
    color: str,
) -> None:
    """Adds one mesh of rectangles (x_min, x_max, y_min, y_max) at height z."""
    corners = [
        p
        for x0, x1, y0, y1 in rectangles
        for p in ((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))
    ]
    first = 4 * np.arange(len(rectangles))
    triangles = np.concatenate(
        [[first, first + 1, first + 2], [first, first + 2, first + 3]], axis=1
    )
    meshcat.SetTriangleMesh(
        path,
        np.array(corners).T,
        triangles.astype(np.int32),
        palette.rgba(color),
    )
