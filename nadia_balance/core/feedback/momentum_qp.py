"""ICP feedback by ankles and hips, one quadratic program (Nadia, Sec. III)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import halfspaces, shrink
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.parameters.bounds import bounded


@dataclass(kw_only=True)
class MomentumQpParams:
    """Gain, weights and limits of the Nadia paper's Eqs. 6-8."""

    # k_p: eCMP offset per ICP error [-].
    # Erratum: the paper's k_p is the total gain, unstable below 1.
    feedback_gain: float = bounded(3.0, above=1.0)
    error_weight: float = bounded(1e3, above=0.0)  # Q_e
    # Q_perp.  With more, an axis at the sole's edge holds back the other one.
    perpendicular_weight: float = bounded(1e3, least=0.0)
    cop_weight: float = bounded(3.0, above=0.0)  # R_delta
    # R_kappa, larger than R_delta: ankles are preferred to hips.
    ecmp_weight: float = bounded(90.0, above=0.0)
    rate_weight: float = bounded(100.0, least=0.0)  # R_p, on changes per tick
    # Below this ICP error its direction is noise: the cost of perpendicular
    # feedback fades out.
    small_error: float = bounded(1e-3, above=0.0, unit="m")
    # Bound on eCMP - CoP, along and across the foot.
    max_kappa: float = bounded(0.05, least=0.0, unit="m")
    # Margin of the CoP to the edge of the support polygon.
    cop_safe_distance: float = bounded(
        0.005, least=0.0, unit="m", of="sole_width"
    )

    def validate_more(self) -> None:
        """Raises ValueError if the weights leave too little of the gain."""
        if not self.effective_gain > 1.0:
            raise ValueError(
                f"error_weight = {self.error_weight}: must be larger beside "
                f"cop_weight = {self.cop_weight} and a feedback_gain of "
                f"{self.feedback_gain}: {self.effective_gain:.2f} are left"
            )

    @property
    def effective_gain(self) -> float:
        """Feedback gain as reduced by the weights on delta and kappa [-]."""
        effort = 1.0 / (1.0 / self.cop_weight + 1.0 / self.ecmp_weight)
        share = self.error_weight / (self.error_weight + effort)
        return self.feedback_gain * share


class FeedbackLimits(NamedTuple):
    """The constraints of the Nadia paper's Eq. 8 for constant contacts.

    lower <= C (cop, kappa) <= upper, with the total kappa = ecmp - cop: the
    CoP is in the `polygon` (n, 2) [m] in W, and kappa within +-max_kappa along
    and across the foot, the last two rows of C (n + 2, 4).
    """

    polygon: Array
    C: Array
    lower: Array
    upper: Array


def feedback_limits(
    support: Array, heading: float, params: MomentumQpParams
) -> FeedbackLimits:
    """Returns the limits for a support polygon (n, 2) [m] in W.

    `heading` is the yaw [rad] of the foot.

    Raises ValueError: the margin leaves no area of the polygon.
    """
    polygon = shrink(support, params.cop_safe_distance, "cop_safe_distance")
    A, b = halfspaces(polygon)
    c, s = math.cos(heading), math.sin(heading)
    C = np.zeros((len(A) + 2, 4))
    C[:-2, :2], C[-2:, 2:] = A, [[c, s], [-s, c]]
    upper = np.append(b, 2 * [params.max_kappa])
    lower = np.append(np.full(len(A), -np.inf), 2 * [-params.max_kappa])
    return FeedbackLimits(polygon, C, lower, upper)


class IcpFeedback(NamedTuple):
    """The feedback increments, and the resulting CoP and eCMP in W [m]."""

    increments: Array  # (4,): delta, of the CoP, and kappa, of eCMP - CoP
    cop: Array  # (2,): r_cop,d
    ecmp: Array  # (2,): r_ecmp,d
    result: QpResult


class IcpFeedbackQp:
    """The quadratic program of the Nadia paper's Eq. 8, in increments.

    With the ICP error e, n = e turned by 90 deg and K the feedback gain:

        min   |delta + kappa - K e|^2_Qe + |n . (delta + kappa)|^2_Qperp
              + |delta|^2_Rd + |kappa|^2_Rk + |delta + kappa - previous|^2_Rp
        s.t.  r_cop,r + delta in the support polygon,
              |kappa_r + kappa| <= max_kappa along and across the foot.

    Erratum: as printed, the Q_perp term penalises the feedback along e.
    Erratum: the printed R_kappa term mixes the total kappa with increments;
    here R_kappa acts on the increment, and the limits on the total.
    """

    def __init__(self, params: MomentumQpParams) -> None:
        self._params = params
        self._qp = DenseQp(4)

    def solve(
        self,
        error: Array,
        cop_r: Array,
        kappa_r: Array,
        previous: Array,
        limits: FeedbackLimits,
    ) -> IcpFeedback:
        """Returns the feedback for the ICP error icp - icp_r, (2,) [m] in W.

        `cop_r` and `kappa_r` = ecmp_r - cop_r (2,) [m] are the reference,
        `previous` (4,) [m] the increments of the last tick.  If the QP has no
        solution, they are used again, and `result.solved` is False.

        Raises ValueError: an argument is not finite.
        """
        H, g = self._cost(error, previous)
        shift = limits.C @ np.concatenate((cop_r, kappa_r))
        lower, upper = limits.lower - shift, limits.upper - shift
        result = self._qp.solve(QpProblem(H, g, limits.C, lower, upper))
        x = result.x if result.solved else previous
        cop = cop_r + x[:2]
        return IcpFeedback(x, cop, cop + kappa_r + x[2:], result)

    def _cost(self, error: Array, previous: Array) -> tuple[Array, Array]:
        """Returns H (4, 4) and g (4,) of the cost 1/2 x'Hx + g'x."""
        p = self._params
        ex, ey = float(error[0]), float(error[1])
        length = max(math.hypot(ex, ey), p.small_error)
        nx, ny = -ey / length, ex / length
        both, q = p.error_weight + p.rate_weight, p.perpendicular_weight
        xx, xy, yy = both + q * nx * nx, q * nx * ny, both + q * ny * ny
        d, k = p.cop_weight, p.ecmp_weight
        H = np.array(
            [
                [xx + d, xy, xx, xy],
                [xy, yy + d, xy, yy],
                [xx, xy, xx + k, xy],
                [xy, yy, xy, yy + k],
            ]
        )
        dx, dy, kx, ky = previous.tolist()
        gain = p.error_weight * p.feedback_gain
        gx = -gain * ex - p.rate_weight * (dx + kx)
        gy = -gain * ey - p.rate_weight * (dy + ky)
        return H, np.array([gx, gy, gx, gy])


def momentum_rate(
    com: Array, ecmp: Array, vertical_acceleration: float, model: PointMassModel
) -> Array:
    """Returns the linear momentum rate (3,) [N] in W (Nadia paper, Eq. 5).

    The rate is m omega^2 (x - r_ecmp) horizontally (`com`, `ecmp` (2,) [m])
    and m zddot vertically; the vertical ground force is m (g + zddot).
    Erratum: g is a vector; it cancels the vertical part at constant height.
    """
    (x, y), (ecmp_x, ecmp_y) = com.tolist(), ecmp.tolist()
    k = model.mass * model.omega**2
    return np.array(
        [k * (x - ecmp_x), k * (y - ecmp_y), model.mass * vertical_acceleration]
    )
