"""Oracles: ticks counted, momentum of a free body, directions by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from nadia_balance.core.push import Push
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.systems.push_source import PushSource

PERIOD = 0.002
MASS = 90.0
REST = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
YAW = 0.6
FEET = FootPoses(
    FootPose([0.0, 0.125, 0.0], YAW), FootPose([0.0, -0.125, 0.0], -0.3)
)
RIGHT_SWING = WalkingState(
    ContactSchedule(Phase.SWING, Side.LEFT, 0.7, FEET, (), REST)
)
P_BoBcm_B = np.array([0.1, -0.2, 0.3])


def run(
    pushes, ticks, state_at=lambda t: RIGHT_SWING, live_at=None
) -> np.ndarray:
    """The force that acts after each tick (ticks, 3) [N]."""
    source = PushSource(pushes, MASS, PERIOD)
    simulator = Simulator(source)
    context = simulator.get_mutable_context()
    port, forces = source.GetInputPort("walking_state"), []
    for k in range(ticks):
        port.FixValue(context, Value(state_at(k * PERIOD)))
        if live_at is not None:
            source.GetInputPort("live_push").FixValue(context, live_at(k))
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        forces.append(source.GetOutputPort("push_force").Eval(context))
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


@pytest.mark.parametrize("duration", [0.002, 0.1, 0.3])
def test_pushes_once_for_exactly_its_ticks(duration):
    """Oracle: from tick time / T on, duration / T ticks."""
    forces = run([Push(force=50.0, time=0.05, duration=duration)], 400)
    first, count = 25, round(duration / PERIOD)
    assert active(forces) == list(range(first, first + count))


def test_a_push_at_time_zero_acts_from_the_first_tick():
    """Oracle: tick 0."""
    assert active(run([Push(force=1.0, time=0.0)], 60)) == list(range(50))


def test_a_delay_shifts_the_push():
    """Oracle: three ticks."""
    forces = run([Push(force=1.0, time=0.01, delay=0.006)], 100)
    assert active(forces) == list(range(8, 58))


def test_a_phase_push_begins_in_that_phase_and_only_the_first_time():
    """Oracle: 25 % of a swing of 0.7 s is in tick 88."""

    def walking(t):
        return replace(RIGHT_SWING, time_in_phase=t % 0.7)

    forces = run([Push(force=1.0, phase="swing")], 800, walking)
    assert active(forces) == list(range(88, 138))


def steps(t, swing=0.7, transfer=0.3, skips=()):
    """A right swing, a transfer to the right foot, a left swing, ...

    The clock leaves out the times of the phase [s] that are in `skips`.
    """
    phases = [
        (Phase.SWING, Side.LEFT, swing),
        (Phase.TRANSFER, Side.RIGHT, transfer),
        (Phase.SWING, Side.RIGHT, swing),
        (Phase.TRANSFER, Side.LEFT, transfer),
    ]
    ticks = round(t / PERIOD)
    for k in range(100):
        phase, side, duration = phases[k % 4]
        clock = [
            time
            for time in PERIOD * np.arange(round(duration / PERIOD))
            if not any(first <= time < last for first, last in skips)
        ]
        if ticks < len(clock):
            schedule = replace(
                RIGHT_SWING.schedule,
                phase=phase,
                support_side=side,
                duration=duration,
            )
            return WalkingState(schedule, time_in_phase=float(clock[ticks]))
        ticks -= len(clock)
    raise AssertionError("the walk is over")


@pytest.mark.parametrize(
    ("push", "tick"),
    [
        (Push(force=1.0, phase="swing", fraction=1.0), 349),
        (Push(force=1.0, phase="transfer", side="left", fraction=1.0), 499),
        (Push(force=1.0, phase="swing", side="left", fraction=1.0), 849),
        (Push(force=1.0, phase="transfer", fraction=1.0), 999),
    ],
)
def test_the_whole_of_a_phase_is_its_last_tick(push, tick):
    """Oracle: 350 ticks of swing, 150 of transfer, counted by hand."""
    forces = run([push], 2200, steps)
    assert active(forces) == list(range(tick, tick + 50))


@pytest.mark.parametrize(
    ("skips", "tick"),
    [
        ([(0.3, 0.5)], 150),  # over it, to a later time: at once
        ([(0.3, 1.0)], 150),  # over it and the end: in the next phase
        ([(0.1, 0.2), (0.3, 0.35)], 100 + 25),  # over other times
    ],
)
def test_a_clock_that_jumps_over_the_fraction_starts_the_push_once(skips, tick):
    """Oracle: 57 % of 0.7 s is 0.4 s; the ticks that are left, by hand."""

    def walking(t):
        return steps(t, skips=skips)

    push = Push(force=1.0, phase="swing", fraction=0.4 / 0.7)
    forces = run([push], 1500, walking)
    assert active(forces) == list(range(tick, tick + 50))


def test_a_push_that_comes_too_late_keeps_the_direction_of_its_phase():
    """Oracle: the left foot's yaw; the next phase has the right foot's."""

    def walking(t):
        return steps(t, skips=[(0.3, 1.0)])

    push = Push(force=1.0, phase="swing", fraction=0.9)
    force = run([push], 200, walking)[160]
    assert force == pytest.approx([math.cos(YAW), math.sin(YAW), 0.0])


@pytest.mark.parametrize(
    ("degrees", "left_foot_frame"),
    [(0, (1, 0)), (90, (0, 1)), (180, (-1, 0)), (-90, (0, -1))],
)
def test_the_direction_is_that_of_the_support_foot(degrees, left_foot_frame):
    """Oracle: rotation of the left foot, times m dv / dt."""
    push = Push(delta_v=0.5, time=0.0, direction_deg=degrees)
    force = run([push], 1)[0]
    expected = 90.0 * 0.5 / 0.1 * FEET.left.rotation @ left_foot_frame
    assert force[:2] == pytest.approx(expected, abs=1e-10)
    assert force[2] == 0.0


def test_the_direction_stays_although_the_foot_turns():
    """Oracle: one direction for the whole push."""

    def turning(t):
        feet = FEET.with_foot(Side.LEFT, FootPose(np.zeros(3), 10.0 * t))
        return replace(
            RIGHT_SWING, schedule=replace(RIGHT_SWING.schedule, feet=feet)
        )

    forces = run([Push(force=1.0, time=0.1)], 100, turning)
    assert len(np.unique(forces[active(forces)], axis=0)) == 1
    assert forces[60] == pytest.approx([math.cos(1.0), math.sin(1.0), 0.0])


def test_pushes_that_overlap_add_up():
    """Oracle: sum."""
    pushes = [
        Push(force=10.0, time=0.0, direction_deg=math.degrees(-YAW)),
        Push(force=4.0, time=0.05, direction_deg=math.degrees(-YAW)),
    ]
    along_x = run(pushes, 100)[:, 0]
    assert along_x == pytest.approx(
        [10.0] * 25 + [14.0] * 25 + [4.0] * 25 + [0.0] * 25
    )


def test_a_live_push_acts_like_a_scripted_one():
    """Oracle: the very same push, scripted for the tick of the click."""
    scripted = run([Push(delta_v=0.4, time=0.02, direction_deg=30.0)], 100)
    live = run([], 100, live_at=lambda k: [k >= 10, 0.4, 30.0])
    assert active(live) == list(range(10, 60))
    assert np.array_equal(live, scripted)


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


def test_a_click_during_a_live_push_starts_it_anew():
    """Oracle: 50 ticks from the last click on."""
    forces = run([], 100, live_at=lambda k: [(k >= 5) + (k >= 20), 0.3, 0.0])
    assert active(forces) == list(range(5, 70))


def test_a_count_that_begins_anew_is_no_push():
    """Oracle: none; the next click is one."""
    counts = [3] * 60 + [0] * 60 + [1] * 60
    forces = run([], 180, live_at=lambda k: [counts[k], 0.3, 0.0])
    assert active(forces) == [*range(0, 50), *range(120, 170)]


def test_live_and_scripted_pushes_add_up():
    """Oracle: sum."""
    scripted = run([Push(delta_v=0.4, time=0.02)], 100)
    live = run([], 100, live_at=lambda k: [k >= 20, 0.2, 90.0])
    both = run(
        [Push(delta_v=0.4, time=0.02)],
        100,
        live_at=lambda k: [k >= 20, 0.2, 90.0],
    )
    assert both == pytest.approx(scripted + live)


@pytest.mark.parametrize("live", [[1, math.nan, 0.0], [1, 0.3, math.inf]])
def test_refuses_a_live_push_that_is_not_finite(live):
    """Oracle: the message of Push.validate."""
    with pytest.raises(ValueError, match="must be finite"):
        run([], 1, live_at=lambda k: live)


@pytest.mark.parametrize("body", ["", "base", "live"])
def test_changes_the_momentum_of_a_body_by_exactly_m_delta_v(body):
    """Oracle: Newton; the force is constant, so rounding only."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(free_body())
    pushes = [Push(body=body, delta_v=0.5, time=0.05, direction_deg=90.0)]
    if body == "live":
        pushes = []
    source = builder.AddSystem(
        PushSource(pushes, MASS, PERIOD, plant, base_body="base")
    )
    if body == "live":
        click = builder.AddSystem(ConstantVectorSource([1.0, 0.5, 90.0]))
        builder.Connect(
            click.get_output_port(), source.GetInputPort("live_push")
        )
    state = builder.AddSystem(ConstantValueSource(Value(RIGHT_SWING)))
    builder.Connect(
        state.get_output_port(), source.GetInputPort("walking_state")
    )
    builder.Connect(
        source.GetOutputPort("spatial_forces"),
        plant.get_applied_spatial_force_input_port(),
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.3)
    root = simulator.get_context()
    v_WB = plant.EvalBodySpatialVelocityInWorld(
        plant.GetMyContextFromRoot(root), plant.GetBodyByName("base")
    )
    expected = 0.5 * np.array([-math.sin(YAW), math.cos(YAW), 0.0])
    assert v_WB.translational() == pytest.approx(expected, abs=1e-12)
    # At the centre of mass: it does not begin to spin.
    assert v_WB.rotational() == pytest.approx(np.zeros(3), abs=1e-12)


