"""Oracles: energies, the wheel's own draws, poses by hand."""

import importlib
import re
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams import tour
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import advance
from nadia_balance.robot.model import load_robot

ROBOT = load_robot("g1")
PLANT = ROBOT.control_plant()
WHEEL = tour.wheel()
STANCE = dict(zip(WHEEL.BENCH_MOTORS, WHEEL.BENCH_STANCE, strict=True))
BASE = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, WHEEL.BENCH_CRANE_HEIGHT_M])


def stand(**changes):
    return load_scenario("stand", robot="g1", **changes)


def test_in_the_crane_the_links_hang_at_rest_in_their_servos():
    """Oracle: the energy of weights and springs is least; torques by hand."""
    q, torques = tour.hung(ROBOT, BASE)
    assert q[:7].tolist() == BASE.tolist()
    context, gains = PLANT.CreateDefaultContext(), tour.servo(ROBOT)

    def energy(at):
        PLANT.SetPositions(context, at)
        springs = 0.0
        for name, angle in STANCE.items():
            stretch = at[PLANT.GetJointByName(name).position_start()] - angle
            springs += 0.5 * gains[name][0] * stretch**2
        return PLANT.CalcPotentialEnergy(context) + springs

    # By 0.2 rad, all of its springs would hold 28 N m/rad * 0.2 rad.
    for i in range(7, q.size):
        step = np.where(np.arange(q.size) == i, 1e-4, 0.0)
        slope = (energy(q + step) - energy(q - step)) / 2e-4
        assert abs(slope) < 0.05, PLANT.GetPositionNames()[i]
    waist = PLANT.GetJointActuatorByName("waist_pitch_joint")
    sag = q[waist.joint().position_start()]
    assert sag > 0.1
    inertia = 0.00721945  # of the motor, in the URDF
    stiffness = inertia * (20.0 * np.pi) ** 2
    assert torques[waist.input_start()] == pytest.approx(-stiffness * sag)
    assert gains["waist_pitch_joint"] == pytest.approx(
        (stiffness, 4.0 * inertia * 20.0 * np.pi)
    )


def test_punches_are_those_of_the_benchmark():
    """Oracle: the wheel, with links named by hand."""
    punches = tour.punches_of(5, PLANT)
    links = [(f"child {i}", f"parent {i}", (0.0,) * 3) for i in range(29)]
    drawn = WHEEL.bench_punches(5, links)
    assert len(punches) == len(drawn) == 18
    for ours, theirs in zip(punches, drawn, strict=True):
        along = ours.along(np.radians(ours.direction_deg))
        assert ours.force * along == pytest.approx(np.array(theirs.vector))
        assert ours.moment.time == pytest.approx(theirs.t)
        assert (ours.duration, ours.point) == (theirs.duration, [0.0] * 3)
        motor = WHEEL.BENCH_MOTORS[int(theirs.body.split()[1])]
        assert ours.body == motor.replace("_joint", "_link").replace(
            "waist_pitch_link", "torso_link"
        )
        assert (ours.frame == ours.body) == (theirs.frame == theirs.body)


@pytest.mark.parametrize(
    ("pitch", "taken"), [(0.2, True), (0.5, False), (-0.3, True), (-2.5, False)]
)
def test_hands_stay_in_front_and_below_the_head(pitch, taken):
    """Oracle: by hand: arms back, forward, up; as in the stance is allowed."""
    takes = tour.hands_clear(ROBOT, STANCE)
    left = np.array(WHEEL.BENCH_ARM_STANCE_LEFT)
    left[0] = pitch
    assert takes(left) == taken


def test_arms_walk_as_the_benchmark_draws_it():
    """Oracle: the wheel's walk without hands, until it draws a pose again."""
    limits = {
        name: (
            PLANT.GetJointByName(name).position_lower_limits()[0],
            PLANT.GetJointByName(name).position_upper_limits()[0],
        )
        for name in WHEEL.BENCH_ARMS
    }
    walk = WHEEL.bench_arm_walk(7, 1.0, limits)
    motions = tour.arm_motions(ROBOT, 7, arms_move=True)
    still = tour.arm_motions(ROBOT, 7, arms_move=False)
    assert {*motions} == {*still} == {*walk}
    steps = 25  # of the first window
    for name, path in walk.items():
        times, positions = np.array(path).T
        assert motions[name].times[:50] == pytest.approx(times)
        assert motions[name].positions[:steps] == pytest.approx(
            positions[:steps]
        )
        assert still[name].positions.tolist() == [STANCE[name]]
        assert len(motions[name].times) == 4500


