"""A made-up run of known figures: what a log looks like, without simulating.

The CoP goes from foot to foot, the ICP follows from it exactly (backward in
time, Eq. 3), and a push adds an ICP error that dies out exponentially.
"""

import functools
from dataclasses import dataclass, field, fields

import numpy as np

from nadia_balance.core.body import reachability
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.walking.state import Mode, Phase, Side
from nadia_balance.results.summary import Run, RunInfo
from nadia_balance.systems import signals
from nadia_balance.systems.signals import (
    MODES,
    PHASES,
    PushSignal,
    WalkingSignal,
)

T, OMEGA, MASS = 0.002, 3.2, 90.9
HALF_WIDTH = 0.125
JOINTS = [
    f"{side}_{joint}"
    for side in ("LEFT", "RIGHT")
    for joint in ("HIP_Z", "HIP_X", "HIP_Y", "KNEE_Y", "ANKLE_Y", "ANKLE_X")
] + ["SPINE_Z", "SPINE_X", "SPINE_Y"]


@dataclass
class Recipe:
    """What the made-up run is like."""

    num_steps: int = 6
    length: float = 0.0  # of a step [m]
    standing: float = 0.5
    transfer: float = 0.3
    swing: float = 0.7
    pushed_step: int | None = 2  # 25 % of its swing; None: no push
    delta_v: float = 0.6
    # Step number -> (adjustment of the foothold [m], swing, transfer [s]).
    changed: dict = field(
        default_factory=lambda: {
            2: (np.array([0.12, 0.2]), 0.43, 0.3),
            3: (np.array([0.0, 0.31]), 0.5, 0.04),
        }
    )
    miss: float = 0.004  # how far beside its target a foot lands [m]


def make_log(recipe: Recipe | None = None) -> dict[str, np.ndarray]:
    """Returns the log of a humanoid, to be changed at will."""
    log = _usual() if recipe is None else _log_of(recipe)
    return {name: values.copy() for name, values in log.items()}


_usual = functools.cache(lambda: _log_of(Recipe()))


def _log_of(recipe: Recipe) -> dict[str, np.ndarray]:
    rows = _walking_signal(recipe)
    log = {"t": T * np.arange(len(rows)), "walking_signal": rows}
    walking = WalkingSignal(rows.T)
    log["push_signal"] = _push(recipe, walking)
    force = PushSignal(log["push_signal"].T).force.T
    _add_point_mass(log, walking, force)
    _add_robot(log, walking, force)
    return log


