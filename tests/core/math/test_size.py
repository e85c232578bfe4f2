"""Oracle: dimensions, by hand; Nadia's parameters to the bit."""

import dataclasses
import math

import pytest

from nadia_balance.balance_controller import ControllerParams
from nadia_balance.parameters.bounds import bounded
from nadia_balance.parameters.scaling import NADIA, Size, scaled
from nadia_balance.robot.model import load_robot_params

DOUBLE = Size(*(2.0 * length for length in NADIA))


@dataclasses.dataclass(kw_only=True)
class Part:
    toe: float = bounded(0.1, unit="m", of="sole_length")
    count: int = 3


@dataclasses.dataclass(kw_only=True)
class Whole:
    length: float = bounded(0.3, unit="m")
    time: float = bounded(0.5, unit="s")
    rate: float = bounded(math.inf, unit="m/s", finite=False)
    force: float | None = bounded(None, unit="N")
    weight: float = bounded(8.0, unit="1/m^2")
    stiffness: float = bounded(8.0, unit="1/s^2")
    moment: float = bounded(8.0, unit="rad/m^3")
    tick: float = bounded(0.002, unit="s", of="")
    angle: float = bounded(1.0, unit="rad")
    parts: list[Part] = dataclasses.field(
        default_factory=lambda: [Part(), Part()]
    )


def test_scales_what_has_a_unit_and_was_not_given():
    """Oracle: lengths double, times grow by sqrt(2), what is given stays.

    Per square metre it is a quarter, per square second (m/s^2 stays) a half.
    """
    given = {"length": 0.3, "parts": [{"count": 3}, {"toe": 0.1}]}
    found = scaled(Whole(force=2.0), DOUBLE, given)
    assert found == Whole(
        time=0.5 * math.sqrt(2.0),
        force=16.0,
        weight=2.0,
        stiffness=4.0,
        moment=1.0,
        parts=[Part(toe=0.2), Part()],
    )
    assert scaled(Whole(), DOUBLE).length == 0.6


@pytest.mark.parametrize("name", ["nadia", "atlas"])
def test_nadia_has_what_was_tuned_and_atlas_nearly(name):
    """Oracle: == for Nadia; Atlas' legs are 0.7 % shorter, its soles wider."""
    params, size = ControllerParams(), load_robot_params(name)[0].size
    found = scaled(params, size)
    assert (found == params) == (name == "nadia")
    assert math.isclose(
        found.timing_adapter.min_swing_duration, 0.25, rel_tol=4e-3
    )
