"""A learned walking policy, in the place of the BalanceController."""

import json
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.systems.framework import BasicVector, Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side
from nadia_balance.parameters.bounds import bounded, check, parameters, require
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuators
from nadia_balance.systems.ports import Block, input_port, optional_input

_METADATA = "dof_names", "kp", "kd"
_STILL = 0.01  # slower commands are to stand [m/s], [rad/s]
_FIRST = {Side.LEFT: 0.0, Side.RIGHT: math.pi}  # phases at the start [rad]


def _g1_pose() -> dict[str, float]:
    """Default angles [rad] of holosoma's policies for the G1."""
    pose: dict[str, float] = {}
    for side in Side:
        pose |= {
            f"{side.value}_hip_pitch_joint": -0.312,
            f"{side.value}_knee_joint": 0.669,
            f"{side.value}_ankle_pitch_joint": -0.363,
            f"{side.value}_shoulder_pitch_joint": 0.2,
            f"{side.value}_shoulder_roll_joint": 0.2 * side.sign,
            f"{side.value}_elbow_joint": 0.6,
        }
    return pose


@parameters
class PolicyParams:
    """What a policy was trained with, and its ONNX file does not say.

    By default, that of holosoma's walking policies for the G1.
    """

    default_angles: dict[str, float] = bounded(
        _g1_pose, doc="q_0 by joint, in rad; of joints that are not named 0"
    )
    action_scale: float = bounded(0.25, above=0.0, doc="s, in rad")
    action_limit: float = bounded(
        100.0, above=0.0, doc="largest entry of an action"
    )
    gyro_scale: float = bounded(
        0.25,
        above=0.0,
        doc="of the angular velocity in an observation, in s/rad",
    )
    speed_scale: float = bounded(
        0.05, above=0.0, doc="of the joint speeds in an observation, in s/rad"
    )
    period: float = bounded(
        0.02, above=0.0, unit="s", doc="time from action to action"
    )
    stride: float = bounded(
        1.0, above=0.0, unit="s", doc="duration of two steps"
    )


