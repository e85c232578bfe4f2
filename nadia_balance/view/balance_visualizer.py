"""Meshcat view of the controller's plans and measurements."""

import math
from itertools import zip_longest

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Sphere
from pydrake.math import RotationMatrix
from pydrake.systems.framework import Context, LeafSystem

from nadia_balance import palette
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.reachability import circle
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import intersection
from nadia_balance.core.walking.state import (
    FootPose,
    Phase,
    Side,
    WalkingState,
    support_polygon,
)
from nadia_balance.systems.ports import input_port, optional_input
from nadia_balance.view.scene import (
    PERIOD,
    ChangingPolygon,
    Drawing,
    add_arrow,
    add_marker,
    add_polygon,
    at_height,
    hide_before,
    sole_transform,
    transform,
)

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
_SUPPORT, _REACH = f"{ROOT}/support_polygon", f"{REGIONS}/reach"
_CAPTURE = (f"{REGIONS}/c_1", f"{REGIONS}/c_2", f"{REGIONS}/c_3")
# Polygons that change: colour, and whether it is filled.  Those that are not
# opaque are painted after the floor.
_POLYGONS = {
    _SUPPORT: (palette.rgba(palette.SUPPORT), False),
    _REACH: (palette.rgba(palette.REACH, 0.99), False),
    **{
        path: (palette.rgba(color, opacity), True)
        for path, color, opacity in zip(
            _CAPTURE, palette.CAPTURE_REGIONS, palette.OPACITIES, strict=True
        )
    },
}
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
        self, meshcat: Meshcat, sole: Array, ground: Ground | None = None
    ):
        """Adds all objects.

        Args:
            meshcat: where it draws.
            sole: corners (n, 2) [m] of a sole in its frame.
            ground: regions of the ground, if it has any.
        """
        super().__init__()
        self._meshcat, self._sole = meshcat, np.asarray(sole, dtype=float)
        self._walking_state = input_port(self, "walking_state")
        self._com = optional_input(self, "com_state")
        self._icp = optional_input(self, "icp")
        self._icp_reference = optional_input(self, "icp_reference")
        self._ecmp_command = optional_input(self, "ecmp_command")
        self._push_force = optional_input(self, "push_force")
        self._regions = optional_input(self, "capture_regions")
        self._add_objects()
        self._add_ground(ground)
        self.DeclareInitializationPublishEvent(self._forget)
        self.DeclarePeriodicPublishEvent(PERIOD, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)
        self.DeclarePeriodicPublishEvent(
            REGIONS_PERIOD, 0.0, self._draw_regions
        )
        self.DeclareForcedPublishEvent(self._draw_regions)

    def _add_objects(self) -> None:
        self._footsteps = {
            side: [
                self._add_outline(
                    f"{ROOT}/footsteps/{side.value}_{i}",
                    palette.foot_color(side),
                )
                for i in range(STEPS_PER_SIDE)
            ]
            for side in Side
        }
        self._polygons = {
            path: ChangingPolygon(self._meshcat, path, color, filled)
            for path, (color, filled) in _POLYGONS.items()
        }
        self._nominal = self._add_outline(
            f"{REGIONS}/nominal", palette.NOMINAL, dashed=True
        )
        self._region_view = Drawing(self._meshcat, REGIONS)
        self._markers = {
            name: add_marker(self._meshcat, f"{ROOT}/{name}", shape, color)
            for name, (shape, color) in _MARKERS.items()
        }
        self._middle = Drawing(self._meshcat, MIDDLE)
        self._arrow = add_arrow(self._meshcat, f"{ROOT}/push", palette.PUSH)

    def _add_outline(
        self, path: str, color: str, dashed: bool = False
    ) -> Drawing:
        """Adds the outline of a sole."""
        return add_polygon(
            self._meshcat,
            path,
            at_height(self._sole, _REGION),
            palette.rgba(color),
            filled=False,
            outlined=True,
            dashed=dashed,
        )

    def _add_ground(self, ground: Ground | None) -> None:
        for i, region in enumerate(ground.regions if ground else ()):
            if not region.obstacle:
                add_polygon(
                    self._meshcat,
                    f"{ROOT}/ground/{i}",
                    np.column_stack(
                        [
                            region.polygon,
                            region.heights(region.polygon) + _ON_FLOOR,
                        ]
                    ),
                    palette.rgba(palette.GROUND, 0.5),
                ).show(True, None)

    def _forget(self, context: Context) -> None:
        """Removes the drawings of the previous run."""
        self._meshcat.Delete(FOOTPRINTS)
        for polygon in self._polygons.values():
            polygon.forget()
        self._arrow.show(False, context.get_time())

    def _draw(self, context: Context) -> None:
        time = context.get_time()
        state = self._walking_state(context)
        schedule = state.schedule
        ground = float(schedule.feet[schedule.support_side].p_WF[2])
        self._draw_feet(state, time)
        self._polygons[_SUPPORT].draw(
            support_polygon(schedule, self._sole), ground + _OUTLINE, time
        )
        self._draw_points(context, ground)
        self._draw_com_and_push(context)
        if schedule.phase is not Phase.SWING:
            self._region_view.show(False, time)

    def _draw_points(self, context: Context, ground: float) -> None:
        """Draws the points that are on the `ground` [m]."""
        com = self._com(context)
        reference = self._icp_reference(context)
        command = self._ecmp_command(context)
        for name, point in {
            "com_ground": None if com is None else com.position[:2],
            "icp": self._icp(context),
            "icp_reference": None if reference is None else reference.icp,
            "cop": None if command is None else command.cop,
            "ecmp": None if command is None else command.ecmp,
        }.items():
            if point is not None:
                self._markers[name].place(
                    transform([*point, ground]), context.get_time()
                )

    def _draw_feet(self, state: WalkingState, time: float) -> None:
        """Draws a print, numbered by its step, for each foot in contact."""
        schedule = state.schedule
        landed = (
            schedule.footsteps[0].side.other
            if schedule.footsteps
            else schedule.support_side
        )
        for side, outlines in self._footsteps.items():
            if schedule.in_contact(side):
                self._draw_footprint(
                    f"{side.value}_{state.steps_taken - (side is not landed)}",
                    palette.foot_color(side),
                    schedule.feet[side],
                    time,
                )
            poses = [
                sole_transform(step.pose)
                for step in schedule.footsteps
                if step.side is side
            ]
            for outline, X_WF in zip_longest(outlines, poses[:STEPS_PER_SIDE]):
                outline.place(X_WF, time)

    def _draw_footprint(
        self, name: str, color: str, pose: FootPose, time: float
    ) -> None:
        path = f"{FOOTPRINTS}/{name}"
        if self._meshcat.HasPath(path):
            drawing = Drawing(self._meshcat, path)
        else:
            drawing = add_polygon(
                self._meshcat,
                path,
                at_height(self._sole, 0.0),
                palette.rgba(color, 0.6),
            )
            hide_before(drawing, time)
        drawing.place(sole_transform(pose, _PRINT), time)

    def _draw_com_and_push(self, context: Context) -> None:
        time, com = context.get_time(), self._com(context)
        if com is None:
            return
        self._markers["com"].place(transform(com.position), time)
        self._middle.place(transform([*com.position[:2], 0.0]), time)
        force = self._push_force(context)
        if force is not None and np.linalg.norm(force) > 1e-6:
            # A push lasts about three frames, too short to be seen: the arrow
            # is hidden later in the recording.
            R_WP = RotationMatrix.MakeFromOneVector(force, 2)
            self._arrow.show(False, time + LINGER)
            self._arrow.place(transform(com.position, R_WP), time)
        elif force is not None:
            self._arrow.show(False, None)  # a recording shows it longer

    def _draw_regions(self, context: Context) -> None:
        """Draws the capture regions, clipped to RADIUS about the stance foot.

        Long before touchdown they extend for many metres.
        """
        schedule = self._walking_state(context).schedule
        regions = (
            self._regions(context) if schedule.phase is Phase.SWING else None
        )
        if regions is None:
            return
        time = context.get_time()
        x, y, z = schedule.feet[schedule.support_side].p_WF
        near = circle(RADIUS, 24) + [x, y]
        self._polygons[_REACH].draw(regions.reach, z + _OUTLINE, time)
        for i, path in enumerate(_CAPTURE):
            region = (
                intersection(regions.regions[i], near)
                if i < len(regions.regions)
                else np.empty((0, 2))
            )
            self._polygons[path].draw(region, z + _REGION, time)
        feet = [foot for foot in (regions.nominal, regions.adjusted) if foot]
        is_moved = (
            len(feet) == 2 and math.dist(feet[0].p_WF, feet[1].p_WF) > 1e-3
        )
        self._nominal.place(sole_transform(feet[0]) if is_moved else None, time)
        self._region_view.show(True, time)
