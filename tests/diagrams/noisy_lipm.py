"""A point mass whose controller sees it through noise."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.systems.wiring import connect


class VelocityNoise(LeafSystem):
    """Adds white noise to the CoM velocity, and what follows to the ICP.

    The noise is drawn before the start, a row for each tick, so that the
    outputs depend on the context alone.
    """

    def __init__(self, noise: np.ndarray, omega: float, period: float):
        """`noise` (n, 2) [m/s], of the ticks 0, ..., n - 1."""
        super().__init__()
        self._noise, self._omega, self._period = noise, omega, period
        self._com = self.DeclareVectorInputPort("com_state", 6)
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self.DeclareVectorOutputPort("com_state", 6, self._calc_com)
        self.DeclareVectorOutputPort("icp", 2, self._calc_icp)

    def _now(self, context) -> np.ndarray:
        return self._noise[round(context.get_time() / self._period)]

    def _calc_com(self, context, output):
        com = self._com.Eval(context).copy()
        com[3:5] += self._now(context)
        output.SetFromVector(com)

    def _calc_icp(self, context, output):
        noise = self._now(context) / self._omega
        output.SetFromVector(self._icp.Eval(context) + noise)


class NoisyLipmDiagram(LipmDiagram):
    """The LIPM diagram with noise on the velocity that the controller gets."""

    def __init__(self, scenario, deviation: float, seed: int = 1):
        """`deviation` [m/s] is the noise's standard deviation, per axis."""
        self._deviation, self._seed = deviation, seed
        super().__init__(scenario)

    def _sensed(self, builder):
        period = self.scenario.lipm_period
        ticks = round(self.scenario.duration / period) + 1
        rng = np.random.default_rng(self._seed)
        noise = self._deviation * rng.standard_normal((ticks, 2))
        sensor = builder.AddNamedSystem(
            "sensor", VelocityNoise(noise, self.robot.point_mass.omega, period)
        )
        connect(builder, self.plant, sensor, "com_state", "icp")
        return sensor
