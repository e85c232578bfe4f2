"""Oracles: what came in so long ago; moments of the normal distribution."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.systems.hardware import Imperfections, StateSensor
from tests.blocks import answer, fix, running, told
from tests.whole_body_examples import nadia, standing_state

PERIOD = 0.002
PLANT = nadia().control_plant()
NQ = PLANT.num_positions()
FORCES = np.array([400.0, 500.0])
NOISY = Imperfections(
    joint_noise=1e-3,
    joint_speed_noise=0.02,
    pelvis_noise=2e-3,
    pelvis_speed_noise=0.03,
)


def sensed(imperfections, ticks, seed=0, shift=0.0):
    """Both outputs in each of `ticks`, as the inputs grow by `shift`."""
    sensor = StateSensor(PLANT, imperfections, PERIOD, seed)
    start = {"state": standing_state(), "foot_forces": FORCES}
    inputs = [
        {name: value + i * shift for name, value in start.items()}
        for i in range(ticks)
    ]
    return told(
        sensor, PERIOD, inputs, "measured_state", "measured_foot_forces"
    )


@pytest.mark.parametrize("ticks", [0, 1, 5])
def test_tells_what_came_so_long_ago(ticks):
    """Oracle: the inputs, that much before; at first those of the start."""
    states, forces = sensed(Imperfections(delay=ticks * PERIOD), 9, shift=0.1)
    i = np.maximum(np.arange(9) - ticks, 0)[:, None]
    assert np.array_equal(states, standing_state() + i * 0.1)
    assert np.array_equal(forces, FORCES + i * 0.1)


def test_a_copy_goes_on_with_its_buffer():
    """Oracle: the input's change is felt three ticks later, as in a walk."""
    sensor = StateSensor(PLANT, Imperfections(delay=3 * PERIOD), PERIOD)
    walk, context = running(sensor, state=standing_state(), foot_forces=FORCES)
    walk.AdvanceTo(5 * PERIOD)
    fix(sensor, context, state=standing_state() + 1.0, foot_forces=FORCES + 1.0)
    copy = Simulator(sensor, context.Clone())
    copy.Initialize()
    for ticks in range(1, 5):
        copy.AdvanceTo((5 + ticks) * PERIOD)
        forces = answer(sensor, copy.get_context(), "measured_foot_forces")
        assert np.array_equal(forces, FORCES + (ticks >= 3))


def test_noise_is_white_and_of_the_deviations_asked_for():
    """Oracle: mean, deviation and correlation from tick to tick; the seed."""
    states, forces = sensed(NOISY, 2000)
    again, other = (sensed(NOISY, 3, seed)[0] for seed in (0, 1))
    assert np.array_equal(states[:3], again)
    assert not np.any(np.isclose(again[:, 4:], other[:, 4:], rtol=0.0))
    noise = states - standing_state()
    assert np.array_equal(forces, np.tile(FORCES, (2000, 1)))
    assert not np.any(noise[:, :4])  # the orientation
    for columns, deviation in (
        (slice(4, 7), NOISY.pelvis_noise),
        (slice(7, NQ), NOISY.joint_noise),
        (slice(NQ, NQ + 6), NOISY.pelvis_speed_noise),
        (slice(NQ + 6, None), NOISY.joint_speed_noise),
    ):
        z = noise[:, columns] / deviation
        # Four standard errors, of 2000 samples.
        assert z.mean(axis=0) == pytest.approx(0.0, abs=4.0 / 2000**0.5)
        assert z.std(axis=0) == pytest.approx(1.0, abs=4.0 / 4000**0.5)
        following = np.mean(z[1:] * z[:-1], axis=0)
        assert following == pytest.approx(0.0, abs=4.0 / 2000**0.5)


def test_refuses_a_delay_between_ticks():
    with pytest.raises(ValueError, match=r"^delay = 0\.003: must be a mult"):
        StateSensor(PLANT, Imperfections(delay=0.003), PERIOD)
