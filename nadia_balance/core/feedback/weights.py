"""Weights of vectors in the plane: matrices, given in the frame of a foot."""

import math

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.parameters.bounds import require

Weight = list[list[float]]  # W (2, 2), as in YAML

_ROUNDING = 1e-9  # of an eigenvalue, relative to the largest


def isotropic(weight: float) -> Weight:
    """The weight w I, alike in all directions.

    Args:
        weight: w.

    Returns:
        The matrix.
    """
    return [[weight, 0.0], [0.0, weight]]


def check_weight(name: str, weight: Weight, definite: bool = False) -> None:
    """Requires a symmetric matrix without a negative eigenvalue.

    Args:
        name: of the weight, which the message begins with.
        weight: the matrix.
        definite: none may be 0 either.

    Raises:
        ValueError: it is none.
    """
    fits = [len(row) for row in weight] == [2, 2]
    if fits:
        lowest, largest = np.linalg.eigvalsh(weight).tolist()
        margin = _ROUNDING * max(largest, _ROUNDING)
        least = margin if definite else -margin
        fits = weight[0][1] == weight[1][0] and lowest >= least
    kind = "definite" if definite else "semidefinite"
    require(
        fits,
        f"{name} = {weight}: must be [[a, b], [b, c]], symmetric and positive "
        f"{kind}",
    )


def weight_in_world(weight: Weight, foot: FootPose, swing: Side) -> Array:
    """A weight in W, of one in a sole frame: R S W S R', S = diag(1, +-1).

    It is written with double angles, as in Mohr's circle, so that a weight
    that is alike in all directions remains exactly what it is.

    Args:
        weight: W in the sole frame, x forward, y toward the swing side.
        foot: pose of the sole in W, of which the yaw counts.
        swing: the swing side; for the right one y is mirrored.

    Returns:
        The weight (2, 2) in W.
    """
    (a, b), (_, c) = weight
    mean, half, mixed = 0.5 * (a + c), 0.5 * (a - c), swing.sign * b
    cos, sin = math.cos(2.0 * foot.yaw), math.sin(2.0 * foot.yaw)
    along = half * cos - mixed * sin
    across = half * sin + mixed * cos
    return np.array([[mean + along, across], [across, mean - along]])
