"""Oracles: the core's functions, called by hand; counted solves."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.feedback import momentum_qp
from nadia_balance.core.math.qp import QpResult
from nadia_balance.core.walking.state import FootPose, Side, WalkingState
from nadia_balance.systems.feedback import MomentumQp
from nadia_balance.systems.signals import EcmpCommand
from tests import example_walks
from tests.blocks import answer, asked, running, tick
from tests.example_walks import MODEL, SOLE

PARAMS, PERIOD = momentum_qp.MomentumQpParams(), 0.002
OUTPUTS = ("ecmp_command", "momentum_qp_status")
TURNED = FootPose([0.0, 0.125, 0.0], 0.2)
FEET = example_walks.FEET.with_foot(Side.LEFT, TURNED)
SWING = WalkingState(replace(example_walks.swing(), feet=FEET), 0.35)
TRANSFER = WalkingState(replace(example_walks.walk(), feet=FEET), 0.1)
COP_R, ECMP_R = np.array([0.02, 0.12]), np.array([0.03, 0.12])
INPUTS = {
    "icp": np.array([0.05, 0.11]),
    "icp_reference": np.array([0.03, 0.12, 0.1, 0.2, *COP_R, *ECMP_R]),
    "walking_state": SWING,
}


def outputs(system, context) -> list[np.ndarray]:
    return [answer(system, context, name).copy() for name in OUTPUTS]


def solved_by_hand(params=PARAMS, previous=(0.0, 0.0, 0.0, 0.0)):
    polygon, yaw = TURNED.to_world(SOLE), TURNED.yaw
    limits = momentum_qp.feedback_limits(polygon, yaw, params)
    error = INPUTS["icp"] - INPUTS["icp_reference"][:2]
    return momentum_qp.IcpFeedbackQp(params).solve(
        error, COP_R, ECMP_R - COP_R, np.array(previous), limits
    )


def test_commands_what_the_core_computes():
    """Oracle: IcpFeedbackQp, called by hand."""
    system = MomentumQp(PARAMS, MODEL, PERIOD)
    expected = solved_by_hand()
    command, status = outputs(system, asked(system, **INPUTS))
    assert command.tolist() == [*expected.cop, *expected.ecmp]
    qp = expected.result
    assert status.tolist() == [1.0, 0.0, qp.solves, qp.violation, 0.0]


def test_remembers_the_feedback_for_the_rate_weight():
    """Oracle: a second tick equals the core with the first as previous."""
    params = replace(PARAMS, rate_weight=1000.0)
    system = MomentumQp(params, MODEL, PERIOD)
    simulator, context = running(system, **INPUTS)
    first = EcmpCommand(outputs(system, context)[0])
    tick(simulator, PERIOD)
    second = outputs(system, context)[0]
    kappa = first.ecmp - first.cop - (ECMP_R - COP_R)
    expected = solved_by_hand(params, [*(first.cop - COP_R), *kappa])
    assert np.abs(second - first[:]).max() > 1e-3
    # The increments are recovered from sums: rounding, times the gain.
    assert second == pytest.approx([*expected.cop, *expected.ecmp], abs=1e-12)


def test_counts_failures_and_holds_the_command(monkeypatch):
    """Oracle: status and command of ticks without a solution."""
    system = MomentumQp(PARAMS, MODEL, PERIOD)
    simulator, context = running(system, **INPUTS)
    before = outputs(system, context)[0]
    tick(simulator, PERIOD)
    failed = QpResult(np.full(4, np.nan), False, 3, True, 0.5)
    monkeypatch.setattr(system._qp._qp, "solve", lambda *args: failed)
    tick(simulator, PERIOD)
    command, status = outputs(system, context)
    assert status.tolist() == [0.0, 1.0, 3.0, 0.5, 2.0]
    assert command == pytest.approx(before, abs=1e-15)
