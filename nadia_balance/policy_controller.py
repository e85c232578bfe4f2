"""A learned walking policy, in the place of the BalanceController."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from nadia_balance.core.walking.state import Side
from nadia_balance.parameters.bounds import bounded, check
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuators
from nadia_balance.systems.ports import Input, inputs

_METADATA = "dof_names", "kp", "kd"
_STILL = 0.01  # slower commands are to stand [m/s], [rad/s]
_FIRST = {Side.LEFT: 0.0, Side.RIGHT: math.pi}  # phases at the start [rad]


def _g1_pose() -> dict[str, float]:
    """Default angles [rad] of holosoma's policies for the G1."""
    both = {"hip_pitch": -0.312, "knee": 0.669, "ankle_pitch": -0.363}
    both |= {"shoulder_pitch": 0.2, "elbow": 0.6}
    pose = {f"{s.value}_{j}_joint": a for s in Side for j, a in both.items()}
    return pose | {f"{s.value}_shoulder_roll_joint": 0.2 * s.sign for s in Side}


@dataclass(kw_only=True)
class PolicyParams:
    """What a policy was trained with, and its ONNX file does not say.

    By default, that of holosoma's walking policies for the G1.
    """

    # q_0 by joint [rad]; of joints that are not named 0.
    default_angles: dict[str, float] = field(default_factory=_g1_pose)
    action_scale: float = bounded(0.25, above=0.0)  # s [rad]
    action_limit: float = bounded(100.0, above=0.0)  # of |a| [-]
    gyro_scale: float = bounded(0.25, above=0.0)  # [s/rad]
    speed_scale: float = bounded(0.05, above=0.0)  # [s/rad]
    period: float = bounded(0.02, above=0.0, unit="s")  # from action to action
    stride: float = bounded(1.0, above=0.0, unit="s")  # of two steps