def without_robot(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns what a run of the point mass logs."""
    kept = ("t", "walking_signal", "com_state", "icp", "icp_reference")
    kept += ("ecmp_command", "momentum_rate", "momentum_qp_status")
    kept += ("push_signal", "foot_forces", "sole")
    kept += ("region_base", "region_forward", "region_backward")
    return {name: log[name] for name in kept}


def cut(log: dict[str, np.ndarray], rows: int) -> dict[str, np.ndarray]:
    """Returns the first `rows` rows of the log."""
    n = len(log["t"])
    timed = {name: a for name, a in log.items() if a.ndim and len(a) == n}
    return log | {name: a[:rows] for name, a in timed.items()}


def summary_of(log: dict[str, np.ndarray], **conditions) -> dict:
    """Returns the summary of a log; `conditions`: fields of Run and RunInfo."""
    of_run = {field.name for field in fields(Run)} & {*conditions}
    run = {name: conditions.pop(name) for name in of_run}
    info = RunInfo(**{"robot": "nadia", "mechanisms": "step", **conditions})
    return Run(logs=log, info=info, **run).summary


def _walking_signal(recipe: Recipe) -> np.ndarray:
    feet = {s: np.array([0.0, s.sign * HALF_WIDTH, 0.0]) for s in Side}
    nowhere, rows = np.full(3, np.nan), []
    swing = Side.RIGHT

    def phase(kind, planned, actual, taken, plan, goal, side=0):
        """One phase; in a swing the target moves from `plan` to `goal`."""
        for i in range(round(actual / T)):
            time = min(i * T, planned)
            moved = kind is Phase.SWING and time > 0.25 * recipe.swing + 0.05
            now = WalkingSignal(np.zeros(len(WalkingSignal.get_fields())))
            now.phase, now.support_side = PHASES.index(kind), swing.other.sign
            now.time_in_phase, now.duration = time, planned
            now.waiting, now.steps_taken = i * T > planned, taken
            now.left[:], now.right[:] = feet[Side.LEFT], feet[Side.RIGHT]
            now.target[:] = goal if moved else plan
            now.target_side = side
            mode = Mode.WALKING if side else Mode.STANDING
            if moved and not np.array_equal(plan, goal):
                mode = Mode.RECOVERING
            now.mode = MODES.index(mode)
            rows.append(now[:])

    for k in range(1, recipe.num_steps + 1):
        plan = np.array([recipe.length * k, swing.sign * HALF_WIDTH, 0.0])
        usual = np.zeros(2), recipe.swing, recipe.transfer
        move, swings, transfers = recipe.changed.get(k, usual)
        goal = plan + [*move, 0.0]
        for kind, planned, actual in (
            (Phase.STANDING, np.inf, recipe.standing if k == 1 else 0.0),
            (Phase.TRANSFER, recipe.transfer, transfers),
            (Phase.SWING, recipe.swing, swings),
        ):
            phase(kind, planned, actual, k - 1, plan, goal, swing.sign)
        feet[swing] = goal + [recipe.miss, 0.0, 0.0]
        swing = swing.other
    taken = recipe.num_steps
    phase(Phase.TRANSFER, 0.8, 0.8, taken, nowhere, nowhere)
    phase(Phase.STANDING, np.inf, 1.0, taken, nowhere, nowhere)
    return np.array(rows, dtype=float)


def _push(recipe: Recipe, walking: WalkingSignal) -> np.ndarray:
    """PushSignal (n, 6): to the left for 0.1 s, one row after it is due."""
    push = PushSignal(np.zeros((6, len(walking.phase))))
    if recipe.pushed_step is not None:
        due = np.flatnonzero(
            (walking.phase == PHASES.index(Phase.SWING))
            & (walking.steps_taken == recipe.pushed_step - 1)
            & (walking.time_in_phase >= 0.25 * recipe.swing - 1e-9)
        )[0]
        acts = slice(due + 1, due + 1 + round(0.1 / T))
        push.number[acts], push.delta_v[acts] = 1.0, recipe.delta_v
        push.force_y[acts] = MASS * recipe.delta_v / 0.1
    return push[:].T.copy()


def _add_point_mass(log, walking: WalkingSignal, push: np.ndarray) -> None:
    n = len(push)
    left, right = walking.left[:2].T, walking.right[:2].T
    on_left = walking.support_side > 0
    support = np.where(on_left[:, None], left, right)
    other = np.where(on_left[:, None], right, left)
    share = np.clip(walking.time_in_phase / walking.duration, 0.0, 1.0)[:, None]
    last = (walking.target_side == 0)[:, None] * 0.5
    phase = walking.phase[:, None]
    shifted = other + (1 - last) * share * (support - other)
    cop = np.where(phase == 1, shifted, 0.5 * (left + right))
    cop = np.where(phase == 2, support + share * [0.06, 0.0], cop)
    icp_r = np.empty((n, 2))
    icp_r[-1] = cop[-1]
    for i in range(n - 2, -1, -1):
        icp_r[i] = cop[i] + np.exp(-OMEGA * T) * (icp_r[i + 1] - cop[i])
    error = np.zeros((n, 2))
    for i in range(1, n):
        jump = push[i, :2] * T / (MASS * OMEGA)
        error[i] = error[i - 1] * np.exp(-2.0 * OMEGA * T) + jump
    icp = icp_r + error
    com = signals.ComState(np.zeros((6, n)))
    com.z[:] = 0.95
    com.position[:2, 0] = icp[0]
    for i in range(1, n):
        offset = com.position[:2, i - 1] - icp[i]
        com.position[:2, i] = icp[i] + np.exp(-OMEGA * T) * offset
    p = com.position[:2].T
    com.velocity[:2] = (OMEGA * (icp - p)).T
    log["com_state"], log["icp"] = com[:].T, icp
    reference = signals.IcpReference(np.empty((8, n)))
    reference.icp[:] = icp_r.T
    reference.icp_velocity[:] = OMEGA * (icp_r - cop).T
    reference.cop[:] = reference.ecmp[:] = cop.T
    log["icp_reference"] = reference[:].T
    command = signals.EcmpCommand(np.empty((4, n)))
    command.cop[:] = (cop + np.clip(3.0 * error, -0.04, 0.04)).T
    command.ecmp[:] = ecmp = (cop + 3.0 * error).T
    log["ecmp_command"] = command[:].T
    rate = MASS * OMEGA**2 * (p - ecmp.T)
    log["momentum_rate"] = np.hstack([rate, np.zeros((n, 1))])
    log["momentum_qp_status"] = np.tile([1.0, 0.0, 4.0, 1e-9, 0.0], (n, 1))
    lengths = np.linalg.norm(left - right, axis=1) + 1e-9
    to_left = np.linalg.norm(cop - right, axis=1) / lengths
    to_left = np.where(walking.phase == 2, on_left, np.clip(to_left, 0, 1))
    weight = MASS * 9.81
    log["foot_forces"] = weight * np.column_stack([to_left, 1 - to_left])
    log["sole"] = rectangle(0.25, 0.12)
    reach = reachability.ReachabilityParams()
    regions = reachability.step_regions(reach, cross_over=True)
    log |= {f"region_{name}": region for name, region in regions.items()}


def _add_robot(log, walking: WalkingSignal, push: np.ndarray) -> None:
    t = log["t"]
    n, nu = len(t), len(JOINTS)
    limits = np.where(["KNEE" in name for name in JOINTS], 350.0, 300.0)
    phases = np.linspace(0.0, 3.0, nu)
    wave = 0.3 + 0.12 * np.sin(2 * np.pi * t[:, None] + phases)
    jolt = np.convolve(push[:, 1], np.exp(-np.arange(200) / 60.0))[:n]
    wave += 0.4 * (jolt / max(jolt.max(), 1.0))[:, None]
    log["actuation"] = wave * limits
    log["effort_limits"], log["actuator_names"] = limits, np.array(JOINTS)
    nq, nv = nu + 7, nu + 6
    log["torques"] = log["actuation"].copy()
    log["joint_speed_columns"] = np.arange(nq + nv - nu, nq + nv)
    log["joint_speed_limits"] = np.full(nu, 20.0)
    speed = 1.5 * np.abs(np.sin(np.pi * t[:, None] + phases))
    log["state"] = np.hstack([np.zeros((n, nq + nv - nu)), speed])
    log["weight"] = np.array(MASS * 9.81)
    log["foot_wrenches"] = np.zeros((n, 12))
    log["whole_body_qp_status"] = np.tile([1.0, 0.0, 2.0, 2e-7, 0.0], (n, 1))
    feet = signals.MeasuredFeet(np.zeros((8, n)))
    feet.left[:2], feet.right[:2] = walking.left[:2], walking.right[:2]
    for x in (feet.left_x, feet.right_x):
        x += 0.002 * np.sin(t)  # slips
    log["foot_poses"] = feet[:].T
    log["swing_foot_reference"] = np.zeros((n, 12))
    log["trunk_tilt"] = np.zeros((n, 2))
