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
        shapes = inspector.GetAllGeometryIds()
        self._index = {shape: i for i, shape in enumerate(shapes)}
        bodies = [
            plant.GetBodyFromFrameId(inspector.GetFrameId(s)) for s in shapes
        ]
        self._bodies = list({body.index(): body for body in bodies}.values())
        # By shape: its body's place among the bodies, and its pose on it.
        places = {body.index(): i for i, body in enumerate(self._bodies)}
        self._body = np.array([places[body.index()] for body in bodies])
        X_BG = [inspector.GetPoseInFrame(s) for s in shapes]
        self._p_BG = np.array([X.translation() for X in X_BG])
        self._R_BG = np.array([X.rotation().matrix() for X in X_BG])
        upper = _upper_body(robot, plant)
        self._is_upper = {
            shape: body.index() in upper
            for shape, body in zip(shapes, bodies, strict=True)
        }
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
        if not pairs:
            return np.empty(0), np.empty((0, self._plant.num_velocities()))
        distances = np.array([pair.distance for pair in pairs])
        normals = np.array([pair.nhat_BA_W for pair in pairs])
        shapes = np.array(
            [(self._index[p.id_A], self._index[p.id_B]) for p in pairs]
        ).T
        # On the bodies, (2, k, 3).
        points = np.array([(p.p_ACa, p.p_BCb) for p in pairs])
        points = self._p_BG[shapes] + np.einsum(
            "skij,ksj->ski", self._R_BG[shapes], points
        )
        bodies = self._body[shapes]
        rates = self._rates(context, bodies, points, normals)
        braking = self._params.link_braking(distances, rates)
        near = distances < self._params.link_attention
        urgent = np.flatnonzero(near | (braking > 0.0))
        urgent = urgent[np.argsort(-braking[urgent])][:MAX_PAIRS]
        rows = [
            normals[k]
            @ (
                self._jacobian(context, bodies[0, k], points[0, k])
                - self._jacobian(context, bodies[1, k], points[1, k])
            )
            for k in urgent
        ]
        return distances[urgent], np.reshape(
            rows, (len(urgent), self._plant.num_velocities())
        )

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

    def _rates(self, context, bodies, points, normals) -> np.ndarray:
        """Of the distances, (k,) [m/s]."""
        used = sorted(set(bodies.ravel().tolist()))
        R_WB = np.empty((len(self._bodies), 3, 3))
        V_WB = np.empty((len(self._bodies), 6))
        for i in used:
            body = self._bodies[i]
            X = self._plant.EvalBodyPoseInWorld(context, body)
            V = self._plant.EvalBodySpatialVelocityInWorld(context, body)
            R_WB[i], V_WB[i] = X.rotation().matrix(), V.get_coeffs()
        arms = np.einsum("skij,skj->ski", R_WB[bodies], points)
        V = V_WB[bodies]
        v_A, v_B = V[..., 3:] + np.cross(V[..., :3], arms)
        return np.einsum("ki,ki->k", normals, v_A - v_B)

    def _jacobian(self, context, body: int, p_BC: np.ndarray) -> np.ndarray:
        frame = self._bodies[body].body_frame()
        return self._plant.CalcJacobianTranslationalVelocity(
            context, _V, frame, p_BC, self._world, self._world
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
