"""Avoidance of self-collisions: distances of links and rows of the QP."""

import itertools
import math

import numpy as np
from pydrake.geometry import Capsule, SceneGraphInspector, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import SegmentPairs, cross
from nadia_balance.core.whole_body.command import Avoidance
from nadia_balance.core.whole_body.params import CollisionAvoidanceParams
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import body_poses, joints

MAX_PAIRS = 8  # largest number of pairs that count
_V = JacobianWrtVariable.kV
_ORIGIN = np.zeros(3)
_TINY = 1e-9  # avoids division by zero if the axes of links meet [m]


class CollisionAvoidance:
    """Keeps links apart: (d/dt + rate)^2 (d - clearance) >= 0.

    A pair counts if its distance d is less than `attention`, then as a hard
    limit, or, with a link of the upper body, if it is less than `arm_attention`
    and decreases so fast that it must brake, then as a soft task.  Pairs of
    legs have no larger distance: legs pass each other closely, and the swing
    foot's reference makes its own detour.

    Capsules and spheres are measured in closed form, all pairs at once; pairs
    with another shape are measured by the SceneGraph, one by one.
    """

    def __init__(self, params: CollisionAvoidanceParams, robot, plant, scene):
        """Measures the links of `robot`, the only one in `plant`.

        `scene` is the SceneGraph with their shapes.
        """
        self._plant, self._params = plant, params
        self._world = plant.world_frame()
        inspector = scene.model_inspector()
        candidates = sorted(inspector.GetCollisionCandidates())
        self._shapes = {
            shape: _Shape(inspector, plant, shape)
            for shape in itertools.chain.from_iterable(candidates)
        }
        bodies = {shape.body.index() for shape in self._shapes.values()}
        self._bodies = [plant.get_body(body) for body in sorted(bodies)]
        self._number = {b.index(): i for i, b in enumerate(self._bodies)}
        upper = _upper_body(robot, plant)
        round_pairs, self._others = [], []
        for pair in candidates:
            shapes = [self._shapes[shape] for shape in pair]
            far = params.attention
            if any(shape.body.index() in upper for shape in shapes):
                far = max(params.arm_attention, far)
            if all(shape.radius is not None for shape in shapes):
                round_pairs.append((*shapes, far))
            else:
                self._others.append((*pair, far))
        self._set_round_pairs(round_pairs)

    def _set_round_pairs(self, pairs: list) -> None:
        """Builds the tables of k pairs of capsules and spheres."""
        sides = [[pair[side] for pair in pairs] for side in (0, 1)]
        shapes = list(dict.fromkeys(sides[0] + sides[1]))
        # The pose of its body times a segment is [begin, way] (3, 2) in W.
        self._segments = np.array([s.segment for s in shapes]).reshape(-1, 4, 2)
        owner = [self._number[s.body.index()] for s in shapes]
        self._owner = np.array(owner, dtype=int)
        # Indices of the first and the second shape, and body, of each pair.
        numbers = [[shapes.index(s) for s in side] for side in sides]
        self._sides = np.array(numbers, dtype=int)
        self._pair_bodies = self._owner[self._sides]
        lengths = np.linalg.norm(self._segments[:, :3, 1], axis=1)
        self._pairs = SegmentPairs(lengths[self._sides])
        radii = np.array([s.radius for s in shapes])
        self._radii = radii[self._sides].sum(axis=0)
        self._squared_far = (self._radii + [pair[2] for pair in pairs]) ** 2

    def calc(self, context: Context) -> Avoidance:
        """Returns the rows of the pairs that need the largest decelerations.

        They are at most MAX_PAIRS, and sorted, the most urgent first.
        """
        distance, rows = self.distances(context)
        params, v = self._params, self._plant.GetVelocities(context)
        near = distance < params.attention
        limits, braking = (
            np.column_stack(
                (rows[of], -params.braking(distance[of], rows[of] @ v))
            )
            for of in (near, ~near)
        )
        return Avoidance(limits, math.sqrt(params.arm_weight) * braking)

    def distances(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Returns distances (k,) [m], and their rows (k, nv), k <= MAX_PAIRS.

        Rows times v are the rates of the distances.
        """
        plant = self._plant
        X_WB = body_poses(plant, context, self._bodies)
        distance, normal, p, bodies = self._near_round(X_WB)
        if self._others:
            more = self._near_others(context, X_WB)
            both = zip((distance, normal, p, bodies), more, strict=True)
            distance, normal, p, bodies = (
                np.concatenate(arrays, axis=-1) for arrays in both
            )
        if not distance.size:
            return np.empty(0), np.empty((0, plant.num_velocities()))
        # n . (v + w x r) = (r x n) . w + n . v for V = [w, v] of a body; a
        # shift of the point along n, from axis to surface, has no effect.
        W = np.empty((6, 2, distance.size))
        W[3:, 0], W[3:, 1] = normal, -normal
        W[:3] = cross(p - X_WB[:, :, 3].T.take(bodies, axis=1), W[3:])
        velocity = plant.EvalBodySpatialVelocityInWorld
        V = np.empty((len(self._bodies), 6))
        for i in set(bodies.ravel().tolist()):
            V[i] = velocity(context, self._bodies[i]).get_coeffs()
        rates = np.einsum("ipk,pki->k", W, V.take(bodies, axis=0))
        braking = self._params.braking(distance, rates)
        near = distance < self._params.attention
        urgent = (near | (braking > 0.0)).nonzero()[0]
        if urgent.size > 1:
            urgent = urgent[np.argsort(-braking[urgent])][:MAX_PAIRS]
        rows = np.empty((urgent.size, plant.num_velocities()))
        jacobian = plant.CalcJacobianSpatialVelocity
        world = self._world
        for row, k in zip(rows, urgent.tolist(), strict=True):
            frames = [self._bodies[body].body_frame() for body in bodies[:, k]]
            J_A, J_B = (
                jacobian(context, _V, frame, _ORIGIN, world, world)
                for frame in frames
            )
            row[:] = W[:, 0, k] @ J_A + W[:, 1, k] @ J_B
        return distance[urgent], rows

    def _near_round(self, X_WB: np.ndarray) -> tuple[np.ndarray, ...]:
        """Returns the n near pairs of capsules and spheres.

        Distances (n,) [m], normals (3, n) from the second to the first link,
        closest points (3, 2, n) [m] on the axes, both in W, and numbers (2, n)
        of the links.
        """
        placed = (X_WB.take(self._owner, axis=0) @ self._segments).T
        begin, way = placed.take(self._sides, axis=2)
        p = self._pairs.closest_points(begin, way)
        apart = p[:, 0] - p[:, 1]
        squares = np.einsum("ik,ik->k", apart, apart)
        near = (squares < self._squared_far).nonzero()[0]
        length = np.sqrt(squares.take(near))
        normal = apart.take(near, axis=1) / np.maximum(length, _TINY)
        bodies = self._pair_bodies.take(near, axis=1)
        distance = length - self._radii.take(near)
        return distance, normal, p.take(near, axis=2), bodies

    def _near_others(self, context: Context, X_WB: np.ndarray) -> tuple:
        """Returns the same for other shapes, with points on the surfaces."""
        query = self._plant.get_geometry_query_input_port().Eval(context)
        found = []
        for a, b, far in self._others:
            pair = query.ComputeSignedDistancePairClosestPoints(a, b)
            if pair.distance < far:
                shapes = self._shapes[a], self._shapes[b]
                bodies = [self._number[s.body.index()] for s in shapes]
                p_GC = pair.p_ACa, pair.p_BCb
                ends = zip(bodies, shapes, p_GC, strict=True)
                points = [X_WB[i] @ [*(s.X_BG @ p), 1.0] for i, s, p in ends]
                row = pair.distance, *pair.nhat_BA_W, *np.ravel(points), *bodies
                found.append(row)
        columns = np.array(found).reshape(-1, 12).T
        p = columns[4:10].reshape(2, 3, -1).transpose(1, 0, 2)
        return columns[0], columns[1:4], p, columns[10:].astype(int)


class _Shape:
    """A shape of a link, with its axis if it is a capsule or a sphere."""

    def __init__(self, inspector: SceneGraphInspector, plant, shape):
        """A pose [R, p] of the body times `segment` (4, 2) is [begin, way].

        `radius` [m] is None unless the shape is a capsule or a sphere.
        """
        self.body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        self.X_BG = inspector.GetPoseInFrame(shape)
        form = inspector.GetShape(shape)
        is_round = isinstance(form, Capsule | Sphere)
        self.radius = form.radius() if is_round else None
        way = np.zeros(3)
        if isinstance(form, Capsule):
            way = form.length() * self.X_BG.rotation().matrix()[:, 2]
        begin = self.X_BG.translation() - 0.5 * way
        self.segment = np.array([[*begin, 1.0], [*way, 0.0]]).T


def _upper_body(robot: RobotModel, plant: MultibodyPlant) -> set[BodyIndex]:
    """The bodies moved by a joint that moves no foot."""
    feet = {plant.GetBodyByName(n).index() for n in robot.foot_bodies.values()}
    upper = set()
    for joint in joints(plant):
        if joint.num_velocities() == 1:
            moved = set(plant.GetBodiesKinematicallyAffectedBy([joint.index()]))
            if not moved & feet:
                upper |= moved
    return upper
