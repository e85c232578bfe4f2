"""Real trials that tests look at: each is simulated once (see run_cache)."""

import math

from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.scripts.envelope_sweep.trial import run_trial
from tests import run_cache
from tests.diagrams.simulated import all_of


def tried(
    walk: Scenario, delta_v: float, direction_deg: float, plant: str = "lipm"
) -> dict:
    """The row of one push, in a scenario with a push of nothing."""

    def run() -> dict:
        text = yaml_dump_typed(walk)
        return run_trial(text, plant, delta_v, direction_deg, math.inf)

    given = f"{all_of(walk, plant)}\n{delta_v!r} {direction_deg!r}"
    return run_cache.once((__name__,), given, run)
