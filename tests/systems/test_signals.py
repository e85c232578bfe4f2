"""Oracle: the names of the entries."""

import numpy as np
import pytest

from nadia_balance.systems import signals

# The axes that a part of this name has; it is in front of them.
PARTS = {
    signals.IcpReference: {"icp icp_velocity cop ecmp": "x y"},
    signals.EcmpCommand: {"cop ecmp": "x y"},
    signals.WalkingSignal: {"left right target": "x y yaw"},
    signals.PushSignal: {"force": "x y z"},
    signals.MeasuredFeet: {"left right": "x y z"},
}


@pytest.mark.parametrize("view", PARTS)
def test_a_part_has_the_entries_of_its_name(view):
    signal = view(np.arange(signals.size(view)))
    for parts, axes in PARTS[view].items():
        for part in parts.split():
            named = [getattr(signal, f"{part}_{axis}") for axis in axes.split()]
            assert getattr(signal, part).tolist() == named
