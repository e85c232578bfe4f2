"""The capture-point controller, for any robot or a point mass."""

from dataclasses import dataclass, field
from functools import partial

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.core.body.com_height import ComHeightParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.feedback.momentum_qp import MomentumQpParams
from nadia_balance.core.math.bounds import bounded, check
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlanParams
from nadia_balance.core.plan.cop_waypoints import IcpPlanParams
from nadia_balance.core.plan.time_adjustment import TimingAdapterParams
from nadia_balance.core.plan.walking_state_machine import (
    WalkingStateMachineParams,
)
from nadia_balance.core.steps.swing_foot import SwingFootParams
from nadia_balance.core.steps.swing_geometry import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.walking.vocabulary import WalkingState
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.systems.feedback import (
    ComHeightController,
    IcpStepController,
    MomentumQp,
)
from nadia_balance.systems.plan import (
    IcpPlanner,
    TimingAdapter,
    WalkingStateMachine,
)
from nadia_balance.systems.steps import CaptureRegionStepAdjuster
from nadia_balance.systems.wiring import fill, wire


@dataclass(kw_only=True)
class ControllerParams:
    """The parameters of every algorithm; robot.yaml overrides `whole_body`."""

    control_period: float = bounded(
        0.004, least=0.0005, most=0.02, unit="s", of=""
    )  # T
    walking_state_machine: WalkingStateMachineParams = field(
        default_factory=WalkingStateMachineParams
    )
    timing_adapter: TimingAdapterParams = field(
        default_factory=TimingAdapterParams
    )
    step_adjuster: CaptureRegionStepAdjusterParams = field(
        default_factory=CaptureRegionStepAdjusterParams
    )
    icp_plan: IcpPlanParams = field(default_factory=IcpPlanParams)
    # The Atlas paper's QP, with its plan; they replace `step_adjuster`,
    # `balance` and `icp_plan`.
    icp_step_qp: IcpStepQpParams | None = None
    atlas_icp_plan: AtlasIcpPlanParams = field(
        default_factory=AtlasIcpPlanParams
    )
    balance: MomentumQpParams = field(default_factory=MomentumQpParams)
    com_height: ComHeightParams = field(default_factory=ComHeightParams)
    swing_foot: SwingFootParams = field(default_factory=SwingFootParams)
    whole_body: WholeBodyQpParams = field(default_factory=WholeBodyQpParams)

    def validate_more(self) -> None:
        """Raises ValueError if the QP moves more steps than are planned."""
        qp, plan = self.icp_step_qp, self.atlas_icp_plan
        if qp and qp.num_steps > plan.num_previewed_steps:
            raise ValueError(
                f"icp_step_qp.num_steps = {qp.num_steps}: must be <= "
                f"num_previewed_steps = {plan.num_previewed_steps} of "
                "atlas_icp_plan"
            )


class CapturePointController(Diagram):
    """Plans the ICP and controls it with ankles, hips, steps and their timing.

    The Nadia paper's Sections II to VI or, with `icp_step_qp`, the Atlas
    paper, for a point mass on two soles.  Signals are connected by their names:

    =====================  ================================  ================
    block                  reads                             writes
    =====================  ================================  ================
    walking_state_machine  foot_poses, foot_forces, icp,     walking_state,
                           icp_plan, time_adjustment,        walking_signal
                           adjustment
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
    those that the controller may use.

    .. pydrake_system::

        name: CapturePointController
        input_ports: [foot_poses, foot_forces, icp, mechanisms, alip_icp,
                      com_state]
        output_ports: [walking_state, walking_signal, icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       ecmp_command, momentum_qp_status, momentum_rate]
    """

    INPUTS = "foot_poses foot_forces icp alip_icp mechanisms com_state".split()
    # The blocks, with the outputs that others read.
    ROLES = {
        "walking_state_machine": "walking_state",
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
        stabilisers: dict = {
            "step_adjuster": (CaptureRegionStepAdjuster, params.step_adjuster),
            "momentum_qp": (MomentumQp, params.balance),
        }
        if qp:  # both in one, for the Atlas paper's plan
            stabilisers = {"step_controller": (IcpStepController, qp)}
        clock = partial(WalkingStateMachine, start=start)
        usual = {
            "walking_state_machine": (clock, params.walking_state_machine),
            "icp_planner": (partial(IcpPlanner, has_reference=not qp), plan),
            "timing_adapter": (TimingAdapter, params.timing_adapter),
            **stabilisers,
            "com_height_controller": (ComHeightController, params.com_height),
        }
        makers = {
            role: partial(kind, own, model, period)
            for role, (kind, own) in usual.items()
        }
        builder = DiagramBuilder()
        wire(builder, fill(makers, self.ROLES, blocks), self.INPUTS)
        builder.BuildInto(self)
