"""Meshcat view of the controller's plans and measurements."""

from itertools import zip_longest

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Sphere
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance import palette
from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.ground import Ground
from nadia_balance.core.polygon import support_polygon
from nadia_balance.core.walking import Phase, Side, WalkingState
from nadia_balance.systems.centroidal_estimator import ComState
from nadia_balance.systems.ground_view import GroundView
from nadia_balance.systems.icp_planner import IcpReference
from nadia_balance.systems.momentum_qp import EcmpCommand
from nadia_balance.systems.overlay import (
    Arrow,
    Footprints,
    Marker,
    PolygonOutline,
    RegionOverlay,
    SoleOutline,
)
from nadia_balance.systems.ports import ValueInput

ROOT = "/overlay"
FOOTPRINTS = f"{ROOT}/footprints"  # .../<side>_<number of the step>
MIDDLE = f"{ROOT}/middle"  # no object: a target for a camera
PERIOD = 1.0 / 32.0  # frame period [s]
REGIONS_PERIOD = 1.0 / 16.0  # of the capture regions: many edges [s]
STEPS_PER_SIDE = 2  # planned footsteps drawn per foot
_DISC = Cylinder(0.028, 0.012)
_MARKERS = {
    "com": (Sphere(0.04), palette.COM),
    "com_ground": (_DISC, palette.COM),
    "icp_reference": (Sphere(0.024), palette.ICP_REFERENCE),
    "icp": (Sphere(0.034), palette.ICP),
    "cop": (_DISC, palette.COP),
    "ecmp": (Box(0.046, 0.046, 0.014), palette.ECMP),
}
# Markers on the ground: their port, and the point (2,) in its value.
_ON_GROUND = {
    "com_ground": ("com_state", lambda value: ComState(value).position[:2]),
    "icp_reference": ("icp_reference", lambda value: IcpReference(value).icp),
    "icp": ("icp", lambda value: value),
    "cop": ("ecmp_command", lambda value: EcmpCommand(value).cop),
    "ecmp": ("ecmp_command", lambda value: EcmpCommand(value).ecmp),
}


class BalanceVisualizer(LeafSystem):
    """Draws into Meshcat, live and in recordings; has neither state nor output.

    It draws footprints (filled) and planned footsteps (outlined), left and
    right in their colours; the support polygon; the ICP and its reference
    (balls, large and small); the CoM (ball) and its projection, the CoP (discs)
    and the eCMP (square) on the ground; the push (arrow).  During swings it
    also draws, at a lower rate, the capture regions (filled), the reachability
    region that limits the step, and the nominal foothold if it is adjusted
    (outlined).  The regions of a `ground` are filled; the region of the next
    step is darker.  Signals of unconnected ports are not drawn;
    `walking_state` is required.

    .. pydrake_system::

        name: BalanceVisualizer
        input_ports: [walking_state, com_state, icp, icp_reference,
                      ecmp_command, push_force, capture_regions]
        output_ports: []
    """

    def __init__(
        self, meshcat: Meshcat, sole: np.ndarray, ground: Ground | None = None
    ):
        """Adds all objects; `sole` (n, 2) [m] are the corners of either sole.

        The corners are in the sole's frame.
        """
        super().__init__()
        self._meshcat, self._sole = meshcat, np.asarray(sole, dtype=float)
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        self._com = self.DeclareVectorInputPort("com_state", 6)
        self.DeclareVectorInputPort("icp", 2)
        self.DeclareVectorInputPort("icp_reference", 8)
        self.DeclareVectorInputPort("ecmp_command", 4)
        self._push = self.DeclareVectorInputPort("push_force", 3)
        self._regions = ValueInput(
            self, "capture_regions", CaptureRegions, None
        )
        self._footprints = Footprints(meshcat, FOOTPRINTS, self._sole, PERIOD)
        self._footsteps = {
            side: [
                SoleOutline(
                    meshcat,
                    f"{ROOT}/footsteps/{side.value}_{i}",
                    self._sole,
                    palette.foot_color(side),
                )
                for i in range(STEPS_PER_SIDE)
            ]
            for side in Side
        }
        self._support = PolygonOutline(
            meshcat, f"{ROOT}/support_polygon", 2 * len(sole), palette.SUPPORT
        )
        self._region_overlay = RegionOverlay(
            meshcat, f"{ROOT}/capture_regions", self._sole, PERIOD
        )
        self._ground = ground and GroundView(meshcat, f"{ROOT}/ground", ground)
        self._markers = {
            name: Marker(meshcat, f"{ROOT}/{name}", *look)
            for name, look in _MARKERS.items()
        }
        self._arrow = Arrow(meshcat, f"{ROOT}/push", palette.PUSH)
        self.DeclareInitializationPublishEvent(self._forget)
        for period, draw in (
            (PERIOD, self._draw),
            (REGIONS_PERIOD, self._draw_regions),
        ):
            self.DeclarePeriodicPublishEvent(period, 0.0, draw)
            self.DeclareForcedPublishEvent(draw)

    def _forget(self, context):
        """Removes the drawings of the previous run."""
        self._footprints.forget()
        self._region_overlay.forget()
        self._arrow.hide(context.get_time())
        return EventStatus.Succeeded()

    def _draw(self, context):
        time = context.get_time()
        state = self._walking_state(context)
        schedule = state.schedule
        ground = float(schedule.feet[schedule.support_side].p_WF[2])
        self._draw_feet(state, time)
        if self._ground is not None and schedule.footsteps:
            self._ground.draw(schedule.footsteps[0].pose, time)
        self._support.draw(
            support_polygon(schedule, self._sole), ground + 0.006, time
        )
        for name, (signal, point) in _ON_GROUND.items():
            if (port := self.GetInputPort(signal)).HasValue(context):
                p_W = [*point(port.Eval(context)), ground]
                self._markers[name].draw(p_W, time)
        if self._com.HasValue(context):
            self._draw_com_and_push(context, time)
        if schedule.phase is not Phase.SWING:
            self._region_overlay.hide(time)
        return EventStatus.Succeeded()

    def _draw_regions(self, context):
        state = self._walking_state(context)
        schedule = state.schedule
        found = None
        if schedule.phase is Phase.SWING:
            found = self._regions(context)
        if found is None:
            return EventStatus.DidNothing()
        p_W = schedule.feet[schedule.support_side].p_WF
        self._region_overlay.draw(
            found, p_W[:2], float(p_W[2]), context.get_time()
        )
        return EventStatus.Succeeded()

    def _draw_feet(self, state: WalkingState, time: float) -> None:
        """Draws a print, numbered by its step, for each foot in contact."""
        schedule = state.schedule
        landed = schedule.support_side
        if schedule.footsteps:
            landed = schedule.footsteps[0].side.other
        for side, outlines in self._footsteps.items():
            if schedule.in_contact(side):
                number = state.steps_taken - (side is not landed)
                self._footprints.draw(side, number, schedule.feet[side], time)
            poses = [s.pose for s in schedule.footsteps if s.side is side]
            for outline, pose in zip_longest(outlines, poses[:STEPS_PER_SIDE]):
                outline.draw(pose, time)

    def _draw_com_and_push(self, context, time: float) -> None:
        com = ComState(self._com.Eval(context)).position
        self._markers["com"].draw(com, time)
        middle = [com[0], com[1], 0.0]
        self._meshcat.SetProperty(MIDDLE, "position", middle, time)
        if not self._push.HasValue(context):
            return
        force = self._push.Eval(context)
        if np.linalg.norm(force) > 1e-6:
            self._arrow.draw(com, force, time)
        else:
            self._arrow.hide(None)  # a recording shows it longer
