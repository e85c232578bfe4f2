"""The capture-point controller, for any robot or a point mass."""

from dataclasses import dataclass, field

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.core.atlas_icp_plan import AtlasIcpPlanParams
from nadia_balance.core.bounds import bounded, check
from nadia_balance.core.icp_plan import IcpPlanParams
from nadia_balance.core.icp_step_qp import IcpStepQpParams
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.momentum_qp import MomentumQpParams
from nadia_balance.core.swing_foot import SwingFootParams
from nadia_balance.core.swing_geometry import CaptureRegionStepAdjusterParams
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import WalkingState
from nadia_balance.core.walking_state_machine import WalkingStateMachineParams
from nadia_balance.systems.capture_region_step_adjuster import (
    CaptureRegionStepAdjuster,
)
from nadia_balance.systems.icp_planner import IcpPlanner
from nadia_balance.systems.icp_step_controller import IcpStepController
from nadia_balance.systems.momentum_qp import MomentumQp
from nadia_balance.systems.ports import require_outputs, wire
from nadia_balance.systems.timing_adapter import TimingAdapter
from nadia_balance.systems.walking_state_machine import WalkingStateMachine


@dataclass(kw_only=True)
class ControllerParams:
    """The parameters of every algorithm; the robot's own are in robot.yaml."""

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
    # The Atlas paper's plan; replaces `icp_plan`.
    atlas_icp_plan: AtlasIcpPlanParams | None = None
    # The Atlas paper's QP, with its plan; replaces `step_adjuster` and
    # `balance`.
    icp_step_qp: IcpStepQpParams | None = None
    balance: MomentumQpParams = field(default_factory=MomentumQpParams)
    swing_foot: SwingFootParams = field(default_factory=SwingFootParams)

    def validate_more(self) -> None:
        """Raises ValueError if the QP moves more steps than are planned."""
        qp, plan = self.icp_step_qp, self.atlas_icp_plan or AtlasIcpPlanParams()
        if qp and qp.num_steps > plan.num_previewed_steps:
            raise ValueError(
                f"icp_step_qp.num_steps = {qp.num_steps}: must be <= "
                f"num_previewed_steps = {plan.num_previewed_steps} of "
                "atlas_icp_plan"
            )


class CapturePointController(Diagram):
    """Plans the ICP and controls it with ankles, hips, steps and their timing.

    It implements the Nadia paper's Sections II to VI or, with `icp_step_qp`,
    the Atlas paper; its model is a point mass and two soles.  `mechanisms` (see
    Mechanisms) selects the mechanisms that it may use, all if not connected.
    Any block may be replaced by another system with the same outputs; its
    inputs are connected by name to any input or output of this diagram.
    The port `capture_regions` exists if the step adjuster has it.  State is
    updated in unrestricted events, once per `control_period`, from the state
    and the inputs before them.

    .. pydrake_system::

        name: CapturePointController
        input_ports: [foot_poses, foot_forces, icp, mechanisms, com_state]
        output_ports: [walking_state, walking_signal, icp_plan, icp_reference,
                       time_adjustment, adjustment, capture_regions,
                       ecmp_command, momentum_qp_status, momentum_rate]
    """

    INPUTS = ("foot_poses", "foot_forces", "icp", "mechanisms", "com_state")

    def __init__(
        self,
        params: ControllerParams,
        model: PointMassModel,
        *,
        start: WalkingState | None = None,
        icp_planner: System | None = None,
        timing_adapter: System | None = None,
        step_adjuster: System | None = None,
        momentum_qp: System | None = None,
    ):
        """Begins with the walking state `start`, by default standing.

        Raises:
            ValueError: a parameter is out of range; a block lacks a port that
                others need, has one of a wrong type, or `icp_step_qp`
                replaces it.
        """
        super().__init__()
        check(params)
        period = params.control_period
        blocks = {
            "walking_state_machine": WalkingStateMachine(
                params.walking_state_machine, model, period, start
            ),
            "icp_planner": icp_planner or _icp_planner(params, model),
            "timing_adapter": timing_adapter
            or TimingAdapter(params.timing_adapter, model, period),
        }
        if params.icp_step_qp:
            for role, block in (
                ("step_adjuster", step_adjuster),
                ("momentum_qp", momentum_qp),
            ):
                if block is not None:
                    raise ValueError(
                        f"{role} = {type(block).__name__}: must be None with "
                        "icp_step_qp, which takes its place"
                    )
            blocks["step_controller"] = IcpStepController(
                params.icp_step_qp, model, period
            )
        else:
            blocks["step_adjuster"] = step_adjuster or (
                CaptureRegionStepAdjuster(params.step_adjuster, model, period)
            )
            blocks["momentum_qp"] = momentum_qp or MomentumQp(
                params.balance, model, period
            )
        reference = () if params.icp_step_qp else ("icp_reference",)
        for role, *outputs in (
            ("icp_planner", "icp_plan", *reference),
            ("timing_adapter", "time_adjustment"),
            ("step_adjuster", "adjustment"),
            ("momentum_qp", "ecmp_command", "momentum_rate"),
        ):
            if role in blocks:
                require_outputs(role, blocks[role], *outputs)
        builder = DiagramBuilder()
        wire(builder, blocks, self.INPUTS)
        builder.BuildInto(self)


def _icp_planner(params: ControllerParams, model: PointMassModel) -> System:
    plan = params.atlas_icp_plan
    if params.icp_step_qp and plan is None:
        plan = AtlasIcpPlanParams()
    return IcpPlanner(
        plan or params.icp_plan,
        model,
        params.control_period,
        has_reference=not params.icp_step_qp,
    )
