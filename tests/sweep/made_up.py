"""Sweeps whose limits are known, without simulating, and quick real trials."""

import copy
import functools
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest.mock import patch

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.sweep import limits
from nadia_balance.sweep.limits import LimitTable, protocol_of
from nadia_balance.sweep.search import SearchParams, Sweep, next_batch
from nadia_balance.sweep.trials import Cell, Rows, Situation

SEARCH = SearchParams()
AT: Situation = ("push", "right swing 25 %")  # of the Nadia paper's Fig. 10
PATIENCE = 60.0  # with a machine that is busy [s]


def papers() -> dict[Cell, float]:
    """The limits of the paper's robot."""
    paper = protocol_of("nadia", AT).curves(AT[0])
    return {
        Cell(*AT, mechanisms, direction): value
        for mechanisms, curve in paper.items()
        for direction, value in curve.items()
    }


def identity_of(search: SearchParams = SEARCH) -> dict:
    """What all trials of a made-up sweep share."""
    return {
        "robot": "nadia",
        "scenario": "push",
        "plant": "humanoid",
        **asdict(search),
        "seed": 0,
        "commit": "fedcba9876",
    }


def made_up_rows(largest: Mapping[Cell, float], search=SEARCH) -> list[dict]:
    """The rows of all trials that the search asks for, cell by cell."""
    rows = []
    for cell, limit in largest.items():
        results: dict[tuple[float, int], bool] = {}
        while batch := next_batch(results, search):
            for delta_v, replica in batch:
                recovered = delta_v <= limit + 1e-9
                results[delta_v, replica] = recovered
                rows.append(_row(cell, delta_v, replica, recovered))
    return rows


@dataclass(frozen=True)
class MadeUpLimit:
    """The limit of any controller, the same in all directions."""

    largest: float  # [m/s]
    on: object = None
    assumptions: str = "a point mass 2 m high"

    def largest_push(self, direction_deg: float) -> float:
        """Knows no direction."""
        return self.largest


def table_of(
    rows: list[dict], search: SearchParams, **changed: object
) -> LimitTable:
    """The limits that follow from these rows, beside a MadeUpLimit.

    Fields of the rows' scenarios are `changed`.
    """
    folder = Rows(Path("nowhere"), identity_of(search), rows)
    names = {row["scenario"] for row in rows}
    scenarios = {name: load_scenario(name).changed(**changed) for name in names}
    made_up = MadeUpLimit(1.86), MadeUpLimit(2.6), MadeUpLimit(3.0)
    with patch.object(limits, "limits_of", return_value=made_up):
        return limits.limit_table(folder, scenarios)


def _row(cell: Cell, delta_v: float, replica: int, recovered: bool) -> dict:
    return {
        **cell._asdict(),
        **{"delta_v": delta_v, "replica": replica, "seed": replica},
        "outcome": "recovered" if recovered else "fell",
        "reason": "" if recovered else "PELVIS_LINK - ground",
        "steps_after_push": 9 if recovered else 2,
        "max_icp_error_m": 0.125 * delta_v,
        "max_torque_ratio": 0.75,
        "max_joint_speed": None,
        "max_torso_tilt_deg": 20.0 + replica,
        "max_pelvis_tilt_deg": 10.0,
        "com_sag_m": 0.125,
        "positive_power_w": 2000.0,
        "qp_failures": 0,
        "max_landing_speed": 0.25,
        "max_landing_force": 1.5 + replica,
        "predicted_at_push": 2 if recovered else -1,
    }


LIMITS = {"icp_only": 0.2, "step": 0.5}  # forward [m/s], of the robot below
WEAKER = 0.04  # is every second replica [m/s]


push_scenario = functools.cache(lambda: load_scenario("push"))


def made_up_sweep(**changes) -> Sweep:
    """Six cells, coarsely."""
    fields = {
        "scenarios": {"push": copy.deepcopy(push_scenario())},
        "directions": (0.0, 90.0, 210.0),
        "mechanisms": ("icp_only", "step"),
        "search": SearchParams(resolution=0.1, stride=3, replicas=3, largest=1),
        "plant": "lipm",
    }
    return Sweep(**{**fields, **changes})


def largest(mechanisms: str, direction_deg: float) -> float:
    """The limit of a cell [m/s], whatever the moment."""
    return LIMITS[mechanisms] + direction_deg / 1000.0


class MadeUpRobot:
    """A robot that recovers up to its limits; runs its cells in threads.

    `tried` keeps its trials: mechanisms, direction, delta_v, replica.
    """

    def __init__(self, workers: int = 2, spoil: Callable = lambda _: None):
        """Before each trial, `spoil` may do what it likes."""
        self._spoil = spoil
        self.threads = ThreadPoolExecutor(workers)
        self.submit = self.threads.submit
        self.tried: list[tuple[str, float, float, int]] = []

    def trial(self, sweep, cell, delta_v, replica) -> dict:
        """Says what run_trial says, without simulating."""
        *_, mechanisms, direction = cell
        self.tried.append((mechanisms, direction, delta_v, replica))
        self._spoil(cell)
        time.sleep(0.001)
        limit = largest(mechanisms, direction) - WEAKER * (replica % 2)
        row = _row(cell, delta_v, replica, delta_v <= limit)
        reason = row["reason"] and 'said "ouch", and\nfell'
        return row | {"reason": reason, "max_icp_error_m": delta_v / 7.0}


def stepping_sweep(duration: float = 3.5) -> Sweep:
    """Steps in place on the point mass; a step takes 1 s, after 0.5 s.

    A trial of it takes no more than a quarter of a second.
    """
    steps = int(duration) + 1
    push = "pushes: [{delta_v: 0.1, at: right swing 25 %}]"
    scenario = load_scenario(
        "push",
        text=f"{{duration: {duration}, gait: {{num_steps: {steps}}}, {push}, "
        "calm_steps: 0, lipm_period: 0.02}",  # there is no time for any
    )
    return Sweep(scenarios={"push": scenario}, plant="lipm")


def cell_to(direction: float, mechanisms: str = "step") -> Cell:
    """The cell of a direction [deg]."""
    return Cell(*AT, mechanisms, direction)
