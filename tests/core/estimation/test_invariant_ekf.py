"""Oracles: series, fine integration, finite differences, least squares."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, expm
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from nadia_balance.core.estimation import invariant_ekf
from nadia_balance.core.estimation.invariant_ekf import InvariantEkf, Legs
from nadia_balance.core.estimation.sensors import SensorParams

T = 0.004
G = np.array([0.0, 0.0, -9.81])
BLIND = SensorParams(joint_noise=1e-3, gyro_bias=2e-3, force_bias=0.05)
NOISY = replace(
    BLIND, gyro_noise=2e-4, gyro_walk=1e-4, force_noise=3e-3, force_walk=1e-3
)
JOINTS = 12
LEG = np.random.default_rng(1).uniform(-0.9, 0.9, (2, 6, JOINTS))  # Jacobians
LEG[0, :, 6:] = LEG[1, :, :6] = 0.0
# The error (23,) in W of rotation, x, biases, headings: of all of xi.  What is
# in W turns about its z axis, and moves along x and y.
IN_W = np.eye(23, 26)
IN_W[[2, 21, 22], 23] = 1.0
IN_W[[6, 9, 12], 24] = IN_W[[7, 10, 13], 25] = 1.0
BOTH, STILL = np.array([True, True]), np.zeros((2, 3))
W, F = np.array([0.8, -1.1, 2.0]), np.array([3.0, -2.0, 11.0])
ERROR = np.array(((0.005, 0.005, 0.002), (0.001,) * 3, (0.003, 0.003, 0.005)))


def cross(a):
    return np.array([np.cross(a, e) for e in np.eye(3)]).T


def rotation(turn):
    """The rotation matrix (3, 3) of a rotation vector."""
    return Rotation.from_rotvec(turn).as_matrix()


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
    """The truth that has the error `xi` (23,), by matrices alone."""
    X = group(*exp(xi[:15])) @ group(estimate.R, estimate.x)
    bias = estimate.bias + xi[15:21].reshape(2, 3)
    heading = estimate.heading + xi[21:]
    return estimate._replace(
        R=X[:3, :3], x=X[:3, 3:].T, bias=bias, heading=heading
    )


def between(truth, estimate):
    """The error (23,), to first order."""
    X = group(truth.R, truth.x) @ np.linalg.inv(group(estimate.R, estimate.x))
    turn = 0.5 * (X[:3, :3] - X[:3, :3].T)
    turn = turn[2, 1], turn[0, 2], turn[1, 0]
    bias = (truth.bias - estimate.bias).ravel()
    heading = truth.heading - estimate.heading
    return np.concatenate((turn, X[:3, 3:].T.ravel(), bias, heading))


def in_w(estimate):
    """The covariance (23, 23) of the errors in W."""
    return IN_W @ estimate.cov @ IN_W.T


def moved(state, imu, steps=400):
    """Euler's midpoint in many steps, of dR = R w, dv = R f + g, dp = v."""
    h = T / steps
    R, x = state.R, state.x.copy()
    w, f = imu.reshape(2, 3) - state.bias
    half = rotation(0.5 * h * w)
    whole = half @ half
    for _ in range(steps):
        a = R @ half @ f + G
        x[1] += h * (x[0] + 0.5 * h * a)
        x[0] += h * a
        R = R @ whole
    return state._replace(R=R, x=x)


def turned(heading):
    """The rotation of a level sole."""
    return rotation(np.array([0.0, 0.0, heading]))


def legs_of(state, noise):
    """What encoders with `noise` (JOINTS,) tell of soles that lie level."""
    p = [state.R.T @ (d - state.x[1]) for d in state.x[2:]] + LEG[:, 3:] @ noise
    wrong = rotation(LEG[:, :3] @ noise)
    R = [
        E @ state.R.T @ turned(h)
        for E, h in zip(wrong, state.heading, strict=True)
    ]
    return Legs(np.array(p), np.array(R), LEG, STILL)


def start(params=BLIND):
    R = rotation(np.array([0.1, -0.2, 0.5]))
    filter_ = InvariantEkf(params, T)
    begun = filter_.begin(R, np.array([3.0, -1.0, 0.9]), ERROR)
    p, turn = np.array([0.1, 0.1, -0.9]), R.T @ turned(0.3)
    legs = Legs(np.array([p, p]), np.array([turn, turn]), LEG, STILL)
    for i in (0, 1):
        begun = filter_.touch(begun, i, legs)
    x = begun.x.copy()
    x[0] = 0.4, -0.3, 0.2
    return begun._replace(x=x)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.049, 0.051, 3.0])
