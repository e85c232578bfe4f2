"""Oracles: forces written by hand; the schedule of a robot that walks."""

import numpy as np
import pytest

from nadia_balance.core.walking.push import Push
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.results.log import phase_spans
from nadia_balance.systems.contact_clock import ContactClock
from tests.blocks import answer, fix, running
from tests.diagrams.simulated import simulated
from tests.diagrams.test_humanoid import WALK

PERIOD, WEIGHT = 0.01, 100.0
BOTH, LEFT, RIGHT, AIR = (50.0, 50.0), (99.0, 1.0), (1.0, 99.0), (0.0, 0.0)


def states(forces, period=PERIOD, weight=WEIGHT) -> list:
    """The walking states after ticks with these forces on the feet (n, 2)."""
    clock, walking_states = ContactClock(weight, period), []
    simulator, context = running(clock)
    for k, force in enumerate(forces):
        fix(clock, context, foot_forces=force)
        simulator.AdvanceTo((k + 0.5) * period)
        walking_states.append(answer(clock, context, "walking_state"))
    return walking_states


def test_knows_a_phase_when_it_comes_again():
    """Oracle: ticks counted by hand; bounces and flights end no phase.

    The second stride's phases are known by the first one's durations.
    """
    stride = [LEFT] * 40 + [BOTH] * 10 + [RIGHT] * 50 + [BOTH] * 20
    first = [AIR] + [BOTH] * 70 + stride
    bounced = [*stride[:40], BOTH, LEFT, AIR, *stride[43:50]]
    walking_states = states([*first, *bounced, *stride[50:]])
    standing = walking_states[: len(first)]
    assert {s.schedule.phase for s in standing[:-1]} == {Phase.STANDING}
    at = len(first)
    for phase, swing, ticks, steps in (
        (Phase.SWING, Side.RIGHT, 40, 2),
        (Phase.TRANSFER, Side.LEFT, 10, 3),
        (Phase.SWING, Side.LEFT, 50, 3),
        (Phase.TRANSFER, Side.RIGHT, 20, 4),
    ):
        for k in range(ticks):
            state = walking_states[at + k]
            schedule = state.schedule
            assert (schedule.phase, state.steps_taken) == (phase, steps)
            assert schedule.support_side.other is swing
            assert schedule.duration == pytest.approx(ticks * PERIOD)
            assert state.time_in_phase == pytest.approx(k * PERIOD)
        at += ticks


@pytest.mark.parametrize("ticks", [1, 5])
def test_the_next_foot_may_be_lifted_at_once(ticks):
    """Oracle: ticks counted by hand: transfers of 10 and of 50 ms.

    Only the foot that has landed bounces within that time.
    """
    stride = [LEFT] * 40 + [BOTH] * ticks + [RIGHT] * 50 + [BOTH] * 20
    walking_states = states([BOTH] * 70 + 3 * stride)
    landed = 70 + 2 * len(stride) + 40
    for k in range(ticks + 50):
        state = walking_states[landed + k]
        phase = Phase.TRANSFER if k < ticks else Phase.SWING
        assert state.schedule.phase is phase
        assert state.schedule.support_side is Side.RIGHT
        assert state.steps_taken == 5


def test_a_transfer_that_does_not_end_is_standing():
    """Oracle: twice the 0.1 s that the last one of this side took."""
    stride = [LEFT] * 40 + [BOTH] * 10 + [RIGHT] * 50 + [BOTH] * 20
    walking_states = states([*stride, *stride[:40], *[BOTH] * 30])
    phases = [state.schedule.phase for state in walking_states[-30:]]
    assert phases == [Phase.TRANSFER] * 20 + [Phase.STANDING] * 10


def test_means_by_25_percent_what_the_walking_state_machine_means():
    """Oracle: the schedule, to a third of a tenth of a swing: 25 ms.

    The third swing is the first one that is known: of the first one's side.
    """
    logs = simulated(WALK).logs
    walking_states = states(logs["foot_forces"], 0.004, float(logs["weight"]))
    *_, swing = (s for s in phase_spans(logs) if s.phase is Phase.SWING)
    push = Push(force=1.0, at=f"{swing.swing_side.value} swing 25 %")
    due = [push.is_due(0.0, state, 0.004) for state in walking_states]
    planned = swing.start + 0.25 * (swing.end - swing.start)
    assert logs["t"][np.argmax(due)] == pytest.approx(planned, abs=0.025)
