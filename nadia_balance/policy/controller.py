"""A learned walking policy, in the place of the BalanceController."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.systems.framework import BasicVector, Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side
from nadia_balance.policy.contract import read_contract
from nadia_balance.policy.network import Network
from nadia_balance.policy.observation import Measured, Observation
from nadia_balance.policy.params import PolicyParams
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuators
from nadia_balance.systems.ports import Block, input_port, optional_input

_STILL = 0.01  # slower commands are to stand [m/s], [rad/s]
_FIRST = {Side.LEFT: 0.0, Side.RIGHT: math.pi}  # phases at the start [rad]


class PolicyController(Block):
    """Computes joint torques by a policy, an ONNX network from o to a.

    It wants joint targets; the torques hold them like springs, clipped at the
    actuators' effort limits [N m]:

        q_d = q_a + s a,    tau = K_p (q_d - q) - K_d v

    The network gives a new action a (n,) every `period` (50 Hz), the torques
    follow the state at all times.  The order of its joints, K_p, K_d, q_a, s
    and the terms of the observation o are its contract, PolicyParams.  Terms:

    =================  ====  ===============================================
    name               size  what, before its scale
    =================  ====  ===============================================
    base_lin_vel       3     velocity of the pelvis, in its frame [m/s]
    base_ang_vel       3     its angular velocity, in its frame [rad/s]
    projected_gravity  3     direction of gravity, in the pelvis' frame
    velocity_commands  3     commanded velocity: forward, left [m/s], and yaw
                             rate [rad/s]
    command_lin_vel    2     the first two of these
    command_ang_vel    1     the last one
    joint_pos_rel      n     q - q_0 [rad]
    joint_vel_rel      n     joint speeds v [rad/s]
    last_action        n     a, at first 0
    gait_phase         2     sin and cos of a clock, 2 pi in each `stride`
    sin_phase          2     of the phases of the left and the right foot
    cos_phase          2     of the same
    =================  ====  ===============================================

    The phases of the feet are 0 and pi at the start; each tick adds 2 pi
    `period` / `stride` first.  At 0 a foot is to be highest, at pi on the
    ground; both stay at pi while the command is to stand.  The clock neither
    knows nor follows where the feet are.

    `estimated_state` is [q, v] of the robot, `velocity_command` (3,) forward,
    left [m/s] and yaw rate [rad/s], 0 if not connected, clipped at the
    contract's limits; `actuation` (n,) [N m] in the order of its actuators.
    The discrete state is a (n,), the phases (2,), and the terms of the ticks
    before.

    Args:
        robot: robot that walks.
        onnx: file of the policy.
        contract: files and fields of it, above what is in the ONNX file and
            beside it (see contract.read_contract).

    Raises:
        ValueError: the file is no such policy, or one of another robot, or
            onnxruntime is missing: one line that names what differs.

    .. pydrake_system::

        name: PolicyController
        input_ports: [estimated_state, velocity_command]
        output_ports: [actuation]
    """

    def __init__(
        self, robot: RobotModel, onnx: str | Path, contract: Sequence[str] = ()
    ) -> None:
        super().__init__()
        self.file = Path(onnx).name
        self._network = Network(onnx)
        plant = robot.control_plant()
        joints = [drive.joint() for drive in actuators(plant)]
        names = [joint.name() for joint in joints]
        self.contract = read_contract(self._network, names, contract)
        self.params = params = self.contract.params
        n = len(params.joints)
        self._layout = Observation(params.observation, n, params.by_tick)
        self._network.check_sizes(self._layout.size, n)
        # In the order of the policy.
        places = [names.index(joint) for joint in params.joints]
        nq = plant.num_positions()
        self._q = np.array([joints[i].position_start() for i in places])
        self._v = nq + np.array([joints[i].velocity_start() for i in places])
        self._base = nq  # where the speeds of the floating base begin, in W
        self._q0 = _by_joint(params, params.default_angles)
        self._offset = _by_joint(
            params,
            params.default_angles
            if params.action_offset is None
            else params.action_offset,
        )
        self._kp, self._kd = (
            np.array(params.stiffness),
            np.array(params.damping),
        )
        self._scale = np.array(params.action_scale)
        self._targets = np.array(params.target_limits or [[-np.inf, np.inf]]).T
        # Least and most of a velocity command (2, 3); None: it takes any.
        limits = params.command_limits
        self.velocity_limits = np.array(limits).T if limits else None
        self._limits: Any = plant.GetEffortUpperLimits()[places]
        self._actuators = np.argsort(places)  # from the policy's order
        self._state = input_port(
            self, "estimated_state", plant.num_multibody_states()
        )
        self._command = optional_input(
            self, "velocity_command", default=np.zeros(3)
        )
        self._action = self._declare(np.zeros(n))
        self._phases = self._declare(np.array([*_FIRST.values()]))
        self._past = self._declare(np.full(self._layout.past_size, np.nan))
        self.DeclareVectorOutputPort(
            "actuation",
            n,
            self._calc_torques,
            {self._state.ticket(), self.discrete_state_ticket(self._action)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            params.period, 0.0, self._update
        )

    def _declare(self, start: Array) -> Any:
        """A discrete state that is `start` at time 0; its index."""
        return self.DeclareDiscreteState(cast(Any, start))

    def observe(self, context: Context) -> Array:
        """The observation of a tick.

        Args:
            context: that of this system.

        Returns:
            The observation (m,), see PolicyController.
        """
        return self._layout.vector(self._ticks(context))

    def _ticks(self, context: Context) -> list[Array]:
        """The terms of this tick and those before."""
        state = self._state(context)
        unit = state[:4] / np.linalg.norm(state[:4])
        R_BW: Any = RotationMatrix(Quaternion(unit)).inverse()
        params, base = self.params, self._base
        now = Measured(
            velocity=R_BW @ state[base + 3 : base + 6],
            spin=R_BW @ state[base : base + 3],
            gravity=R_BW @ [0.0, 0.0, -1.0],
            command=self._commanded(context),
            angles=state[self._q] - self._q0,
            speeds=state[self._v],
            action=_value(context, self._action),
            phases=self._advanced(context),
            clock=2.0
            * math.pi
            * (context.get_time() + params.period)
            / params.stride,
        )
        return self._layout.ticks(now, _value(context, self._past))

    def _commanded(self, context: Context) -> Array:
        command = np.asarray(self._command(context))
        if self.velocity_limits is None:
            return command
        return command.clip(*self.velocity_limits)

    def _advanced(self, context: Context) -> Array:
        """The phases (2,) of the next tick."""
        forward, left, yaw_rate = self._commanded(context)
        if max(math.hypot(forward, left), abs(yaw_rate)) < _STILL:
            return np.full(2, math.pi)
        phases = _value(context, self._phases)
        if np.array_equal(phases, np.full(2, math.pi)):  # it stood
            phases = np.array([*_FIRST.values()])
        return np.asarray(
            phases + 2.0 * math.pi * self.params.period / self.params.stride
        )

    def _update(self, context: Context, state: Any) -> None:
        ticks = self._ticks(context)
        limit = self.params.action_limit
        action = self._network(self._layout.vector(ticks)).clip(-limit, limit)
        for index, value in (
            (self._action, action),
            (self._phases, self._advanced(context)),
            (self._past, self._layout.past(ticks)),
        ):
            state.get_mutable_discrete_state(index).set_value(value)

    def _calc_torques(self, context: Context, output: BasicVector) -> None:
        state = self._state(context)
        target = self._offset + self._scale * _value(context, self._action)
        target = target.clip(*self._targets)
        torques = (
            self._kp * (target - state[self._q]) - self._kd * state[self._v]
        )
        output.SetFromVector(
            torques.clip(-self._limits, self._limits)[self._actuators]
        )


def _value(context: Context, state: Any) -> Array:
    """A copy of a discrete state, by its index."""
    values: Any = context.get_discrete_state(state).value()
    return np.array(values)


def _by_joint(params: PolicyParams, angles: dict[str, float]) -> Array:
    """Angles (n,) in the order of the policy; 0 if they are not named."""
    return np.array([angles.get(joint, 0.0) for joint in params.joints])
