"""Oracles: ticks counted, momentum of a free body, directions by hand."""

import functools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.core.walking.push import Push
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.signals import PushSignal
from nadia_balance.systems.wiring import connect
from tests.blocks import answer, fix, running
from tests.example_walks import standing

PERIOD = 0.002
MASS = 90.0
YAW = 0.6
FEET = FootPoses(*(FootPose([0.0, 0.125 * a, 0.0], a * YAW) for a in (1, -1)))
RIGHT_SWING = WalkingState(
    replace(standing(FEET), phase=Phase.SWING, duration=0.7)
)
P_BoBcm_B = np.array([0.1, -0.2, 0.3])


def run(pushes, ticks, state_at=lambda t: RIGHT_SWING, live_at=None):
    """The force that acts after each tick (ticks, 3) [N]."""
    source, forces = PushSource(pushes, MASS, PERIOD), []
    simulator, context = running(source)
    for k in range(ticks):
        fix(source, context, walking_state=state_at(k * PERIOD))
        if live_at is not None:
            fix(source, context, live_push=[*live_at(k), 0.1])
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        forces.append(answer(source, context, "push_force"))
    return np.array(forces)


def active(forces) -> list[int]:
    """The ticks with a force."""
    return np.flatnonzero(np.abs(forces).sum(axis=1)).tolist()


def free_body() -> MultibodyPlant:
    """A floating body of MASS without gravity; its CoM is off its origin."""
    plant = MultibodyPlant(0.001)
    inertia = SpatialInertia.SolidBoxWithMass(MASS, 0.3, 0.4, 0.5)
    plant.AddRigidBody("base", inertia.Shift(-P_BoBcm_B))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    return plant


@functools.cache
def steps(skips=()) -> list[WalkingState]:
    """Ticks of a right swing, a transfer to the right foot, a left swing, ...

    The clock leaves out the times of the phase [s] that are in `skips`.
    """
    swing, states = RIGHT_SWING.schedule, []
    shift = replace(swing, phase=Phase.TRANSFER, duration=0.3)
    left, right = ({"support_side": side} for side in Side)
    phases = (swing, left), (shift, right), (swing, right), (shift, left)
    for phase, support in 4 * phases:
        in_phase, duration = replace(phase, **support), phase.duration
        for time in PERIOD * np.arange(round(duration / PERIOD)):
            if not any(first <= time < last for first, last in skips):
                states.append(WalkingState(in_phase, float(time)))
    return states


def walking(*skips):
    """The state at a time [s] of that walk."""
    return lambda t: steps(skips)[round(t / PERIOD)]


LATER = {"at": f"right swing {40.0 / 0.7} %"}


@pytest.mark.parametrize(
    ("push", "skips", "tick", "count"),
    [
        ({"at": "0.05 s", "duration": 0.002}, [], 25, 1),
        ({"at": "0.01 s", "delay": 0.006, "duration": 0.3}, [], 8, 150),
        ({"at": "right swing 25 %"}, [], 88, 50),
        ({"at": "left transfer 100 %"}, [], 499, 50),
        ({"at": "left swing 100 %"}, [], 849, 50),
        # 40 / 0.7 % of 0.7 s are 0.4 s: the clock jumps over it, to a later
        # time of the phase or to the next phase, or over earlier times.
        (LATER, [(0.3, 0.5)], 150, 50),
        (LATER, [(0.3, 1.0)], 150, 50),
        (LATER, [(0.1, 0.2), (0.3, 0.35)], 125, 50),
    ],
)
def test_pushes_once_for_exactly_its_ticks(push, skips, tick, count):
    """Oracle: 350 ticks of swing, 150 of transfer, counted by hand; from tick
    (time + delay) / T on, duration / T ticks; all of a phase is its last tick.
    """
    forces = run([Push(force=1.0, **push)], 2200, walking(*skips))
    assert active(forces) == list(range(tick, tick + count))


def test_a_push_that_comes_too_late_keeps_the_direction_of_its_phase():
    """Oracle: the left foot's yaw; the next phase has the right foot's."""
    push = Push(force=1.0, at="right swing 90 %")
    force = run([push], 200, walking((0.3, 1.0)))[160]
    assert force == pytest.approx([math.cos(YAW), math.sin(YAW), 0.0])


def test_pushes_that_overlap_add_up():
    """Oracle: sum; the last is a click."""
    along_x = math.degrees(-YAW)
    pushes = [
        Push(force=10.0, at="0.0 s", direction_deg=along_x),
        Push(force=4.0, at="0.05 s", direction_deg=along_x),
    ]
    forces = run(pushes, 100, live_at=lambda k: [k >= 75, 0.1, along_x])
    assert forces[:, 0] == pytest.approx(
        [10.0] * 25 + [14.0] * 25 + [4.0] * 25 + [90.0] * 25
    )


