"""Meshcat view of the controller's plans and measurements."""

import math
from itertools import zip_longest

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance import palette
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.reachability import circle
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import intersection
from nadia_balance.core.walking import state as walking
from nadia_balance.systems.ports import input_port, optional_input
from nadia_balance.view import scene

ROOT = "/overlay"
FOOTPRINTS = f"{ROOT}/footprints"  # .../<side>_<number of the step>
REGIONS = f"{ROOT}/capture_regions"
MIDDLE = f"{ROOT}/middle"  # no object: a target for a camera
REGIONS_PERIOD = 1.0 / 16.0  # of the capture regions: many edges [s]
STEPS_PER_SIDE = 2  # planned footsteps drawn per foot
LINGER = 0.5  # extra time for which a recording shows a push [s]
RADIUS = 1.2  # capture regions are clipped to it, about the stance foot [m]
_DISC = Cylinder(0.028, 0.012)
_MARKERS = {
    "com": (Sphere(0.04), palette.COM),
    "com_ground": (_DISC, palette.COM),
    "icp_reference": (Sphere(0.024), palette.ICP_REFERENCE),
    "icp": (Sphere(0.034), palette.ICP),
    "cop": (_DISC, palette.COP),
    "ecmp": (Box(0.046, 0.046, 0.014), palette.ECMP),
}
# Polygons that change: colour, and whether it is filled.  Those that are not
# opaque are painted after the floor.
_POLYGONS = {
    f"{ROOT}/support_polygon": (palette.rgba(palette.SUPPORT), False),
    f"{REGIONS}/reach": (palette.rgba(palette.REACH, 0.99), False),
}
_SHADES = zip(palette.CAPTURE_REGIONS, palette.OPACITIES, strict=True)
for _i, _look in enumerate(_SHADES, start=1):
    _POLYGONS[f"{REGIONS}/c_{_i}"] = (palette.rgba(*_look), True)
# Heights above the ground [m], so that none hides another one.
_ON_FLOOR, _PRINT, _REGION, _OUTLINE = 0.0005, 0.002, 0.004, 0.006


