"""The brain: balance by the capture point, for any robot or point mass."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from nadia_balance.core.com_height import ComHeightParams, LegGeometry
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.icp_plan import IcpPlanParams
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
from nadia_balance.systems.momentum_qp import MomentumQp
from nadia_balance.systems.ports import (
    connect,
    export_input,
    export_outputs,
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


@dataclass(frozen=True)
class PointMassModel:
    """All that the brain knows of its robot."""

    mass: float  # [kg]
    omega: float  # natural frequency [rad/s]
    com_height: float  # of the CoM over the soles [m]
    sole: np.ndarray  # (n, 2) corners in the sole frame [m]
    legs: LegGeometry  # how far they reach


class CapturePointController(Diagram):
    """Plans the ICP and controls it with the ankles and the hips.

    The Nadia paper's Sections II and III; knows no robot, only a point mass
    and two soles.

    .. pydrake_system::

        name: CapturePointController
        input_ports: [foot_poses, foot_forces, icp, com_state]
        output_ports: [walking_state, walking_signal, capture_regions,
                       icp_plan, icp_reference, ecmp_command, momentum_rate,
                       momentum_qp_status]
    """

    def __init__(
        self,
        params: ControllerParams,
        model: PointMassModel,
        initial: WalkingState,
    ):
        """Starts walking from the walking state `initial`."""
        super().__init__()
        params.validate()
        period = params.control_period
        builder = DiagramBuilder()
        machine = builder.AddNamedSystem(
            "walking_state_machine",
            WalkingStateMachine(
                params.walking_state_machine,
                initial,
                model.sole,
                params.step_adjuster.reachability,
                period,
            ),
        )
        planner = builder.AddNamedSystem(
            "icp_planner",
            IcpPlanner(params.icp_plan, model.sole, model.omega),
        )
        momentum = builder.AddNamedSystem(
            "momentum_qp",
            MomentumQp(
                params.balance,
                params.com_height,
                mass=model.mass,
                omega=model.omega,
                com_height=model.com_height,
                sole=model.sole,
                control_period=period,
                legs=model.legs,
            ),
        )
        connect(builder, machine, planner, "walking_state")
        connect(builder, machine, momentum, "walking_state")
        connect(builder, planner, momentum, "icp_reference")
        connect(builder, planner, machine, "icp_plan")
        timing = builder.AddNamedSystem(
            "timing_adapter", TimingAdapter(params.timing_adapter, model.sole)
        )
        adjuster = builder.AddNamedSystem(
            "step_adjuster",
            CaptureRegionStepAdjuster(
                params.step_adjuster, model.sole, model.omega
            ),
        )
        connect(builder, machine, timing, "walking_state")
        connect(builder, planner, timing, "icp_plan")
        connect(builder, timing, machine, "time_adjustment")
        connect(builder, machine, adjuster, "walking_state")
        connect(builder, timing, adjuster, "time_adjustment")
        connect(builder, adjuster, machine, "adjustment")

        export_input(builder, "foot_poses", machine, timing)
        export_input(builder, "foot_forces", machine)
        export_input(builder, "icp", machine, momentum, timing, adjuster)
        export_input(builder, "com_state", momentum)
        export_outputs(builder, machine, "walking_state", "walking_signal")
        export_outputs(builder, adjuster, "capture_regions")
        export_outputs(builder, planner, "icp_plan", "icp_reference")
        export_outputs(builder, momentum, "ecmp_command", "momentum_rate")
        builder.ExportOutput(
            momentum.GetOutputPort("qp_status"), "momentum_qp_status"
        )
        builder.BuildInto(self)