def test_the_outputs_depend_on_the_state_only():
    """Oracle: Drake's own dependency graph."""
    source = PushSource([], MASS, PERIOD, free_body(), "base")
    assert not source.HasAnyDirectFeedthrough()
    context = source.CreateDefaultContext()
    assert source.GetOutputPort("spatial_forces").Eval(context) == []
    assert source.GetOutputPort("push_force").Eval(context).tolist() == [0] * 3


def test_without_a_plant_there_is_only_the_vector():
    """Oracle: the ports."""
    assert PushSource([], MASS, PERIOD).num_output_ports() == 1


def test_a_missing_or_wrong_walking_state_is_an_error():
    """Oracle: the message names the port."""
    source = PushSource([Push(force=1.0, time=0.0)], MASS, PERIOD)
    with pytest.raises(RuntimeError, match="walking_state"):
        Simulator(source).AdvanceTo(PERIOD)
    simulator = Simulator(source)
    port = source.GetInputPort("walking_state")
    port.FixValue(simulator.get_mutable_context(), Value(FEET))
    with pytest.raises(TypeError, match="'walking_state' got a FootPoses"):
        simulator.AdvanceTo(PERIOD)


@pytest.mark.parametrize(
    ("push", "message"),
    [
        (Push(force=1.0, time=0.0, duration=0.0015), "duration = 0.0015: must"),
        (Push(force=1.0, time=0.0, delay=0.001), "delay = 0.001: must be a mu"),
        (Push(force=1.0, time=0.0, body="tail"), "body = 'tail': must be a bo"),
        (Push(force=-1.0, time=0.0), "force = -1.0: must be finite"),
    ],
)
def test_refuses_bad_pushes(push, message):
    """Oracle: the message names field and value."""
    with pytest.raises(ValueError, match=message):
        PushSource([push], MASS, PERIOD, free_body(), "base")