class BalanceVisualizer(LeafSystem):
    """Draws into Meshcat, live and in recordings; has neither state nor output.

    It draws footprints (filled) and planned footsteps (outlined), left and
    right in their colours; the support polygon; the ICP and its reference
    (balls, large and small); the CoM (ball) and its projection, the CoP (discs)
    and the eCMP (square) on the ground; the push (arrow).  During swings it
    also draws, at a lower rate, the capture regions (filled), the reachability
    region that limits the step, and the nominal foothold if it is adjusted
    (outlined).  The regions of a `ground` are filled.  Signals of unconnected
    ports are not drawn; `walking_state` is required.

    .. pydrake_system::

        name: BalanceVisualizer
        input_ports: [walking_state, com_state, icp, icp_reference,
                      ecmp_command, push_force, capture_regions]
        output_ports: []
    """

    def __init__(
        self, meshcat: Meshcat, sole: np.ndarray, ground: Ground | None = None
    ):
        """Adds all objects; `sole` (n, 2) [m] are its corners in its frame."""
        super().__init__()
        self._meshcat, self._sole = meshcat, np.asarray(sole, dtype=float)
        self._walking_state = input_port(self, "walking_state")
        self._com = optional_input(self, "com_state")
        self._on_ground = [
            optional_input(self, "icp"),
            optional_input(self, "icp_reference"),
            optional_input(self, "ecmp_command"),
        ]
        self._push = optional_input(self, "push_force")
        self._regions = optional_input(self, "capture_regions")
        self._add_objects(meshcat, ground)
        self.DeclareInitializationPublishEvent(self._forget)
        draws = {scene.PERIOD: self._draw, REGIONS_PERIOD: self._draw_regions}
        for period, draw in draws.items():
            self.DeclarePeriodicPublishEvent(period, 0.0, draw)
            self.DeclareForcedPublishEvent(draw)

    def _add_objects(self, meshcat: Meshcat, ground: Ground | None) -> None:
        def sole(path: str, color: str) -> scene.Drawing:
            corners = scene.at_height(self._sole, _REGION)
            shade = palette.rgba(color)
            return scene.add_polygon(meshcat, path, corners, shade, False, True)

        self._footsteps: dict[walking.Side, list[scene.Drawing]] = {}
        for side in walking.Side:
            path, color = f"{ROOT}/footsteps/{side.value}", palette.foot_color
            steps = (f"{path}_{i}" for i in range(STEPS_PER_SIDE))
            self._footsteps[side] = [sole(one, color(side)) for one in steps]
        self._polygons = {
            path: scene.ChangingPolygon(meshcat, path, color, filled)
            for path, (color, filled) in _POLYGONS.items()
        }
        self._nominal = sole(f"{REGIONS}/nominal", palette.NOMINAL)
        self._region_view = scene.Drawing(meshcat, REGIONS)
        self._markers = {
            name: scene.add_marker(meshcat, f"{ROOT}/{name}", *look)
            for name, look in _MARKERS.items()
        }
        self._middle = scene.Drawing(meshcat, MIDDLE)
        self._arrow = scene.add_arrow(meshcat, f"{ROOT}/push", palette.PUSH)
        for i, region in enumerate(ground.regions if ground else ()):
            if not region.obstacle:
                z = region.heights(region.polygon) + _ON_FLOOR
                corners = np.column_stack([region.polygon, z])
                what = f"{ROOT}/ground/{i}", corners
                color = palette.rgba(palette.GROUND, 0.5)
                scene.add_polygon(meshcat, *what, color).show(True, None)

    def _forget(self, context):
        """Removes the drawings of the previous run."""
        self._meshcat.Delete(FOOTPRINTS)
        for polygon in self._polygons.values():
            polygon.forget()
        self._arrow.show(False, context.get_time())
        return EventStatus.Succeeded()

    def _draw(self, context):
        time = context.get_time()
        state = self._walking_state(context)
        schedule = state.schedule
        ground = float(schedule.feet[schedule.support_side].p_WF[2])
        self._draw_feet(state, time)
        support = walking.support_polygon(schedule, self._sole)
        outline = self._polygons[f"{ROOT}/support_polygon"]
        outline.draw(support, ground + _OUTLINE, time)
        com = self._com(context)
        icp, reference, command = (port(context) for port in self._on_ground)
        for name, point in {
            "com_ground": com and com.position[:2],
            "icp": icp,
            "icp_reference": reference and reference.icp,
            "cop": command and command.cop,
            "ecmp": command and command.ecmp,
        }.items():
            if point is not None:
                p_W = [*point, ground]
                self._markers[name].place(RigidTransform(p_W), time)
        if com is not None:
            self._draw_com_and_push(context, com.position, time)
        if schedule.phase is not walking.Phase.SWING:
            self._region_view.show(False, time)
        return EventStatus.Succeeded()

    def _draw_feet(self, state: walking.WalkingState, time: float) -> None:
        """Draws a print, numbered by its step, for each foot in contact."""
        schedule = state.schedule
        landed = schedule.support_side
        if schedule.footsteps:
            landed = schedule.footsteps[0].side.other
        for side, outlines in self._footsteps.items():
            if schedule.in_contact(side):
                number = state.steps_taken - (side is not landed)
                self._draw_sole(side, number, schedule.feet[side], time)
            poses = [s.pose for s in schedule.footsteps if s.side is side]
            for outline, pose in zip_longest(outlines, poses[:STEPS_PER_SIDE]):
                outline.place(pose and scene.sole_transform(pose), time)

    def _draw_sole(self, side: walking.Side, number: int, pose, time) -> None:
        path = f"{FOOTPRINTS}/{side.value}_{number}"
        if self._meshcat.HasPath(path):
            drawing = scene.Drawing(self._meshcat, path)
        else:
            color = palette.rgba(palette.foot_color(side), 0.6)
            corners = scene.at_height(self._sole, 0.0)
            drawing = scene.add_polygon(self._meshcat, path, corners, color)
            scene.hide_before(drawing, time)
        drawing.place(scene.sole_transform(pose, _PRINT), time)

    def _draw_com_and_push(self, context, com: Array, time: float) -> None:
        self._markers["com"].place(RigidTransform(com), time)
        self._middle.place(RigidTransform([com[0], com[1], 0.0]), time)
        if (force := self._push(context)) is None:
            return
        if np.linalg.norm(force) <= 1e-6:
            self._arrow.show(False, None)  # a recording shows it longer
            return
        # A push lasts about three frames, too short to be seen: the arrow is
        # hidden later in the recording.
        R = RotationMatrix.MakeFromOneVector(force, 2)
        self._arrow.show(False, time + LINGER)
        self._arrow.place(RigidTransform(R, com), time)

    def _draw_regions(self, context):
        """Draws the capture regions, clipped to RADIUS about the stance foot.

        Long before touchdown they extend for many metres.
        """
        schedule = self._walking_state(context).schedule
        swings = schedule.phase is walking.Phase.SWING
        if not swings or (found := self._regions(context)) is None:
            return EventStatus.DidNothing()
        time = context.get_time()
        x, y, z = schedule.feet[schedule.support_side].p_WF
        near = circle(RADIUS, 24) + [x, y]
        drawn = {"reach": found.reach}
        drawn |= dict.fromkeys(("c_1", "c_2", "c_3"), np.empty((0, 2)))
        for i, region in enumerate(found.regions[:3], start=1):
            drawn[f"c_{i}"] = intersection(region, near)
        for name, polygon in drawn.items():
            above = _OUTLINE if name == "reach" else _REGION
            self._polygons[f"{REGIONS}/{name}"].draw(polygon, z + above, time)
        feet = [f.p_WF for f in (found.nominal, found.adjusted) if f]
        is_moved = len(feet) == 2 and math.dist(*feet) > 1e-3
        X_WF = scene.sole_transform(found.nominal) if is_moved else None
        self._nominal.place(X_WF, time)
        self._region_view.show(True, time)
        return EventStatus.Succeeded()
