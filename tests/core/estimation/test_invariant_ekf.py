"""Oracles: series, fine integration, finite differences, least squares."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import least_squares

from nadia_balance.core.estimation import invariant_ekf as ekf
from nadia_balance.core.estimation.invariant_ekf import InvariantEkf
from nadia_balance.core.estimation.sensors import SensorParams

T = 0.004
G = np.array([0.0, 0.0, -9.81])
BLIND = SensorParams(joint_noise=1e-3, gyro_bias=2e-3, force_bias=0.05)
NOISY = SensorParams(
    gyro_noise=2e-4,
    gyro_bias=2e-3,
    gyro_walk=1e-4,
    force_noise=3e-3,
    force_bias=0.05,
    force_walk=1e-3,
    joint_noise=1e-3,
)
LEG = np.random.default_rng(1).uniform(-0.9, 0.9, (2, 3, 6))  # Jacobians
W, F = np.array([0.8, -1.1, 2.0]), np.array([3.0, -2.0, 11.0])
ERROR = 0.005, 0.001, 0.005


def cross(a):
    return np.array([np.cross(a, e) for e in np.eye(3)]).T


def group(R, x):
    """The matrix (7, 7) of the group of double direct isometries."""
    X = np.eye(7)
    X[:3, :3], X[:3, 3:] = R, x.T
    return X


def exp(xi):
    """The exponential of the group, of (15,)."""
    X = np.zeros((7, 7))
    X[:3, :3], X[:3, 3:] = cross(xi[:3]), xi[3:].reshape(4, 3).T
    X = expm(X)
    return X[:3, :3], X[:3, 3:].T


def shifted(estimate, xi):
    """The truth that has the error `xi` (21,), by matrices alone."""
    X = group(*exp(xi[:15])) @ group(estimate.R, estimate.x)
    bias = estimate.bias + xi[15:].reshape(2, 3)
    return estimate._replace(R=X[:3, :3], x=X[:3, 3:].T, bias=bias)


def between(truth, estimate):
    """The error (21,), to first order."""
    X = group(truth.R, truth.x) @ np.linalg.inv(group(estimate.R, estimate.x))
    turn = 0.5 * (X[:3, :3] - X[:3, :3].T)
    turn = turn[2, 1], turn[0, 2], turn[1, 0]
    bias = (truth.bias - estimate.bias).ravel()
    return np.concatenate((turn, X[:3, 3:].T.ravel(), bias))


def moved(state, imu, steps=400):
    """Euler's midpoint in many steps, of dR = R w, dv = R f + g, dp = v."""
    h = T / steps
    R, x = state.R, state.x.copy()
    w, f = imu.reshape(2, 3) - state.bias
    half = expm(0.5 * h * cross(w))
    for _ in range(steps):
        a = R @ half @ f + G
        x[1] += h * (x[0] + 0.5 * h * a)
        x[0] += h * a
        R = R @ half @ half
    return state._replace(R=R, x=x)


def start(params=BLIND):
    R = expm(cross(np.array([0.1, -0.2, 0.5])))
    filter_ = InvariantEkf(params, T)
    begun = filter_.begin(R, np.array([3.0, -1.0, 0.9]), ERROR)
    for i in (0, 1):
        begun = filter_.touch(begun, i, np.array([0.1, 0.1, -0.9]), LEG[i])
    x = begun.x.copy()
    x[0] = 0.4, -0.3, 0.2
    return begun._replace(x=x)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.049, 0.051, 3.0])
def test_gammas_are_sums_of_powers(size):
    """Oracle: 40 terms."""
    K = cross(size * np.array([0.6, 0.0, 0.8]))
    for m, found in enumerate(ekf.gammas(size * np.array([0.6, 0.0, 0.8]))):
        power, total = np.eye(3), np.zeros((3, 3))
        for n in range(40):
            total += power / math.factorial(n + m)
            power = power @ K
        assert found == pytest.approx(total, abs=1e-11)


