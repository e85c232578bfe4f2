"""Oracles: motion at a constant acceleration, a first-order lag, the plant."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.systems.state import StatePredictor
from tests.blocks import answer, asked, fix, running, tick, told
from tests.diagrams.simulated import SOON
from tests.whole_body_examples import random_state, standing_state

PERIOD = 0.002
TICKS = 5
DELAY = TICKS * PERIOD
NADIA = {f: load_robot("nadia", f) for f in ("ideal", "realistic")}
NQ = NADIA["ideal"].control_plant().num_positions()


def predicted(fidelity, v, acceleration, ticks):
    """What is predicted after `ticks` of a constant acceleration."""
    state = standing_state()
    state[NQ:] = v
    predictor = StatePredictor(NADIA[fidelity], PERIOD, DELAY)
    simulator, context = running(
        predictor,
        estimated_state=state,
        generalized_acceleration=np.full(state.size - NQ, acceleration),
    )
    for _ in range(ticks):
        tick(simulator, PERIOD)
    later = answer(predictor, context, "predicted_state")
    return later[:NQ] - state[:NQ], later[NQ:] - state[NQ:]


@pytest.mark.parametrize("ticks", [0, 2, 5, 50])
def test_joints_go_on_as_commanded(ticks):
    """Oracle: v0 + a t, and its integral, of what was commanded by now."""
    displacement, gain = predicted("ideal", 0.3, 4.0, ticks)
    t = min(ticks * PERIOD, DELAY)
    assert gain == pytest.approx(np.full(gain.size, 4.0 * t))
    expected = 0.3 * DELAY + 2.0 * t * t
    assert displacement[7:] == pytest.approx(np.full(NQ - 7, expected))


def test_drives_are_late():
    """Oracle: the integrals of 1 - exp(-t / T), in closed form."""
    displacement, gain = predicted("realistic", 0.0, 4.0, TICKS)
    lag = NADIA["realistic"].drives.lag
    late = lag * (1.0 - math.exp(-DELAY / lag))
    assert gain == pytest.approx(np.full(gain.size, 4.0 * (DELAY - late)))
    # The acceleration counts as constant in a period.
    expected = 4.0 * (0.5 * DELAY**2 - lag * (DELAY - late))
    assert displacement[7:] == pytest.approx(
        np.full(NQ - 7, expected), rel=0.02
    )


def test_a_lead_takes_the_positions_ahead():
    """Oracle: the plant's own kinematics, in 1,000 small steps."""
    state, lead = random_state(4, 5.0), 0.01
    q, v = np.split(state, [NQ])
    plant = NADIA["realistic"].control_plant()
    context = plant.CreateDefaultContext()
    for _ in range(1000):
        plant.SetPositions(context, q)
        q = q + 1e-3 * lead * plant.MapVelocityToQDot(context, v)
    predictor = StatePredictor(NADIA["realistic"], PERIOD, lead=lead)
    context = asked(predictor, estimated_state=state)
    later = answer(predictor, context, "predicted_state")
    # The pelvis turns on along a chord, by 0.02 rad here.
    assert later[:NQ] == pytest.approx(q, abs=1e-4)
    assert later[NQ:].tolist() == v.tolist()


def test_a_walking_robot_is_where_it_is_predicted():
    """Oracle: the plant's state; without prediction the error is larger."""
    text = f"{{imperfections: {{delay: 0.012}}, {SOON % 'right'}}}"
    scenario = load_scenario("walk_in_place", text=text)
    predictor = StatePredictor(NADIA["realistic"], 0.004, 0.012)
    built = HumanoidDiagram(scenario, state_predictor=predictor)
    simulator = Simulator(built)
    context = simulator.get_mutable_context()
    built.set_initial_state(context)
    sensor, errors = built.GetSubsystemByName("state_sensor"), []
    asked_of = (
        *((predictor, "predicted_state"), (sensor, "measured_state")),
        (built.engine, "state"),
    )
    for i in range(100):
        simulator.AdvanceTo(0.352 + i * 0.004)  # a swing from 0.45 s on
        predictions, measurements, state = (
            answer(system, system.GetMyContextFromRoot(context), name)
            for system, name in asked_of
        )
        errors.append(np.abs(np.stack((predictions, measurements)) - state))
    predictions, measurements = np.median(errors, axis=0)
    assert predictions[:NQ].max() < 0.1 * measurements[:NQ].max()
    assert predictions[NQ:].max() < 0.5 * measurements[NQ:].max()


JOINTS, SPEEDS = slice(7, NQ), slice(NQ + 6, None)


def swinging(period: float, ticks: int) -> tuple[list, list]:
    """States, and the accelerations from each to the next, of all joints."""
    rng, now = np.random.default_rng(2), standing_state().copy()
    amplitudes = rng.uniform(-3.0, 3.0, now[JOINTS].size)
    states, accelerations = [], []
    for i in range(ticks):
        a = amplitudes * math.sin(0.5 * i)
        states.append(now.copy())
        accelerations.append(np.concatenate((np.zeros(6), a)))
        now[JOINTS] += period * (now[SPEEDS] + 0.5 * period * a)
        now[SPEEDS] += period * a
    return states, accelerations


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_noise_of_the_sensors_is_filtered_and_motion_is_not(size):
    """Oracles: the motion itself, told a tick late, at the accelerations that
    are commanded; the moments of the noise.
    """
    ticks, rng, period = 400, np.random.default_rng(5), 0.004
    states, accelerations = swinging(period, ticks)
    noise = np.zeros((ticks, states[0].size))
    noise[:, JOINTS] = 1e-3 * rng.normal(size=noise[:, JOINTS].shape)
    noise[:, SPEEDS] = 0.05 * rng.normal(size=noise[:, SPEEDS].shape)
    inputs = [
        {
            "estimated_state": states[max(i - 1, 0)] + size * noise[i],
            "generalized_acceleration": accelerations[i],
        }
        for i in range(ticks)
    ]
    predictor = StatePredictor(
        NADIA["ideal"], period, period, sensors=load_sensors("consumer")
    )
    (answers,) = told(predictor, period, inputs, "predicted_state")
    errors = (answers - states)[ticks // 2 :]
    if not size:
        assert np.abs(errors).max() < 1e-9
        return
    # Less than half of the noise, and a sixth of it from tick to tick.
    assert errors[:, JOINTS].std() < 0.5e-3
    assert errors[:, SPEEDS].std() < 0.025
    assert np.diff(errors[:, SPEEDS], axis=0).std() < 0.05 * 2.0**0.5 / 6.0


def test_an_impact_is_not_filtered():
    """Oracle: by hand: 1 m/s more is told within the bound of the noise."""
    sensors = load_sensors("consumer")
    predictor = StatePredictor(NADIA["ideal"], 0.004, sensors=sensors)
    state = standing_state().copy()
    simulator, context = running(
        predictor,
        estimated_state=state,
        generalized_acceleration=np.zeros(state.size - NQ),
    )
    tick(simulator, 0.004)
    state[NQ:] += 1.0
    fix(predictor, context, estimated_state=state)
    speeds = answer(predictor, context, "predicted_state")[NQ:]
    assert speeds[3:6] == pytest.approx(np.ones(3))  # estimated, not measured
    assert np.all(speeds[6:] >= 1.0 - 3.0 * 0.05)
    assert np.all(speeds[6:] < 1.0)
