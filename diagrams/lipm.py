"""The capture-point controller and a point mass in closed loop."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiagramBuilder, System

from nadia_balance.balance_controller import CapturePointController
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.terrain import foot_beside
from nadia_balance.engines.plants import PointMassPlant
from nadia_balance.systems.push_source import PushSource, find_body
from nadia_balance.systems.signals import connect, read
from nadia_balance.systems.steps import SwingFootPlanner
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
        **blocks: System,
    ):
        """Builds the diagram of `scenario`; draws if `meshcat` is given.

        `blocks` replace blocks of the CapturePointController, `sources` are
        as of HumanoidDiagram.

        Raises ValueError: a block lacks a port, the robot lacks the body of a
        push, the engine is not Drake, the sensors are not perfect, or the
        terrain is not level.
        """
        super().__init__(scenario)
        for name, only in ("engine", "drake"), ("sensors", "perfect"):
            if (value := getattr(scenario, name)) != only:
                why = f"must be {only} for a point mass"
                raise ValueError(f"{name} = {value!r}: {why}")
        # Bodies of pushes are checked on the robot: a point mass has none.
        for name in filter(None, (push.body for push in scenario.pushes)):
            find_body(self.robot.control_plant(), name)
        model, period = scenario.point_mass(self.robot), scenario.lipm_period
        grounds = self._ground, model.ground
        if not all(ground is None or ground.is_level for ground in grounds):
            raise ValueError(
                f"terrain.name = {scenario.terrain.name!r}: must be level, at "
                "height 0, with an error of its place only, for a point mass"
            )
        params = replace(scenario.controller, control_period=period)
        start = scenario.start(model)
        builder = DiagramBuilder()
        add, pushes = builder.AddNamedSystem, scenario.pushes
        blocks |= {"start": start}
        controller = CapturePointController(params, model, **blocks)
        self.controller = add("capture_point_controller", controller)
        swing = SwingFootPlanner(params.swing_foot, model, period)
        self.swing = add("swing_foot_planner", swing)
        self._fallen = FALLEN_DISTANCE * model.com_height
        self.plant = plant = add("plant", PointMassPlant(model, period, start))
        self.push = add("push_source", PushSource(pushes, model.mass, period))
        on = NAMED[scenario.mechanisms]
        limits = self.velocity_limits
        mechanisms = add_mechanisms(builder, on, self.push, meshcat, limits)
        watched = "com_state", "foot_poses"
        self._watched = [plant.GetOutputPort(name) for name in watched]
        connect(builder, controller, self.swing, "walking_state")
        connect(builder, controller, self.push, "walking_state")
        connect(builder, controller, plant, "walking_state", "ecmp_command")
        connect(builder, self.swing, plant, "swing_foot_reference")
        connect(builder, self.push, plant, "push_force")
        connect(builder, plant, controller, "foot_poses", "foot_forces")
        connect(builder, plant, controller, "com_state", "icp")
        if controller.HasInputPort("alip_icp"):  # without a body the same
            connect(builder, plant, controller, icp="alip_icp")
        builder.Connect(mechanisms, controller.GetInputPort("mechanisms"))
        command = self._connect_sources(builder, controller, sources or {})
        systems = plant, self.controller, self.swing, self.push
        logged = {"mechanisms": mechanisms} | command
        self._finish(builder, meshcat, period, systems, **logged)

    def set_initial_state(self, context: Context) -> None:
        """Shifts the point mass at random by the scenario's seed."""
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            own = self.plant.GetMyMutableContextFromRoot(context)
            state = own.get_mutable_discrete_state(0).get_mutable_value()
            state[:2] += rng.uniform(-1e-5, 1e-5, 2)

    def fall_reason(self, context: Context) -> str:
        """The criterion by which it has fallen; empty if it has not."""
        com, feet = (read(port, context) for port in self._watched)
        places = [foot.p_WF[:2] for foot in (feet.left, feet.right)]
        if min(math.dist(com[:2], p) for p in places) > self._fallen:
            return "CoM out of reach of both feet"
        state = self.GetOutputPort("walking_state").Eval(context)
        return foot_beside(self._ground, state.schedule)
