"""Oracles: the rule itself, by its own tests; the wrench by hand."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.systems.whole_body import FrictionEstimator
from tests.blocks import answer, running, tick
from tests.whole_body_examples import nadia, standing_state, terms_at

PERIOD = 0.002
WEIGHT = nadia().mass * 9.81


def estimated(force, velocity, ticks, rpy=(0.0, 0.0, 0.0)):
    """The friction while the right sole, turned by `rpy`, bears the weight.

    `force` (3,) [weights] and `velocity` (3,) [m/s] are in its frame.
    """
    terms = terms_at(standing_state())
    R_WF = RollPitchYaw(*rpy).ToRotationMatrix().matrix()
    velocities, rotations = terms.velocities.copy(), terms.rotations.copy()
    velocities[9:12], rotations[1] = R_WF @ velocity, R_WF
    wrenches = np.zeros(12)
    wrenches[9:] = WEIGHT * (R_WF @ force)
    system = FrictionEstimator(WholeBodyQpParams(), nadia().point_mass, PERIOD)
    simulator, context = running(
        system,
        whole_body_terms=terms._replace(
            velocities=velocities, rotations=rotations
        ),
        foot_wrenches=wrenches,
    )
    for _ in range(ticks):
        tick(simulator, PERIOD)
    return answer(system, context, "friction")[0]


@pytest.mark.parametrize(
    "rpy", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.7), (0.4, -0.3, 2.0)]
)
def test_a_sole_that_slips_lowers_the_friction_once_it_has_settled(rpy):
    """Oracle: 0.9 of 0.5, after 15 ticks of 2 ms; no slip, no change.

    In the sole's frame, however it is turned: along its normal is no slip.
    """
    sideways, forward = [0.1, 0.5, 1.0], [0.4, 0.0, 0.1]
    assert estimated(sideways, forward, 10, rpy) == 0.6
    assert estimated(sideways, forward, 20, rpy) == pytest.approx(0.45)
    assert estimated(sideways, [0.1, 0.0, 0.4], 20, rpy) == 0.6