class PolicyController(LeafSystem):
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

    .. pydrake_system::

        name: PolicyController
        input_ports: [estimated_state, velocity_command]
        output_ports: [actuation]
    """

    def __init__(self, robot: RobotModel, onnx: str | Path, params=None):
        """Reads the policy for `robot` from the file `onnx`; see PolicyParams.

        Raises ValueError: the file is no such policy, or one of another robot,
        or onnxruntime is missing: one line that names what differs.
        """
        super().__init__()
        self.params = params = params or PolicyParams()
        check(params)
        what = f"controller = {str(onnx)!r}: must"
        self.file = Path(onnx).name
        self._network = _session(Path(onnx), what)
        self.joints, self._kp, self._kd = _metadata(self._network, what)
        self._port = _checked_port(self._network, len(self.joints), what)
        plant = robot.control_plant()
        joints = [drive.joint() for drive in actuators(plant)]
        names = [joint.name() for joint in joints]
        _same(names, self.joints, f"{what} be of the joints of {robot.name}")
        for name in {*params.default_angles} - {*names}:
            why = f"must be a joint of {robot.name}"
            raise ValueError(f"default_angles.{name}: {why}")
        # In the order of the policy.
        places = [names.index(name) for name in self.joints]
        nq, default = plant.num_positions(), params.default_angles.get
        self._q = np.array([joints[i].position_start() for i in places])
        self._v = nq + np.array([joints[i].velocity_start() for i in places])
        self._spin = slice(nq, nq + 3)  # of the floating base, in W
        self._q0 = np.array([default(name, 0.0) for name in self.joints])
        self._limits = plant.GetEffortUpperLimits()[places]
        self._actuators = np.argsort(places)  # from the policy's order
        size = plant.num_multibody_states()
        self._state = Input(self, "estimated_state", size)
        (self._command,) = inputs(self, "velocity_command")
        first = [*np.zeros(len(names)), *_FIRST.values()]
        self._memory = self.DeclareDiscreteState(first)
        memory = self.discrete_state_ticket(self._memory)
        out = "actuation", len(names), self._calc_torques
        self.DeclareVectorOutputPort(*out, {self._state.ticket(), memory})
        every = params.period, 0.0, self._update
        self.DeclarePeriodicUnrestrictedUpdateEvent(*every)

    def observe(self, context: Context) -> np.ndarray:
        """Returns the observation (3 n + 13,) of the tick of `context`."""
        p, state = self.params, self._state(context)
        memory = context.get_discrete_state(self._memory).value()
        phases = self._advanced(context)
        unit = state[:4] / np.linalg.norm(state[:4])
        R_BW = RotationMatrix(Quaternion(unit)).inverse()
        *velocity, yaw_rate = self._command(context)
        spin, speeds = R_BW @ state[self._spin], state[self._v]
        moved, down = state[self._q] - self._q0, R_BW @ [0.0, 0.0, -1.0]
        parts = [memory[:-2], p.gyro_scale * spin, [yaw_rate, *velocity]]
        parts += [np.cos(phases), moved, p.speed_scale * speeds, down]
        return np.concatenate([*parts, np.sin(phases)])

    def _advanced(self, context: Context) -> np.ndarray:
        """The phases (2,) of the next tick."""
        forward, left, yaw_rate = self._command(context)
        if max(math.hypot(forward, left), abs(yaw_rate)) < _STILL:
            return np.full(2, math.pi)
        phases = context.get_discrete_state(self._memory).value()[-2:]
        if np.array_equal(phases, np.full(2, math.pi)):  # it stood
            phases = np.array([*_FIRST.values()])
        return phases + 2.0 * math.pi * self.params.period / self.params.stride

    def _update(self, context: Context, state) -> EventStatus:
        seen = self.observe(context).astype(np.float32)
        action = self._network.run(None, {self._port: seen[None]})[0][0]
        most = self.params.action_limit
        after = [*np.clip(action, -most, most), *self._advanced(context)]
        state.get_mutable_discrete_state(self._memory).set_value(after)
        return EventStatus.Succeeded()

    def _calc_torques(self, context: Context, output) -> None:
        state = self._state(context)
        action = context.get_discrete_state(self._memory).value()[:-2]
        target = self._q0 + self.params.action_scale * action
        torques = self._kp * (target - state[self._q])
        torques -= self._kd * state[self._v]
        torques = torques.clip(-self._limits, self._limits)
        output.SetFromVector(torques[self._actuators])


def _session(onnx: Path, what: str) -> Any:
    """The network in the file `onnx`; errors begin with `what`."""
    if not onnx.is_file():
        raise ValueError(f"{what} be a file")
    try:
        import onnxruntime
    except ModuleNotFoundError:
        why = "have its package: pip install onnxruntime"
        raise ValueError(f"{what} {why}") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(onnx), options)
    except Exception as error:  # its exceptions have no class in common
        reason = " ".join(str(error).split())
        raise ValueError(f"{what} be an ONNX model ({reason})") from None


def _metadata(network: Any, what: str) -> tuple[list[str], Any, Any]:
    """The names (n,) of the joints, and the gains (n,) and (n,)."""
    texts = network.get_modelmeta().custom_metadata_map
    _same(_METADATA, set(texts) & {*_METADATA}, f"{what} have metadata")
    try:
        names, *gains = (json.loads(texts[name]) for name in _METADATA)
        names, gains = [*map(str, names)], np.array(gains, dtype=float)
    except (TypeError, ValueError):  # no JSON, or lists of several lengths
        names, gains = [], np.zeros((2, 0))
    sized = len({*names}) > 0 and gains.shape == (2, len({*names}))
    if not sized or not np.all((gains >= 0.0) & np.isfinite(gains)):
        lists = "dof_names, as many kp >= 0 and kd >= 0"
        raise ValueError(f"{what} have lists in JSON as metadata: {lists}")
    return names, *gains


def _checked_port(network: Any, n: int, what: str) -> str:
    """The name of the input, if input and output fit `n` joints."""
    for name, ports, size in (
        ("input", network.get_inputs(), 3 * n + 13),
        ("output", network.get_outputs(), n),
    ):
        wanted = f"tensor(float) [1, {size}]"
        has = ", ".join(f"{port.type} {port.shape}" for port in ports)
        if has != wanted:
            why = f"have one {name} {wanted} for {n} joints; has {has}"
            raise ValueError(f"{what} {why}")
    return network.get_inputs()[0].name


def _same(wanted: Any, found: Any, what: str) -> None:
    """Raises ValueError, beginning with `what`, unless the names agree."""
    more = [name for name in found if name not in wanted]
    told = {"lacks": [n for n in wanted if n not in found], "has besides": more}
    said = [f"{v} {', '.join(names)}" for v, names in told.items() if names]
    if said:
        raise ValueError(f"{what}: {'; '.join(said)}")
