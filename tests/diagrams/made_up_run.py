"""A made-up run of known figures: what a log looks like, without simulating.

The CoP goes from foot to foot, the ICP follows from it exactly (backward in
time, Eq. 3), and a push adds an ICP error that dies out exponentially.
"""

from dataclasses import dataclass, field

import numpy as np

from diagrams.logs import region_logs
from diagrams.run_log import PHASES
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import Phase, Side

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
    """Returns the log of a humanoid."""
    recipe = recipe or Recipe()
    signal = _walking_signal(recipe)
    n = len(signal)
    t = T * np.arange(n)
    log = {"t": t, "walking_signal": signal}
    push = _push(recipe, signal)
    _add_point_mass(log, push)
    _add_robot(log, push)
    return log


def without_robot(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns what a run of the point mass logs."""
    kept = ("t", "walking_signal", "com_state", "icp", "icp_reference")
    kept += ("ecmp_command", "momentum_rate", "momentum_qp_status")
    kept += ("push_force", "foot_forces", "sole")
    kept += ("region_base", "region_forward", "region_backward")
    return {name: log[name] for name in kept}


def cut(log: dict[str, np.ndarray], rows: int) -> dict[str, np.ndarray]:
    """Returns the first `rows` rows of the log."""
    n = len(log["t"])
    return {
        name: a[:rows] if a.ndim and len(a) == n else a
        for name, a in log.items()
    }


def _walking_signal(recipe: Recipe) -> np.ndarray:
    feet = {s: np.array([0.0, s.sign * HALF_WIDTH, 0.0]) for s in Side}
    nowhere, rows = np.full(3, np.nan), []
    swing = Side.RIGHT

    def phase(kind, planned, actual, taken, plan, goal, side=0):
        """One phase; in a swing the target moves from `plan` to `goal`."""
        for i in range(round(actual / T)):
            time = min(i * T, planned)
            moved = kind is Phase.SWING and time > 0.25 * recipe.swing + 0.05
            head = [PHASES.index(kind), swing.other.sign, time, planned]
            soles = [*feet[Side.LEFT], *feet[Side.RIGHT]]
            target = goal if moved else plan
            waits = i * T > planned
            rows.append([*head, waits, taken, *soles, *target, side])

    for k in range(1, recipe.num_steps + 1):
        plan = np.array([recipe.length * k, swing.sign * HALF_WIDTH, 0.0])
        move, swings, transfers = recipe.changed.get(
            k, (np.zeros(2), recipe.swing, recipe.transfer)
        )
        goal = plan + [*move, 0.0]
        step = (k - 1, plan, goal, swing.sign)
        if k == 1:
            phase(Phase.STANDING, np.inf, recipe.standing, *step)
        phase(Phase.TRANSFER, recipe.transfer, transfers, *step)
        phase(Phase.SWING, recipe.swing, swings, *step)
        feet[swing] = goal + [recipe.miss, 0.0, 0.0]
        swing = swing.other
    end = (recipe.num_steps, nowhere, nowhere)
    phase(Phase.TRANSFER, 0.8, 0.8, *end)
    phase(Phase.STANDING, np.inf, 1.0, *end)
    return np.array(rows, dtype=float)


def _push(recipe: Recipe, signal: np.ndarray) -> np.ndarray:
    """Force (n, 3): to the left for 0.1 s."""
    force = np.zeros((len(signal), 3))
    if recipe.pushed_step is not None:
        first = np.flatnonzero(
            (signal[:, 0] == 2)
            & (signal[:, 5] == recipe.pushed_step - 1)
            & (signal[:, 2] >= 0.25 * recipe.swing - 1e-9)
        )[0]
        force[first : first + round(0.1 / T), 1] = MASS * recipe.delta_v / 0.1
    return force


def _add_point_mass(log, push: np.ndarray) -> None:
    signal = log["walking_signal"]
    n = len(signal)
    left, right = signal[:, 6:8], signal[:, 9:11]
    support = np.where(signal[:, 1:2] > 0, left, right)
    other = np.where(signal[:, 1:2] > 0, right, left)
    share = np.clip(signal[:, 2:3] / signal[:, 3:4], 0.0, 1.0)
    last = (signal[:, 15:16] == 0) * 0.5
    cop = np.select(
        [signal[:, :1] == 2, signal[:, :1] == 1],
        [
            support + np.hstack([0.06 * share, np.zeros((n, 1))]),
            other + (1 - last) * share * (support - other),
        ],
        0.5 * (left + right),
    )
    icp_r = np.empty((n, 2))
    icp_r[-1] = cop[-1]
    for i in range(n - 2, -1, -1):
        icp_r[i] = cop[i] + np.exp(-OMEGA * T) * (icp_r[i + 1] - cop[i])
    error = np.zeros((n, 2))
    for i in range(1, n):
        jump = push[i, :2] * T / (MASS * OMEGA)
        error[i] = error[i - 1] * np.exp(-2.0 * OMEGA * T) + jump
    icp = icp_r + error
    com = np.empty((n, 2))
    com[0] = icp[0]
    for i in range(1, n):
        com[i] = icp[i] + np.exp(-OMEGA * T) * (com[i - 1] - icp[i])
    velocity = OMEGA * (icp - com)
    height, zero = np.full((n, 1), 0.95), np.zeros((n, 1))
    log["com_state"] = np.hstack([com, height, velocity, zero])
    log["icp"] = icp
    log["icp_reference"] = np.hstack([icp_r, OMEGA * (icp_r - cop), cop, cop])
    ecmp = cop + 3.0 * error
    log["ecmp_command"] = np.hstack(
        [cop + np.clip(3 * error, -0.04, 0.04), ecmp]
    )
    log["momentum_rate"] = np.hstack([MASS * OMEGA**2 * (com - ecmp), zero])
    log["push_force"] = push
    log["momentum_qp_status"] = np.tile([1.0, 0.0, 4.0, 1e-9, 0.0], (n, 1))
    lengths = np.linalg.norm(left - right, axis=1) + 1e-9
    to_left = np.linalg.norm(cop - right, axis=1) / lengths
    in_air = signal[:, 0] == 2
    to_left = np.where(in_air, signal[:, 1] > 0, np.clip(to_left, 0, 1))
    weight = MASS * 9.81
    log["foot_forces"] = weight * np.column_stack([to_left, 1 - to_left])
    log["sole"] = np.array(
        [[0.125, 0.06], [-0.125, 0.06], [-0.125, -0.06], [0.125, -0.06]]
    )
    log |= region_logs(ReachabilityParams())


def _add_robot(log, push: np.ndarray) -> None:
    t, signal = log["t"], log["walking_signal"]
    n, nu = len(t), len(JOINTS)
    limits = np.where(["KNEE" in name for name in JOINTS], 350.0, 300.0)
    phases = np.linspace(0.0, 3.0, nu)
    wave = 0.3 + 0.12 * np.sin(2 * np.pi * t[:, None] + phases)
    jolt = np.convolve(push[:, 1], np.exp(-np.arange(200) / 60.0))[:n]
    wave += 0.4 * (jolt / max(jolt.max(), 1.0))[:, None]
    log["actuation"] = wave * limits
    log["effort_limits"], log["actuator_names"] = limits, np.array(JOINTS)
    nq, nv = nu + 7, nu + 6
    log["num_positions"] = np.array(nq)
    log["joint_speed_limit"] = np.array(20.0)
    speed = 1.5 * np.abs(np.sin(np.pi * t[:, None] + phases))
    log["state"] = np.hstack([np.zeros((n, nq + nv - nu)), speed])
    log["foot_wrenches"] = np.zeros((n, 12))
    log["whole_body_qp_status"] = np.tile([1.0, 0.0, 2.0, 2e-7, 0.0], (n, 1))
    slip = 0.002 * np.sin(t)
    zero = np.zeros(n)
    log["foot_poses"] = np.column_stack(
        [signal[:, 6] + slip, signal[:, 7], zero]
        + [signal[:, 9] + slip, signal[:, 10], zero]
    )
    log["swing_foot_reference"] = np.zeros((n, 12))
