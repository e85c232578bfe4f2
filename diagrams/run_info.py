"""Description of a run, with its criteria of recovery."""

import itertools

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.log import Log, pushes, signal
from nadia_balance.results.summary import Run, RunInfo
from nadia_balance.robot import load_robot

_FIELDS = "robot", "mechanisms", "fidelity", "engine", "seed"  # in RunInfo too
PATIENCE = 8  # largest number of steps of a recovery


def required_calm_steps(scenario: Scenario, log: Log) -> tuple[int, bool]:
    """Returns the required calm steps, and whether the run is long enough.

    The number is the scenario's `calm_steps`, or one less than the steps that
    the gait has left when the last push begins, if that is less; 0 for a robot
    that only stands.  A run is long enough if PATIENCE steps, or all that are
    left, end one step before the end of the run, since a push delays the steps.
    A run without a push is judged from its start.
    """
    robot = load_robot(scenario.robot, scenario.fidelity)
    start = scenario.start(scenario.point_mass(robot)).schedule
    begin, taken = 0.0, 0
    if felt := pushes(log):
        begin = felt[-1].start
        walking = signal(log, "walking_signal", felt[-1].first)
        taken = int(walking.steps_taken)
    left = start.footsteps[taken:]
    required = min(scenario.calm_steps, max(len(left) - 1, 0))
    ends = itertools.accumulate(
        (step.transfer_duration + step.swing_duration for step in left),
        initial=max(begin, start.duration),  # the robot stands until then
    )
    gait = scenario.gait
    last = scenario.duration - gait.transfer_duration - gait.swing_duration
    fitting = sum(end <= last + 1e-9 for end in itertools.islice(ends, 1, None))
    return required, not required or fitting >= min(PATIENCE, len(left))


def run_info(
    scenario: Scenario, run: Run, plant: str = "humanoid", name: str = ""
) -> RunInfo:
    """Returns the RunInfo by which `run`, a run of `scenario`, is judged.

    `plant` is humanoid or lipm, `name` is the scenario's name.
    """
    push = scenario.pushes[0] if scenario.pushes else None
    calm_steps, is_long_enough = required_calm_steps(scenario, run.logs)
    upright = {}
    if scenario.fidelity == "realistic":
        upright["max_torso_tilt_deg"] = scenario.max_torso_tilt_deg
    return RunInfo(
        **{field: getattr(scenario, field) for field in _FIELDS},
        scenario=name,
        plant=plant,
        direction_deg=push.direction_deg if push else None,
        delta_v=push.delta_v if push else None,
        calm_steps=calm_steps,
        is_long_enough=is_long_enough,
        **upright,
    )