def test_the_mean_moves_as_the_body_does():
    """Oracle: 400 steps in the period."""
    imu = np.concatenate((W, F))
    found, expected = InvariantEkf(BLIND, T).predict(start(), imu), start()
    expected = moved(expected, imu)
    assert found.R == pytest.approx(expected.R, abs=1e-12)
    assert found.x == pytest.approx(expected.x, abs=1e-8)


def test_the_error_moves_as_its_transition_says(monkeypatch):
    """Oracle: finite differences of the motion in 40 steps, per error."""
    monkeypatch.setattr(ekf, "STANCE_NOISE", 0.0)
    imu, last, eps = np.concatenate((W, F)), start(), 1e-6
    mean = moved(last, imu, 40)
    Phi = np.column_stack(
        [
            between(moved(shifted(last, eps * e), imu, 40), mean) / eps
            for e in np.eye(21)
        ]
    )
    A = np.random.default_rng(0).standard_normal((21, 21))
    found = InvariantEkf(BLIND, T).predict(last._replace(cov=A @ A.T), imu).cov
    # What turns and moves within a period squared: (2.4 rad/s * 4 ms)^2 / 12.
    expected = Phi @ A @ A.T @ Phi.T
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-4)


def legs_of(state, i, noise):
    """The measured sole `i` in I."""
    measured = state.R.T @ (state.x[2 + i] - state.x[1])
    return measured + LEG[i] @ noise


def test_a_filter_without_process_noise_is_least_squares(monkeypatch):
    """Oracle: the start that fits 40 ticks of legs best, moved to the end.

    Of all errors at once, by scipy, with a motion integrated here.
    """
    monkeypatch.setattr(ekf, "STANCE_NOISE", 0.0)
    rng, filter_ = np.random.default_rng(5), InvariantEkf(BLIND, T)
    first = start()
    # Soles stand a little aside, so that the prior is of full rank.
    first = first._replace(cov=first.cov + 1e-6 * np.eye(21))
    root = np.linalg.cholesky(first.cov)
    truth, estimate = shifted(first, root @ rng.standard_normal(21)), first
    imus = [np.concatenate((W, F)) * math.cos(0.1 * k) for k in range(40)]
    measured = []
    for imu in imus:
        truth = moved(truth, imu, 4)
        noise = 1e-3 * rng.standard_normal(6)
        measured.append([legs_of(truth, i, noise) for i in (0, 1)])
        estimate = filter_.predict(estimate, imu)
        both = np.ones(2, dtype=bool)
        estimate, _ = filter_.correct(
            estimate, both, np.array(measured[-1]), LEG
        )
    S = 1e-6 * np.concatenate(LEG) @ np.concatenate(LEG).T
    weight = np.linalg.inv(np.linalg.cholesky(S))

    def misfit(z):
        state, found = shifted(first, root @ z), [z]
        for imu, soles in zip(imus, measured, strict=True):
            state = moved(state, imu, 4)
            told = [legs_of(state, i, np.zeros(6)) for i in (0, 1)]
            found.append(weight @ (np.ravel(soles) - np.ravel(told)))
        return np.concatenate(found)

    best = shifted(first, root @ least_squares(misfit, np.zeros(21)).x)
    for imu in imus:
        best = moved(best, imu, 4)
    error = between(best, estimate)
    # Parts of a standard deviation.
    assert np.max(np.abs(error) / np.sqrt(np.diag(estimate.cov))) < 0.02
    off = between(truth, estimate)
    assert np.max(np.abs(off) / np.sqrt(np.diag(estimate.cov))) > 0.5


