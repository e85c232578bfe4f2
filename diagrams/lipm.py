"""The capture-point controller and a point mass in closed loop."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiagramBuilder, System

from nadia_balance.balance_controller import CapturePointController
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams.closed_loop import ClosedLoop, block_labels
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.terrain import foot_beside
from nadia_balance.engines.plants import PointMassPlant
from nadia_balance.parameters.bounds import require
from nadia_balance.systems.hardware import Imperfections
from nadia_balance.systems.push_source import PushSource, find_body
from nadia_balance.systems.signals import read
from nadia_balance.systems.steps import SwingFootPlanner
from nadia_balance.systems.wiring import connect
from nadia_balance.view.scene import add_mechanisms

FALLEN_DISTANCE = 0.9  # of the CoM from the nearer foot, per its height [-]


class LipmDiagram(ClosedLoop):
    """Closes the loop of CapturePointController and PointMassPlant."""

    PLANT = "lipm"

    def __init__(
        self,
        scenario: Scenario,
        meshcat: Meshcat | None = None,
        sources: Mapping[str, System] | None = None,
        **blocks: Any,
    ):
        """Builds the diagram.

        Args:
            scenario: what is simulated.
            meshcat: where it is drawn, if given.
            sources: as of HumanoidDiagram.
            **blocks: those that replace blocks of the CapturePointController.

        Raises:
            ValueError: a block lacks a port, the robot lacks the body of a
                push, the engine is not Drake, the sensors are not perfect, or
                the terrain is not level.
        """
        super().__init__(scenario)
        self._check(scenario)
        self.replaced = block_labels(blocks)
        period = scenario.lipm_period
        model = scenario.point_mass(self.robot)
        require(
            all(
                ground is None or ground.is_level
                for ground in (self._ground, model.ground)
            ),
            f"terrain.name = {scenario.terrain.name!r}: must be level, at "
            "height 0, with an error of its place only, for a point mass",
        )
        params = replace(scenario.controller, control_period=period)
        start = scenario.start(model)
        self._fallen = FALLEN_DISTANCE * model.com_height
        builder = DiagramBuilder()
        self.controller = builder.AddNamedSystem(
            "capture_point_controller",
            CapturePointController(params, model, start=start, **blocks),
        )
        self.swing = builder.AddNamedSystem(
            "swing_foot_planner",
            SwingFootPlanner(params.swing_foot, model, period),
        )
        self.plant = builder.AddNamedSystem(
            "plant", PointMassPlant(model, period, start)
        )
        self.push = PushSource(scenario.pushes, model.mass, period)
        builder.AddNamedSystem("push_source", self.push)
        self._connect(builder)
        self._mechanisms = add_mechanisms(
            builder,
            NAMED[scenario.mechanisms],
            self.push,
            meshcat,
            self.velocity_limits,
            has_switches=self.controller.HasInputPort("mechanisms"),
        )
        if self.controller.HasInputPort("mechanisms"):
            builder.Connect(
                self._mechanisms, self.controller.GetInputPort("mechanisms")
            )
        self._finish(
            builder,
            meshcat,
            period,
            [self.plant, self.controller, self.swing, self.push],
            mechanisms=self._mechanisms,
            **self._connect_sources(builder, self.controller, sources or {}),
        )

    def _check(self, scenario: Scenario) -> None:
        """Raises ValueError: the scenario is not for a point mass."""
        for name, only in ("engine", "drake"), ("sensors", "perfect"):
            value = getattr(scenario, name)
            require(
                value == only,
                f"{name} = {value!r}: must be {only} for a point mass",
            )
        require(
            scenario.imperfections == Imperfections(),
            f"imperfections = {scenario.imperfections}: must be none for a "
            "point mass",
        )
        # Bodies of pushes are checked on the robot: a point mass has none.
        for push in scenario.pushes:
            require(
                push.point is None,
                f"point = {push.point}: must not be given for a point mass",
            )
            if push.body:
                find_body(self.robot.control_plant(), push.body)

    def _connect(self, builder: DiagramBuilder) -> None:
        plant, controller, swing = self.plant, self.controller, self.swing
        connect(builder, controller, swing, "walking_state")
        connect(builder, controller, self.push, "walking_state")
        self.timing = controller.GetOutputPort("walking_state")
        connect(builder, controller, plant, "walking_state", "ecmp_command")
        connect(builder, swing, plant, "swing_foot_reference")
        connect(builder, self.push, plant, "push_force")
        for name in "foot_poses", "foot_forces", "com_state", "icp":
            if controller.HasInputPort(name):  # blocks may not need all
                connect(builder, plant, controller, name)
        if controller.HasInputPort("alip_icp"):  # without a body the same
            connect(builder, plant, controller, icp="alip_icp")

    def set_initial_state(self, context: Context) -> None:
        """Shifts the point mass at random by the scenario's seed.

        Args:
            context: that of this diagram, which is changed.
        """
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            plant_context = self.plant.GetMyMutableContextFromRoot(context)
            x = plant_context.get_mutable_discrete_state(0).get_mutable_value()
            x[:2] += rng.uniform(-1e-5, 1e-5, 2)

    def fall_reason(self, context: Context) -> str:
        """Returns the criterion by which it has fallen.

        Args:
            context: that of this diagram.

        Returns:
            A few words; empty if it has not fallen.
        """
        com = read(self.plant.GetOutputPort("com_state"), context)
        feet = read(self.plant.GetOutputPort("foot_poses"), context)
        if self._fallen < min(
            math.dist(com[:2], foot.p_WF[:2])
            for foot in (feet.left, feet.right)
        ):
            return "CoM out of reach of both feet"
        return foot_beside(
            self._ground, read(self.signals["walking_state"], context).schedule
        )
