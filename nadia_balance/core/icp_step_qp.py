"""One QP for the ankles and the next foothold (Atlas paper, Sec. IV)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nadia_balance.core.qp_programs import QpProblem
from nadia_balance.core.qp_solver import DenseQp, QpResult
from nadia_balance.core.walking import Array

_STEP, _CMP, _SLACK = slice(0, 2), slice(2, 4), slice(4, 6)


@dataclass(kw_only=True)
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eq. 20."""

    feedback_gain: float = 3.0  # k_xi, CMP per ICP error [-]
    # The CoP is used up before the foothold moves: Q_f is much more than R.
    step_weight: float = 10.0  # Q_f, on the way from the foothold planned
    feedback_weight: float = 1.0  # R, on delta
    slack_weight: float = 1e5  # Q_eta, on the ICP error that is left over
    cop_safe_distance: float = 0.005  # CMP inside the sole [m]
    sole_clearance: float = 0.005  # between the soles, sideways [m]
    dead_band: float = 0.02  # the foothold moves by so much, or not at all [m]
    freeze_time: float = 0.05  # no change so shortly before touchdown [s]
    settling_time: float = 0.01  # nor so early in a swing [s]
    solver: str = "active_set"  # a name of qp_solver.SOLVERS

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        if not 1.0 < self.feedback_gain < math.inf:
            raise ValueError(
                f"feedback_gain = {self.feedback_gain}: must be > 1"
            )
        for name in ("step_weight", "feedback_weight", "slack_weight"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and > 0")
        for name in (
            "cop_safe_distance",
            "sole_clearance",
            "dead_band",
            "freeze_time",
            "settling_time",
        ):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and >= 0")


class StepFeedback(NamedTuple):
    """What the QP decides, each (2,) [m] in W.

    `step` is how far the foothold goes from the one planned, `delta` the
    feedback on the CMP, `slack` = eta the ICP error that is left to neither.
    They are NaN if the `result` is not solved.
    """

    step: Array
    delta: Array
    slack: Array
    result: QpResult


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for the next step.

    With the error e of the ICP from its reference, were the foothold where it
    is planned, and Gamma, by how much the reference moves with it (Eq. 18):

        min   |step|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        s.t.  delta = k_xi (e - Gamma step - eta),
              delta in the room that the sole leaves (Eq. 21),
              step in the room that the legs' reach leaves (Eq. 22).

    Half-spaces of the sole stand for the paper's multipliers of its corners.
    """

    def __init__(self, params: IcpStepQpParams, max_rows: int = 32) -> None:
        """For rooms that have, together, up to `max_rows` half-spaces."""
        params.validate()
        self.params, self._max_rows = params, max_rows
        self._qp = DenseQp(6, 2, max_rows, params.solver)
        p = params
        weights = p.step_weight, p.feedback_weight, p.slack_weight
        self._H = np.diag(np.repeat(weights, 2))

    def solve(
        self,
        error: Array,
        sensitivity: float,
        cmp_room: tuple[Array, Array],
        step_room: tuple[Array, Array],
    ) -> StepFeedback:
        """Returns step and feedback for the ICP `error` (2,) [m] in W.

        `sensitivity` is Gamma [-].  The rooms of delta and of the step are
        half-spaces A x <= b, with A (n, 2) and b (n,) [m].

        Raises:
            ValueError: an argument is not finite.
        """
        gain = self.params.feedback_gain
        A_eq = np.hstack(
            [gain * sensitivity * np.eye(2), np.eye(2), gain * np.eye(2)]
        )
        C = np.zeros((self._max_rows, 6))
        upper = np.full(self._max_rows, np.inf)
        (A_c, b_c), (A_s, b_s) = cmp_room, step_room
        n, m = len(b_c), len(b_c) + len(b_s)
        C[:n, _CMP], upper[:n] = A_c, b_c
        C[n:m, _STEP], upper[n:m] = A_s, b_s
        result = self._qp.solve(
            QpProblem(
                self._H,
                np.zeros(6),
                A_eq,
                gain * error,
                C,
                np.full(self._max_rows, -np.inf),
                upper,
            )
        )
        x = result.x
        return StepFeedback(x[_STEP], x[_CMP], x[_SLACK], result)
