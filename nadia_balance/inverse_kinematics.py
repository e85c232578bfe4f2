"""Inverse kinematics of a robot whose soles stand on level ground."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import SnoptSolver


class StandingKinematics(InverseKinematics):
    """Inverse kinematics with level soles and a bounded centre of mass."""

    def __init__(
        self,
        plant: MultibodyPlant,
        soles: Mapping[str, np.ndarray],
        places: Mapping[str, ArrayLike],
        com_lower: ArrayLike,
        com_upper: ArrayLike,
    ):
        """Constrains the robot of `plant`, finalized.

        `soles` are the positions (3,) [m] of the sole centres in the frames of
        the feet, by foot; `places` are their positions (2,) [m] on the plane
        z = 0 of W.  The CoM (3,) [m] in W is between `com_lower` and
        `com_upper`.
        """
        super().__init__(plant)
        world, free = plant.world_frame(), np.inf
        for name, p_FS in soles.items():
            foot, (x, y) = plant.GetFrameByName(name), places[name]
            # Three points with 3 + 2 + 1 fixed coordinates fix the sole.
            for p_S, low, high in (
                ([0.0, 0.0, 0.0], [x, y, 0.0], [x, y, 0.0]),
                ([0.1, 0.0, 0.0], [-free, y, 0.0], [free, y, 0.0]),
                ([0.0, 0.1, 0.0], [-free, -free, 0.0], [free, free, 0.0]),
            ):
                self.AddPositionConstraint(foot, p_FS + p_S, world, low, high)
        prog = self.prog()
        self._com = prog.NewContinuousVariables(3, "com")
        prog.AddBoundingBoxConstraint(com_lower, com_upper, self._com)
        prog.AddConstraint(
            ComPositionConstraint(
                plant, None, world, self.get_mutable_context()
            ),
            [*self.q(), *self._com],
        )

    def nearest(
        self, q: np.ndarray, com: ArrayLike, weight: float = 1.0
    ) -> np.ndarray | None:
        """Returns the positions (nq,) nearest to `q`; None if there are none.

        The search begins at `q` (nq,) and the CoM `com` (3,) [m].
        """
        prog = self.prog()
        prog.AddQuadraticErrorCost(weight * np.eye(len(q)), q, self.q())
        prog.SetInitialGuess(self.q(), q)
        prog.SetInitialGuess(self._com, com)
        result = SnoptSolver().Solve(prog)
        return result.GetSolution(self.q()) if result.is_success() else None
