"""Real runs that more than one test looks at: each is simulated once."""

import functools

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.run_info import run_info
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import simulate
from nadia_balance.results.summary import Run, summarize

DIAGRAMS = {"humanoid": HumanoidDiagram, "lipm": LipmDiagram}


def scenario_of(text: str = "{}") -> Scenario:
    """Stands, by ankles and hips alone, but for what the YAML says.

    The point mass has the robot's control period, so that one holds for both.
    """
    usual = ("mechanisms: icp_only, ", "lipm_period: 0.002, ")
    base = "".join(item for item in usual if item.split()[0] not in text)
    return load_scenario("stand", text=f"{{{base}{text[1:]}")


def diagram_of(text: str = "{}", plant: str = "humanoid"):
    """The closed loop of that scenario."""
    return DIAGRAMS[plant](scenario_of(text))


def simulated(text: str = "{}", plant: str = "humanoid") -> Run:
    """What comes out of that scenario; do not change it."""
    return _simulated(text, plant)


@functools.cache
def _simulated(text: str, plant: str) -> Run:
    diagram = diagram_of(text, plant)
    return simulate(diagram, diagram.scenario.duration)


def figures(text: str = "{}", plant: str = "humanoid") -> dict:
    """The summary of that scenario."""
    run = simulated(text, plant)
    return summarize(run, run_info(scenario_of(text), run, plant))
