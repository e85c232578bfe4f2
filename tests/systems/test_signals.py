"""Oracles: the names of the entries; a status by hand."""

import numpy as np
import pytest

from nadia_balance.core.math.qp import QpResult
from nadia_balance.systems import signals


@pytest.mark.parametrize(
    ("view", "part", "names"),
    [
        (signals.ComState, "position", "x y z"),
        (signals.ComState, "velocity", "vx vy vz"),
        (signals.IcpReference, "icp", "icp_x icp_y"),
        (signals.IcpReference, "icp_velocity", "icp_velocity_x icp_velocity_y"),
        (signals.IcpReference, "cop", "cop_x cop_y"),
        (signals.IcpReference, "ecmp", "ecmp_x ecmp_y"),
        (signals.EcmpCommand, "cop", "cop_x cop_y"),
        (signals.EcmpCommand, "ecmp", "ecmp_x ecmp_y"),
        (signals.SwingFootReference, "position", "x y z"),
        (signals.SwingFootReference, "velocity", "vx vy vz"),
        (signals.SwingFootReference, "acceleration", "ax ay az"),
        (signals.WalkingSignal, "left", "left_x left_y left_yaw"),
        (signals.WalkingSignal, "right", "right_x right_y right_yaw"),
        (signals.WalkingSignal, "target", "target_x target_y target_yaw"),
        (signals.PushSignal, "force", "force_x force_y force_z"),
        (signals.MeasuredFeet, "left", "left_x left_y left_z"),
        (signals.MeasuredFeet, "right", "right_x right_y right_z"),
    ],
)
def test_a_part_has_the_entries_of_its_name(view, part, names):
    signal = view(np.arange(signals.size(view)))
    named = [getattr(signal, name) for name in names.split()]
    assert getattr(signal, part).tolist() == named


def test_a_failed_qp_is_counted():
    """Oracle: by hand; the count stays when a QP is solved."""
    status = signals.QpStatus(np.zeros(signals.size(signals.QpStatus)))
    for solved, failures in (True, 0), (False, 1), (False, 2), (True, 2):
        result = QpResult(np.zeros(2), solved, solves=3, violation=0.5)
        status = signals.QpStatus(np.array(status.after(result), float))
        assert status.solved == solved
        assert status.failures == failures
