"""Joint torques from a momentum rate, and the friction that they count on."""

from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.whole_body import limits
from nadia_balance.core.whole_body.command import SOLES, whole_body_command
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.core.whole_body.tasks import Task
from nadia_balance.robot.kinematics import whole_body_model
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.ports import Input, Outcome, declare_output, inputs
from nadia_balance.systems.signals import QpStatus, sizes

GIVES_UP_AFTER = 0.05  # uninterrupted time without a solution [s]


class WholeBodyInverseDynamics(LeafSystem):
    """Computes joint torques by the whole-body QP once a tick and holds them.

    `friction` is by default that of the parameters; `actuation` [N m] is in the
    order of the plant's actuators; `generalized_acceleration` (nv,) is vdot.

    Before the update of a tick the outputs are computed from the inputs; from
    then on to the next tick they are those of the state, independent of the
    inputs.  The discrete state holds the outputs of the last tick, its torques
    in the order of the joints, the number of ticks without a solution in a row,
    and the time of the next tick.  In a tick without a solution the torques
    damp the joints, wrenches and accelerations are 0, and the failure is
    counted.  After GIVES_UP_AFTER without a solution this is permanent, and the
    QP is no longer solved.

    .. pydrake_system::

        name: WholeBodyInverseDynamics
        input_ports: [whole_body_terms, momentum_rate, swing_foot_reference,
                      walking_state, friction]
        output_ports: [actuation, foot_wrenches, whole_body_qp_status,
                       generalized_acceleration]
    """

    def __init__(
        self,
        params: WholeBodyQpParams,
        robot: RobotModel,
        period: float,
        tasks: Iterable[Task] = (),
    ):
        """Solves every `period` [s], for this `robot`.

        `tasks` are added to those of the QP (see Task).
        """
        super().__init__()
        plant = robot.control_plant()
        model = whole_body_model(robot, plant, params)
        self._params, self._model = params, model
        self._qp = WholeBodyQp(params, model, period, tasks)
        self._max_unsolved = round(GIVES_UP_AFTER / period)
        self._joint_of_actuator = actuated_velocities(plant) - 6
        names = "whole_body_terms momentum_rate swing_foot_reference"
        self._terms, self._momentum_rate, self._swing, self._walking_state = (
            inputs(self, names, "walking_state")
        )
        self._friction = Input(self, "friction", 1, [params.friction])
        Outcome(
            self,
            {
                "actuation": len(self._joint_of_actuator),
                **sizes("foot_wrenches whole_body_qp_status"),
                "generalized_acceleration": plant.num_velocities(),
            },
            {"torques": model.num_joints, "unsolved": 1},
            self._calc_outcome,
            period,
            holds=True,
        )

    def _calc_outcome(self, context, last) -> tuple:
        terms = self._terms(context)
        rate, swing = self._momentum_rate(context), self._swing(context)[:]
        wishes = rate, swing, float(self._friction(context)[0])
        command = whole_body_command(
            self._walking_state(context), *wishes, self._params, self._model
        )
        (unsolved,) = last["unsolved"]
        status, torques = QpStatus(last["whole_body_qp_status"]), None
        if status.solved or unsolved:  # false before the first tick only
            torques = last["torques"]
        if unsolved > self._max_unsolved:
            status = 0.0, 0.0, 0.0, np.nan, status.failures + 1
        else:
            found = self._qp.solve(terms, command, torques)
            status = status.after(found.qp)
        if status[0]:
            torques, wrenches, vdot = found.torques, found.wrenches, found.vdot
            unsolved = 0
        else:
            torques = self._qp.damping_torques(terms, torques)
            wrenches, vdot = np.zeros(12), np.zeros(terms.v.size)
            unsolved += 1
        actuation = torques[self._joint_of_actuator]
        return actuation, wrenches, status, vdot, torques, [unsolved]


class FrictionEstimator(LeafSystem):
    """Lowers the friction coefficient when a loaded sole slips.

    `foot_wrenches` are the commanded ones of this tick; `friction` is one tick
    late.  The discrete state is [friction; time [s] under load of each sole].

    .. pydrake_system::

        name: FrictionEstimator
        input_ports: [whole_body_terms, foot_wrenches]
        output_ports: [friction]
    """

    def __init__(
        self, params: WholeBodyQpParams, model: PointMassModel, period: float
    ):
        """Updates every `period` [s], for a robot of the mass of `model`.

        The friction of `params` is the initial and the largest estimate.
        """
        super().__init__()
        self._params, self._period = params, period
        self._weight = model.mass * GRAVITY
        names = "whole_body_terms foot_wrenches"
        self._terms, self._wrenches = inputs(self, names)
        self.DeclareDiscreteState([params.friction, 0.0, 0.0])
        declare_output(
            self,
            "friction",
            lambda context: context.get_discrete_state_vector().value()[:1],
            [self.all_state_ticket()],
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context, new):
        last = context.get_discrete_state_vector().value()
        terms, wrenches = self._terms(context), self._wrenches(context)
        # Force per weight and velocity of each sole, from W to its own frame.
        motion = np.empty((2, 2, 3))
        motion[:, 0] = wrenches.reshape(2, 6)[:, 3:] / self._weight
        motion[:, 1] = terms.velocities[: SOLES[1].stop].reshape(2, 6)[:, 3:]
        motion = motion @ terms.rotations[:2]
        estimate = limits.friction_after(
            last.tolist(), *motion.swapaxes(0, 1), self._params, self._period
        )
        new.get_mutable_discrete_state(0).set_value(estimate)
        return EventStatus.Succeeded()
