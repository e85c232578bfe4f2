"""What the controller thinks, drawn into Meshcat."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Box, Cylinder, Meshcat, Sphere
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import (
    ContactSchedule,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems import palette
from nadia_balance.systems.overlay import Arrow, Marker, PolygonOutline
from nadia_balance.systems.overlay_regions import RegionOverlay
from nadia_balance.systems.overlay_soles import Footprints, SoleOutline
from nadia_balance.systems.ports import eval_typed

ROOT = "/overlay"
MIDDLE = f"{ROOT}/middle"  # no object: where a camera may look
REGIONS_PERIOD = 1.0 / 16.0  # they have many edges: not in every frame [s]
STEPS_PER_SIDE = 2  # of the footsteps still to land, so many are drawn


class BalanceVisualizer(LeafSystem):
    """Draws into Meshcat, live and in recordings; has neither state nor output.

    Footprints (filled) and footsteps still to land (outlined), left and right
    in their colours; the support polygon; the ICP and its reference (balls,
    large and small); the CoM (ball) and its projection, the CoP (discs) and
    the eCMP (square) on the ground; the push (arrow).  In swings the capture
    regions, the reachability region that the step respects, and the nominal
    foothold if it is adjusted, all outlined, and redrawn less often: they
    have many edges.  What is not connected is not drawn, except that
    `walking_state` is needed.

    .. pydrake_system::

        name: BalanceVisualizer
        input_ports: [walking_state, com_state, icp, icp_reference,
                      ecmp_command, push_force, capture_regions]
        output_ports: []
    """

    def __init__(
        self,
        meshcat: Meshcat,
        sole: np.ndarray,
        publish_period: float = 1.0 / 32.0,
        regions_period: float = REGIONS_PERIOD,
    ):
        """`sole` (n, 2) [m] are the corners of either sole in its frame.

        Draws every `publish_period` [s], regions every `regions_period`.
        """
        super().__init__()
        self._meshcat, self._sole = meshcat, np.asarray(sole, dtype=float)
        self._walking_state = self.DeclareAbstractInputPort(
            "walking_state", Value(object())
        )
        self._com = self.DeclareVectorInputPort("com_state", 6)
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._reference = self.DeclareVectorInputPort("icp_reference", 8)
        self._ecmp = self.DeclareVectorInputPort("ecmp_command", 4)
        self._push = self.DeclareVectorInputPort("push_force", 3)
        self._regions = self.DeclareAbstractInputPort(
            "capture_regions", Value(object())
        )
        self._add_feet(publish_period)
        self._add_points()
        self._region_overlay = RegionOverlay(
            self._meshcat, f"{ROOT}/capture_regions", self._sole
        )
        self.DeclareInitializationPublishEvent(self._forget)
        self.DeclarePeriodicPublishEvent(publish_period, 0.0, self._draw)
        self.DeclarePeriodicPublishEvent(
            regions_period, 0.0, self._draw_regions
        )
        self.DeclareForcedPublishEvent(self._draw)
        self.DeclareForcedPublishEvent(self._draw_regions)

    def _add_feet(self, publish_period: float) -> None:
        self._footprints = Footprints(
            self._meshcat, f"{ROOT}/footprints", self._sole, publish_period
        )
        self._footsteps = {
            side: [
                SoleOutline(
                    self._meshcat,
                    f"{ROOT}/footsteps/{side.value}_{i}",
                    self._sole,
                    palette.rgba(palette.foot_color(side)),
                )
                for i in range(STEPS_PER_SIDE)
            ]
            for side in Side
        }
        self._support = PolygonOutline(
            self._meshcat,
            f"{ROOT}/support_polygon",
            2 * len(self._sole),
            palette.rgba(palette.SUPPORT),
        )

    def _add_points(self) -> None:
        def marker(name, shape, color):
            path = f"{ROOT}/{name}"
            return Marker(self._meshcat, path, shape, color)

        disc, square = Cylinder(0.028, 0.012), Box(0.046, 0.046, 0.014)
        self._com_ball = marker("com", Sphere(0.04), palette.COM)
        # Port, the columns that are the point, and what shows it.
        self._points = [
            (self._com, slice(0, 2), marker("com_ground", disc, palette.COM)),
            (
                self._reference,
                slice(0, 2),
                marker("icp_reference", Sphere(0.024), palette.ICP_REFERENCE),
            ),
            (
                self._icp,
                slice(0, 2),
                marker("icp", Sphere(0.034), palette.ICP),
            ),
            (self._ecmp, slice(0, 2), marker("cop", disc, palette.COP)),
            (self._ecmp, slice(2, 4), marker("ecmp", square, palette.ECMP)),
        ]
        self._arrow = Arrow(self._meshcat, f"{ROOT}/push", palette.PUSH)

    def _forget(self, context):
        """A new run: what the last one left behind is not its own."""
        self._footprints.forget()
        self._arrow.forget(context.get_time())
        return EventStatus.Succeeded()

    def _draw(self, context):
        time = context.get_time()
        state = eval_typed(self, context, self._walking_state, WalkingState)
        schedule = state.schedule
        ground = float(schedule.feet[schedule.support_side].p_WF[2])
        self._draw_footprints(state, time)
        self._draw_footsteps(schedule, time)
        self._support.draw(
            support_polygon(schedule, self._sole), ground + 0.006, time
        )
        for port, columns, marker in self._points:
            if port.HasValue(context):
                marker.draw([*port.Eval(context)[columns], ground], time)
        if self._com.HasValue(context):
            self._draw_com_and_push(context, time)
        if schedule.phase is not Phase.SWING:
            self._region_overlay.hide(time)
        return EventStatus.Succeeded()

    def _draw_regions(self, context):
        state = eval_typed(self, context, self._walking_state, WalkingState)
        schedule = state.schedule
        if schedule.phase is not Phase.SWING or not self._regions.HasValue(
            context
        ):
            return EventStatus.DidNothing()
        x, y, z = schedule.feet[schedule.support_side].p_WF
        self._region_overlay.draw(
            eval_typed(self, context, self._regions, CaptureRegions),
            np.array([x, y]),
            float(z),
            context.get_time(),
        )
        return EventStatus.Succeeded()

    def _draw_footprints(self, state: WalkingState, time: float) -> None:
        """Each foot that carries leaves a print, numbered by its step."""
        schedule = state.schedule
        landed = schedule.support_side
        if schedule.footsteps:
            landed = schedule.footsteps[0].side.other
        for side in Side:
            if schedule.in_contact(side):
                number = state.steps_taken - (side is not landed)
                self._footprints.draw(side, number, schedule.feet[side], time)

    def _draw_footsteps(self, schedule: ContactSchedule, time: float) -> None:
        for side, outlines in self._footsteps.items():
            steps = [s for s in schedule.footsteps if s.side is side]
            for i, outline in enumerate(outlines):
                if i < len(steps):
                    outline.draw(steps[i].pose, time)
                else:
                    outline.hide(time)

    def _draw_com_and_push(self, context, time: float) -> None:
        com = self._com.Eval(context)[:3]
        self._com_ball.draw(com, time)
        self._meshcat.SetProperty(
            MIDDLE, "position", [com[0], com[1], 0.0], time
        )
        if not self._push.HasValue(context):
            return
        force = self._push.Eval(context)
        if np.linalg.norm(force) > 1e-6:
            self._arrow.draw(com, force, time)
        else:
            self._arrow.hide()
