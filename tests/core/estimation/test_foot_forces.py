"""Oracles: a first-order lag, moments of the noise, the optimum itself."""

import math

import numpy as np
import pytest

from nadia_balance.core.estimation.foot_forces import (
    BANDWIDTH,
    CARRIED,
    CARRIES,
    WEIGHT_ERROR,
    SoleTerms,
    carrying,
    observed,
    sole_forces,
)
from tests.whole_body_examples import nadia, random_state, terms_at

WEIGHT = 900.0
ACCELERATION, TORQUE = 4.0, 2.0  # standard deviations [rad/s^2], [N m]


@pytest.mark.parametrize("period", [0.001, 0.004])
def test_the_observer_lags_behind_a_force_that_begins(period):
    """Oracle: 1 - exp(-K t), whatever the period."""
    force = np.zeros(1)
    for _ in range(round(0.02 / period)):
        force = observed(force, np.array([100.0]), period)
    assert force[0] == pytest.approx(
        100.0 * (1.0 - math.exp(-BANDWIDTH * 0.02))
    )


def walking_terms(seed: int) -> SoleTerms:
    """Nadia in a random posture, its world turned and tilted."""
    terms = terms_at(random_state(seed, 8.0))
    rng = np.random.default_rng(seed)
    up, leg = rng.normal(size=3) + [0.0, 0.0, 4.0], np.arange(6)
    plant = nadia().control_plant()
    names = ("LEFT_HIP_Z", "RIGHT_HIP_Z")
    first = [plant.GetJointByName(name).velocity_start() for name in names]
    return SoleTerms(
        M=nadia().mass * terms.forces[:, :-1],
        J=terms.rows[:12, :-1].reshape(2, 6, -1),
        up=up / np.linalg.norm(up),
        legs=np.array([start + leg for start in first]),
    )


def told(external, terms) -> np.ndarray:
    noise = np.full(len(external), TORQUE)
    return sole_forces(external, terms, WEIGHT, ACCELERATION, noise)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_forces_without_noise_are_told_exactly(seed):
    """Oracle: J' of any wrenches; a push along the ground changes nothing."""
    terms = walking_terms(seed)
    rng = np.random.default_rng(seed)
    wrenches = rng.normal(size=(2, 6)) * [40.0, 40.0, 10.0, 90.0, 90.0, 300.0]
    external = np.einsum("fin,fi->n", terms.J, wrenches)
    forces = wrenches[:, 3:] @ terms.up
    assert told(external, terms) == pytest.approx(forces, abs=1e-6)
    push = np.cross(terms.up, rng.normal(size=3)) * 200.0
    external[3:6] += push  # at the base
    assert told(external, terms) == pytest.approx(forces, abs=1e-6)


def test_what_the_legs_do_not_explain_is_shared_by_their_noise():
    """Oracle: covariance of 20,000 readings of each leg, from J' F = noise."""
    terms = walking_terms(4)
    rng, n = np.random.default_rng(5), 20_000
    joints = terms.M.shape[0] - 6
    noise = ACCELERATION * rng.normal(size=(n, joints)) @ terms.M[6:]
    noise[:, 6:] += TORQUE * rng.normal(size=(n, joints))
    readings = [
        np.linalg.solve(terms.J[i][:, leg].T, noise[:, leg].T)[3:].T @ terms.up
        for i, leg in enumerate(terms.legs)
    ]
    variances = np.var(readings, axis=1)
    total = np.var(noise[:, 3:6] @ terms.up) + (WEIGHT_ERROR * WEIGHT) ** 2
    missing = np.zeros(joints + 6)
    missing[3:6] = 100.0 * terms.up
    expected = 100.0 * variances / (variances.sum() + total)
    # The variance of a variance is 2 / n; 20 N m of a base moment are not seen.
    assert told(missing, terms) == pytest.approx(expected, rel=0.05)
    assert expected.min() > 1.0


def test_a_straight_leg_is_given_what_the_other_does_not_carry():
    """Oracle: by hand: its own torques say nothing, but for 1e6 N of noise."""
    terms = walking_terms(6)
    terms.J[0][:, terms.legs[0][3]] = 1e-9  # the knee moves no sole
    forces = np.array([250.0, 650.0])
    external = np.einsum(
        "fin,f,i->n", terms.J, forces, np.r_[0, 0, 0, terms.up]
    )
    assert told(external, terms) == pytest.approx(forces, abs=1.0)
    external[terms.legs[0][3]] += 1e-3
    assert told(external, terms)[0] == pytest.approx(250.0, abs=30.0)


def test_a_foot_carries_from_more_than_it_is_let_go_at():
    """Oracle: by hand."""
    between = 0.5 * (CARRIED + CARRIES) * WEIGHT
    forces = np.array([between, between])
    carried = carrying(forces, np.array([1.0, 0.0]), WEIGHT)
    assert carried.tolist() == [1.0, 0.0]
    forces = np.array([0.99 * CARRIED, 1.01 * CARRIES]) * WEIGHT
    assert carrying(forces, carried, WEIGHT).tolist() == [0.0, 1.0]
