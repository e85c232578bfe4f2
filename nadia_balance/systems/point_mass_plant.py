"""The plant of the LIPM diagram: a point mass on two massless legs."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.lipm import com_after, icp
from nadia_balance.core.walking import (
    FootPose,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems.ports import declare_input, eval_typed


class PointMassPlant(LeafSystem):
    """Moves as the linear inverted pendulum under the commanded eCMP.

    Feet go exactly where they are told.  A foot carries weight when it is in
    contact by the plan, or when the swing foot's reference has come down to
    the ground.  Discrete state: [p_WC(3), v_WC(3)], exact between ticks for
    a constant eCMP and push.

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
        self._mass, self._omega = mass, omega
        self._period = control_period
        start = initial.schedule.start
        self._com = self.DeclareDiscreteState(
            [*start.com, com_height, *start.com_velocity, 0.0]
        )
        self._ecmp = self.DeclareVectorInputPort("ecmp_command", 4)
        self._swing = self.DeclareVectorInputPort("swing_foot_reference", 12)
        self._walking = declare_input(self, "walking_state", initial)
        self._push = self.DeclareVectorInputPort("push_force", 3)
        state_only = {self.discrete_state_ticket(self._com)}
        self.DeclareStateOutputPort("com_state", self._com)
        self.DeclareVectorOutputPort(
            "icp", 2, self._calc_icp, prerequisites_of_calc=state_only
        )
        feet = {self._swing.ticket(), self._walking.ticket()}
        self.DeclareAbstractOutputPort(
            "foot_poses",
            alloc=lambda: Value(initial.schedule.feet),
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
            p, yaw = self._swing.Eval(context)[:3], self._swing.Eval(context)[9]
            side = schedule.support_side.other
            ground = min(feet[Side.LEFT].p_WF[2], feet[Side.RIGHT].p_WF[2])
            p = np.array([p[0], p[1], max(p[2], ground)])
            feet = feet.with_foot(side, FootPose(p, yaw))
        output.set_value(feet)

    def _calc_forces(self, context, output):
        schedule = self._schedule(context)
        loaded = [schedule.in_contact(side) for side in Side]
        if schedule.phase is Phase.SWING and schedule.footsteps:
            ground = schedule.footsteps[0].pose.p_WF[2]
            landed = self._swing.Eval(context)[2] <= ground + 1e-4
            loaded = [carries or landed for carries in loaded]
        weight = self._mass * 9.81
        output.SetFromVector(weight * np.array(loaded) / sum(loaded))

    def _schedule(self, context):
        return eval_typed(self, context, self._walking, WalkingState).schedule

    def _step(self, context, state):
        com = context.get_discrete_state(self._com).value().copy()
        omega = self._omega
        force = self._push.Eval(context)[:2] / (self._mass * omega**2)
        pivot = self._ecmp.Eval(context)[2:] - force
        com[:2], com[3:5] = com_after(
            com[:2], com[3:5], pivot, omega, self._period
        )
        state.set_value(self._com, com)
        return EventStatus.Succeeded()
