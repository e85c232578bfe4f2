"""The mechanisms of recovery that can be switched on and off.

A mechanism is a field of Mechanisms; named sets of them, and how pictures show
these, are one table.  A mechanism of one's own is a field here, and a line of
SETS if it has a curve of its own; no other list names them.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import require


def _switch(label: str) -> Any:
    return dataclasses.field(default=False, metadata={"label": label})


@dataclass(frozen=True)
class Mechanisms:
    """Switches of the recovery mechanisms besides ankles and hips; off.

    Attributes:
        step: the foothold is adjusted.
        swing: the duration of a swing is adjusted.
        transfer: the duration of a transfer is adjusted.
        cross_over: adjusted footholds may cross the legs.
    """

    step: bool = _switch("step adjustment")
    swing: bool = _switch("swing timing")
    transfer: bool = _switch("transfer timing")
    cross_over: bool = _switch("cross-over")

    def as_vector(self) -> Array:
        """Returns the switches as numbers.

        Returns:
            1 for on and 0 for off, in the order of the fields, (NUM_SWITCHES,).
        """
        return np.array(dataclasses.astuple(self), dtype=float)

    @classmethod
    def from_vector(cls, vector: Array) -> Self:
        """Returns the inverse of `as_vector`.

        Args:
            vector: (NUM_SWITCHES,), each 0 or 1.

        Returns:
            The switches.

        Raises:
            ValueError: it has another size, or other numbers.
        """
        values = vector.tolist()
        require(
            len(values) == NUM_SWITCHES and {*values} <= {0.0, 1.0},
            f"mechanisms = {values}: must be {NUM_SWITCHES} times 0 or 1",
        )
        return cls(*map(bool, values))


# The names of the switches, and the labels of their buttons.
LABELS: dict[str, str] = {
    field.name: field.metadata["label"]
    for field in dataclasses.fields(Mechanisms)
}
NUM_SWITCHES = len(LABELS)


class MechanismSet(NamedTuple):
    """Mechanisms that are on together: a curve in a paper's figure."""

    name: str  # of --mechanisms
    on: Mechanisms
    color: str  # of its curve; one hue, darker for more mechanisms
    # "nadia": a curve of its Fig. 10; "atlas": of its Fig. 6; "": one's own.
    paper: str


# In order of more mechanisms.
SETS = (
    MechanismSet("icp_only", Mechanisms(), "#b5cdf5", "nadia"),
    MechanismSet("step", Mechanisms(step=True), "#82a8ee", "nadia"),
    MechanismSet(
        "step_swing", Mechanisms(step=True, swing=True), "#4f80e4", "nadia"
    ),
    MechanismSet(
        "step_swing_transfer",
        Mechanisms(step=True, swing=True, transfer=True),
        "#2456d6",
        "nadia",
    ),
    MechanismSet(
        "all_with_cross_over",
        Mechanisms(step=True, swing=True, transfer=True, cross_over=True),
        "#102a78",
        "nadia",
    ),
    MechanismSet("feedback", Mechanisms(), "#b5cdf5", "atlas"),
    MechanismSet("feedback_step", Mechanisms(step=True), "#82a8ee", "atlas"),
    MechanismSet("feedback_timing", Mechanisms(swing=True), "#4f80e4", "atlas"),
    MechanismSet(
        "feedback_step_timing",
        Mechanisms(step=True, swing=True),
        "#102a78",
        "atlas",
    ),
)
#: The Nadia paper's sets of mechanisms, by name.
MECHANISMS = {one.name: one.on for one in SETS if one.paper == "nadia"}
ATLAS_MECHANISMS = {one.name: one.on for one in SETS if one.paper == "atlas"}
NAMED = {one.name: one.on for one in SETS}
# What is on where nobody says: all of the paper.
MOST = list(MECHANISMS)[-1]
USUAL = MECHANISMS[MOST]
COLORS = {one.name: one.color for one in SETS}
