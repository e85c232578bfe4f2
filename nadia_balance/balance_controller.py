"""The controllers: from a robot's state to its joint torques.

In it, the capture-point controller is for any robot, or a point mass.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.core.body.com_height import ComHeightParams
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.feedback.momentum_qp import MomentumQpParams
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlanParams
from nadia_balance.core.plan.cop_waypoints import IcpPlanParams
from nadia_balance.core.plan.footstep_plan import FootstepPlannerParams
from nadia_balance.core.plan.time_adjustment import TimingAdapterParams
from nadia_balance.core.plan.walking_state_machine import (
    WalkingStateMachineParams as StateMachineParams,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams as StepAdjusterParams,
)
from nadia_balance.core.steps.swing_foot import SwingFootParams
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.tasks import Task
from nadia_balance.parameters.bounds import bounded, check
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems import feedback, steps, whole_body
from nadia_balance.systems import plan as planning
from nadia_balance.systems.signals import fill, wire
from nadia_balance.systems.state import CentroidalEstimator, StatePredictor


@dataclass(kw_only=True)
class ControllerParams:
    """The parameters of every algorithm; robot.yaml overrides `whole_body`."""

    # T
    control_period: float = bounded(
        0.004, least=5e-4, most=0.02, unit="s", of=""
    )
    walking_state_machine: StateMachineParams = bounded(StateMachineParams)
    timing_adapter: TimingAdapterParams = bounded(TimingAdapterParams)
    footstep_planner: FootstepPlannerParams = bounded(FootstepPlannerParams)
    step_adjuster: StepAdjusterParams = bounded(StepAdjusterParams)
    icp_plan: IcpPlanParams = bounded(IcpPlanParams)
    # The Atlas paper's QP, with its plan; they replace `step_adjuster`,
    # `balance` and `icp_plan`.
    icp_step_qp: IcpStepQpParams | None = None
    atlas_icp_plan: AtlasIcpPlanParams = bounded(AtlasIcpPlanParams)
    balance: MomentumQpParams = bounded(MomentumQpParams)
    com_height: ComHeightParams = bounded(ComHeightParams)
    swing_foot: SwingFootParams = bounded(SwingFootParams)
    whole_body: WholeBodyQpParams = bounded(WholeBodyQpParams)

    def validate_more(self) -> None:
        """Raises ValueError if the QP moves more steps than are planned."""
        qp, plan = self.icp_step_qp, self.atlas_icp_plan
        if qp and qp.num_steps > (most := plan.num_previewed_steps):
            must = f"must be <= num_previewed_steps = {most} of atlas_icp_plan"
            raise ValueError(f"icp_step_qp.num_steps = {qp.num_steps}: {must}")


class CapturePointController(Diagram):
    """Plans the ICP and controls it with ankles, hips, steps and their timing.

    The Nadia paper's Sections II to VI or, with `icp_step_qp`, the Atlas
    paper, for a point mass on two soles.  Signals are connected by their names:

    =====================  ================================  ================
    block                  reads                             writes
    =====================  ================================  ================
    walking_state_machine  foot_poses, foot_forces, icp,     walking_state,
                           icp_plan, time_adjustment,        walking_signal
                           adjustment, footsteps,
                           revised_footsteps
    footstep_planner       walking_state, icp_plan,          footsteps,
                           alip_icp, foot_poses,             revised_footsteps
                           velocity_command, mechanisms
    icp_planner            walking_state                     icp_plan,
                                                             icp_reference
    timing_adapter         icp, icp_plan,                    time_adjustment
                           walking_state, foot_poses,
                           mechanisms
    step_adjuster          alip_icp, walking_state,          adjustment,
                           foot_poses, time_adjustment,      capture_regions
                           mechanisms
    momentum_qp            icp, icp_reference,               ecmp_command,
                           walking_state                     ...qp_status
    step_controller        takes the place of the last two   the outputs of
                           blocks with `icp_step_qp`         both, and
                                                             icp_reference
    com_height_controller  com_state, ecmp_command,          momentum_rate
                           walking_state
    =====================  ================================  ================

    walking_state is a state, which closes the loop through the planner: it is
    updated once per `control_period`, as all state here, from the state and the
    inputs before.  `mechanisms` (see Mechanisms), all if not connected, selects
    those that the controller may use.  The footstep_planner is a
    FootstepPlanner, or FixedFootsteps if the start has some; without one, the
    `footsteps` are an input.

    .. pydrake_system::

        name: CapturePointController
        input_ports: [foot_poses, foot_forces, icp, velocity_command,
                      alip_icp, mechanisms, com_state]
        output_ports: [walking_state, walking_signal, footsteps,
                       revised_footsteps, icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       ecmp_command, momentum_qp_status, momentum_rate]
    """

    INPUTS = (
        "foot_poses",
        "foot_forces",
        "icp",
        "alip_icp",
        "mechanisms",
        "com_state",
        "velocity_command",
        "footsteps",
        "revised_footsteps",
    )
    # The blocks, with the outputs that others read.
    ROLES = {
        "walking_state_machine": "walking_state",
        "footstep_planner": "footsteps",
        "icp_planner": "icp_plan",
        "timing_adapter": "time_adjustment",
        "step_adjuster": "adjustment",
        "momentum_qp": "ecmp_command",
        "step_controller": "adjustment ecmp_command icp_reference",
        "com_height_controller": "momentum_rate",
    }

    def __init__(
        self,
        params: ControllerParams,
        model: PointMassModel,
        *,
        start: WalkingState | None = None,
        **blocks: System | None,
    ):
        """Begins with the walking state `start`, by default standing.

        `blocks` replace those of the same names, None leaves one out.  A block
        has at least the output ports that others read, and any input whose name
        is a signal of this diagram.

        Raises ValueError: a parameter is out of range; a block lacks a port
        that others need, has one of a wrong type, or has no place here.
        """
        super().__init__()
        check(params)
        period, qp = params.control_period, params.icp_step_qp
        plan = params.atlas_icp_plan if qp else params.icp_plan
        clock = partial(planning.WalkingStateMachine, start=start)
        footsteps = partial(
            planning.FootstepPlanner,
            adjuster=params.step_adjuster,
            timing=params.timing_adapter,
        )
        if start is not None and start.schedule.footsteps:
            footsteps = partial(
                planning.FixedFootsteps,
                footsteps=start.schedule.footsteps,
                adjuster=params.step_adjuster,
                timing=params.timing_adapter,
            )
        planner = partial(planning.IcpPlanner, has_reference=not qp)
        usual: dict = {
            "walking_state_machine": (clock, params.walking_state_machine),
            "footstep_planner": (footsteps, params.footstep_planner),
            "icp_planner": (planner, plan),
            "timing_adapter": (planning.TimingAdapter, params.timing_adapter),
        }
        if qp:  # both in one, for the Atlas paper's plan
            usual["step_controller"] = feedback.IcpStepController, qp
        else:
            adjuster = steps.CaptureRegionStepAdjuster, params.step_adjuster
            usual["step_adjuster"] = adjuster
            usual["momentum_qp"] = feedback.MomentumQp, params.balance
        height = feedback.ComHeightController, params.com_height
        usual["com_height_controller"] = height
        makers = {r: partial(*made, model, period) for r, made in usual.items()}
        builder = DiagramBuilder()
        wire(builder, fill(makers, self.ROLES, blocks), self.INPUTS)
        builder.BuildInto(self)


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
                              velocity_command,
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
        input_ports: [estimated_state, foot_forces, velocity_command,
                      mechanisms]
        output_ports: [predicted_state, whole_body_terms, com_state, icp,
                       alip_icp, foot_poses, walking_state,
                       walking_signal, footsteps, revised_footsteps,
                       icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       ecmp_command, momentum_qp_status, momentum_rate,
                       swing_foot_reference, friction, actuation,
                       foot_wrenches, whole_body_qp_status,
                       generalized_acceleration]
    """

    INPUTS = (
        "estimated_state",
        "foot_forces",
        "mechanisms",
        "velocity_command",
        "footsteps",
        "revised_footsteps",
    )
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

        Raises ValueError: as CapturePointController; `tasks` for a QP not ours.
        """
        super().__init__()
        check(params)
        period = params.control_period
        own = params.whole_body
        model = replace(robot.point_mass, ground=ground)
        # Each torque is held for a period.
        lead = robot.drives.lag + 0.5 * period if robot.drives else 0.0
        tasks = tuple(tasks)
        if tasks and "whole_body_inverse_dynamics" in blocks:
            names = ", ".join(task.name for task in tasks)
            where = "the block that replaces whole_body_inverse_dynamics"
            raise ValueError(f"tasks = {names}: must be given to {where}")
        replaced = "capture_point_controller" in blocks
        inner = {} if replaced else CapturePointController.ROLES
        planners = {name: blocks.pop(name) for name in inner if name in blocks}
        planned = partial(CapturePointController, start=start, **planners)
        inverse_dynamics = whole_body.WholeBodyInverseDynamics
        usual: tuple = (  # in the order of ROLES
            (StatePredictor, robot, period, delay, lead),
            (CentroidalEstimator, robot, own.avoidance, lead),
            (planned, params, model),
            (steps.SwingFootPlanner, params.swing_foot, model, period, lead),
            (whole_body.FrictionEstimator, own, model, period),
            (inverse_dynamics, own, robot, period, tasks),
        )
        made = zip(self.ROLES, usual, strict=True)
        makers = {role: partial(*kind) for role, kind in made}
        builder = DiagramBuilder()
        found = fill(makers, self.ROLES, blocks, inner)
        wire(builder, found, self.INPUTS)
        builder.BuildInto(self)
