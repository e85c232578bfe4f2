"""The controllers: from a robot's state to its joint torques.

In it, the capture-point controller is for any robot, or a point mass.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.core.body.com_height import ComHeightParams
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.feedback.momentum_qp import MomentumQpParams
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlanParams
from nadia_balance.core.plan.cop_waypoints import IcpPlanParams
from nadia_balance.core.plan.footstep_plan import FootstepPlannerParams
from nadia_balance.core.plan.time_adjustment import TimingAdapterParams
from nadia_balance.core.plan.walking_state_machine import (
    WalkingStateMachineParams,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.steps.swing_foot import SwingFootParams
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.tasks import Task
from nadia_balance.parameters.bounds import (
    bounded,
    check,
    check_number,
    check_type,
    parameters,
    require,
)
from nadia_balance.parameters.scaling import scaled
from nadia_balance.robot.model import RobotModel, load_robot_params
from nadia_balance.systems.feedback import (
    ComHeightController,
    IcpStepController,
    MomentumQp,
)
from nadia_balance.systems.plan import (
    FixedFootsteps,
    FootstepPlanner,
    IcpPlanner,
    TimingAdapter,
    WalkingStateMachine,
)
from nadia_balance.systems.state import CentroidalEstimator, StatePredictor
from nadia_balance.systems.steps import (
    CaptureRegionStepAdjuster,
    SwingFootPlanner,
)
from nadia_balance.systems.whole_body import (
    FrictionEstimator,
    WholeBodyInverseDynamics,
)
from nadia_balance.systems.wiring import fill, wire


@parameters
class ControllerParams:
    """The parameters of every algorithm; some are those of a robot.yaml."""

    control_period: float = bounded(
        0.004,
        least=5e-4,
        most=0.02,
        unit="s",
        of="",
        doc="time between two ticks of the controller, T",
    )
    walking_state_machine: WalkingStateMachineParams = bounded(
        WalkingStateMachineParams, doc="conditions that end a phase"
    )
    timing_adapter: TimingAdapterParams = bounded(
        TimingAdapterParams, doc="of the timing of steps"
    )
    footstep_planner: FootstepPlannerParams = bounded(
        FootstepPlannerParams, doc="of where to step"
    )
    step_adjuster: CaptureRegionStepAdjusterParams = bounded(
        CaptureRegionStepAdjusterParams,
        doc="of the adjustment of footholds by capture regions",
    )
    icp_plan: IcpPlanParams = bounded(IcpPlanParams, doc="of the ICP plan")
    icp_step_qp: IcpStepQpParams | None = bounded(
        None,
        doc="of the Atlas paper's QP, if it replaces, with its plan, "
        "`step_adjuster`, `balance` and `icp_plan`",
    )
    atlas_icp_plan: AtlasIcpPlanParams = bounded(
        AtlasIcpPlanParams, doc="of the ICP plan for `icp_step_qp`"
    )
    balance: MomentumQpParams = bounded(
        MomentumQpParams, doc="of the ICP feedback"
    )
    com_height: ComHeightParams = bounded(
        ComHeightParams, doc="of the height of the CoM"
    )
    swing_foot: SwingFootParams = bounded(
        SwingFootParams, doc="of the motion of the swing foot"
    )
    whole_body: WholeBodyQpParams = bounded(
        WholeBodyQpParams, doc="of the whole-body QP"
    )

    def validate_more(self) -> None:
        """Checks what bounds of single fields cannot say.

        Raises:
            ValueError: the QP moves more steps than are planned.
        """
        qp = self.icp_step_qp
        planned = self.atlas_icp_plan.num_previewed_steps
        if qp and qp.num_steps > planned:
            raise ValueError(
                f"icp_step_qp.num_steps = {qp.num_steps}: must be <= "
                f"num_previewed_steps = {planned} of atlas_icp_plan"
            )


def controller_params(robot: str) -> ControllerParams:
    """The parameters of a robot, without those of a scenario.

    Args:
        robot: name of a robot of the package, or path of a robot.yaml.

    Returns:
        The defaults, scaled to its size, below what its robot.yaml gives.

    Raises:
        ValueError: as load_robot.
        FileNotFoundError: as load_robot.
    """
    params = load_robot_params(robot)[0]
    usual = scaled(ControllerParams(), params.size)
    return replace(usual, whole_body=params.whole_body)


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
    timing_adapter         icp, alip_icp, icp_plan,          time_adjustment
                           walking_state, foot_poses,
                           mechanisms
    step_adjuster          alip_icp, walking_state,          adjustment,
                           foot_poses, time_adjustment,      capture_regions,
                           mechanisms                        no_foothold
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

    Args:
        params: parameters of all blocks, and the control period.
        model: point mass of the robot.
        start: walking state at the start, by default standing.
        **blocks: replace those of the same names, None leaves one out.  A block
            has at least the output ports that others read, and any input whose
            name is a signal of this diagram.

    Raises:
        ValueError: a parameter is out of range; a block lacks a port that
            others need, has one of a wrong type, or has no place here.

    .. pydrake_system::

        name: CapturePointController
        input_ports: [foot_poses, foot_forces, icp, velocity_command,
                      alip_icp, mechanisms, com_state]
        output_ports: [walking_state, walking_signal, footsteps,
                       revised_footsteps, icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       no_foothold, ecmp_command, momentum_qp_status,
                       momentum_rate]
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
        "walking_state_machine": ("walking_state",),
        "footstep_planner": ("footsteps",),
        "icp_planner": ("icp_plan",),
        "timing_adapter": ("time_adjustment",),
        "step_adjuster": ("adjustment",),
        "momentum_qp": ("ecmp_command",),
        "step_controller": ("adjustment", "ecmp_command", "icp_reference"),
        "com_height_controller": ("momentum_rate",),
    }

    def __init__(
        self,
        params: ControllerParams,
        model: PointMassModel,
        *,
        start: WalkingState | None = None,
        **blocks: System | None,
    ) -> None:
        super().__init__()
        check_type("params", params, ControllerParams)
        check(params)
        check_type("model", model, PointMassModel)
        if start is not None:
            check_type("start", start, WalkingState)
        period = params.control_period
        qp = params.icp_step_qp
        makers: dict[str, Callable[[], System]] = {
            "walking_state_machine": lambda: WalkingStateMachine(
                params.walking_state_machine, model, period, start=start
            ),
            "footstep_planner": lambda: _footstep_planner(params, model, start),
            "icp_planner": lambda: IcpPlanner(
                params.atlas_icp_plan if qp else params.icp_plan,
                model,
                period,
                has_reference=not qp,
            ),
            "timing_adapter": lambda: TimingAdapter(
                params.timing_adapter, model, period
            ),
        }
        if qp:  # both in one, for the Atlas paper's plan
            makers["step_controller"] = lambda: IcpStepController(
                qp, model, period
            )
        else:
            makers["step_adjuster"] = lambda: CaptureRegionStepAdjuster(
                params.step_adjuster, model, period
            )
            makers["momentum_qp"] = lambda: MomentumQp(
                params.balance, model, period
            )
        makers["com_height_controller"] = lambda: ComHeightController(
            params.com_height, model, period
        )
        builder = DiagramBuilder()
        wire(builder, fill(makers, self.ROLES, blocks), self.INPUTS)
        builder.BuildInto(self)


def _footstep_planner(
    params: ControllerParams, model: PointMassModel, start: WalkingState | None
) -> FootstepPlanner:
    """Returns FixedFootsteps, if the start has some."""
    if start is None or not start.schedule.footsteps:
        return FootstepPlanner(
            params.footstep_planner,
            model,
            params.control_period,
            adjuster=params.step_adjuster,
            timing=params.timing_adapter,
        )
    return FixedFootsteps(
        params.footstep_planner,
        model,
        params.control_period,
        footsteps=start.schedule.footsteps,
        adjuster=params.step_adjuster,
        timing=params.timing_adapter,
    )


class BalanceController(Diagram):
    """Computes joint torques from the robot's state.

    Signals are connected by their names; `actuation` [N m] and `joint_command`
    (see WholeBodyInverseDynamics) are in the order of the plant's actuators:

    ===========================  ========================  =====================
    block                        reads                     writes
    ===========================  ========================  =====================
    state_predictor              estimated_state,          predicted_state
                                 generalized_acceleration
    centroidal_estimator         predicted_state           com_state, icp,
                                                           alip_icp, foot_poses,
                                                           whole_body_terms
    capture_point_controller     com_state, icp,           walking_state,
                                 alip_icp, foot_poses,     momentum_rate, ...
                                 foot_forces,
                                 velocity_command,
                                 mechanisms
    swing_foot_planner           walking_state             swing_foot_reference
    friction_estimator           whole_body_terms,         friction
                                 foot_wrenches
    whole_body_inverse_dynamics  whole_body_terms,         actuation,
                                 momentum_rate, friction,  joint_command,
                                 walking_state,            foot_wrenches, and
                                 swing_foot_reference;     what state_predictor
                                 for tasks of one's own    reads
                                 icp, icp_reference,
                                 mechanisms
    ===========================  ========================  =====================

    Three loops are closed by states of the last tick: the walking state, the
    friction coefficient and, with a delay or noise, the acceleration.
    `estimated_state` is [q, v] of the robot's `control_plant`, `foot_forces`
    (2,) [N] are those of the left and the right foot; `mechanisms` (4,), all on
    if not connected.

    Any evaluation of `actuation` gives the torque of that control tick: before
    the update of the tick it is computed from the inputs, afterwards it is
    held.  No other hold is needed between controller and plant.

    Args:
        params: parameters of all blocks, and the control period.
        robot: robot that is controlled.
        start: walking state at the start, by default standing.
        ground: model of the ground; None: flat.
        delay: of the measurements [s], a multiple of the control period.
        sensors: whose noise is filtered, while the drives hold the joints
            by the robot's `impedance`; None: no noise, and torques alone.
        tasks: tasks that are added to those of the whole-body QP.
        **blocks: replace these blocks, and those of the CapturePointController,
            by name; None leaves one out.

    Raises:
        ValueError: as CapturePointController; `tasks` for a QP not ours.

    .. pydrake_system::

        name: BalanceController
        input_ports: [estimated_state, foot_forces, velocity_command,
                      mechanisms]
        output_ports: [predicted_state, whole_body_terms, com_state, icp,
                       alip_icp, foot_poses, walking_state,
                       walking_signal, footsteps, revised_footsteps,
                       icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       no_foothold, ecmp_command, momentum_qp_status,
                       momentum_rate,
                       swing_foot_reference, friction, actuation,
                       joint_command, foot_wrenches, whole_body_qp_status,
                       generalized_acceleration]
    """

    INPUTS = (
        "estimated_state",
        "foot_forces",
        "mechanisms",
        "velocity_command",
        "footsteps",
        "revised_footsteps",
        "icp_reference",  # if the capture_point_controller has none
    )
    # The blocks, with the outputs that others read.
    ROLES = {
        "state_predictor": ("predicted_state",),
        "centroidal_estimator": ("com_state", "icp", "alip_icp", "foot_poses"),
        "capture_point_controller": ("walking_state", "momentum_rate"),
        "swing_foot_planner": ("swing_foot_reference",),
        "friction_estimator": ("friction",),
        "whole_body_inverse_dynamics": ("actuation",),
    }

    def __init__(
        self,
        params: ControllerParams,
        robot: RobotModel,
        *,
        start: WalkingState | None = None,
        ground: Ground | None = None,
        delay: float = 0.0,
        sensors: SensorParams | None = None,
        tasks: Iterable[Task] = (),
        **blocks: System | None,
    ) -> None:
        super().__init__()
        check_type("params", params, ControllerParams)
        check(params)
        check_type("robot", robot, RobotModel)
        if sensors is not None:
            check_type("sensors", sensors, SensorParams)
        if ground is not None:
            check_type("ground", ground, Ground)
        check_number("delay", delay, least=0.0, most=1.0, unit="s")
        tasks = tuple(tasks)
        require(
            not (tasks and "whole_body_inverse_dynamics" in blocks),
            f"tasks = {', '.join(task.name for task in tasks)}: must be "
            "given to the block that replaces whole_body_inverse_dynamics",
        )
        period = params.control_period
        model = replace(robot.point_mass, ground=ground)
        # Each torque is held for a period.
        lead = robot.drives.lag + 0.5 * period if robot.drives else 0.0
        # The names of the blocks in the CapturePointController, unless it is
        # replaced itself, and those of them that the user has.
        inner = (
            ()
            if "capture_point_controller" in blocks
            else CapturePointController.ROLES
        )
        planners = {name: blocks.pop(name) for name in inner if name in blocks}
        makers: dict[str, Callable[[], System]] = {
            "state_predictor": lambda: StatePredictor(
                robot, period, delay=delay, lead=lead, sensors=sensors
            ),
            "centroidal_estimator": lambda: CentroidalEstimator(
                robot,
                params.whole_body.avoidance,
                lead,
                given=params.whole_body.given_joints,
            ),
            "capture_point_controller": lambda: CapturePointController(
                params, model, start=start, **planners
            ),
            "swing_foot_planner": lambda: SwingFootPlanner(
                params.swing_foot, model, period, lead=lead
            ),
            "friction_estimator": lambda: FrictionEstimator(
                params.whole_body, model, period
            ),
            "whole_body_inverse_dynamics": lambda: WholeBodyInverseDynamics(
                params.whole_body,
                robot,
                period,
                tasks=tasks,
                impedance=robot.params.impedance if sensors else None,
            ),
        }
        builder = DiagramBuilder()
        wire(
            builder,
            fill(makers, outputs=self.ROLES, blocks=blocks, others=inner),
            self.INPUTS,
        )
        builder.BuildInto(self)
