"""The plant of the LIPM diagram: a point mass on two massless legs."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.lipm import GRAVITY, com_after, icp
from nadia_balance.core.walking import (
    FootPose,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems.ports import declare_input, eval_finite, eval_typed


class PointMassPlant(LeafSystem):
    """Moves as the linear inverted pendulum under the commanded eCMP.

    The swing foot goes exactly as it is told, with the acceleration of the last
    tick until the next one.  A foot carries weight when it is in contact by the
    plan, or when the swing foot has come down to the ground.  Discrete states:
    [p_WC(3), v_WC(3)], exact between ticks for a constant eCMP and push, and
    [p(3), yaw] of the swing foot.

    Raises RuntimeError if an input is not finite.

    .. pydrake_system::

        name: PointMassPlant
        input_ports: [ecmp_command, swing_foot_reference, walking_state,
                      push_force]
        output_ports: [com_state, icp, foot_poses, foot_forces]
    """

    def __init__(
        self,
        mass: float,
        omega: float,
        com_height: float,
        initial: WalkingState,
        control_period: float,
    ):
        """`mass` [kg], `omega` [rad/s], `com_height` [m]."""
        super().__init__()
        self._omega, self._period = omega, control_period
        self._weight, self._stiffness = mass * GRAVITY, mass * omega**2
        self._one_tick = _taylor(control_period)
        schedule = initial.schedule
        start, foot = schedule.start, schedule.feet[schedule.support_side.other]
        self._com = self.DeclareDiscreteState(
            [*start.com, com_height, *start.com_velocity, 0.0]
        )
        self._foot = self.DeclareDiscreteState([*foot.p_WF, foot.yaw])
        self._ecmp = self.DeclareVectorInputPort("ecmp_command", 4)
        self._swing = self.DeclareVectorInputPort("swing_foot_reference", 12)
        self._walking = declare_input(self, "walking_state", initial)
        self._push = self.DeclareVectorInputPort("push_force", 3)
        state_only = {self.discrete_state_ticket(self._com)}
        self.DeclareStateOutputPort("com_state", self._com)
        self.DeclareVectorOutputPort(
            "icp", 2, self._calc_icp, prerequisites_of_calc=state_only
        )
        feet = {self.discrete_state_ticket(self._foot), self._walking.ticket()}
        self.DeclareAbstractOutputPort(
            "foot_poses",
            alloc=lambda: Value(schedule.feet),
            calc=self._calc_foot_poses,
            prerequisites_of_calc=feet,
        )
        self.DeclareVectorOutputPort(
            "foot_forces", 2, self._calc_forces, prerequisites_of_calc=feet
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=control_period, offset_sec=0.0, update=self._step
        )

    def _calc_icp(self, context, output):
        com = context.get_discrete_state(self._com).value()
        output.SetFromVector(icp(com[:2], com[3:5], self._omega))

    def _calc_foot_poses(self, context, output):
        schedule = self._schedule(context)
        feet = schedule.feet
        if schedule.phase is Phase.SWING:
            x, y, z, yaw = self._swing_foot(context)
            ground = min(feet[Side.LEFT].p_WF[2], feet[Side.RIGHT].p_WF[2])
            pose = FootPose(np.array([x, y, max(z, ground)]), yaw)
            feet = feet.with_foot(schedule.support_side.other, pose)
        output.set_value(feet)

    def _calc_forces(self, context, output):
        schedule = self._schedule(context)
        left = right = True
        if schedule.phase is Phase.SWING and not self._landed(context):
            left = schedule.in_contact(Side.LEFT)
            right = not left
        share = self._weight / (left + right)
        output.SetFromVector([share * left, share * right])

    def _landed(self, context) -> bool:
        ground = self._schedule(context).footsteps[0].pose.p_WF[2]
        return self._swing_foot(context)[2] <= ground + 1e-4

    def _schedule(self, context):
        return eval_typed(self, context, self._walking, WalkingState).schedule

    def _swing_foot(self, context) -> list[float]:
        return context.get_discrete_state(self._foot).value().tolist()

    def _step(self, context, state):
        com = context.get_discrete_state(self._com).value().copy()
        push = eval_finite(self, context, self._push)
        ecmp = eval_finite(self, context, self._ecmp)
        swing = eval_finite(self, context, self._swing)
        pivot = ecmp[2:] - push[:2] / self._stiffness
        com[:2], com[3:5] = com_after(
            com[:2], com[3:5], pivot, self._omega, self._period
        )
        state.set_value(self._com, com)
        state.set_value(self._foot, self._one_tick @ swing)
        return EventStatus.Succeeded()


def _taylor(t: float) -> np.ndarray:
    """Turns [p(3), v(3), a(3), yaw, yawdot, yawddot] into [p(3), yaw] after t.

    A matrix (4, 12); the acceleration stays what it is; `t` [s].
    """
    matrix = np.zeros((4, 12))
    powers = np.array([1.0, t, 0.5 * t * t])
    matrix[:3, :9] = np.kron(powers, np.eye(3))
    matrix[3, 9:] = powers
    return matrix
