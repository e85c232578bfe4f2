"""Oracles: the rule itself, by its own tests; the wrench by hand."""

import numpy as np
import pytest

from nadia_balance.core.whole_body_command import WholeBodyQpParams
from nadia_balance.systems.friction_estimator import FrictionEstimator
from tests.blocks import answer, running, tick
from tests.whole_body_examples import nadia, standing_state, terms_at

PERIOD = 0.002
WEIGHT = nadia().mass * 9.81


def estimated(f_y, speed, ticks):
    """The friction while the right sole bears the weight and f_y [weights]."""
    terms = terms_at(standing_state())
    velocities = terms.velocities.copy()
    velocities[9] = speed  # of the right sole, forward
    wrenches = np.zeros(12)
    wrenches[10:] = WEIGHT * np.array([f_y, 1.0])
    system = FrictionEstimator(WholeBodyQpParams(), nadia().mass, PERIOD)
    simulator, context = running(
        system,
        whole_body_terms=terms._replace(velocities=velocities),
        foot_wrenches=wrenches,
    )
    for _ in range(ticks):
        tick(simulator, PERIOD)
    return answer(system, context, "friction")[0]


def test_a_sole_that_slips_lowers_the_friction_once_it_has_settled():
    """Oracle: 0.9 of 0.5, after 15 ticks of 2 ms; no slip, no change."""
    assert estimated(0.5, 0.4, 10) == 0.6
    assert estimated(0.5, 0.4, 20) == pytest.approx(0.45)
    assert estimated(0.5, 0.1, 20) == 0.6