@pytest.mark.parametrize("engine", ["drake", "mujoco"])
def test_it_falls_from_the_crane_onto_its_feet(engine):
    """Oracle: by hand: it falls freely at first; its weight, on both feet.

    The arms follow their servos: the elbow, told to hold 0.6 rad, stays within
    the 0.1 rad by which it sags.
    """
    diagram = tour.TourDiagram(stand(engine=engine), "held", seed=3)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.set_initial_state(context)
    assert diagram.pelvis(context)[2] == BASE[6]
    simulator.AdvanceTo(0.02)
    logs = diagram.read_logs(context)
    assert not logs["foot_forces"].any()
    speed = logs["com_state"][-1, 5]
    assert speed == pytest.approx(-9.81 * 0.02, rel=0.1)
    simulator.AdvanceTo(0.6)
    logs = diagram.read_logs(context)
    weight = logs["foot_forces"][-25:].sum(axis=1).mean()
    assert weight == pytest.approx(33.34 * 9.81, rel=0.1)
    elbow = PLANT.GetJointByName("left_elbow_joint").position_start()
    assert np.abs(logs["state"][:, elbow] - 0.6).max() < 0.15
    assert diagram.fall_reason(context) == ""
    assert HumanoidDiagram.fall_reason(diagram, context) == ""


def test_it_has_fallen_below_20_cm():
    """Oracle: the benchmark's rule; our own says it earlier."""
    diagram = tour.TourDiagram(stand(), "punched", seed=3)
    context = diagram.CreateDefaultContext()
    diagram.set_initial_state(context)
    engine = diagram.engine.GetMyMutableContextFromRoot(context)
    q, _ = tour.hung(ROBOT, BASE)
    for height, ours, theirs in (0.3, True, False), (0.19, True, True):
        q[6] = height
        diagram.engine.SetPositions(engine, q)
        assert bool(HumanoidDiagram.fall_reason(diagram, context)) == ours
        assert bool(diagram.fall_reason(context)) == theirs


def test_a_robot_is_scored_by_the_wheel():
    """Oracle: by hand: it stays where it hangs: the waypoints' distances."""
    diagram = tour.TourDiagram(stand(), "held", seed=3)
    context = diagram.CreateDefaultContext()
    diagram.set_initial_state(context)
    score = tour.Score(diagram, 3)
    for tick in range(250 * 11 // 2):
        context.SetTime(0.004 * tick)
        assert not score(context)
    report = score.tour.report(5.5)
    x, y, yaw = WHEEL.bench_waypoints(3)[0]
    assert report["targets"] == 1
    assert report["pos_err_cm"] == pytest.approx(100.0 * np.hypot(x, y))
    assert report["yaw_err_deg"] == pytest.approx(abs(np.degrees(yaw)))


@pytest.mark.parametrize(
    ("changes", "stage", "message"),
    [
        ({}, "thrown", "stage = 'thrown': must be one of held, walked"),
        ({"fidelity": "ideal"}, "held", "fidelity = 'ideal': must be real"),
        ({"robot": "nadia"}, "held", "robot = 'nadia': must have the joint l"),
        (
            {"pushes": [{"at": "2 s", "delta_v": 0.3}]},
            "held",
            "pushes = [Push(body",
        ),
        ({"commands": [{"forward": 0.3}]}, "held", "commands = [Command(time"),
    ],
)
def test_refuses_what_is_not_the_tour_s(changes, stage, message):
    scenario = load_scenario("stand", **({"robot": "g1"} | changes))
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        tour.tour_scenario(scenario, stage, 0)


def test_an_interrupted_run_has_no_result(monkeypatch):
    """Oracle: what has not come to its end is neither complete nor fallen."""

    def interrupted(simulator, duration, **more):
        return replace(advance(simulator, 0.01, **more), interrupted=True)

    monkeypatch.setattr(tour, "advance", interrupted)
    with pytest.raises(RuntimeError, match="^held, seed 3: interrupted"):
        tour.run_tour(stand(), "held", 3)


def test_says_what_to_install(monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name=name.partition(".")[0])

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(ValueError, match="^tour: must have .* gaitkeeper is "):
        tour.wheel()
