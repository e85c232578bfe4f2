"""The brain: balance by the capture point, for any robot or point mass."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from nadia_balance.core.com_height import ComHeightParams, LegGeometry
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.icp_plan import IcpPlanParams
from nadia_balance.core.icp_step_qp import IcpStepQpParams
from nadia_balance.core.lipm import GRAVITY
from nadia_balance.core.mechanisms import mechanisms_of
from nadia_balance.core.momentum_qp import MomentumQpParams
from nadia_balance.core.swing_foot import SwingFootParams
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import WalkingState
from nadia_balance.core.walking_state_machine import (
    WalkingStateMachineParams,
)
from nadia_balance.systems.capture_region_step_adjuster import (
    CaptureRegionStepAdjuster,
)
from nadia_balance.systems.icp_planner import IcpPlanner
from nadia_balance.systems.icp_step_adjuster import IcpStepAdjuster
from nadia_balance.systems.momentum_qp import MomentumQp
from nadia_balance.systems.ports import (
    connect,
    export_input,
    export_outputs,
    feed_input,
)
from nadia_balance.systems.timing_adapter import TimingAdapter
from nadia_balance.systems.walking_state_machine import WalkingStateMachine


@dataclass(kw_only=True)
class ControllerParams:
    """The parameters of every algorithm; the robot's own are in robot.yaml."""

    control_period: float = 0.002  # T [s]
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
    com_height: ComHeightParams = field(default_factory=ComHeightParams)
    swing_foot: SwingFootParams = field(default_factory=SwingFootParams)

    def validate(self) -> None:
        """Raises ValueError if a field, here or below, is out of range."""
        if not 0.0005 <= self.control_period <= 0.02:
            raise ValueError(
                f"control_period = {self.control_period}: "
                "must be in [0.0005, 0.02] s"
            )
        for part in vars(self).values():
            if hasattr(part, "validate"):
                part.validate()


@dataclass(frozen=True, eq=False)
class PointMassModel:
    """All that the brain knows of its robot."""

    mass: float  # [kg]
    omega: float  # natural frequency [rad/s]
    com_height: float  # of the CoM over the soles [m]
    sole: np.ndarray  # (n, 2) corners in the sole frame [m]
    legs: LegGeometry  # how far they reach


class CapturePointController(Diagram):
    """Plans the ICP and controls it with ankles, hips and what is switched on.

    The Nadia paper's Sections II to VI; knows no robot, only a point mass and
    two soles.  It has a TimingAdapter and a CaptureRegionStepAdjuster, or an
    IcpStepAdjuster in its place, only if they have something to do;
    `capture_regions` comes from the latter.  If it is made `switchable` it has
    both, and `mechanisms` (see SwitchedParams) switches them while it runs.

    .. pydrake_system::

        name: CapturePointController
        input_ports: [foot_poses, foot_forces, icp, com_state, mechanisms]
        output_ports: [walking_state, walking_signal, icp_plan, icp_reference,
                       ecmp_command, momentum_rate, momentum_qp_status,
                       capture_regions]
    """

    def __init__(
        self,
        params: ControllerParams,
        model: PointMassModel,
        initial: WalkingState,
        switchable: bool = False,
    ):
        """Starts walking from the walking state `initial`.

        Raises:
            ValueError: a parameter is out of range, or does not go with others.
        """
        super().__init__()
        params.validate()
        on = mechanisms_of(params.timing_adapter, params.step_adjuster)
        if params.icp_step_qp and on.cross_over:
            raise ValueError(
                "icp_step_qp: must be null where the legs may cross, as with "
                "mechanisms = all_with_cross_over"
            )
        builder = DiagramBuilder()
        machine = _add_machine(builder, params, model, initial)
        planner = builder.AddNamedSystem(
            "icp_planner",
            IcpPlanner(params.icp_plan, model.sole, model.omega),
        )
        momentum = _add_momentum_qp(builder, params, model)
        connect(builder, machine, planner, "walking_state")
        connect(builder, machine, momentum, "walking_state")
        connect(builder, planner, momentum, "icp_reference")
        connect(builder, planner, machine, "icp_plan")
        export_input(builder, "foot_poses", machine)
        export_input(builder, "foot_forces", machine)
        export_input(builder, "icp", machine, momentum)
        export_input(builder, "com_state", momentum)
        export_outputs(builder, machine, "walking_state", "walking_signal")
        export_outputs(builder, planner, "icp_plan", "icp_reference")
        export_outputs(builder, momentum, "ecmp_command", "momentum_rate")
        builder.ExportOutput(
            momentum.GetOutputPort("qp_status"), "momentum_qp_status"
        )
        timing = adjuster = None
        if switchable or on.swing or on.transfer:
            timing = _add_timing(builder, params, model, machine, planner)
        if switchable or on.step:
            adjuster = _make_adjuster(params, model)
            _add_adjuster(builder, adjuster, machine, timing)
        if switchable:
            export_input(builder, "mechanisms", timing, adjuster)
        builder.BuildInto(self)


def _add_machine(
    builder: DiagramBuilder,
    params: ControllerParams,
    model: PointMassModel,
    initial: WalkingState,
) -> WalkingStateMachine:
    return builder.AddNamedSystem(
        "walking_state_machine",
        WalkingStateMachine(
            params.walking_state_machine,
            initial,
            model.sole,
            params.step_adjuster.reachability,
            model.mass * GRAVITY,
            params.control_period,
        ),
    )


def _add_momentum_qp(
    builder: DiagramBuilder, params: ControllerParams, model: PointMassModel
) -> MomentumQp:
    return builder.AddNamedSystem(
        "momentum_qp",
        MomentumQp(
            params.balance,
            params.com_height,
            mass=model.mass,
            omega=model.omega,
            com_height=model.com_height,
            sole=model.sole,
            control_period=params.control_period,
            legs=model.legs,
        ),
    )


def _add_timing(
    builder: DiagramBuilder,
    params: ControllerParams,
    model: PointMassModel,
    machine: WalkingStateMachine,
    planner: IcpPlanner,
) -> TimingAdapter:
    timing = builder.AddNamedSystem(
        "timing_adapter",
        TimingAdapter(
            params.timing_adapter,
            model.sole,
            params.swing_foot.detour,
            params.control_period,
        ),
    )
    connect(builder, machine, timing, "walking_state")
    connect(builder, planner, timing, "icp_plan")
    connect(builder, timing, machine, "time_adjustment")
    feed_input(builder, timing, "icp", "foot_poses")
    return timing


def _make_adjuster(
    params: ControllerParams, model: PointMassModel
) -> CaptureRegionStepAdjuster | IcpStepAdjuster:
    if params.icp_step_qp:
        return IcpStepAdjuster(
            params.icp_step_qp,
            params.icp_plan.cop,
            params.step_adjuster.reachability,
            model.sole,
            model.omega,
        )
    return CaptureRegionStepAdjuster(
        params.step_adjuster, model.sole, model.omega, params.control_period
    )


def _add_adjuster(
    builder: DiagramBuilder,
    adjuster: CaptureRegionStepAdjuster | IcpStepAdjuster,
    machine: WalkingStateMachine,
    timing: TimingAdapter | None,
) -> None:
    builder.AddNamedSystem("step_adjuster", adjuster)
    connect(builder, machine, adjuster, "walking_state")
    connect(builder, adjuster, machine, "adjustment")
    if timing and isinstance(adjuster, CaptureRegionStepAdjuster):
        connect(builder, timing, adjuster, "time_adjustment")
    feed_input(builder, adjuster, "icp")
    export_outputs(builder, adjuster, "capture_regions")
