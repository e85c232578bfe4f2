"""Oracles: messages by hand; the same vector, seen from the foot."""

import numpy as np
import pytest

from nadia_balance.core.feedback.weights import check_weight, weight_in_world
from nadia_balance.core.walking.state import FootPose, Side

THIRD = 1.0 / 3.0


@pytest.mark.parametrize(
    ("weight", "definite", "allowed"),
    [
        ([[1.0, 0.5], [0.0, 1.0]], False, False),  # not symmetric
        ([[1.0, 2.0], [2.0, 3.9]], False, False),  # b^2 > a c
        ([[-1.0, 0.0], [0.0, -1.0]], False, False),
        ([[1.0], [0.0, 1.0]], False, False),
        ([[0.0, 0.0], [0.0, 0.0]], False, True),
        ([[0.0, 0.0], [0.0, 0.0]], True, False),
        ([[0.9, 0.3], [0.3, 0.1]], False, True),  # b^2 = a c but for rounding
        ([[0.9, 0.3], [0.3, 0.1]], True, False),
        ([[0.9, -0.3], [-0.3, 0.2]], True, True),
    ],
    ids=str,
)
def test_a_weight_is_symmetric_and_positive(weight, definite, allowed):
    """Oracle: a, c >= 0 and b^2 <= a c; the message names value and rule."""
    if allowed:
        check_weight("R", weight, definite)
        return
    kind = "definite" if definite else "semidefinite"
    with pytest.raises(ValueError) as error:
        check_weight("R", weight, definite)
    assert str(error.value) == (
        f"R = {weight}: must be [[a, b], [b, c]], symmetric and positive {kind}"
    )


@pytest.mark.parametrize("side", Side)
def test_a_weight_turns_with_the_foot(side):
    """Oracle: v' W v of v in the sole frame; exact if W is isotropic."""
    foot, weight = FootPose(yaw=2.2), np.array([[4.0, 1.5], [1.5, 9.0]])
    in_world = weight_in_world(weight.tolist(), foot, side)
    for v in np.random.default_rng(1).normal(size=(5, 2)):
        seen = foot.rotation.T @ v * [1.0, side.sign]
        assert v @ in_world @ v == pytest.approx(seen @ weight @ seen)
    alike = [[THIRD, 0.0], [0.0, THIRD]]
    assert (weight_in_world(alike, foot, side) == alike).all()
