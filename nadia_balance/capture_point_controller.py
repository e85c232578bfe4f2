"""The capture-point controller: balance of any robot, or of a point mass."""

from dataclasses import dataclass, field

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.core.bounds import bounded, check
from nadia_balance.core.capture_region import CaptureRegionStepAdjusterParams
from nadia_balance.core.icp_plan import IcpPlanParams
from nadia_balance.core.icp_step_qp import IcpStepQpParams
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.momentum_qp import MomentumQpParams
from nadia_balance.core.swing_foot import SwingFootParams
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import WalkingState
from nadia_balance.core.walking_state_machine import WalkingStateMachineParams
from nadia_balance.systems.capture_region_step_adjuster import (
    CaptureRegionStepAdjuster,
)
from nadia_balance.systems.icp_planner import IcpPlanner
from nadia_balance.systems.icp_step_adjuster import IcpStepAdjuster
from nadia_balance.systems.momentum_qp import MomentumQp
from nadia_balance.systems.ports import require_outputs, wire
from nadia_balance.systems.timing_adapter import TimingAdapter
from nadia_balance.systems.walking_state_machine import WalkingStateMachine


@dataclass(kw_only=True)
class ControllerParams:
    """The parameters of every algorithm; the robot's own are in robot.yaml."""

    control_period: float = bounded(
        0.002, least=0.0005, most=0.02, unit="s"
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
    # The Atlas paper's QP moves the footholds; null: the capture regions do.
    icp_step_qp: IcpStepQpParams | None = None
    icp_plan: IcpPlanParams = field(default_factory=IcpPlanParams)
    balance: MomentumQpParams = field(default_factory=MomentumQpParams)
    swing_foot: SwingFootParams = field(default_factory=SwingFootParams)


class CapturePointController(Diagram):
    """Plans the ICP and controls it with ankles, hips, steps and their timing.

    The Nadia paper's Sections II to VI; knows no robot, only a point mass and
    two soles.  `mechanisms` (see Mechanisms) says what it may use; not
    connected, all.  Any block may be replaced by another system with the same
    outputs; its inputs are connected by their names and may be any signal
    here, input or output.  `capture_regions` is there if the step adjuster
    has it.  All that has state updates in unrestricted events, once per
    `control_period`, from the state and the inputs before them.

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
        """Begins with the walking state `start`, by default it stands.

        Raises:
            ValueError: a parameter is out of range; a block lacks a port that
                others need, or has one that does not fit.
        """
        super().__init__()
        check(params)
        period = params.control_period
        blocks = {
            "walking_state_machine": WalkingStateMachine(
                params.walking_state_machine, model, period, start
            ),
            "icp_planner": icp_planner
            or IcpPlanner(params.icp_plan, model, period),
            "timing_adapter": timing_adapter
            or TimingAdapter(params.timing_adapter, model, period),
            "step_adjuster": step_adjuster
            or _step_adjuster(params, model, period),
            "momentum_qp": momentum_qp
            or MomentumQp(params.balance, model, period),
        }
        for role, *outputs in (
            ("icp_planner", "icp_plan", "icp_reference"),
            ("timing_adapter", "time_adjustment"),
            ("step_adjuster", "adjustment"),
            ("momentum_qp", "ecmp_command", "momentum_rate"),
        ):
            require_outputs(role, blocks[role], *outputs)
        builder = DiagramBuilder()
        wire(builder, blocks, self.INPUTS)
        builder.BuildInto(self)


def _step_adjuster(
    params: ControllerParams, model: PointMassModel, period: float
) -> System:
    if params.icp_step_qp:
        return IcpStepAdjuster(params.icp_step_qp, model, period)
    return CaptureRegionStepAdjuster(params.step_adjuster, model, period)
