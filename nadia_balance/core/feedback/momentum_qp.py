"""ICP feedback by ankles and hips, one quadratic program (Nadia, Sec. III)."""

import functools
import math
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import halfspaces, shrink
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.parameters.bounds import bounded, parameters, require

_KEPT = 8  # limits: a foothold that moves changes none


@parameters
class MomentumQpParams:
    """Gain, weights and limits of the Nadia paper's Eqs. 6-8.

    Erratum: the paper's k_p is the total gain, unstable below 1.
    """

    feedback_gain: float = bounded(
        3.0, doc="k_p: eCMP offset per ICP error", above=1.0
    )
    error_weight: float = bounded(
        1e3, doc="Q_e: weight of the feedback's error", above=0.0
    )
    perpendicular_weight: float = bounded(
        1e3,
        doc="Q_perp: weight of the feedback across the ICP error; with more, "
        "an axis at the sole's edge holds back the other one",
        least=0.0,
    )
    cop_weight: float = bounded(
        3.0, doc="R_delta: weight of the CoP's feedback", above=0.0
    )
    ecmp_weight: float = bounded(
        90.0,
        doc="R_kappa: weight of the feedback by angular momentum; larger than "
        "R_delta: ankles are preferred to hips",
        above=0.0,
    )
    rate_weight: float = bounded(
        100.0, doc="R_p: weight of the feedback's change per tick", least=0.0
    )
    small_error: float = bounded(
        1e-3,
        doc="ICP error below which its direction is noise: the cost of "
        "perpendicular feedback fades out",
        above=0.0,
        unit="m",
    )
    max_kappa: float = bounded(
        0.05,
        doc="bound on eCMP - CoP, along and across the foot",
        least=0.0,
        unit="m",
    )
    cop_safe_distance: float = bounded(
        0.005,
        doc="margin of the CoP to the edge of the support polygon",
        least=0.0,
        unit="m",
        of="sole_width",
    )

    def validate_more(self) -> None:
        """Checks that the weights leave enough of the gain.

        Raises:
            ValueError: the effective gain is not > 1.
        """
        require(
            self.effective_gain > 1.0,
            f"error_weight = {self.error_weight}: must be larger beside "
            f"cop_weight = {self.cop_weight} and a feedback_gain of "
            f"{self.feedback_gain}: {self.effective_gain:.2f} are left",
        )

    @property
    def effective_gain(self) -> float:
        """Feedback gain as reduced by the weights on delta and kappa [-]."""
        effort = 1.0 / (1.0 / self.cop_weight + 1.0 / self.ecmp_weight)
        return self.feedback_gain * (
            self.error_weight / (self.error_weight + effort)
        )


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
    """A cop <= b, |R(heading)' kappa| <= max_kappa (Nadia paper, Eq. 8).

    Args:
        support: support polygon (n, 2) in W [m].
        heading: yaw of the stance foot in W [rad].
        params: margin of the CoP, and max_kappa.

    Returns:
        The limits of CoP and kappa in W.

    Raises:
        ValueError: the margin leaves no area of the polygon.
    """
    return _limits(
        support.tobytes(),
        heading,
        margin=params.cop_safe_distance,
        max_kappa=params.max_kappa,
    )


@functools.lru_cache(_KEPT)
def _limits(
    support: bytes, heading: float, margin: float, max_kappa: float
) -> FeedbackLimits:
    """Returns the `feedback_limits`, of the bytes of the support polygon."""
    vertices = np.frombuffer(support).reshape(-1, 2)
    polygon = shrink(vertices, margin, "cop_safe_distance")
    A, b = halfspaces(polygon)
    c, s = math.cos(heading), math.sin(heading)
    C = np.zeros((len(A) + 2, 4))
    C[:-2, :2] = A
    C[-2:, 2:] = [[c, s], [-s, c]]
    return FeedbackLimits(
        polygon,
        C,
        lower=np.append(np.full(len(A), -np.inf), 2 * [-max_kappa]),
        upper=np.append(b, 2 * [max_kappa]),
    )


class IcpFeedback(NamedTuple):
    """The feedback increments, and the resulting CoP and eCMP in W [m]."""

    increments: Array  # (4,): delta, of the CoP, and kappa, of eCMP - CoP
    cop: Array  # (2,): r_cop,d
    ecmp: Array  # (2,): r_ecmp,d
    result: QpResult


class IcpFeedbackQp:
    """The quadratic program of the Nadia paper's Eq. 8, in increments.

    With the ICP error e, n = e turned by 90 deg and K the feedback gain:

        minimise    |delta + kappa - K e|^2_Qe + |n . (delta + kappa)|^2_Qperp
                    + |delta|^2_Rd + |kappa|^2_Rk
                    + |delta + kappa - previous|^2_Rp
        subject to  r_cop,r + delta in the support polygon,
                    |kappa_r + kappa| <= max_kappa along and across the foot.

    Erratum: as printed, the Q_perp term penalises the feedback along e.
    Erratum: the printed R_kappa term mixes the total kappa with increments;
    here R_kappa acts on the increment, and the limits on the total.

    Args:
        params: gain and weights.
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
        """Solves the QP of a tick.

        Args:
            error: ICP error icp - icp_r (2,) in W [m].
            cop_r: reference CoP (2,) in W [m].
            kappa_r: reference ecmp_r - cop_r (2,) in W [m].
            previous: increments (4,) of the last tick [m].
            limits: of CoP and kappa.

        Returns:
            The feedback; if the QP has no solution, with the `previous`
            increments, and `result.solved` is False.

        Raises:
            ValueError: an argument is not finite.
        """
        H, g = self._cost(error, previous)
        shift = limits.C @ np.concatenate((cop_r, kappa_r))
        lower, upper = limits.lower - shift, limits.upper - shift
        result = self._qp.solve(QpProblem(H, g, limits.C, lower, upper))
        x = result.x if result.solved else previous
        cop = cop_r + x[:2]
        return IcpFeedback(
            x, cop=cop, ecmp=cop + kappa_r + x[2:], result=result
        )

    def _cost(self, error: Array, previous: Array) -> tuple[Array, Array]:
        """Returns H (4, 4) and g (4,) of the cost 1/2 x'Hx + g'x."""
        p = self._params
        ex, ey = error.tolist()
        length = max(math.hypot(ex, ey), p.small_error)
        nx, ny = -ey / length, ex / length
        diagonal = p.error_weight + p.rate_weight
        q, d, k = p.perpendicular_weight, p.cop_weight, p.ecmp_weight
        xx, xy, yy = diagonal + q * nx * nx, q * nx * ny, diagonal + q * ny * ny
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
    """l_dot = (m omega^2 (com - ecmp), m zddot) (Nadia paper, Eq. 5).

    The vertical ground force is m (g + zddot).
    Erratum: g is a vector; it cancels the vertical part at constant height.

    Args:
        com: CoM (2,) in W [m].
        ecmp: eCMP (2,) in W [m].
        vertical_acceleration: zddot of the CoM [m/s^2].
        model: mass m and natural frequency omega.

    Returns:
        The linear momentum rate (3,) in W [N].
    """
    k = model.mass * model.omega**2
    x, y = (k * (com - ecmp)).tolist()
    return np.array((x, y, model.mass * vertical_acceleration))