def test_errors_are_as_large_as_the_filter_says():
    """Oracle: the chi^2 of 20 runs of 15 errors, within its 95 % bounds.

    Each run has its own start, biases, noise, and feet that creep; every 25
    ticks one foot is lifted and set down elsewhere.
    """
    filter_, total = InvariantEkf(NOISY, T), 0.0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        estimate = start(NOISY)
        values, vectors = np.linalg.eigh(estimate.cov)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        truth = shifted(estimate, root @ rng.standard_normal(21))
        white = np.repeat([2e-4, 3e-3], 3) / math.sqrt(T)
        walk = np.array([[1e-4], [1e-3]]) * math.sqrt(T)
        for k in range(150):
            ideal = np.concatenate((W * math.sin(0.07 * k), -truth.R.T @ G))
            bias = truth.bias.ravel()
            truth = moved(truth, ideal + bias, 2)
            x = truth.x.copy()
            x[2:] += (
                ekf.STANCE_NOISE * math.sqrt(T) * rng.standard_normal((2, 3))
            )
            if k % 25 == 0:
                x[2 + k // 25 % 2, :2] += 0.3
            truth = truth._replace(
                x=x, bias=truth.bias + walk * rng.standard_normal((2, 3))
            )
            imu = ideal + bias + white * rng.standard_normal(6)
            estimate = filter_.predict(estimate, imu)
            noise = 1e-3 * rng.standard_normal(6)
            soles = np.array([legs_of(truth, i, noise) for i in (0, 1)])
            stands = np.ones(2, dtype=bool)
            if k % 25 == 0:
                foot = k // 25 % 2
                stands[foot] = False
                estimate = filter_.touch(estimate, foot, soles[foot], LEG[foot])
            estimate, _ = filter_.correct(estimate, stands, soles, LEG)
        e, cov = between(truth, estimate), estimate.cov
        used = [*range(9), *range(15, 21)]
        e, cov = e[used], cov[np.ix_(used, used)]
        total += e @ np.linalg.solve(cov, e)
    # chi^2 of 300: 95 % within 300 +- 1.96 sqrt(600).
    assert total == pytest.approx(300.0, abs=1.96 * math.sqrt(600.0))


def test_a_foot_that_slips_is_not_believed():
    """Oracle: the other foot, without it."""
    filter_, last = InvariantEkf(BLIND, T), start()
    soles = np.array([legs_of(last, i, np.zeros(6)) for i in (0, 1)])
    soles[0, 0] += 0.1
    both, right = np.array([True, True]), np.array([False, True])
    found, slipped = filter_.correct(last, both, soles, LEG)
    expected, _ = filter_.correct(last, right, soles, LEG)
    assert slipped == [0]
    assert np.array_equal(found.R, expected.R)
    assert np.array_equal(found.x[:2], expected.x[:2])
    assert found.x[2] == pytest.approx(found.x[1] + found.R @ soles[0])


def test_a_flat_sole_on_known_ground_bounds_height_and_tilt():
    """Oracle: variances of parallel measurements, without a lever arm."""
    last = start()._replace(cov=np.diag(np.full(21, 1e-4)), R=np.eye(3))
    x = np.zeros((4, 3))
    x[2, 2] = 0.03
    turn, J = 0.01, np.diag([1.0, 2.0, 3.0])
    up = expm(cross(np.array([turn, 0.0, 0.0])))[:, 2]
    filter_, last = InvariantEkf(BLIND, T), last._replace(x=x)
    found = filter_.level(last, 0, 0.01, up, J)
    share = 1e-4 / (1e-4 + ekf.SINKING**2)
    assert found.x[2, 2] == pytest.approx(0.03 - share * 0.02, abs=1e-5)
    assert found.cov[11, 11] == pytest.approx(1e-4 * (1.0 - share))
    noise = ekf.FLATNESS**2 + np.square([1e-3, 2e-3])
    share = 1e-4 / (1e-4 + noise)
    assert np.diag(found.cov)[:2] == pytest.approx(1e-4 * (1.0 - share))
    tilt = np.arcsin((found.R @ up)[:2])
    assert tilt == pytest.approx([0.0, -turn * (1.0 - share[0])], abs=1e-6)
    on_edge = expm(cross(np.array([0.05, 0.0, 0.0])))[:, 2]
    assert filter_.level(last, 0, 0.01, on_edge, J) is last
