"""The Atlas paper's QP for feedback and footholds (Sec. IV)."""

from typing import NamedTuple

import numpy as np

from nadia_balance.core.feedback.weights import (
    Weight,
    check_weight,
    isotropic,
    weight_in_world,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import Halfspaces, project
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.walking.state import FootPose, Footstep, Side
from nadia_balance.parameters.bounds import bounded, parameters, require


@parameters
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eqs. 20 to 22.

    A weight is a matrix [[a, b], [b, c]] in a sole frame, x forward and y
    toward the swing side: that of a step in its own, the others in that of the
    support foot.
    """

    feedback_gain: float = bounded(
        3.0, doc="k_xi: CMP offset per ICP error", above=1.0
    )
    num_steps: int = bounded(
        1, doc="N: number of adjustable footholds", least=1, most=4
    )
    step_weights: list[Weight] = bounded(
        lambda: [isotropic(10.0)],
        doc="Q_f,i: weight [[a, b], [b, c]] of the shift of footstep i, "
        "positive semidefinite, x along its sole, y outward. The last one is "
        "for all steps after it; larger than R: the CoP reaches its limit "
        "before a foothold moves",
    )
    feedback_weight: Weight = bounded(
        lambda: isotropic(1.0),
        doc="R: weight of the CMP feedback delta, x along the support foot, y "
        "toward the swing side",
    )
    slack_weight: Weight = bounded(
        lambda: isotropic(1e5),
        doc="Q_eta: weight of the slack in the ICP error, likewise, but "
        "positive definite",
    )
    cop_safe_distance: float = bounded(
        0.005,
        doc="margin of the CMP to the edge of the support polygon",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    sole_clearance: float = bounded(
        0.005,
        doc="lateral clearance between the soles",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    dead_band: float = bounded(
        0.02,
        doc="foothold changes smaller than this are ignored",
        least=0.0,
        unit="m",
    )
    freeze_time: float = bounded(
        0.05,
        doc="time before touchdown without foothold changes",
        least=0.0,
        unit="s",
    )
    settling_time: float = bounded(
        0.01,
        doc="time after a phase change without foothold changes",
        least=0.0,
        unit="s",
    )

    def validate_more(self) -> None:
        """Checks the weights.

        Raises:
            ValueError: one is not symmetric and positive semidefinite, that of
                the slack not definite, or there are more than footsteps.
        """
        require(
            1 <= len(self.step_weights) <= self.num_steps,
            f"step_weights = {self.step_weights}: must be 1 to num_steps = "
            f"{self.num_steps} matrices",
        )
        for i, weight in enumerate(self.step_weights):
            check_weight(f"step_weights[{i}]", weight)
        check_weight("feedback_weight", self.feedback_weight)
        check_weight("slack_weight", self.slack_weight, definite=True)


class StepWeights(NamedTuple):
    """The weights of Eq. 20 in W."""

    costs: Array  # blocks Q_f,1, ..., Q_f,N, Q_eta (2 N + 2, 2 N + 2)
    R: Array  # (2, 2)


def step_weights(
    params: IcpStepQpParams,
    stance: FootPose,
    steps: tuple[Footstep, ...],
    swing: Side,
) -> StepWeights:
    """The weights, turned with the feet.

    Args:
        params: weights in the sole frames.
        stance: support foot in W.
        steps: n <= N planned footsteps; the cost of others is 1.
        swing: side of the other foot.

    Returns:
        The weights in W.
    """
    costs = np.eye(2 * params.num_steps + 2)
    costs[-2:, -2:] = weight_in_world(params.slack_weight, stance, swing)
    for i, step in enumerate(steps):
        weight = params.step_weights[min(i, len(params.step_weights) - 1)]
        block = slice(2 * i, 2 * i + 2)
        costs[block, block] = weight_in_world(weight, step.pose, step.side)
    return StepWeights(
        costs, R=weight_in_world(params.feedback_weight, stance, swing)
    )


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for N steps.

        minimise    sum |step_i|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        subject to  delta = k_xi (e - sum Gamma_i step_i - eta),
                    the CMP + delta in the support polygon (Eq. 21),
                    the footholds within reach of each other, and each on its
                    region of the ground (Eq. 22).

    Half-spaces replace the paper's multipliers of the corners.  The CMP also
    moves with the footholds while a spline shifts it.  Delta is eliminated.

    Args:
        params: gain and N.
    """

    def __init__(self, params: IcpStepQpParams) -> None:
        self._gain = params.feedback_gain
        self._size = 2 * params.num_steps + 2
        self._qp = DenseQp(self._size)

    def solve(
        self,
        error: Array,
        cmp: Array,
        moves: Array,
        cmp_room: Halfspaces,
        step_room: Halfspaces,
        weights: StepWeights,
    ) -> tuple[Array, QpResult]:
        """Solves the QP of a tick for n <= N footholds.

        Args:
            error: ICP error xi - xi_r (2,) in W [m].
            cmp: reference CMP (2,) in W [m].
            moves: Gamma_i (2, n) of ICP and CMP (Eq. 18) [-].
            cmp_room: limits A p <= b of the CMP, A (k, 2), in W [m].
            step_room: limits of the shifts, A (m, 2 n), in W [m].
            weights: of shifts, delta and eta in W.

        Returns:
            The shifts (n, 2) of the footholds from the planned ones in W [m],
            NaN unless the result is solved; and the result, whose x ends in
            eta (2,), the slack in the ICP error [m].

        Raises:
            ValueError: an argument is not finite.
        """
        A_cmp, b_cmp = cmp_room
        A_steps, b_steps = step_room
        used = 2 * moves.shape[1]
        # x = (steps, eta), and delta = delta_0 + D x by the constraint.
        delta_0 = self._gain * error
        D = np.zeros((2, self._size))
        D[0, 0:used:2] = D[1, 1:used:2] = -self._gain * moves[0]
        D[0, -2] = D[1, -1] = -self._gain
        cmp_D = D.copy()
        cmp_D[0, 0:used:2] += moves[1]
        cmp_D[1, 1:used:2] += moves[1]
        C = np.zeros((len(b_cmp) + len(b_steps), self._size))
        C[: len(b_cmp)] = A_cmp.dot(cmp_D)
        C[len(b_cmp) :, :used] = A_steps
        upper = np.concatenate((b_cmp - A_cmp.dot(cmp + delta_0), b_steps))
        DR = D.T.dot(weights.R)
        result = self._qp.solve(
            QpProblem(
                H=weights.costs + DR.dot(D),
                g=DR.dot(delta_0),
                A=C,
                lower=np.full(len(upper), -np.inf),
                upper=upper,
            )
        )
        return result.x[:used].reshape(-1, 2), result


class AnkleFeedback(NamedTuple):
    """Minimises |delta - K e|^2_M subject to cmp + delta in a polygon.

    This is Eq. 20 for fixed footholds in closed form: eta is eliminated, which
    leaves M = R + Q_eta / k_xi^2 and K = M^-1 Q_eta / k_xi.  In the coordinates
    L' p, where M = L L' but for a factor, it is a projection.
    """

    gain: Array  # K (2, 2)
    root: Array  # L' (2, 2)
    inverse: Array  # of L' (2, 2)
    room: Array  # L' p of the vertices p of the polygon (n, 2) [m]

    def delta(self, error: Array, cmp: Array) -> Array:
        """The feedback of a tick.

        Args:
            error: ICP error e = xi - xi_r (2,) in W [m].
            cmp: reference CMP (2,) in W [m].

        Returns:
            The CMP feedback delta (2,) in W [m].
        """
        goal = self.root.dot(cmp + self.gain.dot(error))
        delta: Array = self.inverse.dot(project(goal, self.room)) - cmp
        return delta


def ankle_feedback(
    room: Array, weights: StepWeights, gain: float
) -> AnkleFeedback:
    """The feedback for fixed footholds, while the feet in contact stand.

    Args:
        room: polygon (n, 2) of the CMP in W [m].
        weights: of delta and eta in W.
        gain: k_xi [-].

    Returns:
        Its matrices, and the polygon in its coordinates.
    """
    slack = weights.costs[-2:, -2:] / gain
    M = weights.R + slack / gain
    # Scaled, so that the root of an isotropic one is exactly I.
    root = np.linalg.cholesky(M / M[0, 0]).T
    inverse = np.linalg.inv(root)
    return AnkleFeedback(
        gain=inverse @ inverse.T @ (slack / M[0, 0]),
        root=root,
        inverse=inverse,
        room=room @ root.T,
    )
