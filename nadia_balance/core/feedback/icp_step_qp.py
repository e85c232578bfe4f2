"""QP for CMP feedback and the next footholds (Atlas paper, Sec. IV)."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import bounded
from nadia_balance.core.math.polygon import contains, project
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.walking.vocabulary import FootPose, Immutable


def _diagonal(weight: float) -> Any:
    return field(default_factory=lambda: [[weight, 0.0], [0.0, weight]])


@dataclass(kw_only=True)
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eqs. 20 to 22."""

    feedback_gain: float = bounded(3.0, above=1.0)  # k_xi, CMP per ICP error
    num_steps: int = bounded(1, least=1, most=4)  # N adjustable footholds
    # Q_f, R and Q_eta, forward and left of the stance foot: weights of the
    # foothold shifts, of delta, and of the slack in the ICP error.  Q_f is
    # larger than R: the CoP reaches its limit before a foothold moves.
    step_weight: list[list[float]] = _diagonal(10.0)
    feedback_weight: list[list[float]] = _diagonal(1.0)
    slack_weight: list[list[float]] = _diagonal(1e5)
    # Margin of the CMP to the edge of the support polygon.
    cop_safe_distance: float = bounded(
        0.005, least=0.0, unit="m", of="sole_width"
    )
    # Lateral clearance between the soles.
    sole_clearance: float = bounded(0.005, least=0.0, unit="m", of="sole_width")
    # Foothold changes smaller than this are ignored.
    dead_band: float = bounded(0.02, least=0.0, unit="m")
    # Times before touchdown and after a phase change without foothold changes.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")

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
        """Returns the weights of `params`, rotated from the `stance` frame."""
        R, names = stance.rotation, ("step", "feedback", "slack")
        weights = (
            np.array(getattr(params, f"{name}_weight")) for name in names
        )
        return cls(*(R @ weight @ R.T for weight in weights))


@dataclass(frozen=True, eq=False)
class StepLimits(Immutable):
    """The part of the QP that is constant for given contacts and steps.

    A_cmp p <= b_cmp limits the CMP in W (Eq. 21), with A_cmp (k, 2).  The first
    k rows of C x <= upper are reserved for it; the rows of the footholds
    follow.  `H` is the cost without that of delta, whose weight is `R` (2, 2).
    """

    A_cmp: Array
    b_cmp: Array
    C: Array
    upper: Array
    H: Array
    R: Array


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for N steps.

        min   sum |step_i|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        s.t.  delta = k_xi (e - sum Gamma_i step_i - eta),
              the CMP + delta in the support polygon (Eq. 21),
              the footholds within reach of each other (Eq. 22).

    Half-spaces replace the paper's multipliers of the corners.  The CMP also
    moves with the footholds while a spline shifts it.  Delta is eliminated.
    """

    def __init__(self, params: IcpStepQpParams) -> None:
        self._gain, self._size = params.feedback_gain, 2 * params.num_steps + 2
        self._qp = DenseQp(self._size)

    def limits(
        self,
        weights: StepWeights,
        cmp_room: tuple[Array, Array],
        step_room: tuple[Array, Array],
    ) -> StepLimits:
        """Returns the limits for `solve` from half-spaces A p <= b in W.

        A is (k, 2) for the CMP, and (m, 2 n) for the shifts of n footholds.
        """
        (A_cmp, b_cmp), (A, b) = cmp_room, step_room
        H = np.zeros((self._size, self._size))
        H += np.kron(np.eye(self._size // 2), weights.step)
        H[-2:, -2:] = weights.slack
        C = np.zeros((len(b_cmp) + len(b), self._size))
        C[len(b_cmp) :, : A.shape[1]] = A
        upper = np.concatenate((b_cmp, b))
        return StepLimits(A_cmp, b_cmp, C, upper, H, weights.feedback)

    def solve(
        self, error: Array, cmp: Array, moves: Array, limits: StepLimits
    ) -> tuple[Array, QpResult]:
        """Returns the shifts (n, 2) [m] of the footholds from the planned ones.

        `error` (2,) is xi - xi_r [m] and `cmp` (2,) the reference CMP [m]; all
        are in W; `moves` (2, n) are their Gamma_i (Eq. 18) for n <= N
        footholds.  Unless the result is solved, the shifts are NaN; its x ends
        in eta (2,) [m], the slack in the ICP error.

        Raises ValueError: an argument is not finite.
        """
        used, k = 2 * moves.shape[1], len(limits.b_cmp)
        # x = (steps, eta), and delta = delta_0 + D x by the constraint.
        delta_0, D = self._gain * error, np.zeros((2, self._size))
        D[0, 0:used:2] = D[1, 1:used:2] = -self._gain * moves[0]
        D[0, -2] = D[1, -1] = -self._gain
        DR, cmp_D = D.T @ limits.R, D.copy()
        cmp_D[0, 0:used:2] += moves[1]
        cmp_D[1, 1:used:2] += moves[1]
        C, upper = limits.C.copy(), limits.upper.copy()
        C[:k] = limits.A_cmp @ cmp_D
        upper[:k] = limits.b_cmp - limits.A_cmp @ (cmp + delta_0)
        result = self._qp.solve(
            QpProblem(
                limits.H + DR @ D,
                DR @ delta_0,
                C,
                np.full(len(upper), -np.inf),
                upper,
            )
        )
        return result.x[:used].reshape(-1, 2), result


class AnkleFeedback:
    """Closed form of Eq. 20 for fixed footholds: a projection in the norm of M.

    Eliminating eta leaves the cost |delta - K error|^2_M, with the CMP in the
    polygon `room` (n, 2) [m].
    """

    def __init__(self, room: Array, weights: StepWeights, gain: float) -> None:
        M = weights.feedback + weights.slack / gain**2
        self._K = np.linalg.inv(M) @ weights.slack / gain
        self._L = np.linalg.cholesky(M).T
        self._room, self._image = room, room @ self._L.T

    def delta(self, error: Array, cmp: Array) -> Array:
        """Returns delta (2,) for xi - xi_r and the reference CMP (2,) [m]."""
        delta = self._K @ error
        if contains(cmp + delta, self._room):
            return np.asarray(delta)
        nearest = project(self._L @ (cmp + delta), self._image)
        return np.asarray(np.linalg.solve(self._L, nearest) - cmp)
