"""The plant of the LIPM diagram: a point mass on two massless legs."""

import numpy as np
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.lipm import GRAVITY, com_after, icp
from nadia_balance.core.walking import vocabulary as walking
from nadia_balance.systems.ports import declare_output, inputs
from nadia_balance.systems.signals import ComState, SwingFootReference


class PointMassPlant(LeafSystem):
    """Integrates the linear inverted pendulum under the commanded eCMP.

    The swing foot follows its reference exactly, with constant acceleration
    within a tick.  A foot carries weight if it is in contact by the plan, or if
    it is the swing foot and has come down to the ground.

    Discrete states: [p_WC(3), v_WC(3)], exact between ticks for a constant eCMP
    and push, and [p(3), yaw] of the swing foot.

    .. pydrake_system::

        name: PointMassPlant
        input_ports: [ecmp_command, swing_foot_reference, walking_state,
                      push_force]
        output_ports: [com_state, icp, foot_poses, foot_forces]
    """

    def __init__(
        self,
        model: PointMassModel,
        period: float,
        initial: walking.WalkingState,
    ):
        """Integrates `model` from `initial` on, one tick per `period` [s]."""
        super().__init__()
        self._omega, self._period = model.omega, period
        self._weight = model.mass * GRAVITY
        self._stiffness = model.mass * model.omega**2
        schedule = initial.schedule
        start, foot = schedule.start, schedule.feet[schedule.support_side.other]
        self._com = self.DeclareDiscreteState(
            [*start.com, model.com_height, *start.com_velocity, 0.0]
        )
        self._foot = self.DeclareDiscreteState([*foot.p_WF, foot.yaw])
        self._ecmp, self._swing, self._walking, self._push = inputs(
            self, "ecmp_command swing_foot_reference walking_state push_force"
        )
        self.DeclareStateOutputPort("com_state", self._com)
        com = [self.discrete_state_ticket(self._com)]
        declare_output(self, "icp", self._calc_icp, com)
        feet = [self.discrete_state_ticket(self._foot), self._walking]
        declare_output(self, "foot_poses", self._calc_foot_poses, feet)
        declare_output(self, "foot_forces", self._calc_forces, feet)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._step)

    def _calc_icp(self, context) -> np.ndarray:
        com = ComState(context.get_discrete_state(self._com).value())
        return icp(com.position[:2], com.velocity[:2], self._omega)

    def _calc_foot_poses(self, context) -> walking.FootPoses:
        schedule = self._schedule(context)
        feet = schedule.feet
        if schedule.phase is not walking.Phase.SWING:
            return feet
        x, y, z, yaw = self._swing_foot(context)
        ground = min(feet.left.p_WF[2], feet.right.p_WF[2])
        pose = walking.FootPose(np.array([x, y, max(z, ground)]), yaw)
        return feet.with_foot(schedule.support_side.other, pose)

    def _calc_forces(self, context) -> tuple[float, float]:
        schedule = self._schedule(context)
        left = right = True
        if schedule.phase is walking.Phase.SWING and not self._landed(context):
            left = schedule.in_contact(walking.Side.LEFT)
            right = not left
        share = self._weight / (left + right)
        return share * left, share * right

    def _landed(self, context) -> bool:
        ground = self._schedule(context).footsteps[0].pose.p_WF[2]
        return self._swing_foot(context)[2] <= ground + 1e-4

    def _schedule(self, context):
        return self._walking(context).schedule

    def _swing_foot(self, context) -> list[float]:
        return context.get_discrete_state(self._foot).value().tolist()

    def _step(self, context, state):
        com = ComState(context.get_discrete_state(self._com).value().copy())
        pivot = self._ecmp(context).ecmp
        pivot = pivot - self._push(context)[:2] / self._stiffness
        com.position[:2], com.velocity[:2] = com_after(
            com.position[:2], com.velocity[:2], pivot, self._omega, self._period
        )
        state.get_mutable_discrete_state(self._com).set_value(com[:])
        state.get_mutable_discrete_state(self._foot).set_value(
            self._foot_after(self._swing(context))
        )
        return EventStatus.Succeeded()

    def _foot_after(self, now: SwingFootReference) -> np.ndarray:
        """[p(3), yaw] a period later, with constant accelerations."""
        t, t2 = self._period, 0.5 * self._period**2
        p = now.position + t * now.velocity + t2 * now.acceleration
        yaw = now.yaw + t * now.yaw_rate + t2 * now.yaw_acceleration
        return np.append(p, yaw)
