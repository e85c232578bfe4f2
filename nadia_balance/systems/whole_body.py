"""Joint torques from a momentum rate, and the friction that they count on."""

from collections.abc import Iterable
from typing import Any, cast

import numpy as np
from pydrake.systems.framework import Context

from nadia_balance.core.body.model import JointImpedanceParams, PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.mechanisms import USUAL
from nadia_balance.core.whole_body.command import (
    SOLES,
    WholeBodyCommand,
    WholeBodyTerms,
    whole_body_command,
)
from nadia_balance.core.whole_body.limits import friction_after
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.core.whole_body.tasks import Task
from nadia_balance.robot.kinematics import whole_body_model
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.ports import (
    Block,
    check_period,
    declare_outcome,
    declare_output,
    declare_update,
    input_port,
    optional_input,
)
from nadia_balance.systems.signals import QpStatus, SwingFootReference, size

GIVES_UP_AFTER = 0.05  # uninterrupted time without a solution [s]


class WholeBodyInverseDynamics(Block):
    """Computes joint torques by the whole-body QP once a tick and holds them.

    `friction` is by default that of the parameters; `actuation` [N m] is in the
    order of the plant's actuators; `generalized_acceleration` (nv,) is vdot.
    `joint_command` (5 nu,) are in that order the positions [rad] and speeds
    [rad/s] that vdot leads to in the middle of the tick, the torques [N m], and
    stiffness [N m/rad] and damping [N m s/rad] about that motion.
    `mechanisms`, `icp` and `icp_reference` are for `tasks` alone: by default
    all are on, and there is no error.

    Before the update of a tick the outputs are computed from the inputs; from
    then on to the next tick they are those of the state, independent of the
    inputs.  The discrete state holds the outputs of the last tick, its torques
    in the order of the joints, the number of ticks without a solution in a row,
    and the time of the next tick.  In a tick without a solution the torques
    damp the joints, wrenches and accelerations are 0, and the failure is
    counted.  After GIVES_UP_AFTER without a solution this is permanent, and the
    QP is no longer solved.

    Args:
        params: weights, gains and limits of the QP.
        robot: robot whose joints are driven.
        period: control period [s].
        tasks: tasks that are added to those of the QP (see Task).
        impedance: that of the joint command; None: torques alone.

    .. pydrake_system::

        name: WholeBodyInverseDynamics
        input_ports: [whole_body_terms, momentum_rate, swing_foot_reference,
                      walking_state, friction, mechanisms, icp,
                      icp_reference]
        output_ports: [actuation, joint_command, foot_wrenches,
                       whole_body_qp_status, generalized_acceleration]
    """

    def __init__(
        self,
        params: WholeBodyQpParams,
        robot: RobotModel,
        period: float,
        tasks: Iterable[Task] = (),
        impedance: JointImpedanceParams | None = None,
    ) -> None:
        super().__init__()
        check_period(period)
        plant, tasks = robot.control_plant(), tuple(tasks)
        self._params, self._has_tasks = params, bool(tasks)
        self._model = whole_body_model(robot, plant, params)
        self._qp = WholeBodyQp(params, self._model, period, tasks=tasks)
        self._max_unsolved = round(GIVES_UP_AFTER / period)
        self._driven = actuated_velocities(plant)
        self._positions = self._driven + 1  # the base has a quaternion
        self._joint_of_actuator = self._driven - 6
        inertia = self._model.inertia[self._joint_of_actuator]
        self._kp = inertia * (impedance.stiffness**2 if impedance else 0.0)
        self._kd = inertia * (impedance.damping if impedance else 0.0)
        self._half = 0.5 * period
        # By which the positions of the terms are ahead of the period's middle
        # (see BalanceController).
        self._ahead = robot.drives.lag if robot.drives else -self._half
        self._terms = input_port(self, "whole_body_terms")
        self._momentum_rate = input_port(self, "momentum_rate")
        self._swing = input_port(
            self, "swing_foot_reference", size(SwingFootReference)
        )
        self._walking = input_port(self, "walking_state")
        self._friction = optional_input(
            self, "friction", default=[params.friction]
        )
        self._mechanisms = optional_input(self, "mechanisms", default=USUAL)
        self._icp = optional_input(self, "icp")
        self._icp_reference = optional_input(self, "icp_reference")
        declare_outcome(
            self,
            outputs={
                "actuation": len(self._joint_of_actuator),
                "joint_command": 5 * len(self._joint_of_actuator),
                "foot_wrenches": 12,
                "whole_body_qp_status": size(QpStatus),
                "generalized_acceleration": plant.num_velocities(),
            },
            memory={"torques": self._model.num_joints, "unsolved": 1},
            calc=self._calc_outcome,
            period=period,
            holds=True,
        )

    def _calc_outcome(
        self, context: Context, last: dict[str, Any]
    ) -> tuple[Any, ...]:
        terms, command = self._terms(context), self._command(context)
        unsolved = last["unsolved"][0]
        last_status = QpStatus(last["whole_body_qp_status"])
        has_torques = last_status.solved or unsolved  # not in the first tick
        torques = last["torques"] if has_torques else None
        if unsolved > self._max_unsolved:  # it is given up
            given_up = 0.0, 0.0, 0.0, np.nan, last_status.failures + 1
            return self._damped(terms, given_up, unsolved, torques)
        solution = self._qp.solve(terms, command, torques)
        status = last_status.after(solution.qp)
        if not solution.qp.solved:
            return self._damped(terms, status, unsolved, torques)
        torques = solution.torques[self._joint_of_actuator]
        return (
            torques,
            self._joint_command(terms, solution.vdot, torques),
            solution.wrenches,
            status,
            solution.vdot,
            solution.torques,
            [0],
        )

    def _damped(
        self,
        terms: WholeBodyTerms,
        status: tuple[float, ...],
        unsolved: float,
        last_torques: Array | None,
    ) -> tuple[Any, ...]:
        """The outcome of a tick without a solution, after `unsolved` others."""
        torques = self._qp.damping_torques(terms, last_torques)
        damping = torques[self._joint_of_actuator]
        return (
            damping,
            self._damping_command(terms, damping),
            np.zeros(12),
            status,
            np.zeros(terms.v.size),
            torques,
            [unsolved + 1],
        )

    def _command(self, context: Context) -> WholeBodyCommand:
        """What the QP shall do; its last fields are for tasks of the user's."""
        command = whole_body_command(
            self._walking(context),
            momentum_rate=self._momentum_rate(context),
            swing=self._swing(context),
            friction=float(self._friction(context)[0]),
            params=self._params,
            model=self._model,
        )
        if self._has_tasks:
            command = command._replace(
                mechanisms=self._mechanisms(context),
                icp_error=self._icp_error(context),
            )
        return command

    def _joint_command(
        self, terms: WholeBodyTerms, vdot: Array, torques: Array
    ) -> Array:
        """The joint command (5 nu,) of a solution, whose `torques` are (nu,).

        The positions of the terms are those when the torques act, too late by
        the lag of the drives for the motion itself.  What vdot adds to them in
        half a period is nothing beside that: 0.2 mrad at 100 rad/s^2.
        """
        v = terms.v[self._driven]
        q = terms.q[self._positions] - self._ahead * v
        ahead = v + self._half * vdot[self._driven]
        return np.concatenate((q, ahead, torques, self._kp, self._kd))

    def _damping_command(self, terms: WholeBodyTerms, torques: Array) -> Array:
        """That of a tick without a solution: joints at rest, where they are."""
        none = np.zeros(torques.size)
        q = terms.q[self._positions]
        return np.concatenate((q, none, torques, none, self._kd))

    def _icp_error(self, context: Context) -> Array:
        icp, reference = self._icp(context), self._icp_reference(context)
        if icp is None or reference is None:
            return np.zeros(2)
        return np.asarray(icp - reference.icp)


