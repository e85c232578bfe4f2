"""The balance controller: from a robot's state to its joint torques."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.capture_point_controller import (
    CapturePointController,
    ControllerParams,
)
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.vocabulary import WalkingState
from nadia_balance.core.whole_body.tasks import Task
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.state import CentroidalEstimator, StatePredictor
from nadia_balance.systems.steps import SwingFootPlanner
from nadia_balance.systems.whole_body import (
    FrictionEstimator,
    WholeBodyInverseDynamics,
)
from nadia_balance.systems.wiring import fill, wire


class BalanceController(Diagram):
    """Computes joint torques from the robot's state.

    Signals are connected by their names; `actuation` [N m] is in the order of
    the plant's actuators:

    ========================  ============================  ==================
    block                     reads                         writes
    ========================  ============================  ==================
    state_predictor           estimated_state,              predicted_state
                              generalized_acceleration
    centroidal_estimator      predicted_state               com_state, icp,
                                                            alip_icp,
                                                            foot_poses,
                                                            whole_body_terms
    capture_point_controller  com_state, icp, alip_icp,     walking_state,
                              foot_poses, foot_forces,      momentum_rate, ...
                              mechanisms
    swing_foot_planner        walking_state                 swing_foot_...
                                                            reference
    friction_estimator        whole_body_terms,             friction
                              foot_wrenches
    whole_body_...            whole_body_terms,             actuation,
    inverse_dynamics          momentum_rate, friction,      foot_wrenches,
                              walking_state,                generalized_...
                              swing_foot_reference          acceleration
    ========================  ============================  ==================

    Three loops are closed by states of the last tick: the walking state, the
    friction coefficient and, with a delay, the acceleration.  `estimated_state`
    is [q, v] of the robot's `control_plant`, `foot_forces` (2,) [N] are those
    of the left and the right foot; `mechanisms` (4,), all on if not connected.

    Any evaluation of `actuation` gives the torque of that control tick: before
    the update of the tick it is computed from the inputs, afterwards it is
    held.  No other hold is needed between controller and plant.

    .. pydrake_system::

        name: BalanceController
        input_ports: [estimated_state, foot_forces, mechanisms]
        output_ports: [predicted_state, whole_body_terms, com_state, icp,
                       alip_icp, foot_poses, walking_state,
                       walking_signal, icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       ecmp_command, momentum_qp_status, momentum_rate,
                       swing_foot_reference, friction, actuation,
                       foot_wrenches, whole_body_qp_status,
                       generalized_acceleration]
    """

    INPUTS = ("estimated_state", "foot_forces", "mechanisms")
    # The blocks, with the outputs that others read.
    ROLES = {
        "state_predictor": "predicted_state",
        "centroidal_estimator": "com_state icp alip_icp foot_poses",
        "capture_point_controller": "walking_state momentum_rate",
        "swing_foot_planner": "swing_foot_reference",
        "friction_estimator": "friction",
        "whole_body_inverse_dynamics": "actuation",
    }

    def __init__(
        self,
        params: ControllerParams,
        robot: RobotModel,
        *,
        start: WalkingState | None = None,
        ground: Ground | None = None,
        delay: float = 0.0,
        tasks: Iterable[Task] = (),
        **blocks: System | None,
    ):
        """Begins with the walking state `start`, by default standing.

        `ground` is the controller's model of the ground, None: flat; `delay`
        [s] that of the measurements, a multiple of the period; `tasks` are
        added to those of the whole-body QP.  `blocks` replace these blocks
        and those of the CapturePointController by name; None leaves one out.

        Raises ValueError: as CapturePointController.
        """
        super().__init__()
        check(params)
        period = params.control_period
        whole_body = robot.whole_body(params.whole_body)
        model = replace(robot.point_mass, ground=ground)
        lead = 0.0
        if robot.drives is not None:  # each torque is held for a period
            lead = robot.drives.lag + 0.5 * period
        tasks = tuple(tasks)
        if tasks and "whole_body_inverse_dynamics" in blocks:
            names = ", ".join(task.name for task in tasks)
            raise ValueError(
                f"tasks = {names}: must be given to the block that replaces "
                "whole_body_inverse_dynamics"
            )
        inner = CapturePointController.ROLES
        if "capture_point_controller" in blocks:
            inner = {}
        planners = {name: blocks.pop(name) for name in inner if name in blocks}
        makers = {
            "state_predictor": partial(
                StatePredictor, robot, period, delay, lead
            ),
            "centroidal_estimator": partial(
                CentroidalEstimator, robot, whole_body.avoidance, lead
            ),
            "capture_point_controller": partial(
                CapturePointController, params, model, start=start, **planners
            ),
            "swing_foot_planner": partial(
                SwingFootPlanner, params.swing_foot, model, period, lead
            ),
            "friction_estimator": partial(
                FrictionEstimator, whole_body, model, period
            ),
            "whole_body_inverse_dynamics": partial(
                WholeBodyInverseDynamics, whole_body, robot, period, tasks
            ),
        }
        builder = DiagramBuilder()
        found = fill(makers, self.ROLES, blocks, inner)
        wire(builder, found, self.INPUTS)
        builder.BuildInto(self)