def test_each_click_is_one_push_with_the_sliders_as_they_were():
    """Oracle: clicks in ticks 10 and 100; what the sliders do then is late."""
    forces = run(
        [],
        200,
        live_at=lambda k: [(k >= 10) + (k >= 100), 0.1 + 0.01 * k, float(k)],
    )
    assert active(forces) == [*range(10, 60), *range(100, 150)]
    for k, delta_v in (10, 0.2), (100, 1.1):
        force = MASS * delta_v / 0.1
        angle = YAW + math.radians(k)
        expected = [force * math.cos(angle), force * math.sin(angle), 0.0]
        assert forces[k : k + 50] == pytest.approx(np.tile(expected, (50, 1)))


def pushed_body(pushes, time, live=(0.0, 0.0, 0.0, 0.1)):
    """The plant of a free body that was pushed, and its context at `time`."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(free_body())
    source = builder.AddSystem(
        PushSource(pushes, MASS, PERIOD, plant, base_body="base")
    )
    assert not source.HasAnyDirectFeedthrough()
    connect(builder, source, plant, spatial_forces="applied_spatial_force")
    if source.HasInputPort("state"):
        connect(builder, plant, source, "state")
    for name in "walking_state", "live_push":
        builder.ExportInput(source.GetInputPort(name), name)
    simulator, root = running(
        builder.Build(), walking_state=RIGHT_SWING, live_push=live
    )
    simulator.AdvanceTo(time)
    return plant, plant.GetMyContextFromRoot(root)


@pytest.mark.parametrize("body", ["", "base", "live"])
def test_changes_the_momentum_of_a_body_by_exactly_m_delta_v(body):
    """Oracle: Newton; the force is constant, so rounding only."""
    push = Push(body=body, delta_v=0.5, at="0.05 s", direction_deg=90.0)
    live = (1.0, 0.5, 90.0, 0.1)
    how = ([], 0.3, live) if body == "live" else ([push], 0.3)
    plant, context = pushed_body(*how)
    base = plant.GetBodyByName("base")
    v_WB = plant.EvalBodySpatialVelocityInWorld(context, base)
    expected = 0.5 * np.array([-math.sin(YAW), math.cos(YAW), 0.0])
    assert v_WB.translational() == pytest.approx(expected, abs=1e-12)
    # At the centre of mass: it does not begin to spin.
    assert v_WB.rotational() == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_push_at_a_point_turns_the_body():
    """Oracle: angular momentum; in one tick the body hardly moves."""
    point = [0.0, 0.1, 0.5]
    push = Push(force=40.0, at="0 s", duration=PERIOD, point=point)
    plant, context = pushed_body([push], 5.0 * PERIOD)
    H = plant.CalcSpatialMomentumInWorldAboutPoint(
        context, plant.CalcCenterOfMassPositionInWorld(context)
    )
    impulse = 40.0 * PERIOD * np.array([math.cos(YAW), math.sin(YAW), 0.0])
    turn = np.cross(point - P_BoBcm_B, impulse)
    assert H.rotational() == pytest.approx(turn, rel=1e-3, abs=1e-6)


def test_a_push_in_the_frame_of_a_body_turns_with_it():
    """Oracle: a push along an axis through the CoM, in the body's frame, of a
    body that spins about W's z: the velocity is the integral of R(w t) f / m.
    """
    up, time, spin = 30.0, 0.2, 4.0
    push = Push(
        force=MASS,
        at="0 s",
        duration=time,
        direction_deg=20.0,
        elevation_deg=up,
        frame="base",
    )
    builder = DiagramBuilder()
    plant = builder.AddSystem(free_body())
    source = builder.AddSystem(
        PushSource([push], MASS, PERIOD, plant, base_body="base")
    )
    connect(builder, source, plant, spatial_forces="applied_spatial_force")
    connect(builder, plant, source, "state")
    builder.ExportInput(source.GetInputPort("walking_state"), "walking_state")
    simulator, root = running(builder.Build(), walking_state=RIGHT_SWING)
    context = plant.GetMyMutableContextFromRoot(root)
    w = np.array([0.0, 0.0, spin])
    plant.SetVelocities(context, [*w, *np.cross(w, -P_BoBcm_B)])
    simulator.AdvanceTo(time + 5.0 * PERIOD)
    v = plant.CalcCenterOfMassTranslationalVelocityInWorld(context)
    begin, end = math.radians(20.0), math.radians(20.0) + spin * time
    level = math.cos(math.radians(up)) / spin
    expected = [
        level * (math.sin(end) - math.sin(begin)),
        level * (math.cos(begin) - math.cos(end)),
        math.sin(math.radians(up)) * time,
    ]
    # A tick turns the body by half a degree.
    assert v == pytest.approx(expected, abs=2e-3)


def test_without_links_there_is_no_frame():
    push = Push(force=1.0, at="0 s", frame="base")
    with pytest.raises(ValueError, match="^frame = 'base': must be empty"):
        PushSource([push], MASS, PERIOD)
    with pytest.raises(ValueError, match="^frame = 'tail': must be a body"):
        push = replace(push, frame="tail")
        PushSource([push], MASS, PERIOD, free_body(), base_body="base")


def test_the_signal_says_which_push_acts_and_how_many_are_to_come():
    """Oracle: by hand; scripted in ticks 10 to 59, 100 to 104, and never.

    A click in tick 31 lasts for 50 ticks; what began last is told.
    """
    pushes = [
        Push(delta_v=0.4, at="0.02 s"),
        Push(force=90.0, at="0.2 s", duration=0.01, direction_deg=90.0),
        Push(force=1.0, at="left swing 50 %"),
    ]
    source = PushSource(pushes, MASS, PERIOD)
    simulator, context = running(source, walking_state=RIGHT_SWING)
    for ticks, clicks, number, newtons, duration, waiting in [
        (5, 0, 0, 0.0, 0.0, 3),
        (30, 0, 1, MASS * 0.4 / 0.1, 0.1, 3),
        (45, 1, 4, MASS * 0.3 / 0.1, 0.1, 3),
        (70, 1, 4, MASS * 0.3 / 0.1, 0.1, 2),
        (90, 1, 0, 0.0, 0.0, 2),
        (102, 1, 2, 90.0, 0.01, 2),
        (110, 1, 0, 0.0, 0.0, 1),
    ]:
        fix(source, context, live_push=[clicks, 0.3, 90.0, 0.1])
        simulator.AdvanceTo((ticks + 0.5) * PERIOD)
        signal = PushSignal(answer(source, context, "push_signal"))
        assert (signal.number, signal.waiting) == (number, waiting)
        assert signal.delta_v == pytest.approx(newtons * duration / MASS)
        assert np.linalg.norm(signal.force) == pytest.approx(newtons)


@pytest.mark.parametrize("entry", range(4))
def test_a_live_push_that_is_not_finite_is_an_error_that_tells_when(entry):
    """Oracle: by hand; one tick before it, all is well."""
    source, live = PushSource([], MASS, PERIOD), [1.0, 0.3, 90.0, 0.1]
    simulator, context = running(
        source, walking_state=RIGHT_SWING, live_push=live
    )
    simulator.AdvanceTo(9.5 * PERIOD)
    live[entry] = math.nan
    fix(source, context, live_push=live)
    said = re.escape(f"live_push = {live} at {10.0 * PERIOD:.3f} s: must be")
    with pytest.raises(ValueError, match=f"^{said} finite$"):
        simulator.AdvanceTo(10.5 * PERIOD)


SINE_PUSH = Push(at="0 s", force=9.0, shape="sine", frequency=10.0)
SMALL_PUSH = Push(at="0 s", delta_v=0.1)


@pytest.mark.parametrize(
    ("pushes", "delta_v", "direction", "message"),
    [
        ([], 0.5, 0.0, "pushes = []: must have a push"),
        ([SINE_PUSH], 0.5, 0.0, "delta_v = 0.5: must be null for a sine"),
        ([SMALL_PUSH], math.nan, 0.0, "delta_v = nan: must be"),
        ([SMALL_PUSH], -1.0, 0.0, "delta_v = -1.0: must be in [0, 100]"),
        ([SMALL_PUSH], 0.5, math.inf, "direction_deg = inf: must be in"),
    ],
)
def test_refuses_to_set_what_is_no_push(pushes, delta_v, direction, message):
    """Oracle: the message names the field; the context is as it was."""
    source = PushSource(pushes, MASS, PERIOD)
    context = source.CreateDefaultContext()
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        source.set_push(context, delta_v, direction)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("duration", 0.0015), ("delay", 0.001), ("body", "tail")),
        *(("point", [0.0, 1.0]), ("point", [0.0, 0.0, 9.0])),
    ],
)
def test_refuses_bad_pushes(field, value):
    """Oracle: the message names the field."""
    push = replace(Push(force=1.0, at="0.0 s"), **{field: value})
    with pytest.raises(ValueError, match=f"{field} = "):
        PushSource([push], MASS, PERIOD, free_body(), "base")