class PolicyController(Block):
    """Computes joint torques by a policy, an ONNX network from o to a.

    It wants joint targets; the torques hold them like springs, clipped at the
    actuators' effort limits [N m]:

        q_d = q_0 + s a,    tau = K_p (q_d - q) - K_d v

    The network gives a new action a (n,) every `period` (50 Hz), the torques
    follow the state at all times.  Joint order, K_p [N m/rad] and K_d
    [N m s/rad] are the file's metadata `dof_names`, `kp` and `kd`; q_0, s and
    all numbers below are PolicyParams.  The observation o (3 n + 13,) has, as
    in training, the parts in the alphabetical order of their names:

    =============  =====  ===================================  ==============
    from           size   what                                 unit, scale
    =============  =====  ===================================  ==============
    0              n      last action a, at first 0            -
    n              3      angular velocity of the pelvis, in   rad/s x 0.25
                          its frame
    n + 3          1      commanded yaw rate                   rad/s
    n + 4          2      commanded velocity, forward, left    m/s
    n + 6          2      cos of the phases                    -
    n + 8          n      q - q_0                              rad
    2 n + 8        n      joint speeds v                       rad/s x 0.05
    3 n + 8        3      direction of gravity, in the         -
                          pelvis' frame
    3 n + 11       2      sin of the phases                    -
    =============  =====  ===================================  ==============

    The clock is two phases, of the left and the right foot, from 0 and pi at
    the start on: each tick adds 2 pi `period` / `stride` first.  At 0 a foot is
    to be highest, at pi on the ground; both stay at pi while the command is to
    stand.  The clock neither knows nor follows where the feet are.

    `estimated_state` is [q, v] of the robot, `velocity_command` (3,) forward,
    left [m/s] and yaw rate [rad/s], 0 if not connected, `actuation` (n,) [N m]
    in the order of its actuators.  The discrete state is [a, phases] (n + 2,).

    Args:
        robot: robot that walks.
        onnx: file of the policy.
        params: what the policy was trained with, by default PolicyParams().

    Raises:
        ValueError: the file is no such policy, or one of another robot, or
            onnxruntime is missing: one line that names what differs.

    .. pydrake_system::

        name: PolicyController
        input_ports: [estimated_state, velocity_command]
        output_ports: [actuation]
    """

    def __init__(
        self,
        robot: RobotModel,
        onnx: str | Path,
        params: PolicyParams | None = None,
    ) -> None:
        super().__init__()
        self.params = params = params or PolicyParams()
        check(params)
        name = f"controller = {str(onnx)!r}"
        self.file = Path(onnx).name
        self._network = _session(Path(onnx), name)
        self.joints, self._kp, self._kd = _metadata(self._network, name)
        self._port = _checked_port(self._network, len(self.joints), name)
        plant = robot.control_plant()
        joints = [drive.joint() for drive in actuators(plant)]
        names = [joint.name() for joint in joints]
        _check_names(
            self.joints,
            names,
            message=f"{name}: must be of the joints of {robot.name}",
        )
        for joint in {*params.default_angles} - {*names}:
            raise ValueError(
                f"default_angles.{joint}: must be a joint of {robot.name}"
            )
        # In the order of the policy.
        places = [names.index(joint) for joint in self.joints]
        nq = plant.num_positions()
        self._q = np.array([joints[i].position_start() for i in places])
        self._v = nq + np.array([joints[i].velocity_start() for i in places])
        self._spin = slice(nq, nq + 3)  # of the floating base, in W
        self._q0 = np.array(
            [params.default_angles.get(joint, 0.0) for joint in self.joints]
        )
        self._limits: Any = plant.GetEffortUpperLimits()[places]
        self._actuators = np.argsort(places)  # from the policy's order
        self._state = input_port(
            self, "estimated_state", plant.num_multibody_states()
        )
        self._command = optional_input(
            self, "velocity_command", default=np.zeros(3)
        )
        self._memory: Any = self.DeclareDiscreteState(
            cast(Any, [*np.zeros(len(names)), *_FIRST.values()])
        )
        self.DeclareVectorOutputPort(
            "actuation",
            len(names),
            self._calc_torques,
            {self._state.ticket(), self.discrete_state_ticket(self._memory)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            params.period, 0.0, self._update
        )

    def observe(self, context: Context) -> Array:
        """The observation of a tick.

        Args:
            context: that of this system.

        Returns:
            The observation (3 n + 13,), see PolicyController.
        """
        state = self._state(context)
        phases = self._advanced(context)
        unit = state[:4] / np.linalg.norm(state[:4])
        R_BW: Any = RotationMatrix(Quaternion(unit)).inverse()
        forward, left, yaw_rate = self._command(context)
        return np.concatenate(
            [
                context.get_discrete_state(self._memory).value()[:-2],
                self.params.gyro_scale * (R_BW @ state[self._spin]),
                [yaw_rate],
                [forward, left],
                np.cos(phases),
                state[self._q] - self._q0,
                self.params.speed_scale * state[self._v],
                R_BW @ [0.0, 0.0, -1.0],
                np.sin(phases),
            ]
        )

    def _advanced(self, context: Context) -> Array:
        """The phases (2,) of the next tick."""
        forward, left, yaw_rate = self._command(context)
        if max(math.hypot(forward, left), abs(yaw_rate)) < _STILL:
            return np.full(2, math.pi)
        phases: Any = context.get_discrete_state(self._memory).value()[-2:]
        if np.array_equal(phases, np.full(2, math.pi)):  # it stood
            phases = np.array([*_FIRST.values()])
        return np.asarray(
            phases + 2.0 * math.pi * self.params.period / self.params.stride
        )

    def _update(self, context: Context, state: Any) -> None:
        observation = self.observe(context).astype(np.float32)
        action = self._network.run(None, {self._port: observation[None]})[0][0]
        limit = self.params.action_limit
        state.get_mutable_discrete_state(self._memory).set_value(
            [*np.clip(action, -limit, limit), *self._advanced(context)]
        )

    def _calc_torques(self, context: Context, output: BasicVector) -> None:
        state = self._state(context)
        action: Any = context.get_discrete_state(self._memory).value()[:-2]
        target = self._q0 + self.params.action_scale * action
        torques = (
            self._kp * (target - state[self._q]) - self._kd * state[self._v]
        )
        output.SetFromVector(
            torques.clip(-self._limits, self._limits)[self._actuators]
        )


def _session(onnx: Path, name: str) -> Any:
    """The network in the file `onnx`; errors begin with `name`."""
    require(onnx.is_file(), f"{name}: must be a file")
    try:
        import onnxruntime  # type: ignore[import-untyped]
    except ModuleNotFoundError:
        raise ValueError(
            f"{name}: must have its package: pip install onnxruntime"
        ) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(onnx), options)
    except Exception as error:  # its exceptions have no class in common
        raise ValueError(
            f"{name}: must be an ONNX model ({' '.join(str(error).split())})"
        ) from None


def _metadata(network: Any, name: str) -> tuple[list[str], Any, Any]:
    """The names (n,) of the joints, and the gains (n,) and (n,)."""
    texts = network.get_modelmeta().custom_metadata_map
    _check_names(
        [key for key in _METADATA if key in texts],
        expected=_METADATA,
        message=f"{name}: must have metadata",
    )
    try:
        names = [str(joint) for joint in json.loads(texts["dof_names"])]
        gains = np.array(
            [json.loads(texts["kp"]), json.loads(texts["kd"])], dtype=float
        )
    except (TypeError, ValueError):  # no JSON, or lists of several lengths
        names, gains = [], np.zeros((2, 0))
    require(
        len(names) > 0
        and gains.shape == (2, len({*names}))
        and bool(np.all((gains >= 0.0) & np.isfinite(gains))),
        f"{name}: must have lists in JSON as metadata: dof_names, as many "
        "kp >= 0 and kd >= 0",
    )
    return names, gains[0], gains[1]


def _checked_port(network: Any, n: int, name: str) -> str:
    """The name of the input, if input and output fit `n` joints."""
    for kind, ports, size in (
        ("input", network.get_inputs(), 3 * n + 13),
        ("output", network.get_outputs(), n),
    ):
        needed = f"tensor(float) [1, {size}]"
        types = ", ".join(f"{port.type} {port.shape}" for port in ports)
        require(
            types == needed,
            f"{name}: must have one {kind} {needed} for {n} joints; has "
            f"{types}",
        )
    return str(network.get_inputs()[0].name)


def _check_names(
    names: Collection[str], expected: Collection[str], message: str
) -> None:
    """Raises ValueError, beginning with `message`, unless the names agree."""
    faults = {
        "lacks": [name for name in expected if name not in names],
        "has besides": [name for name in names if name not in expected],
    }
    texts = [f"{verb} {', '.join(n)}" for verb, n in faults.items() if n]
    require(not texts, f"{message}: {'; '.join(texts)}")
