"""Oracle: core.steps.swing_foot, called with the same values."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.steps.swing_clearance import edges_on_way
from nadia_balance.core.steps.swing_foot import (
    FootMotion,
    SwingFootParams,
    swing_foot_motion,
    velocity_now,
)
from nadia_balance.core.walking.vocabulary import WalkingState
from nadia_balance.systems.swing_foot_planner import SwingFootPlanner
from tests import example_walks
from tests.blocks import answer, asked
from tests.core.body.test_ground import square
from tests.example_walks import MODEL

PERIOD, LEAD, PARAMS = 0.002, 0.005, SwingFootParams()
OUTPUT = "swing_foot_reference"


@pytest.fixture
def planner():
    return SwingFootPlanner(PARAMS, MODEL, PERIOD, LEAD)


def swing(t):
    """The right foot swings 0.3 m forward."""
    return WalkingState(example_walks.swing(), t)


def test_continues_from_the_last_reference(planner):
    """Oracle: the core function, from the discrete state."""
    context = asked(planner, walking_state=swing(0.2))
    last = np.array([0.1, -0.1, 0.05, 0.5, 0, 0, 0, 0, 0, 0.1, 0, 0])
    context.SetDiscreteState(np.concatenate((np.zeros(12), last)))
    _, expected = swing_foot_motion(
        FootMotion.from_vector(last), swing(0.2), PERIOD, PARAMS, MODEL, LEAD
    )
    found = answer(planner, context, OUTPUT)
    expected = velocity_now(expected.as_vector(), LEAD)
    assert found == pytest.approx(expected, abs=1e-15)


def test_lifts_the_foot_over_the_edges_of_its_model():
    """Oracle: the core functions, with the edges of this swing."""
    regions = square("low"), square("high", x=0.5, height=0.2)
    model = replace(MODEL, ground=Ground(regions, MODEL.sole))
    planner, state = SwingFootPlanner(PARAMS, model, PERIOD), swing(0.2)
    edges = edges_on_way(state.schedule, model, PARAMS.clearance)
    assert edges is not None
    last = np.array([0.0, -0.125, 0.05, 0, 0, 0.5, 0, 0, 0, 0, 0, 0])
    context = asked(planner, walking_state=state)
    context.SetDiscreteState(np.concatenate((np.zeros(12), last)))
    expected, _ = swing_foot_motion(
        FootMotion.from_vector(last), state, PERIOD, PARAMS, model, edges=edges
    )
    found = answer(planner, context, OUTPUT)
    assert found == pytest.approx(expected.as_vector(), abs=1e-15)
