"""Joint torques that move the whole body as the capture point demands."""

import functools

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem, ValueProducer

from nadia_balance.core.lipm import GRAVITY
from nadia_balance.core.walking import WalkingState
from nadia_balance.core.whole_body_command import whole_body_command
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.robot import RobotModel
from nadia_balance.systems.ports import declare_input, eval_finite, eval_typed
from nadia_balance.systems.whole_body_kinematics import (
    WholeBodyKinematics,
    whole_body_model,
)


class WholeBodyInverseDynamics(LeafSystem):
    """Solves the whole-body QP once a tick.

    `estimated_state` is [q, v] of the robot's `control_plant`;
    `momentum_rate` [N] is that of the linear momentum, in W;
    `swing_foot_reference` is [p, v, a, yaw, yawdot, yawddot] of the swing
    sole in W.  `actuation` [N m] is in the order of the plant's actuators;
    `foot_wrenches` are [tau, f] [N m, N] of the left and the right sole, at
    its centre, in W; `qp_status` is [solved, fallback, iterations, violation,
    failures so far].

    If the QP has no solution, torques and wrenches of the last tick are held
    and the failure is counted.  The discrete state holds what came of the
    last tick: the outputs, and the active rows that warm-start the next one.

    Evaluating any output raises RuntimeError if an input is not finite.

    .. pydrake_system::

        name: WholeBodyInverseDynamics
        input_ports: [estimated_state, momentum_rate, swing_foot_reference,
                      walking_state]
        output_ports: [actuation, foot_wrenches, qp_status]
    """

    def __init__(
        self,
        robot: RobotModel,
        params: WholeBodyQpParams,
        control_period: float,
    ):
        """Solves every `control_period` [s]; one private plant of `robot`."""
        super().__init__()
        plant = robot.control_plant()
        model = whole_body_model(robot, plant, params.joint_lower_limits)
        self._params, self._weight = params, model.mass * GRAVITY
        self._kinematics = WholeBodyKinematics(robot, plant)
        self._qp = WholeBodyQp(params, model)
        self._joint_of_actuator = np.array(
            [
                plant.get_joint_actuator(i).joint().velocity_start() - 6
                for i in plant.GetJointActuatorIndices()
            ]
        )
        self._declare_inputs(plant)
        self._declare_state(plant.num_actuators(), control_period)
        self._declare_caches(plant)
        self._declare_outputs()

    def _declare_inputs(self, plant):
        self._estimated_state = self.DeclareVectorInputPort(
            "estimated_state", plant.num_multibody_states()
        )
        self._momentum_rate = self.DeclareVectorInputPort("momentum_rate", 3)
        self._swing = self.DeclareVectorInputPort("swing_foot_reference", 12)
        self._walking_state = declare_input(self, "walking_state", object())

    def _declare_state(self, num_actuators, control_period):
        # Parts of an outcome, which is what one tick comes to.
        ends = np.cumsum([num_actuators, 12, 5, self._qp.num_inequalities])
        self._actuation = slice(0, ends[0])
        self._wrenches = slice(ends[0], ends[1])
        self._status = slice(ends[1], ends[2])
        self._active = slice(ends[2], ends[3])
        self._last = self.DeclareDiscreteState(ends[3])
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=control_period, offset_sec=0.0, update=self._remember
        )

    def _declare_caches(self, plant):
        self._plant_context = self.DeclareCacheEntry(
            "plant context",
            ValueProducer(
                allocate=lambda: Value(plant.CreateDefaultContext()),
                calc=self._set_state,
            ),
            prerequisites_of_calc={self._estimated_state.ticket()},
        )
        self._outcome = self.DeclareCacheEntry(
            "outcome",
            ValueProducer(
                allocate=lambda: Value(object()), calc=self._calc_outcome
            ),
            prerequisites_of_calc={
                self._plant_context.ticket(),
                self._momentum_rate.ticket(),
                self._swing.ticket(),
                self._walking_state.ticket(),
                self.xd_ticket(),
            },
        )

    def _declare_outputs(self):
        for name, part in (
            ("actuation", self._actuation),
            ("foot_wrenches", self._wrenches),
            ("qp_status", self._status),
        ):
            self.DeclareVectorOutputPort(
                name,
                part.stop - part.start,
                functools.partial(self._write, part),
                prerequisites_of_calc={self._outcome.ticket()},
            )

    def _write(self, part, context, output):
        output.set_value(self._outcome.Eval(context)[part])

    def _set_state(self, context, cache):
        self._kinematics.plant.SetPositionsAndVelocities(
            cache.get_mutable_value(),
            eval_finite(self, context, self._estimated_state),
        )

    def _calc_outcome(self, context, cache):
        command = whole_body_command(
            self._params,
            eval_typed(self, context, self._walking_state, WalkingState),
            eval_finite(self, context, self._momentum_rate),
            eval_finite(self, context, self._swing),
            self._weight,
        )
        terms = self._kinematics.calc(self._plant_context.Eval(context))
        last = context.get_discrete_state(self._last).value()
        guess = last[self._active].astype(np.int8)
        found = self._qp.solve(terms, command, guess)
        cache.set_value(self._judge(found, last))

    def _judge(self, found, last):
        """Turns a solution into an outcome, or holds what was `last`."""
        qp, failures = found.qp, last[self._status][-1]
        actuation = found.torques[self._joint_of_actuator]
        wrenches = found.wrenches
        if not qp.solved:
            failures += 1.0
            actuation, wrenches = last[self._actuation], last[self._wrenches]
        status = qp.solved, qp.fallback, qp.iterations, qp.violation, failures
        return np.concatenate((actuation, wrenches, status, qp.active))

    def _remember(self, context, state):
        state.set_value(self._last, self._outcome.Eval(context))
        return EventStatus.Succeeded()
