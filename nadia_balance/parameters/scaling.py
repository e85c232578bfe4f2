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
    """Parameters for a robot of another size than Nadia's.

    A number p with a unit (`bounded`) becomes p (l / l_Nadia)^k, with the
    length l of its `of` and the power k of its unit; for Nadia exactly p.

    Args:
        params: dataclass, tuned on Nadia.
        size: lengths of the robot [m].
        given: tree as from YAML or with dataclasses; the values in it are not
            scaled.

    Returns:
        A new dataclass like `params`.
    """
    tree = given if isinstance(given, dict) else {}
    return dataclasses.replace(  # type: ignore[type-var]
        params,
        **{
            field.name: _scaled(
                value=getattr(params, field.name),
                size=size,
                given=tree.get(field.name),
                bounds=field.metadata.get("bounds", UNBOUNDED),
            )
            for field in dataclasses.fields(params)  # type: ignore[arg-type]
        },
    )


def _scaled(value: Any, size: Size, given: object, bounds: Bounds) -> Any:
    if dataclasses.is_dataclass(value):
        return (
            value
            if dataclasses.is_dataclass(given)
            else scaled(value, size, given)
        )
    if isinstance(value, list):
        parts = given if isinstance(given, list) else [given] * len(value)
        return [
            _scaled(value=item, size=size, given=part, bounds=bounds)
            for item, part in zip(value, parts, strict=True)
        ]
    power = _POWERS.get(bounds.unit, 0.0)
    if value is None or given is not None or not power or not bounds.of:
        return value
    ratio = getattr(size, bounds.of) / getattr(NADIA, bounds.of)
    return value * ratio**power
