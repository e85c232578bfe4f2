"""Oracles: the core's functions, called by hand; counted solves."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value

from nadia_balance.core.com_height import ComHeightParams, LegGeometry
from nadia_balance.core.feedback_limits import feedback_limits
from nadia_balance.core.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    momentum_rate,
)
from nadia_balance.core.polygon import contains
from nadia_balance.core.qp_solver import QpResult
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    rectangle,
)
from nadia_balance.systems.momentum_qp import MomentumQp

SOLE = rectangle(0.25, 0.12)
PARAMS = MomentumQpParams()
MASS, OMEGA, HEIGHT = 90.0, 3.3, 0.88
REST = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
FEET = FootPoses(FootPose([0.0, 0.125, 0.0], 0.2), FootPose([0.0, -0.125, 0.0]))
STEP = Footstep(Side.RIGHT, FootPose([0.6, -0.125, 0.0]), 0.3, 0.7)
SWING = WalkingState(
    ContactSchedule(Phase.SWING, Side.LEFT, 0.7, FEET, (STEP,), REST), 0.35
)
TRANSFER = WalkingState(
    replace(SWING.schedule, phase=Phase.TRANSFER, duration=0.3), 0.1
)
COP_R, ECMP_R = np.array([0.02, 0.12]), np.array([0.03, 0.12])
INPUTS = {
    "com_state": np.array([0.01, 0.1, HEIGHT, 0.2, 0.1, 0.0]),
    "icp": np.array([0.05, 0.11]),
    "icp_reference": np.array([0.03, 0.12, 0.1, 0.2, *COP_R, *ECMP_R]),
    "walking_state": SWING,
}


def make(**changes) -> MomentumQp:
    arguments = {
        "mass": MASS,
        "omega": OMEGA,
        "com_height": HEIGHT,
        "sole": SOLE,
        "legs": LegGeometry(
            length=0.782, ankle_height=0.098, com_above_hip=0.04, hip_width=0.26
        ),
        "control_period": 0.002,
    } | changes
    params = arguments.pop("params", PARAMS)
    return MomentumQp(params, ComHeightParams(), **arguments)


def context_of(system, without="", **changes):
    context = system.CreateDefaultContext()
    for name, value in (INPUTS | changes).items():
        if name != without:
            if name == "walking_state":
                value = Value(value)
            system.GetInputPort(name).FixValue(context, value)
    return context


def outputs(system, context) -> dict[str, np.ndarray]:
    return {
        name: system.GetOutputPort(name).Eval(context).copy()
        for name in ("ecmp_command", "momentum_rate", "qp_status")
    }


def tick(system, context) -> None:
    """One discrete update."""
    updates = system.EvalUniquePeriodicDiscreteUpdate(context)
    context.SetDiscreteState(updates.value().copy())


def test_commands_what_the_core_computes():
    """Oracle: IcpFeedbackQp and Eq. 5, called by hand."""
    limits = feedback_limits(
        FEET.left.to_world(SOLE),
        FEET.left.yaw,
        PARAMS.cop_safe_distance,
        PARAMS.max_kappa,
    )
    expected = IcpFeedbackQp(PARAMS).solve(
        INPUTS["icp"] - INPUTS["icp_reference"][:2],
        COP_R,
        ECMP_R - COP_R,
        np.zeros(4),
        limits,
    )
    system = make()
    found = outputs(system, context_of(system))
    assert found["ecmp_command"].tolist() == [*expected.cop, *expected.ecmp]
    rate = momentum_rate(
        MASS, OMEGA, INPUTS["com_state"][:2], expected.ecmp, 0.0
    )
    assert found["momentum_rate"][:2].tolist() == rate[:2].tolist()
    status = [
        1.0,
        0.0,
        expected.result.iterations,
        expected.result.violation,
        0.0,
    ]
    assert found["qp_status"].tolist() == status


def test_the_cop_stays_in_the_soles_that_are_in_contact():
    """Oracle: a push to the right; only the transfer has a right sole."""
    system = make()
    commands = [
        outputs(system, context_of(system, icp=[0.03, -0.1], walking_state=s))
        for s in (SWING, TRANSFER)
    ]
    in_swing, in_transfer = (c["ecmp_command"][:2] for c in commands)
    left_sole = FEET.left.to_world(SOLE)
    assert contains(in_swing, left_sole)
    assert not contains(in_transfer, left_sole)


def test_remembers_the_feedback_for_the_rate_weight():
    """Oracle: a second tick equals the core with the first as previous."""
    params = replace(PARAMS, rate_weight=1000.0)
    system = make(params=params)
    context = context_of(system)
    first = outputs(system, context)["ecmp_command"]
    tick(system, context)
    second = outputs(system, context)["ecmp_command"]
    previous = np.concatenate(
        (first[:2] - COP_R, first[2:] - first[:2] - (ECMP_R - COP_R))
    )
    expected = IcpFeedbackQp(params).solve(
        INPUTS["icp"] - INPUTS["icp_reference"][:2],
        COP_R,
        ECMP_R - COP_R,
        previous,
        feedback_limits(FEET.left.to_world(SOLE), 0.2, 0.005, 0.05),
    )
    assert np.abs(second - first).max() > 1e-3
    # The increments are recovered from sums: rounding, times the gain.
    assert second == pytest.approx([*expected.cop, *expected.ecmp], abs=1e-12)


def test_solves_once_per_tick(monkeypatch):
    """Oracle: the calls counted, over all outputs and the update."""
    system, calls = make(), []
    real = system._qp.solve
    monkeypatch.setattr(
        system._qp, "solve", lambda *args: (calls.append(1), real(*args))[1]
    )
    context = context_of(system)
    outputs(system, context)
    system.EvalUniquePeriodicDiscreteUpdate(context)
    assert len(calls) == 1


def test_starts_from_the_active_limits_of_the_last_tick():
    """Oracle: at the same limits again, one iteration is enough."""
    system = make()
    context = context_of(system, icp=[0.2, 0.3])
    assert outputs(system, context)["qp_status"][2] > 1
    for _ in range(20):
        tick(system, context)
    assert outputs(system, context)["qp_status"][2] == 1


def test_counts_failures_and_holds_the_command(monkeypatch):
    """Oracle: status and command of ticks without a solution."""
    system = make()
    context = context_of(system)
    before = outputs(system, context)["ecmp_command"]
    tick(system, context)
    nan = np.full(4, np.nan)
    failed = QpResult(nan, False, np.zeros(10, dtype=np.int8), 3, True, 0.5)
    monkeypatch.setattr(system._qp._qp, "solve", lambda *args: failed)
    tick(system, context)
    found = outputs(system, context)
    assert found["qp_status"].tolist() == [0.0, 1.0, 3.0, 0.5, 2.0]
    assert found["ecmp_command"] == pytest.approx(before, abs=1e-15)


def test_long_steps_lower_the_com_and_short_ones_do_not():
    """Oracle: the sign of the vertical momentum rate at nominal height."""
    system = make()
    near = replace(STEP, pose=FootPose([0.1, -0.125, 0.0]))
    short = replace(SWING.schedule, footsteps=(near,))
    rates = [
        outputs(system, context_of(system, walking_state=s))["momentum_rate"]
        for s in (SWING, replace(SWING, schedule=short), TRANSFER)
    ]
    assert rates[0][2] < -10.0
    assert rates[1][2] == pytest.approx(0.0, abs=1e-9)
    assert rates[2][2] == pytest.approx(0.0, abs=1e-9)


def test_a_support_foot_on_a_stair_lifts_the_com():
    """Oracle: PD on the height above the support sole."""
    feet = FEET.with_foot(Side.LEFT, FootPose([0.0, 0.125, 0.01]))
    state = replace(TRANSFER, schedule=replace(TRANSFER.schedule, feet=feet))
    system = make()
    found = outputs(system, context_of(system, walking_state=state))
    gain = ComHeightParams().position_gain
    assert found["momentum_rate"][2] == pytest.approx(MASS * gain * 0.01)


def test_equal_contexts_give_equal_outputs():
    """Oracle: bits, before and after other inputs were seen."""
    system = make()
    first = outputs(system, context_of(system))
    outputs(system, context_of(system, icp=[0.2, 0.3], walking_state=TRANSFER))
    again = outputs(system, context_of(system))
    assert {k: v.tobytes() for k, v in first.items()} == {
        k: v.tobytes() for k, v in again.items()
    }


@pytest.mark.parametrize("name", INPUTS)
def test_a_missing_input_is_an_error(name):
    """Oracle: Drake names the port."""
    system = make()
    with pytest.raises(RuntimeError, match=name):
        outputs(system, context_of(system, without=name))


def test_a_wrong_walking_state_is_an_error():
    """Oracle: the message names the port and both types."""
    system = make()
    message = "'walking_state' got a FootPoses, needs a WalkingState"
    with pytest.raises(TypeError, match=message):
        outputs(system, context_of(system, walking_state=FEET))


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
@pytest.mark.parametrize(
    ("port", "size"), [("com_state", 6), ("icp", 2), ("icp_reference", 8)]
)
def test_a_number_that_is_not_finite_is_an_error_by_name(port, size, bad):
    """Oracle: the message; each number alone; never a silent command."""
    system = make()
    for i in range(size):
        values = [0.0] * size
        values[i] = bad
        with pytest.raises(RuntimeError, match=f"'{port}' is not finite"):
            outputs(system, context_of(system, **{port: values}))


def test_refuses_bad_parameters_before_anything_runs():
    """Oracle: the message names the field."""
    with pytest.raises(ValueError, match="feedback_gain = 0.9: must be > 1"):
        make(params=replace(PARAMS, feedback_gain=0.9))
    message = "cop_safe_distance = 0.06: must leave some of the sole"
    with pytest.raises(ValueError, match=message):
        make(params=replace(PARAMS, cop_safe_distance=0.06))