class FrictionEstimator(Block):
    """Lowers the friction coefficient when a loaded sole slips.

    `foot_wrenches` are the commanded ones of this tick; `friction` is one tick
    late.  The discrete state is [friction; time [s] under load of each sole].

    Args:
        params: its friction is the initial and the largest estimate.
        model: point mass of the robot.
        period: control period [s].

    .. pydrake_system::

        name: FrictionEstimator
        input_ports: [whole_body_terms, foot_wrenches]
        output_ports: [friction]
    """

    def __init__(
        self, params: WholeBodyQpParams, model: PointMassModel, period: float
    ) -> None:
        super().__init__()
        self._params, self._period = params, period
        self._weight = model.mass * GRAVITY
        self._terms = input_port(self, "whole_body_terms")
        self._wrenches = input_port(self, "foot_wrenches")
        self.DeclareDiscreteState(cast(Any, [params.friction, 0.0, 0.0]))
        declare_output(
            self,
            "friction",
            lambda context: context.get_discrete_state_vector().value()[:1],
            needs=[self.all_state_ticket()],
        )
        declare_update(self, period, self._update)

    def _update(self, context: Context, new: Any) -> None:
        terms = self._terms(context)
        wrenches = self._wrenches(context).reshape(2, 6)
        # Force per weight and velocity of each sole, from W to its own frame.
        motion = np.empty((2, 2, 3))
        motion[:, 0] = wrenches[:, 3:] / self._weight
        motion[:, 1] = terms.velocities[: SOLES[1].stop].reshape(2, 6)[:, 3:]
        motion = motion @ terms.rotations[:2]
        new.get_mutable_discrete_state(0).set_value(
            friction_after(
                context.get_discrete_state_vector().value().tolist(),
                forces=motion[:, 0],
                velocities=motion[:, 1],
                params=self._params,
                period=self._period,
            )
        )