def test_gammas_are_sums_of_powers(size):
    """Oracle: 40 terms."""
    K = cross(size * np.array([0.6, 0.0, 0.8]))
    for m, found in enumerate(
        invariant_ekf.gammas(size * np.array([0.6, 0.0, 0.8]))
    ):
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
    monkeypatch.setattr(invariant_ekf, "STANCE_NOISE", 0.0)
    monkeypatch.setattr(invariant_ekf, "TURNING", 0.0)
    imu, last, eps = np.concatenate((W, F)), start(), 1e-6
    mean = moved(last, imu, 40)
    Phi = np.column_stack(
        [
            between(moved(shifted(last, eps * e), imu, 40), mean) / eps
            for e in np.eye(23)
        ]
    )
    Phi = block_diag(Phi, np.eye(3))
    A = np.random.default_rng(0).standard_normal((26, 26))
    found = InvariantEkf(BLIND, T).predict(last._replace(cov=A @ A.T), imu).cov
    # What turns and moves within a period squared: (2.4 rad/s * 4 ms)^2 / 12.
    expected = Phi @ A @ A.T @ Phi.T
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_a_filter_without_process_noise_is_least_squares(monkeypatch):
    """Oracle: the start that fits 20 ticks of legs best, moved to the end.

    Of all errors at once, by scipy, with a motion integrated here.  A filter
    that has turn and place in the gauge leaves these as they were, and what it
    tells within the robot is the same.
    """
    monkeypatch.setattr(invariant_ekf, "STANCE_NOISE", 0.0)
    monkeypatch.setattr(invariant_ekf, "TURNING", 0.0)
    # A twentieth of the errors: of their squares the filter knows nothing.
    rng, sharp = np.random.default_rng(5), replace(BLIND, joint_noise=5e-5)
    filter_ = InvariantEkf(sharp, T)
    # Soles stand a little aside, so that the prior is of full rank.
    gauged = start()
    gauged.cov[:23, :23] += 1e-6 * np.eye(23)
    gauged.cov[:] /= 400.0
    cov = in_w(gauged)
    first = gauged._replace(cov=block_diag(cov, np.zeros((3, 3))))
    root = np.linalg.cholesky(cov)
    truth, estimate = shifted(first, root @ rng.standard_normal(23)), first
    imus = [np.concatenate((W, F)) * math.cos(0.1 * k) for k in range(20)]
    measured, weights, kept = [], [], gauged
    for imu in imus:
        truth = moved(truth, imu, 4)
        measured.append(legs_of(truth, 5e-5 * rng.standard_normal(JOINTS)))
        J = np.concatenate((LEG[:, 3:], (truth.R @ LEG[:, :3])[:, 2:]), axis=1)
        J = 5e-5 * J.reshape(8, JOINTS)
        weights.append(np.linalg.inv(np.linalg.cholesky(J @ J.T)))
        estimate = filter_.predict(estimate, imu)
        estimate = filter_.correct(estimate, BOTH, measured[-1])
        kept = filter_.predict(kept, imu)
        kept = filter_.correct(kept, BOTH, measured[-1])

    def misfit(z):
        state, found = shifted(first, root @ z), [z]
        for imu, legs, weight in zip(imus, measured, weights, strict=True):
            state = moved(state, imu, 4)
            x, y, _ = state.R @ legs.R[:, :, 0].T
            off = legs.p - legs_of(state, np.zeros(JOINTS)).p
            turn = np.arctan2(y, x) - state.heading
            found.append(weight @ np.column_stack((off, turn)).ravel())
        return np.concatenate(found)

    best = shifted(first, root @ least_squares(misfit, np.zeros(23)).x)
    for imu in imus:
        best = moved(best, imu, 4)
    error = between(best, estimate)
    # Parts of a standard deviation.
    assert np.max(np.abs(error) / np.sqrt(np.diag(in_w(estimate)))) < 0.02
    off = between(truth, estimate)
    assert np.max(np.abs(off) / np.sqrt(np.diag(in_w(estimate)))) > 0.5
    # The whole of both, but for one turn about z and a move along x and y.
    other = between(estimate, kept)
    gauge = np.linalg.lstsq(IN_W[:, 23:], other, rcond=None)[0]
    rest = other - IN_W[:, 23:] @ gauge
    assert np.max(np.abs(rest) / np.sqrt(np.diag(in_w(estimate)))) < 0.02
    assert np.array_equal(kept.cov[23:, 23:], gauged.cov[23:, 23:])
    assert np.all(np.linalg.eigvalsh(in_w(kept) - in_w(estimate)) > -1e-9)


