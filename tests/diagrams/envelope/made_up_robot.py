"""A robot whose limits are known, which takes no time to try."""

import random
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_plan import Sweep
from diagrams.scenario import Scenario, load_scenario
from nadia_balance.typed_yaml import load_typed

LIMITS = {"icp_only": 0.2, "step": 0.5}  # forward [m/s]
WEAKER = 0.04  # is every second replica [m/s]


def made_up_sweep(**changes) -> Sweep:
    """Six cells, coarsely."""
    fields = {
        "directions": (0.0, 90.0, 210.0),
        "mechanisms": ("icp_only", "step"),
        "moments": (Moment("swing", "right", 0.25),),
        "search": SearchParams(
            resolution=0.1, stride=3, replicas=3, largest=1.0
        ),
    }
    return Sweep(
        scenario=load_scenario("push"),
        scenario_name="push",
        plant="lipm",
        **{**fields, **changes},
    )


def largest(mechanisms: str, direction_deg: float) -> float:
    """The limit of a cell [m/s], whatever the moment."""
    return LIMITS[mechanisms] + direction_deg / 1000.0


def is_recovered(scenario: Scenario) -> bool:
    """Whether she recovers; odd replicas are a bit weaker."""
    (push,) = scenario.pushes
    limit = largest(scenario.mechanisms, push.direction_deg)
    return push.delta_v <= limit - WEAKER * (scenario.seed % 2)


class MadeUpRobot(Executor):
    """Runs trials in threads, each for a random while; keeps their names."""

    def __init__(
        self,
        workers: int,
        spoil: Callable[[Scenario], None] = lambda scenario: None,
    ):
        """Before each trial, `spoil` may do what it likes."""
        self._threads = ThreadPoolExecutor(workers)
        self._spoil, self._random = spoil, random.Random(workers)
        self.tried: list[tuple[str, float, float, int]] = []

    def submit(
        self, function, text: str, plant: str, timeout: float, identity: dict
    ) -> Future:
        """Looks at the scenario instead of simulating it."""
        scenario = load_typed(Scenario, "scenario", data=text)
        (push,) = scenario.pushes
        self.tried.append(
            (
                scenario.mechanisms,
                push.direction_deg,
                push.delta_v,
                scenario.seed,
            )
        )
        pause = self._random.uniform(0.0, 0.004)
        return self._threads.submit(self._run, scenario, pause)

    def shutdown(self, wait=True, *, cancel_futures=False) -> None:
        self._threads.shutdown(wait, cancel_futures=cancel_futures)

    def _run(self, scenario: Scenario, pause: float) -> dict:
        self._spoil(scenario)
        time.sleep(pause)
        recovered = is_recovered(scenario)
        return {
            "outcome": "recovered" if recovered else "fell",
            "reason": "" if recovered else 'said "ouch", and\nfell',
            "steps_after_push": 8 if recovered else 1,
            "max_icp_error_m": scenario.pushes[0].delta_v / 7.0,
            "max_torque_ratio": None,
            "qp_failures": 0,
            "predicted_at_push": -1,
            "predicted_at_touchdowns": [2, 1, 0],
            "cpu_s": pause,
        }
