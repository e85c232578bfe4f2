"""Oracles: the simulation itself; the walking state, tick by tick."""

import numpy as np
import pytest

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.tick_replay import record_push, replay
from tests.diagrams.simulated import scenario_of

SCENARIO = """{mechanisms: all_with_cross_over,
    gait: {num_steps: 4, standing_duration: 0.1},
    pushes: [{delta_v: 0.6, at: right swing 25 %, direction_deg: 90.0}]}"""


@pytest.fixture(scope="module")
def pushed():
    """The scenario, and what its controller got, 0.2 s beyond the push."""
    scenario = scenario_of(SCENARIO)
    return scenario, record_push(scenario, 0.2)


def test_a_replay_repeats_the_run_to_the_last_bit(pushed):
    """Oracle: the torques that were logged."""
    scenario, ticks = pushed
    times, torques = replay(HumanoidDiagram(scenario).controller, ticks)
    assert np.array_equal(torques, ticks.actuation)
    assert times.shape == ticks.pushed.shape and np.all(times > 0.0)


def test_tells_the_ticks_of_walking_and_of_the_push(pushed):
    """Oracles: by hand, 0.1 s of standing; what comes after the first one."""
    _, ticks = pushed
    assert not ticks.walks[0] and ticks.walks[ticks.pushed].all()
    first = int(np.argmax(ticks.pushed))
    assert ticks.pushed[first:].all() and ticks.pushed.sum() == 50
    assert np.argmax(ticks.walks) == pytest.approx(25, abs=2)


def test_tells_the_ticks_that_move_the_foothold(pushed):
    """Oracle: the foothold in the log, one tick after the other.

    The push lasts for some ticks, and the foothold is moved in a few of them;
    where the next swing begins, its foothold is another one, not moved.
    """
    _, ticks = pushed
    targets = ticks.walking_signal[:, 12:15]
    moving = np.flatnonzero(ticks.moves)
    assert moving.size and ticks.pushed[moving].all()
    for tick in moving:
        assert np.abs(targets[tick + 1] - targets[tick]).max() > 1e-3
