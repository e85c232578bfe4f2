"""How many more steps a pushed robot must take to count as recovered."""

import itertools

from diagrams.run_log import STEPS_TAKEN, Log, pushes
from diagrams.scenario import Scenario
from diagrams.start import initial_walking_state


def required_steps(scenario: Scenario, log: Log) -> tuple[int, int]:
    """Returns how many steps the last push requires, and how many were wanted.

    Wanted are the scenario's `required_steps`, or as many as the gait had left
    to take when the push began: none of a robot that only stands.  Required
    are no more of them than fit between the push and the end of the run, each
    with its own transfer and swing, less one, since a push delays the steps.
    A run without a push is judged from its start.
    """
    start = initial_walking_state(scenario).schedule
    begin, taken = 0.0, 0
    if felt := pushes(log):
        begin = felt[-1].start
        taken = int(log["walking_signal"][felt[-1].first, STEPS_TAKEN])
    left = start.footsteps[taken:]
    wanted = min(scenario.required_steps, len(left))
    ends = itertools.accumulate(
        (step.transfer_duration + step.swing_duration for step in left),
        initial=max(begin, start.duration),  # until then she stands
    )
    gait = scenario.gait
    last = scenario.duration - gait.transfer_duration - gait.swing_duration
    fitting = sum(end <= last + 1e-9 for end in itertools.islice(ends, 1, None))
    return min(wanted, fitting), wanted
