"""One QP for the ankles and the next footholds (Atlas paper, Sec. IV)."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.com_height import ComHeightParams
from nadia_balance.core.polygon import contains, project
from nadia_balance.core.qp import SOLVERS, DenseQp, QpProblem, QpResult
from nadia_balance.core.walking import Array, FootPose


def _diagonal(weight: float) -> Any:
    return field(default_factory=lambda: [[weight, 0.0], [0.0, weight]])


@dataclass(kw_only=True)
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eqs. 20 to 22."""

    feedback_gain: float = bounded(3.0, above=1.0)  # k_xi, CMP per ICP error
    num_steps: int = bounded(1, least=1, most=4)  # N, of those previewed
    # Q_f, R and Q_eta, forward and left of the stance foot: on the shifts of
    # the footholds, on delta, and on the ICP error that is left over.  Q_f is
    # the larger: the CoP is used up before a foothold moves.
    step_weight: list[list[float]] = _diagonal(10.0)
    feedback_weight: list[list[float]] = _diagonal(1.0)
    slack_weight: list[list[float]] = _diagonal(1e5)
    # How far inside the support polygon the CMP stays.
    cop_safe_distance: float = bounded(0.005, least=0.0, unit="m")
    # Between the soles, sideways.
    sole_clearance: float = bounded(0.005, least=0.0, unit="m")
    # The footholds move by so much, or not at all.
    dead_band: float = bounded(0.02, least=0.0, unit="m")
    # No change so shortly before touchdown, nor so early in a phase.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")
    solver: str = bounded("active_set", one_of=SOLVERS)
    com_height: ComHeightParams = field(default_factory=ComHeightParams)

    def validate_more(self) -> None:
        """Raises ValueError if a weight is no positive definite matrix."""
        for name in "step_weight", "feedback_weight", "slack_weight":
            value = getattr(self, name)
            if [len(row) for row in value] == [2, 2]:
                (a, b), (c, d) = value
                if b == c and a > 0.0 and a * d > b * c:
                    continue
            raise ValueError(
                f"{name} = {value}: must be 2 x 2, symmetric and positive "
                "definite"
            )


class StepWeights(NamedTuple):
    """Q_f, R and Q_eta, each (2, 2), in W."""

    step: Array
    feedback: Array
    slack: Array

    @classmethod
    def of(cls, params: IcpStepQpParams, stance: FootPose) -> "StepWeights":
        """Those of `params`, which are forward and left of `stance`."""
        R, names = stance.rotation, ("step", "feedback", "slack")
        weights = (
            np.array(getattr(params, f"{name}_weight")) for name in names
        )
        return cls(*(R @ weight @ R.T for weight in weights))


class StepProblem(NamedTuple):
    """An ICP error, and what ankles and footholds can do about it, in W.

    `error` (2,) is xi - xi_r [m] and `cmp` (2,) the reference CMP [m] with the
    planned footholds; `moves` (2, n) are Gamma_i of the ICP and of that CMP
    (Eq. 18).  Half-spaces A p <= b: of the CMP with A (k, 2) (Eq. 21), and of
    the shifts of all footholds with A (m, 2 n) (Eq. 22).
    """

    error: Array
    cmp: Array
    moves: Array
    cmp_room: tuple[Array, Array]
    step_room: tuple[Array, Array]


class StepSolution(NamedTuple):
    """What the QP decides, in W [m]; NaN if the `result` is not solved.

    `steps` (n, 2) are the shifts of the footholds from the planned ones,
    `delta` (2,) the feedback on the CMP, `slack` = eta (2,) the ICP error left
    to neither.
    """

    steps: Array
    delta: Array
    slack: Array
    result: QpResult


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for N steps.

        min   sum |step_i|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        s.t.  delta = k_xi (e - sum Gamma_i step_i - eta),
              the CMP + delta where the soles are (Eq. 21),
              the footholds within reach of each other (Eq. 22).

    Half-spaces stand for the paper's multipliers of the corners.  The CMP also
    moves with the footholds where a spline shifts it.
    """

    def __init__(self, params: IcpStepQpParams, max_rows: int) -> None:
        """For rooms that have, together, up to `max_rows` half-spaces."""
        self._num_steps, self._max_rows = params.num_steps, max_rows
        self._gain = params.feedback_gain
        self._size = 2 * params.num_steps + 4
        self._qp = DenseQp(self._size, 2, max_rows, params.solver)
        self._no_lower = np.full(max_rows, -np.inf)

    def solve(self, problem: StepProblem, weights: StepWeights) -> StepSolution:
        """Returns steps and feedback; up to N footholds may move.

        Raises:
            ValueError: an argument is not finite.
        """
        gain, n = self._gain, problem.moves.shape[1]
        used, cmp, eta = 2 * n, self._size - 4, self._size - 2
        H, A_eq = np.zeros((self._size, self._size)), np.zeros((2, self._size))
        for i in range(0, cmp, 2):  # those without a step stay 0
            H[i : i + 2, i : i + 2] = weights.step
        H[cmp:eta, cmp:eta], H[eta:, eta:] = weights.feedback, weights.slack
        icp_moves, cmp_moves = problem.moves
        A_eq[0, 0:used:2] = A_eq[1, 1:used:2] = gain * icp_moves
        A_eq[[0, 1], [cmp, cmp + 1]] = 1.0
        A_eq[[0, 1], [eta, eta + 1]] = gain
        C, upper = np.zeros((self._max_rows, self._size)), -self._no_lower
        (A_c, b_c), (A_s, b_s) = problem.cmp_room, problem.step_room
        k, m = len(b_c), len(b_c) + len(b_s)
        C[:k, cmp:eta], upper[:k] = A_c, b_c - A_c @ problem.cmp
        C[:k, :used] = np.kron(cmp_moves, A_c)
        C[k:m, :used], upper[k:m] = A_s, b_s
        b_eq, g = gain * problem.error, np.zeros(self._size)
        result = self._qp.solve(
            QpProblem(H, g, A_eq, b_eq, C, self._no_lower, upper)
        )
        x = result.x
        return StepSolution(x[:used].reshape(n, 2), x[cmp:eta], x[eta:], result)


def feedback_alone(
    error: Array, cmp: Array, room: Array, weights: StepWeights, gain: float
) -> Array:
    """Returns delta (2,) [m], the optimum of Eq. 20 if no foothold moves.

    Without eta it is k_xi `error`, and one quadratic cost |delta - ...|^2_M is
    left: the optimum in the polygon `room` (n, 2) [m], where the CMP has to be,
    is a projection on it by that measure.
    """
    M = weights.feedback + weights.slack / gain**2
    delta = np.asarray(np.linalg.solve(M, weights.slack @ error / gain), float)
    if contains(cmp + delta, room):
        return delta
    L = np.asarray(np.linalg.cholesky(M).T, float)
    nearest = project(L @ (cmp + delta), room @ L.T)
    return np.asarray(np.linalg.solve(L, nearest) - cmp)
