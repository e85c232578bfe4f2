"""The brain on a point mass, which is faster than the robot."""

import math
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    System,
)

from diagrams.logs import SignalLog, region_logs
from diagrams.scenario import Scenario
from diagrams.start import initial_walking_state
from nadia_balance.balance_controller import point_mass_of
from nadia_balance.capture_point_controller import CapturePointController
from nadia_balance.robot import load_robot
from nadia_balance.systems.point_mass_plant import PointMassPlant
from nadia_balance.systems.ports import connect
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.swing_foot_planner import SwingFootPlanner

BRAIN_LOGS = (
    "icp_reference",
    "ecmp_command",
    "momentum_rate",
    "momentum_qp_status",
    "walking_signal",
)
FALLEN_DISTANCE = 0.8  # of the CoM from the nearer foot, horizontally [m]


class LipmDiagram(Diagram):
    """Closes the loop of CapturePointController and PointMassPlant."""

    def __init__(self, scenario: Scenario):
        """Builds everything from the `scenario`."""
        super().__init__()
        self.scenario = scenario
        self.robot = load_robot(scenario.robot)
        model, period = point_mass_of(self.robot), scenario.lipm_period
        params = replace(scenario.controller_params(), control_period=period)
        initial = initial_walking_state(scenario)
        builder = DiagramBuilder()
        self.brain = builder.AddNamedSystem(
            "capture_point_controller",
            CapturePointController(params, model, initial),
        )
        self.swing = builder.AddNamedSystem(
            "swing_foot_planner",
            SwingFootPlanner(params.swing_foot, initial, period),
        )
        self.plant = builder.AddNamedSystem(
            "plant",
            PointMassPlant(
                model.mass, model.omega, model.com_height, initial, period
            ),
        )
        self.push = builder.AddNamedSystem(
            "push_source", PushSource(scenario.pushes, model.mass, period)
        )
        self._watched = [
            self.plant.GetOutputPort(name)
            for name in ("com_state", "foot_poses")
        ]
        self._close_loop(builder)
        self._log(builder, period)
        builder.BuildInto(self)

    def _close_loop(self, builder: DiagramBuilder) -> None:
        brain, plant = self.brain, self.plant
        connect(builder, brain, self.swing, "walking_state")
        connect(builder, brain, self.push, "walking_state")
        connect(builder, brain, plant, "walking_state", "ecmp_command")
        connect(builder, self.swing, plant, "swing_foot_reference")
        connect(builder, self.push, plant, "push_force")
        connect(builder, plant, brain, "foot_poses", "foot_forces")
        connect(builder, self._sensed(builder), brain, "com_state", "icp")

    def _sensed(self, builder: DiagramBuilder) -> System:
        """The system whose com_state and icp the brain gets: the truth."""
        return self.plant

    def _log(self, builder: DiagramBuilder, period: float) -> None:
        logged = (
            (self.plant, ("com_state", "icp", "foot_forces")),
            (self.swing, ("swing_foot_reference",)),
            (self.push, ("push_force",)),
            (self.brain, BRAIN_LOGS),
        )
        self._signal_log = SignalLog(
            builder,
            period,
            {
                name: system.GetOutputPort(name)
                for system, names in logged
                for name in names
            },
        )

    def set_initial_state(self, context: Context) -> None:
        """Shifts the point mass as the scenario's seed says."""
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            state = self.plant.GetMyMutableContextFromRoot(
                context
            ).get_mutable_discrete_state(0)
            start = state.value().copy()
            start[:2] += rng.uniform(-1e-5, 1e-5, 2)
            state.set_value(start)

    def fall_reason(self, context: Context) -> str:
        """Why the point mass counts as fallen; empty while it does not."""
        plant = self.plant.GetMyContextFromRoot(context)
        com, feet = (port.Eval(plant) for port in self._watched)
        nearest = min(
            math.dist(com[:2], foot.p_WF[:2])
            for foot in (feet.left, feet.right)
        )
        if nearest > FALLEN_DISTANCE:
            return "CoM out of reach of both feet"
        return ""

    def improper_contacts(self, context: Context) -> set[str]:
        """A point mass touches nothing."""
        return set()

    def read_logs(self, context: Context) -> dict[str, np.ndarray]:
        """All that was logged (see diagrams.logs)."""
        logs = self._signal_log.read(context)
        logs["sole"] = self.robot.sole
        adjuster = self.scenario.controller.step_adjuster
        return logs | region_logs(adjuster.reachability)
