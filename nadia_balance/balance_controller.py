"""The body: the brain, plus all that knows the robot."""

from pydrake.systems.framework import Diagram, DiagramBuilder

from nadia_balance.capture_point_controller import (
    CapturePointController,
    ControllerParams,
    PointMassModel,
)
from nadia_balance.core.walking import WalkingState
from nadia_balance.robot import RobotModel
from nadia_balance.systems.centroidal_estimator import CentroidalEstimator
from nadia_balance.systems.ports import (
    connect,
    export_input,
    export_outputs,
)
from nadia_balance.systems.swing_foot_planner import SwingFootPlanner
from nadia_balance.systems.whole_body_inverse_dynamics import (
    WholeBodyInverseDynamics,
)


class BalanceController(Diagram):
    """Turns the robot's state into joint torques.

    The ports `mechanisms` and `capture_regions` are there when they are in
    CapturePointController.

    .. pydrake_system::

        name: BalanceController
        input_ports: [estimated_state, foot_forces, mechanisms]
        output_ports: [actuation, foot_wrenches, whole_body_qp_status,
                       swing_foot_reference, com_state, icp, foot_poses,
                       walking_state, walking_signal, icp_plan, icp_reference,
                       ecmp_command, momentum_rate, momentum_qp_status,
                       capture_regions]
    """

    def __init__(
        self,
        params: ControllerParams,
        robot: RobotModel,
        initial: WalkingState,
        switchable: bool = False,
    ):
        """Starts walking from the walking state `initial`.

        `switchable`: the mechanisms can be switched while it runs.
        """
        super().__init__()
        params.validate()
        period = params.control_period
        builder = DiagramBuilder()
        estimator = builder.AddNamedSystem(
            "centroidal_estimator", CentroidalEstimator(robot)
        )
        brain = builder.AddNamedSystem(
            "capture_point_controller",
            CapturePointController(
                params, point_mass_of(robot), initial, switchable
            ),
        )
        swing = builder.AddNamedSystem(
            "swing_foot_planner",
            SwingFootPlanner(params.swing_foot, initial, period),
        )
        body = builder.AddNamedSystem(
            "whole_body_inverse_dynamics",
            WholeBodyInverseDynamics(robot, robot.whole_body, period),
        )
        connect(builder, estimator, brain, "com_state", "icp", "foot_poses")
        connect(builder, brain, swing, "walking_state")
        connect(builder, brain, body, "walking_state", "momentum_rate")
        connect(builder, swing, body, "swing_foot_reference")

        export_input(builder, "estimated_state", estimator, body)
        export_input(builder, "foot_forces", brain)
        if switchable:
            export_input(builder, "mechanisms", brain)
        export_outputs(builder, body, "actuation", "foot_wrenches")
        builder.ExportOutput(
            body.GetOutputPort("qp_status"), "whole_body_qp_status"
        )
        export_outputs(builder, swing, "swing_foot_reference")
        export_outputs(builder, estimator, "com_state", "icp", "foot_poses")
        for i in range(brain.num_output_ports()):
            export_outputs(builder, brain, brain.get_output_port(i).get_name())
        builder.BuildInto(self)


def point_mass_of(robot: RobotModel) -> PointMassModel:
    """What the brain needs to know of `robot`."""
    return PointMassModel(
        robot.mass, robot.omega, robot.com_height, robot.sole, robot.legs
    )
