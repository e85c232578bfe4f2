"""The balance controller: from a robot's state to its joint torques."""

from collections.abc import Iterable
from dataclasses import replace

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.capture_point_controller import (
    CapturePointController,
    ControllerParams,
)
from nadia_balance.core.bounds import check
from nadia_balance.core.ground import Ground
from nadia_balance.core.walking import WalkingState
from nadia_balance.core.whole_body_tasks import Task
from nadia_balance.robot import RobotModel
from nadia_balance.systems.centroidal_estimator import CentroidalEstimator
from nadia_balance.systems.friction_estimator import FrictionEstimator
from nadia_balance.systems.ports import wire
from nadia_balance.systems.swing_foot_planner import SwingFootPlanner
from nadia_balance.systems.whole_body_inverse_dynamics import (
    WholeBodyInverseDynamics,
)


class BalanceController(Diagram):
    """Computes joint torques from the robot's state.

    A CapturePointController with state estimation, swing-foot planning and
    whole-body inverse dynamics.  `estimated_state` is [q, v] of the robot's
    `control_plant`, `foot_forces` (2,) [N] are those of the left and the right
    foot; `mechanisms` (4,), all on if not connected.  `actuation` [N m] is in
    the order of the plant's actuators.

    Any evaluation of `actuation` gives the torque of that control tick: before
    the update of the tick it is computed from the inputs, afterwards it is
    held.  No other hold is needed between controller and plant.  The state is
    predicted to the time at which that torque acts: the lag of the drives plus
    half a period ahead (0 without drives).

    .. pydrake_system::

        name: BalanceController
        input_ports: [estimated_state, foot_forces, mechanisms]
        output_ports: [whole_body_terms, com_state, icp, foot_poses,
                       walking_state, walking_signal, icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       ecmp_command, momentum_qp_status, momentum_rate,
                       swing_foot_reference, friction, actuation,
                       foot_wrenches, whole_body_qp_status,
                       generalized_acceleration]
    """

    INPUTS = ("estimated_state", "foot_forces", "mechanisms")

    def __init__(
        self,
        params: ControllerParams,
        robot: RobotModel,
        *,
        start: WalkingState | None = None,
        ground: Ground | None = None,
        tasks: Iterable[Task] = (),
        **blocks: System,
    ):
        """Begins with the walking state `start`, by default standing.

        `ground` is the controller's model of the ground, None: flat.  `tasks`
        are added to those of the whole-body QP.  `blocks` replace blocks of
        the CapturePointController.

        Raises:
            ValueError: as CapturePointController.
        """
        super().__init__()
        check(params)
        period = params.control_period
        whole_body = robot.whole_body(params.whole_body)
        model = replace(robot.point_mass, ground=ground)
        lead = 0.0
        if robot.drives is not None:  # each torque is held for a period
            lead = robot.drives.lag + 0.5 * period
        builder = DiagramBuilder()
        wire(
            builder,
            {
                "centroidal_estimator": CentroidalEstimator(
                    robot, lead, whole_body.avoidance
                ),
                "capture_point_controller": CapturePointController(
                    params, model, start=start, **blocks
                ),
                "swing_foot_planner": SwingFootPlanner(
                    params.swing_foot, model, period, lead
                ),
                "friction_estimator": FrictionEstimator(
                    whole_body, model, period
                ),
                "whole_body_inverse_dynamics": WholeBodyInverseDynamics(
                    whole_body, robot, period, lead, tasks
                ),
            },
            self.INPUTS,
        )
        builder.BuildInto(self)
