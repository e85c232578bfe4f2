"""How near the robot's links are to each other, and how that changes."""

import numpy as np
from pydrake.geometry import SceneGraph, SignedDistancePair
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable
from pydrake.systems.framework import Context

from nadia_balance.core.whole_body_command import MAX_PAIRS
from nadia_balance.robot import RobotModel

_V = JacobianWrtVariable.kV


class LinkDistances:
    """Reads the distances of links from the context of a plant with shapes.

    What counts is nearer than `link_attention`; or nearer than `arm_attention`
    and so fast that it has to brake, if one of the links is of the upper body.
    Legs swing past each other closely, by a way of their own.
    """

    def __init__(
        self,
        robot: RobotModel,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
    ):
        """Of `robot`, alone in `plant`."""
        self._plant, self._params = plant, robot.whole_body
        inspector = scene_graph.model_inspector()
        self._world = plant.world_frame()
        upper = _upper_body(robot, plant)
        # The frame of a shape's body, and the shape's pose in it.
        self._place, self._is_upper = {}, {}
        for shape in inspector.GetAllGeometryIds():
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
            X_BG = inspector.GetPoseInFrame(shape)
            self._place[shape] = body.body_frame(), X_BG
            self._is_upper[shape] = body.index() in upper
        self._upper_pairs = [
            (a, b)
            for a, b in sorted(inspector.GetCollisionCandidates())
            if self._is_upper[a] or self._is_upper[b]
        ]

    def calc(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Returns distances (k,) [m], and their rows (k, nv), k <= MAX_PAIRS.

        Rows times v are the rates of the distances.  The first has to brake
        most.
        """
        pairs = self._pairs(context)
        rows = np.empty((len(pairs), self._plant.num_velocities()))
        for row, pair in zip(rows, pairs, strict=True):
            J_A = self._jacobian(context, pair.id_A, pair.p_ACa)
            J_B = self._jacobian(context, pair.id_B, pair.p_BCb)
            row[:] = pair.nhat_BA_W @ (J_A - J_B)
        distances = np.array([pair.distance for pair in pairs])
        rates = rows @ self._plant.GetVelocities(context)
        braking = self._params.link_braking(distances, rates)
        near = distances < self._params.link_attention
        urgent = np.flatnonzero(near | (braking > 0.0))
        urgent = urgent[np.argsort(-braking[urgent])][:MAX_PAIRS]
        return distances[urgent], rows[urgent]

    def _pairs(self, context: Context) -> list[SignedDistancePair]:
        """Those near enough: of the legs, and with the upper body."""
        port = self._plant.get_geometry_query_input_port()
        query, params = port.Eval(context), self._params
        pairs = [
            pair
            for pair in query.ComputeSignedDistancePairwiseClosestPoints(
                params.link_attention
            )
            if not (self._is_upper[pair.id_A] or self._is_upper[pair.id_B])
        ]
        # One by one, as most that are so near are of the legs.
        far = max(params.arm_attention, params.link_attention)
        for a, b in self._upper_pairs:
            pair = query.ComputeSignedDistancePairClosestPoints(a, b)
            if pair.distance < far:
                pairs.append(pair)
        return pairs

    def _jacobian(self, context, shape, p_GC) -> np.ndarray:
        frame, X_BG = self._place[shape]
        return self._plant.CalcJacobianTranslationalVelocity(
            context, _V, frame, X_BG @ p_GC, self._world, self._world
        )


def _upper_body(robot: RobotModel, plant: MultibodyPlant) -> set[BodyIndex]:
    """Those that move with a joint that moves no foot."""
    feet = {plant.GetBodyByName(n).index() for n in robot.foot_bodies.values()}
    upper = set()
    for joint in plant.GetJointIndices():
        if plant.get_joint(joint).num_velocities() == 1:
            moved = set(plant.GetBodiesKinematicallyAffectedBy([joint]))
            if not moved & feet:
                upper |= moved
    return upper
