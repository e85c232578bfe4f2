"""Oracles: the times of a gait of 0.3 s transfers and 0.7 s swings, by hand.

It stands for 0.5 s, and the first transfer takes 0.8 s.
"""

import numpy as np
import pytest

from nadia_balance.diagrams.run_info import required_steps
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.results.log import signal

PERIOD = 0.002
SIZES = {"walking_signal": 16, "push_signal": 6}


def log_of(*pushes: tuple[float, int]) -> dict[str, np.ndarray]:
    """A log of 14 s with these pushes: (start [s], steps taken by then)."""
    t = PERIOD * np.arange(7000)
    log = {name: np.zeros((len(t), n)) for name, n in SIZES.items()} | {"t": t}
    for number, (start, taken) in enumerate(pushes, start=1):
        first = round(start / PERIOD)
        signal(log, "walking_signal").steps_taken[first:] = taken
        push = signal(log, "push_signal", slice(first + 1, first + 51))
        push.number[:], push.force_y[:] = number, 300.0
    return log


IN_SWING = (3.476, 2)  # 25 % of the third swing


@pytest.mark.parametrize(
    ("text", "push", "steps"),
    [
        # The scenario as it is: 10 of 10.5 s, less one, are more than eight.
        ("{}", IN_SWING, (8, 8)),
        ("{duration: 12.474}", IN_SWING, (8, 7)),
        ("{duration: 8.0}", IN_SWING, (8, 3)),
        ("{duration: 4.0}", IN_SWING, (8, 0)),  # not even one
        ("{required_steps: 3, duration: 8.0}", IN_SWING, (3, 3)),
        # Steps of 0.5 s: 9 of 4.524 s.
        ("{duration: 8.0, gait: {swing_duration: 0.2}}", IN_SWING, (8, 8)),
        # The gait ends before.
        ("{gait: {num_steps: 6}}", IN_SWING, (4, 4)),
        ("{gait: {num_steps: 0}, pushes: []}", (1.0, 0), (0, 0)),
        # It stands until 0.5 s, and lands at 2, 3, 4 s.
        ("{duration: 4.0}", (0.1, 0), (8, 2)),
    ],
)
def test_requires_what_the_gait_and_the_time_allow(text, push, steps):
    scenario = load_scenario("push", text=text)
    assert required_steps(scenario, log_of(push)) == steps


def test_the_last_push_counts():
    """Oracle: as if the first had not been."""
    scenario = load_scenario("push", text="{gait: {num_steps: 12}}")
    first, last = (1.7, 0), (7.4, 6)
    assert required_steps(scenario, log_of(first)) == (8, 8)
    assert required_steps(scenario, log_of(first, last)) == (6, 5)


def test_without_a_push_all_steps_count():
    """Oracle: it lands at 2, 3, ... s; a push of nothing leaves no trace."""
    scenario = load_scenario("push", text="{duration: 6.0}")
    assert required_steps(scenario, log_of()) == (8, 4)


def test_a_run_that_logged_nothing_has_an_answer():
    """Oracle: as a run without a push; Ctrl-C may come at once."""
    scenario = load_scenario("push")
    nothing = {name: array[:0] for name, array in log_of().items()}
    assert required_steps(scenario, nothing) == (8, 8)
