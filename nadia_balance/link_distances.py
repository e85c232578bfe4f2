"""How near the robot's links are to each other, and how that changes."""

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

_V = JacobianWrtVariable.kV


class LinkDistances:
    """Reads the distances of links from the context of a plant with shapes."""

    def __init__(
        self, plant: MultibodyPlant, scene_graph: SceneGraph, most: int
    ):
        """Returns no more than `most` pairs, the nearest ones."""
        self._plant, self._most = plant, most
        inspector = scene_graph.model_inspector()
        self._world = plant.world_frame()
        # The frame of a shape's body, and the shape's pose in it.
        self._place = {}
        for shape in inspector.GetAllGeometryIds():
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
            X_BG = inspector.GetPoseInFrame(shape)
            self._place[shape] = body.body_frame(), X_BG

    def calc(
        self, context: Context, within: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns distances (k,) [m], all <= `within`, and their rows (k, nv).

        Rows times v are the rates of the distances.
        """
        port = self._plant.get_geometry_query_input_port()
        pairs = port.Eval(context).ComputeSignedDistancePairwiseClosestPoints(
            within
        )
        pairs = sorted(pairs, key=lambda pair: pair.distance)[: self._most]
        rows = np.empty((len(pairs), self._plant.num_velocities()))
        for row, pair in zip(rows, pairs, strict=True):
            J_A = self._jacobian(context, pair.id_A, pair.p_ACa)
            J_B = self._jacobian(context, pair.id_B, pair.p_BCb)
            row[:] = pair.nhat_BA_W @ (J_A - J_B)
        return np.array([pair.distance for pair in pairs]), rows

    def _jacobian(self, context, shape, p_GC) -> np.ndarray:
        frame, X_BG = self._place[shape]
        return self._plant.CalcJacobianTranslationalVelocity(
            context, _V, frame, X_BG @ p_GC, self._world, self._world
        )
