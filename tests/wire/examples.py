"""States and commands that mean nothing, and a balance that knows its ticks."""

import numpy as np

from nadia_balance.wire.messages import JointCommand, RobotState

N = 3  # joints
LIMITS = np.array([50.0, 100.0, 20.0])  # [N m]
BEARS = np.array([True, True, False])
STANDING = np.array([0.3, -0.2, 0.1])  # [rad]


def state(time: float, n: int = N, **changes) -> RobotState:
    """A state whose numbers rise with time, each at its own rate."""
    rates = np.arange(3 * n, dtype=float).reshape(3, n)
    values = {
        "time": time,
        "q": rates[0] * time,
        "dq": rates[1] * time,
        "tau": rates[2] * time,
        "quaternion": np.array([1.0, 0.0, 0.0, 0.0]),
        "gyro": np.array([1.0, -2.0, 3.0]) * time,
        "force": np.array([0.0, 5.0 * time, 9.81]),
    }
    return RobotState(**(values | changes))


def command(n: int = N, seed: int = 0) -> JointCommand:
    """A command of random numbers."""
    return JointCommand(*np.random.default_rng(seed).random((5, n)))


def numbers(message) -> dict:
    """The arrays and numbers of a message."""
    return {
        name: np.asarray(value, dtype=float)
        for name, value in vars(message).items()
    }


class FakeBalance:
    """Has a command for each tick; writes down what it is asked."""

    period = 0.004

    def __init__(self) -> None:
        self.shares = np.zeros(2)
        self.ticks, self.passed = [], []
        self.begun = 0
        self.fault, self.fall, self.is_broken = None, "", False

    def loads(self, imu, state):
        return self.shares

    def lies(self, state):
        return state.quaternion[0] < 0.5

    def begin(self) -> None:
        self.begun += 1

    def tick(self, imu, state, velocity):
        if self.fault:
            raise RuntimeError(self.fault)
        self.ticks.append((state.time, imu, state, velocity))
        if self.is_broken:
            return JointCommand(*np.full((5, N), np.nan))
        return command(seed=len(self.ticks))

    def estimate(self, imu, state):
        self.passed.append((state.time, imu))

    def finish(self) -> None:
        pass

    def fall_reason(self) -> str:
        return self.fall
