"""Froude scaling of parameters that are tuned on Nadia to other robots.

At constant gravity lengths scale with the leg, times with its square root,
forces with its cube; parameters of the sole scale with the sole, those of
treads with what is larger for its size.
"""

import dataclasses
from typing import Any, NamedTuple, TypeVar

from nadia_balance.parameters.bounds import UNBOUNDED, Bounds

T = TypeVar("T")


class Size(NamedTuple):
    """Lengths [m] that determine the scaling."""

    leg: float  # hip pitch axis to sole, the knee straight
    sole_length: float
    sole_width: float

    @property
    def tread(self) -> float:
        """Depth of a tread over Nadia's: it fits the sole and the shin."""
        return max(self.leg / NADIA.leg, self.sole_length / NADIA.sole_length)


NADIA = Size(0.782 + 0.098, 0.178 + 0.072, 2.0 * 0.06)

# Power of the length with which a quantity of each unit scales; none for
# angles, shares, accelerations.
_POWERS = {
    "m": 1.0,
    "m^2": 2.0,
    "1/m^2": -2.0,
    "s": 0.5,
    "1/s": -0.5,
    "1/s^2": -1.0,
    "m/s": 0.5,
    "N": 3.0,
    "rad/s^2": -1.0,
    "rad/m^3": -3.0,
}


def scaled(params: T, size: Size, given: object = None) -> T:
    """Returns the dataclass `params`, tuned on Nadia, for a robot of `size`.

    Each number with a unit (`bounded`) is multiplied; for Nadia by exactly 1.
    Values in `given`, a tree as from YAML or with dataclasses, are not scaled.
    """
    tree = given if isinstance(given, dict) else {}
    found = {}
    for field in dataclasses.fields(params):  # type: ignore[arg-type]
        name, bounds = field.name, field.metadata.get("bounds", UNBOUNDED)
        value = getattr(params, name)
        found[name] = _scaled(value, size, tree.get(name), bounds)
    return dataclasses.replace(params, **found)  # type: ignore[type-var]


def _scaled(value: Any, size: Size, given: object, bounds: Bounds) -> Any:
    if dataclasses.is_dataclass(value):
        whole = dataclasses.is_dataclass(given)
        return value if whole else scaled(value, size, given)
    if isinstance(value, list):
        known = given if isinstance(given, list) else [given] * len(value)
        return [
            _scaled(item, size, part, bounds)
            for item, part in zip(value, known, strict=True)
        ]
    power = _POWERS.get(bounds.unit, 0.0)
    if value is None or given is not None or not power or not bounds.of:
        return value
    ratio = getattr(size, bounds.of) / getattr(NADIA, bounds.of)
    return value * ratio**power
