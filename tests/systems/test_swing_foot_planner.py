"""Oracle: core.steps.swing_foot, called with the same values."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.swing_detour import edges_on_way
from nadia_balance.core.steps import swing_foot
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.systems.steps import SwingFootPlanner
from tests.blocks import answer, asked
from tests.core.body.test_ground import square
from tests.example_walks import MODEL, swing

PERIOD, PARAMS = 0.002, swing_foot.SwingFootParams()
LAST = np.array([0.0, -0.125, 0.05, 0.1, 0.5, 0, 0.5, 0, 0, 0, 0, 0])


@pytest.mark.parametrize("lead", [0.0, 0.005])
def test_continues_from_the_last_motion_over_the_edges_of_its_model(lead):
    """Oracle: the core functions, with the edges of this swing."""
    regions = square("low"), square("high", x=0.5, height=0.2)
    model = replace(MODEL, ground=Ground(regions, MODEL.sole))
    planner = SwingFootPlanner(PARAMS, model, PERIOD, lead)
    state = WalkingState(swing(), 0.2)  # 0.3 m forward
    edges = edges_on_way(state.schedule, model.ground, PARAMS.clearance)
    assert edges is not None
    context = asked(planner, walking_state=state)
    context.SetDiscreteState(np.concatenate((np.zeros(12), LAST)))
    foot = swing_foot.SwingFoot(PARAMS, model, PERIOD, lead)
    _, ahead = foot.motion(LAST.reshape(3, 4), state, edges)
    expected = swing_foot.as_reference(ahead, lead)
    reference = answer(planner, context, "swing_foot_reference")
    assert reference == pytest.approx(expected, abs=1e-15)
