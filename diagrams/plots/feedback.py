"""What the cost across the ICP error is for (Nadia paper, Fig. 3)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.plots.plan_view import (
    SOLE,
    draw_sole,
    fill,
    note,
    plans,
    share_legend,
)
from diagrams.plots.regions import STANCE, SWING
from diagrams.plots.style import FAINT
from nadia_balance.core.feedback_limits import feedback_limits
from nadia_balance.core.momentum_qp import IcpFeedbackQp, MomentumQpParams
from nadia_balance.core.walking import Array
from nadia_balance.systems import palette

COP_R = np.array([-0.06, -0.02])  # reference, of the eCMP as well [m]
ERROR = np.array([0.05, 0.042])  # of the ICP [m]


def draw_feedback() -> Figure:
    """Fig. 3: the eCMP that the ankles alone give, without and with Q_perp."""
    fig, axes = plans(
        "Without $Q_⊥$: as near as can be",
        "With $Q_⊥$: along the error",
        x=(-0.15, 0.17),
        y=(-0.08, 0.13),
    )
    weights = 0.0, MomentumQpParams().perpendicular_weight
    for ax, weight in zip(axes, weights, strict=True):
        params = MomentumQpParams(
            perpendicular_weight=weight, max_kappa=0.0, rate_weight=0.0
        )
        _draw_one(ax, params)
    share_legend(fig, axes[0])
    return fig


def _draw_one(ax: Axes, params: MomentumQpParams) -> None:
    limits = feedback_limits(
        SOLE, 0.0, params.cop_safe_distance, params.max_kappa
    )
    none = np.zeros(2)
    found = IcpFeedbackQp(params).solve(ERROR, COP_R, none, np.zeros(4), limits)
    asked = params.feedback_gain * ERROR
    draw_sole(ax, STANCE, SWING.other, "support polygon")
    fill(ax, limits.polygon, palette.SUPPORT, "limit of the CoP", 0.0, 0.8)
    _arrow(ax, asked, FAINT)
    _arrow(ax, found.ecmp - COP_R, palette.ECMP)
    dots = {"ls": "none", "mec": "white", "ms": 9}
    ax.plot(*(COP_R + asked), "D", color=FAINT, label="eCMP asked for", **dots)
    ax.plot(*COP_R, "o", color=palette.COP, label="reference", **dots)
    ax.plot(*found.ecmp, "s", color=palette.ECMP, label="eCMP", **dots)
    note(ax, "$k_p\\,ξ_e$", tuple(COP_R + 0.85 * asked + [-0.014, 0.002]))


def _arrow(ax: Axes, way: Array, color: str) -> None:
    """An arrow from the reference."""
    ax.annotate(
        "",
        xy=COP_R + way,
        xytext=COP_R,
        arrowprops={
            "arrowstyle": "-|>,head_width=0.3,head_length=0.6",
            "color": color,
            "linewidth": 2.0,
            "shrinkA": 0,
            "shrinkB": 4,
        },
    )