def test_errors_are_as_large_as_the_filter_says():
    """Oracle: the chi^2 of 20 runs of 15 errors, within its 95 % bounds.

    Each run has its own start, biases, noise, and feet that creep; every 25
    ticks one foot is lifted and set down elsewhere.
    """
    filter_, total = InvariantEkf(NOISY, T), 0.0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        estimate = start(NOISY)
        values, vectors = np.linalg.eigh(in_w(estimate))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        truth = shifted(estimate, root @ rng.standard_normal(23))
        white = np.repeat([2e-4, 3e-3], 3) / math.sqrt(T)
        walk = np.array([[1e-4], [1e-3]]) * math.sqrt(T)
        for k in range(150):
            ideal = np.concatenate((W * math.sin(0.07 * k), -truth.R.T @ G))
            bias = truth.bias.ravel()
            truth = moved(truth, ideal + bias, 1)
            x = truth.x.copy()
            x[2:] += (
                invariant_ekf.STANCE_NOISE
                * math.sqrt(T)
                * rng.standard_normal((2, 3))
            )
            heading = truth.heading + (
                invariant_ekf.TURNING * math.sqrt(T) * rng.standard_normal(2)
            )
            foot = k // 25 % 2
            if k % 25 == 0:
                x[2 + foot, :2] += 0.3
                heading[foot] += 0.2
            walked = truth.bias + walk * rng.standard_normal((2, 3))
            truth = truth._replace(x=x, bias=walked, heading=heading)
            imu = ideal + bias + white * rng.standard_normal(6)
            estimate = filter_.predict(estimate, imu)
            legs = legs_of(truth, 1e-3 * rng.standard_normal(JOINTS))
            stands = BOTH.copy()
            if k % 25 == 0:
                stands[foot] = False
                estimate = filter_.touch(estimate, foot, legs)
            estimate = filter_.correct(estimate, stands, legs)
        e, cov = between(truth, estimate), in_w(estimate)
        used = [*range(9), *range(15, 21)]
        e, cov = e[used], cov[np.ix_(used, used)]
        total += e @ np.linalg.solve(cov, e)
    # chi^2 of 300: 95 % within 300 +- 1.96 sqrt(600).
    assert total == pytest.approx(300.0, abs=1.96 * math.sqrt(600.0))


def test_a_landing_changes_nothing_that_is_known_of_the_rest():
    """Oracle: the covariance in W before; the sole's is the body's, and noise.

    Turn and place of the whole go to the gauge, which has some of them before.
    """
    foot, body = [9, 10, 11, 21], [6, 7, 8, 2]
    A = np.random.default_rng(2).standard_normal((26, 26))
    last = start()._replace(cov=A @ A.T)
    found = InvariantEkf(BLIND, T).touch(last, 0, legs_of(last, np.zeros(12)))
    copies = np.eye(23)
    copies[foot] = copies[body]
    expected = copies @ in_w(last) @ copies.T
    J = np.vstack((last.R @ LEG[0, 3:], (last.R @ LEG[0, :3])[2]))
    expected[np.ix_(foot, foot)] += 1e-6 * J @ J.T
    assert in_w(found) == pytest.approx(expected, rel=0.0, abs=1e-9)
    assert found.cov[[2, 6, 7]] == pytest.approx(np.zeros((3, 26)), abs=1e-12)
    told = invariant_ekf.IN_W @ found.cov @ invariant_ekf.IN_W.T
    assert told == pytest.approx(expected[:9, :9])


def test_a_foot_that_slips_is_not_believed():
    """Oracle: the other foot, without it."""
    filter_, last = InvariantEkf(BLIND, T), start()
    legs = legs_of(last, np.zeros(JOINTS))
    legs.p[0, 0] += 0.1
    found = filter_.correct(last, BOTH, legs)
    expected = filter_.correct(last, np.array([False, True]), legs)
    assert np.array_equal(found.R, expected.R)
    assert np.array_equal(found.x[:2], expected.x[:2])
    assert found.x[2] == pytest.approx(found.x[1] + found.R @ legs.p[0])


def test_a_flat_sole_on_known_ground_bounds_height_and_tilt():
    """Oracle: variances of parallel measurements, without a lever arm."""
    last = start()._replace(cov=np.diag(np.full(26, 1e-4)), R=np.eye(3))
    x = np.zeros((4, 3))
    x[2, 2] = 0.03
    turn, J = 0.01, np.zeros((2, 6, 3))
    J[0, :3] = np.diag([1.0, 2.0, 3.0])
    tilted = rotation(np.array([turn, 0.0, 0.0]))
    legs = Legs(STILL, np.array([tilted, tilted]), J, STILL)
    filter_, last = InvariantEkf(BLIND, T), last._replace(x=x)
    found = filter_.level(last, 0, 0.01, legs)
    share = 1e-4 / (1e-4 + invariant_ekf.SINKING**2)
    assert found.x[2, 2] == pytest.approx(0.03 - share * 0.02, abs=1e-5)
    assert found.cov[11, 11] == pytest.approx(1e-4 * (1.0 - share))
    noise = invariant_ekf.FLATNESS**2 + np.square([1e-3, 2e-3])
    share = 1e-4 / (1e-4 + noise)
    assert np.diag(found.cov)[:2] == pytest.approx(1e-4 * (1.0 - share))
    tilt = np.arcsin((found.R @ tilted[:, 2])[:2])
    assert tilt == pytest.approx([0.0, -turn * (1.0 - share[0])], abs=1e-6)
    on_edge = rotation(np.array([0.06, 0.0, 0.0]))
    legs = legs._replace(R=np.array([on_edge, on_edge]))
    assert filter_.level(last, 0, 0.01, legs) is last
