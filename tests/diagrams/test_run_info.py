"""Oracles: the times of a gait of 0.3 s transfers and 0.7 s swings, by hand.

It stands for 0.5 s, and the first transfer takes 0.8 s.
"""

import numpy as np
import pytest

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import required_calm_steps
from nadia_balance.results import signal
from nadia_balance.robot.model import load_robot

PERIOD, NADIA = 0.002, load_robot("nadia")
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
    ("text", "push", "answer"),
    [
        # The scenario as it is: 10 of 10.5 s, less one, are more than eight.
        ("{}", IN_SWING, (2, True)),
        ("{duration: 12.476}", IN_SWING, (2, True)),
        ("{duration: 12.474}", IN_SWING, (2, False)),
        ("{calm_steps: 0, duration: 4.0}", IN_SWING, (0, True)),
        # Steps of 0.5 s: 9 of 4.524 s.
        ("{duration: 8.0, gait: {swing_duration: 0.2}}", IN_SWING, (2, True)),
        # The gait ends before: four steps are left, or two, or none.
        ("{duration: 8.6, gait: {num_steps: 6}}", IN_SWING, (2, True)),
        ("{duration: 8.4, gait: {num_steps: 6}}", IN_SWING, (2, False)),
        ("{gait: {num_steps: 4}}", IN_SWING, (1, True)),
        ("{gait: {num_steps: 0}, pushes: []}", (1.0, 0), (0, True)),
    ],
)
def test_requires_what_the_gait_and_the_time_allow(text, push, answer):
    scenario = load_scenario("push", text=text)
    assert required_calm_steps(scenario, NADIA, log_of(push)) == answer


@pytest.mark.parametrize("rows", [7000, 0])
def test_without_a_push_a_run_is_judged_from_its_start(rows):
    """Oracle: it lands at 2, 3, ... s; Ctrl-C may come at once."""
    log = {name: array[:rows] for name, array in log_of().items()}
    for duration, is_long_enough in (9.9, False), (10.1, True):
        text = f"{{duration: {duration}}}"
        scenario = load_scenario("push", text=text)
        assert required_calm_steps(scenario, NADIA, log) == (2, is_long_enough)
