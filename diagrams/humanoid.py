"""The whole robot in closed loop."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    OutputPort,
)
from pydrake.systems.primitives import ZeroOrderHold

from diagrams.logs import SignalLog, region_logs
from diagrams.meshcat_scene import add_robot_view
from diagrams.scenario import Scenario
from diagrams.start import initial_walking_state
from nadia_balance.balance_controller import BalanceController
from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.mechanisms import mechanisms_of
from nadia_balance.robot import load_robot, terrain_file
from nadia_balance.systems.balance_visualizer import BalanceVisualizer
from nadia_balance.systems.foot_force_sensor import FootForceSensor
from nadia_balance.systems.live_controls import LiveControls
from nadia_balance.systems.ports import connect
from nadia_balance.systems.push_source import PushSource

CONTROLLER_LOGS = (
    "com_state",
    "icp",
    "icp_reference",
    "ecmp_command",
    "momentum_rate",
    "momentum_qp_status",
    "whole_body_qp_status",
    "foot_wrenches",
    "swing_foot_reference",
    "walking_signal",
    "actuation",
)
VISUALIZED = (
    "walking_state",
    "com_state",
    "icp",
    "icp_reference",
    "ecmp_command",
    "capture_regions",
)
FALLEN_HEIGHT = 0.6  # of the pelvis, as a fraction of its height at the start
FALLEN_TILT = 1.0  # of the pelvis against the vertical [rad]


class HumanoidDiagram(Diagram):
    """Closes the loop of BalanceController and a MultibodyPlant."""

    def __init__(self, scenario: Scenario, meshcat: Meshcat | None = None):
        """Builds all of `scenario`; draws if there is a `meshcat`.

        Raises:
            ValueError: the robot cannot stand as it is told.
        """
        super().__init__()
        self.scenario = scenario
        params = scenario.controller_params()
        period = params.control_period
        self.robot = load_robot(scenario.robot)
        self.initial = initial_walking_state(scenario)
        self._standing = self.robot.standing_positions(scenario.gait.step_width)
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlant(
            scenario.plant_config, builder
        )
        self.robot.add_to(self.plant)
        Parser(self.plant).AddModels(str(terrain_file()))
        self.plant.Finalize()
        self.controller = builder.AddNamedSystem(
            "balance_controller",
            BalanceController(
                params, self.robot, self.initial, switchable=meshcat is not None
            ),
        )
        self.push = builder.AddNamedSystem(
            "push_source",
            PushSource(
                scenario.pushes,
                self.robot.mass,
                period,
                self.plant,
                self.robot.pelvis_body,
            ),
        )
        self.sensor = builder.AddNamedSystem(
            "foot_force_sensor", FootForceSensor(self.plant, self.robot, period)
        )
        self._close_loop(builder, period)
        live = {}
        if meshcat is not None:
            self._draw(builder, meshcat)
            live = self._add_controls(builder, meshcat, params)
        self._log(builder, period, live)
        builder.BuildInto(self)

    def _close_loop(self, builder: DiagramBuilder, period: float) -> None:
        plant, controller = self.plant, self.controller
        actuation = controller.GetOutputPort("actuation")
        self.hold = builder.AddNamedSystem(
            "actuation_zero_order_hold",
            ZeroOrderHold(period, actuation.size()),
        )
        for source, sink in (
            (actuation, self.hold.get_input_port()),
            (self.hold.get_output_port(), plant.get_actuation_input_port()),
            (
                plant.get_state_output_port(),
                controller.GetInputPort("estimated_state"),
            ),
            (
                plant.get_contact_results_output_port(),
                self.sensor.GetInputPort("contact_results"),
            ),
            (
                self.push.GetOutputPort("spatial_forces"),
                plant.get_applied_spatial_force_input_port(),
            ),
        ):
            builder.Connect(source, sink)
        connect(builder, self.sensor, controller, "foot_forces")
        connect(builder, controller, self.push, "walking_state")

    def _draw(self, builder: DiagramBuilder, meshcat: Meshcat) -> None:
        add_robot_view(builder, self.scene_graph, meshcat)
        view = builder.AddNamedSystem(
            "balance_visualizer", BalanceVisualizer(meshcat, self.robot.sole)
        )
        connect(builder, self.controller, view, *VISUALIZED)
        connect(builder, self.push, view, "push_force")

    def _add_controls(
        self,
        builder: DiagramBuilder,
        meshcat: Meshcat,
        params: ControllerParams,
    ) -> dict[str, OutputPort]:
        """Returns what is to be logged of them."""
        on = mechanisms_of(params.timing_adapter, params.step_adjuster)
        controls = builder.AddNamedSystem(
            "live_controls", LiveControls(meshcat, on)
        )
        connect(builder, controls, self.push, "live_push")
        connect(builder, controls, self.controller, "mechanisms")
        return {"mechanisms": controls.GetOutputPort("mechanisms")}

    def _log(
        self,
        builder: DiagramBuilder,
        period: float,
        live: dict[str, OutputPort],
    ) -> None:
        signals = {
            name: self.controller.GetOutputPort(name)
            for name in CONTROLLER_LOGS
        }
        signals["push_force"] = self.push.GetOutputPort("push_force")
        signals["foot_forces"] = self.sensor.GetOutputPort("foot_forces")
        signals["state"] = self.plant.get_state_output_port()
        self._signal_log = SignalLog(builder, period, signals | live)

    def set_initial_state(self, context: Context) -> None:
        """Puts the robot on its feet, with the torques that hold it."""
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        q = self._standing.copy()
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            q[4:6] += rng.uniform(-1e-5, 1e-5, 2)
        self.plant.SetPositions(plant_context, q)
        controller_context = self.controller.GetMyContextFromRoot(context)
        torque = self.controller.GetOutputPort("actuation").Eval(
            controller_context
        )
        self.hold.SetVectorState(
            self.hold.GetMyMutableContextFromRoot(context), torque
        )

    def fall_reason(self, context: Context) -> str:
        """Why the robot counts as fallen; empty while it does not."""
        plant_context = self.plant.GetMyContextFromRoot(context)
        pelvis = self.plant.GetBodyByName(self.robot.pelvis_body)
        X_WP = pelvis.EvalPoseInWorld(plant_context)
        if X_WP.translation()[2] < FALLEN_HEIGHT * self._standing[6]:
            return "pelvis too low"
        if X_WP.rotation().matrix()[2, 2] < np.cos(FALLEN_TILT):
            return "pelvis tilted"
        return ""

    def improper_contacts(self, context: Context) -> set[str]:
        """Contacts that are not those of a foot and the ground, by name."""
        plant_context = self.plant.GetMyContextFromRoot(context)
        port = self.plant.get_contact_results_output_port()
        return self.robot.improper_contacts(
            self.plant, port.Eval(plant_context)
        )

    def read_logs(self, context: Context) -> dict[str, np.ndarray]:
        """All that was logged (see diagrams.logs)."""
        logs = self._signal_log.read(context)
        logs["foot_poses"] = self._foot_positions(logs["state"])
        logs["num_positions"] = np.array(self.plant.num_positions())
        logs["sole"] = self.robot.sole
        logs["actuator_names"] = np.array(self.plant.GetActuatorNames())
        logs["effort_limits"] = self.plant.GetEffortUpperLimits()
        logs["joint_speed_limit"] = np.array(self.robot.params.max_joint_speed)
        adjuster = self.scenario.controller.step_adjuster
        logs |= region_logs(adjuster.reachability)
        return logs

    def _foot_positions(self, states: np.ndarray) -> np.ndarray:
        """Sole centres p_WF (n, 6) [m], left and right, along `states`."""
        plant = self.robot.control_plant()
        context = plant.CreateDefaultContext()
        feet = [
            (plant.GetBodyByName(name), self.robot.X_FootSole[side])
            for side, name in self.robot.foot_bodies.items()
        ]
        positions = np.empty((len(states), 6))
        for row, state in zip(positions, states, strict=True):
            plant.SetPositionsAndVelocities(context, state)
            for i, (body, X_FootSole) in enumerate(feet):
                X_WF = plant.EvalBodyPoseInWorld(context, body) @ X_FootSole
                row[3 * i : 3 * i + 3] = X_WF.translation()
        return positions
