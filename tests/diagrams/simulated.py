"""Real runs that tests look at: each is simulated once (see run_cache)."""

from dataclasses import replace
from pathlib import Path

from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import closed_loop, simulate
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.results.summary import Run
from nadia_balance.robot.model import load_robot_params
from tests import run_cache

# Fields of a scenario by which the first foot is lifted at 0.45 s already.
EARLY = "gait: {%s, initial_transfer_duration: 0.4, standing_duration: 0.05}"
SOON = EARLY % "num_steps: 2, first_swing: %s"


def scenario_of(text: str = "{}") -> Scenario:
    """Stands, by ankles and hips alone, but for what the YAML says."""
    base = "" if "mechanisms:" in text else "mechanisms: icp_only, "
    return load_scenario("stand", text=f"{{{base}{text[1:]}")


def soon(scenario: Scenario) -> Scenario:
    """The scenario, in which the first foot is lifted at 0.45 s already."""
    gait = replace(
        scenario.gait, initial_transfer_duration=0.4, standing_duration=0.05
    )
    return scenario.changed(gait=gait)


def soon_pushed(text: str = "{}") -> Scenario:
    """The scenario `push`, in the first swing, until the middle of the next.

    It has what the YAML says, too.  The foot moves, and lands at 0.97 s.
    """
    scenario = soon(load_scenario("push", text=text, duration=1.2))
    scenario.pushes[0].after_steps = 0
    return scenario


def diagram_of(text: str = "{}", plant: str = "humanoid"):
    """The closed loop of that scenario."""
    return closed_loop(scenario_of(text), plant)


def simulated(text: str = "{}", plant: str = "humanoid") -> Run:
    """What comes out of that scenario."""
    return run_of(scenario_of(text), plant)


def run_of(scenario: Scenario, plant: str = "humanoid") -> Run:
    """What comes out of a scenario; nobody can change it."""

    def run() -> Run:
        done = simulate(closed_loop(scenario, plant), scenario.duration)
        if done.interrupted:
            raise KeyboardInterrupt
        return done

    found = run_cache.once(__name__, all_of(scenario, plant), run)
    for values in found.logs.values():
        values.flags.writeable = False
    return found


def all_of(scenario: Scenario, plant: str) -> str:
    """The scenario, and all that is in the files that it names."""
    params, urdf = load_robot_params(scenario.robot)
    files = filter(Path.is_file, [urdf, Path(scenario.terrain.name)])
    texts = [path.read_text(encoding="utf-8") for path in files]
    dumped = map(dump, (scenario, params))
    return "\n".join([plant, *dumped, *texts])
