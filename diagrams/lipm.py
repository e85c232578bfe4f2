"""The brain on a point mass: some hundred times faster than the robot."""

import math

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from diagrams.logs import SignalLog
from diagrams.scenario import Scenario
from diagrams.start import initial_walking_state
from nadia_balance.balance_controller import point_mass_of
from nadia_balance.capture_point_controller import CapturePointController
from nadia_balance.core.walking import Side
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
        params = scenario.controller_params()
        period = params.control_period
        self.robot = load_robot(scenario.robot)
        model = point_mass_of(self.robot)
        initial = initial_walking_state(scenario)
        builder = DiagramBuilder()
        brain = builder.AddNamedSystem(
            "capture_point_controller",
            CapturePointController(params, model, initial),
        )
        swing = builder.AddNamedSystem(
            "swing_foot_planner",
            SwingFootPlanner(params.swing_foot, initial, period),
        )
        self.plant = plant = builder.AddNamedSystem(
            "plant",
            PointMassPlant(
                model.mass, model.omega, model.com_height, initial, period
            ),
        )
        push = builder.AddNamedSystem(
            "push_source", PushSource(scenario.pushes, model.mass, period)
        )
        connect(builder, brain, swing, "walking_state")
        connect(builder, brain, push, "walking_state")
        connect(builder, brain, plant, "walking_state", "ecmp_command")
        connect(builder, swing, plant, "swing_foot_reference")
        connect(builder, push, plant, "push_force")
        connect(builder, plant, brain, "com_state", "icp")
        connect(builder, plant, brain, "foot_poses", "foot_forces")
        self._signal_log = SignalLog(
            builder,
            period,
            {
                name: system.GetOutputPort(name)
                for system, names in (
                    (plant, ("com_state", "icp", "foot_forces")),
                    (swing, ("swing_foot_reference",)),
                    (push, ("push_force",)),
                    (brain, BRAIN_LOGS),
                )
                for name in names
            },
        )
        builder.BuildInto(self)

    def set_initial_state(self, context: Context) -> None:
        """Shifts the point mass as the scenario's seed says."""
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            state = self.plant.GetMyMutableContextFromRoot(
                context
            ).get_mutable_discrete_state_vector()
            start = state.value().copy()
            start[:2] += rng.uniform(-1e-5, 1e-5, 2)
            state.set_value(start)

    def fall_reason(self, context: Context) -> str:
        """Why the point mass counts as fallen; empty while it does not."""
        com = self.plant.GetOutputPort("com_state").Eval(
            self.plant.GetMyContextFromRoot(context)
        )
        feet = self.plant.GetOutputPort("foot_poses").Eval(
            self.plant.GetMyContextFromRoot(context)
        )
        nearest = min(math.dist(com[:2], feet[side].p_WF[:2]) for side in Side)
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
        return logs
