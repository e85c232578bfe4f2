"""Weights, gains and limits of the whole-body QP."""

import math
from dataclasses import dataclass, field, fields

from nadia_balance.core.crossing_turn import CrossingTurnParams
from nadia_balance.core.qp_solver import SOLVERS


@dataclass(kw_only=True)
class WholeBodyQpParams:
    """Parameters of the whole-body QP.

    Weights multiply squared accelerations, of the CoM [m/s^2], of bodies
    [rad/s^2], [m/s^2] and of joints [rad/s^2].  Forces and moments are per
    unit of the robot's mass, [m/s^2] and [m^2/s^2], so that the same weights
    serve robots of any size.
    """

    # Soft tasks
    momentum_weight: float = 1e3  # horizontal linear momentum / mass
    height_weight: float = 30.0  # vertical linear momentum / mass
    angular_momentum_weight: float = 0.1  # about the CoM / mass
    angular_momentum_damping: float = 5.0  # [1/s]
    pelvis_weight: float = 0.5  # orientation
    torso_weight: float = 0.5  # orientation
    orientation_gain: float = 80.0  # of both, kp [1/s^2]
    swing_position_weight: float = 100.0
    swing_position_gain: float = 150.0  # kp [1/s^2]
    swing_orientation_weight: float = 10.0
    swing_orientation_gain: float = 200.0  # kp [1/s^2]
    posture_weight: float = 0.03
    # The legs go where pelvis and feet go: this one only breaks ties.
    leg_posture_weight: float = 1e-4
    posture_gain: float = 80.0  # kp [1/s^2]
    damping_ratio: float = 1.0  # of all these tasks: kd = 2 ratio sqrt(kp)
    # Regularisation: it shares the load so that sole moments are small
    moment_weight: float = 1e-2  # of sole moments / mass
    tangential_weight: float = 1e-3  # of horizontal forces / mass
    normal_weight: float = 1e-6  # of normal forces / mass; biases the height
    acceleration_weight: float = 1e-4  # of all generalised accelerations
    # Soles on the ground
    stance_damping: float = 30.0  # of the sole's velocity [1/s]
    stance_tilt_gain: float = 100.0  # brings the sole level, kp [1/s^2]
    friction: float = 0.6  # of the pyramid, mu [-]
    sole_margin: float = 0.005  # the CoP keeps off the sole's edge [m]
    min_normal_force: float = 2.0  # of a foot in contact [N]
    unloading_fraction: float = 0.2  # last part of a transfer [-]
    unloaded_force: float = 50.0  # allowed at its end [N]
    # Joints
    joint_lower_limits: dict[str, float] = field(default_factory=dict)  # [rad]
    joint_limit_horizon: float = 0.1  # looks ahead so far [s]
    max_joint_acceleration: float = 500.0  # to keep the limits [rad/s^2]
    max_effort_ratio: float = 1.0  # of the actuators' limits [-]
    crossing_turn: CrossingTurnParams = field(
        default_factory=CrossingTurnParams
    )
    solver: str = "active_set"  # see nadia_balance.core.qp_solver

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, float | int):
                if not (math.isfinite(value) and value >= 0.0):
                    raise ValueError(f"{f.name} = {value}: must be >= 0")
        for name in _POSITIVE:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)}: must be > 0")
        for name in ("unloading_fraction", "max_effort_ratio"):
            if not getattr(self, name) <= 1.0:
                raise ValueError(
                    f"{name} = {getattr(self, name)}: must be <= 1"
                )
        if not self.unloaded_force > self.min_normal_force:
            raise ValueError(
                f"unloaded_force = {self.unloaded_force}: must be > "
                f"min_normal_force = {self.min_normal_force}"
            )
        for joint, limit in self.joint_lower_limits.items():
            if not math.isfinite(limit):
                raise ValueError(
                    f"joint_lower_limits[{joint}] = {limit}: must be finite"
                )
        self.crossing_turn.validate()
        if self.solver not in SOLVERS:
            raise ValueError(
                f"solver = {self.solver}: must be one of {', '.join(SOLVERS)}"
            )


_POSITIVE = (
    "posture_weight",
    "leg_posture_weight",
    "moment_weight",
    "tangential_weight",
    "normal_weight",
    "acceleration_weight",
    "friction",
    "joint_limit_horizon",
    "max_joint_acceleration",
    "max_effort_ratio",
)
