"""Distances of the robot's links, and the QP that keeps them apart."""

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.geometry import Capsule, Sphere

from nadia_balance.core.whole_body.command import Avoidance
from nadia_balance.core.whole_body.params import (
    CollisionAvoidanceParams,
    WholeBodyQpParams,
)
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.robot import collision_avoidance
from nadia_balance.robot.collision_avoidance import CollisionAvoidance
from nadia_balance.robot.model import RobotModel, load_robot, load_robot_params
from tests import whole_body_examples as examples
from tests.core.math.test_segments import brute_force

ElementTree.register_namespace("drake", "http://drake.mit.edu")
PARAMS = CollisionAvoidanceParams()
MAX_PAIRS = collision_avoidance.MAX_PAIRS
FAR = 0.4  # [m]


class Links:
    """A robot, what is said of its links, and what is true."""

    def __init__(self, robot: RobotModel):
        self.robot = robot
        self.diagram, self.plant, self.scene = robot.control_diagram()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        inspector = self.scene.model_inspector()
        self.candidates = sorted(inspector.GetCollisionCandidates())
        shapes = {shape for pair in self.candidates for shape in pair}
        self.round = {
            shape: (
                self.plant.GetBodyFromFrameId(inspector.GetFrameId(shape)),
                inspector.GetPoseInFrame(shape),
                getattr(form, "length", float)(),
                form.radius(),
            )
            for shape in shapes
            if isinstance(form := inspector.GetShape(shape), Capsule | Sphere)
        }

    def at(self, q, v=None):
        """The context at q and v; None: at rest."""
        nv = self.plant.num_velocities()
        self.plant.SetPositions(self.context, q)
        self.plant.SetVelocities(self.context, np.zeros(nv) if v is None else v)
        return self.context

    def said(self, q, within, v=None):
        """Distances of links within so many metres, and their rows."""
        params = replace(PARAMS, attention=within)
        return self.avoidance(params).distances(self.at(q, v))

    def avoidance(self, params):
        return CollisionAvoidance(params, self.robot, self.plant, self.scene)

    def true(self, positions):
        """Distances (n, k) of all capsules and spheres at q (n, nq)."""
        pairs = [p for p in self.candidates if set(p) <= set(self.round)]
        places, radii = [], np.zeros(len(pairs))
        for q in positions:
            context, ends = self.at(q), {}
            for shape, (body, X_BG, length, _) in self.round.items():
                X_WG = body.EvalPoseInWorld(context) @ X_BG
                axis = 0.5 * length * X_WG.rotation().matrix()[:, 2]
                ends[shape] = X_WG.translation() - axis, 2.0 * axis
            places.append([[ends[a], ends[b]] for a, b in pairs])
        for k, pair in enumerate(pairs):
            radii[k] = sum(self.round[shape][3] for shape in pair)
        # As begin and way, (3, 2, n k).
        sides = np.moveaxis(places, (3, 4, 2), (0, 1, 2)).reshape(2, 3, 2, -1)
        return brute_force(*sides).reshape(-1, len(pairs)) - radii

    def by_drake(self, q, v):
        """Distances and rates (k, 2) of all pairs with another shape."""
        port = self.plant.get_geometry_query_input_port()
        query = port.Eval(self.at(q, v))
        inspector = self.scene.model_inspector()
        rows = []
        for pair in self.candidates:
            if not set(pair) <= set(self.round):
                near = query.ComputeSignedDistancePairClosestPoints(*pair)
                speeds, points = [], (near.p_ACa, near.p_BCb)
                for shape, p_GC in zip(pair, points, strict=True):
                    frame = inspector.GetFrameId(shape)
                    body = self.plant.GetBodyFromFrameId(frame)
                    p_BC = inspector.GetPoseInFrame(shape) @ p_GC
                    to_point = body.EvalPoseInWorld(self.context).rotation()
                    V_WB = body.EvalSpatialVelocityInWorld(self.context)
                    speeds.append(V_WB.Shift(to_point @ p_BC).translational())
                rate = near.nhat_BA_W @ (speeds[0] - speeds[1])
                rows.append((near.distance, rate))
        return np.array(rows)

    def random_positions(self, rng):
        """Any pose of the base, and joints within their limits."""
        q = rng.normal(size=self.plant.num_positions())
        q[:4] /= np.linalg.norm(q[:4])
        lower = self.plant.GetPositionLowerLimits()[7:]
        upper = self.plant.GetPositionUpperLimits()[7:]
        q[7:] = rng.uniform(lower, upper)
        return q


NADIA = Links(examples.nadia())
ROBOTS = [NADIA, Links(load_robot("atlas"))]


@pytest.fixture
def all_pairs(monkeypatch):
    """No pair is left out because there are so many."""
    monkeypatch.setattr(collision_avoidance, "MAX_PAIRS", 1000)


def nearest(distances):
    """Where those are that are near, the nearest first."""
    order = np.argsort(distances)
    return order[distances[order] < FAR]


@pytest.mark.usefixtures("all_pairs")
@pytest.mark.parametrize("links", ROBOTS)
def test_distances_are_those_of_the_shapes(links):
    """Oracle: brute force over each pair's axes, in random poses."""
    rng = np.random.default_rng(0)
    poses = [links.random_positions(rng) for _ in range(20)]
    for q, expected in zip(poses, links.true(poses), strict=True):
        distances, _ = links.said(q, FAR)
        near = expected[nearest(expected)]
        assert distances == pytest.approx(near, abs=1e-9)
        assert len(distances) > 10


@pytest.mark.usefixtures("all_pairs")
@pytest.mark.parametrize("links", ROBOTS)
def test_rows_are_the_rates_of_the_distances(links):
    """Oracle: finite differences of brute force along each velocity.

    Drake maps velocities to q.  Steps of 1e-5: 1e-10 of curvature, of rounding.
    """
    q, step = links.random_positions(np.random.default_rng(1)), 1e-5
    distances, rows = links.said(q, FAR)
    nv, rates = links.plant.num_velocities(), links.plant.MapVelocityToQDot
    along = [step * rates(links.at(q), v) for v in np.eye(nv)]
    now, *others = links.true([q, *(q + along), *(q - along)])
    after, before = np.array(others).reshape(2, nv, -1)
    rates = (after - before) / (2.0 * step)
    assert len(distances) > 10
    assert rows == pytest.approx(rates.T[nearest(now)], rel=1e-6, abs=1e-7)


def test_those_that_brake_most_come_first(monkeypatch):
    """Oracle: the accelerations that the law demands, sorted."""
    rng = np.random.default_rng(2)
    q, v = NADIA.random_positions(rng), rng.normal(size=29)
    few, few_rows = NADIA.said(q, FAR, v)
    monkeypatch.setattr(collision_avoidance, "MAX_PAIRS", 1000)
    distances, rows = NADIA.said(q, FAR, v)
    assert len(few) == MAX_PAIRS < len(distances)
    assert np.all(np.diff(PARAMS.braking(distances, rows @ v)) < 0.0)
    assert few.tolist() == distances[:MAX_PAIRS].tolist()
    assert few_rows == pytest.approx(rows[:MAX_PAIRS], abs=1e-15)


def with_other_shapes(folder):
    """Nadia, with a box for its left thigh and a cylinder for its torso."""
    params, urdf = load_robot_params("nadia")
    tree = ElementTree.parse(urdf)
    box, sizes = {"size": "0.12 0.14 0.3"}, {"radius": "0.16", "length": "0.3"}
    thigh = "LEFT_THIGH_LINK", "box", box
    for link, shape, size in (thigh, ("TORSO_LINK", "cylinder", sizes)):
        geometry = tree.find(f"link[@name='{link}']/collision/geometry")
        geometry.clear()
        ElementTree.SubElement(geometry, shape, size)
    tree.write(folder / "nadia.urdf")
    return RobotModel(params, folder / "nadia.urdf")


@pytest.mark.usefixtures("all_pairs")
def test_other_shapes_are_measured_by_drake(tmp_path):
    """Oracles: Drake's distances, and its velocities of the nearest points.

    Capsules and spheres are measured by brute force, as without such shapes.
    """
    links, rng = Links(with_other_shapes(tmp_path)), np.random.default_rng(3)
    for _ in range(10):
        q, v = links.random_positions(rng), rng.normal(size=29)
        others = links.by_drake(q, v)
        others = others[others[:, 0] < FAR]
        distances, rows = links.said(q, FAR)
        expected = np.append(links.true([q])[0], others[:, 0])
        near = expected[nearest(expected)]
        assert distances == pytest.approx(near, abs=1e-9)
        for distance, rate in others:
            row = rows[np.argmin(np.abs(distances - distance))]
            assert row @ v == pytest.approx(rate, abs=1e-9)


def moving(joint, speed):
    """All velocities, zero but for one [rad/s]."""
    v = np.zeros(29)
    v[NADIA.plant.GetJointByName(joint).velocity_start()] = speed
    return v


@pytest.mark.parametrize(
    ("link", "speed", "seen"),
    [("SHOULDER", v, n) for v, n in ((-10.0, 2), (-6.0, 0), (10.0, 0))]
    + [("HIP", -6.0, 0)],
)
def test_an_arm_is_seen_from_afar_if_it_has_to_brake(link, speed, seen):
    """Oracle: the law, by hand.

    Legs may pass each other as closely, and as fast.
    """
    q, v = examples.standing_positions(), moving(f"LEFT_{link}_X", speed)
    distances, rows = NADIA.said(q, 0.08, v)
    assert len(distances) == seen
    for d, rate in zip(distances, rows @ v, strict=True):
        assert d > 0.08 and 2.0 * rate + 25.0 * (d - 0.02) < 0.0


def test_rows_are_those_of_the_law():
    """Oracle: (d/dt + 25)^2 (d - 2 cm), by hand; nearer than 8 cm: hard."""
    rng = np.random.default_rng(2)
    q, v = NADIA.random_positions(rng), 3.0 * rng.normal(size=29)
    vdot = rng.normal(size=29)
    distances, rows = NADIA.said(q, 0.08, v)
    avoidance = NADIA.avoidance(PARAMS).calc(NADIA.at(q, v))
    law = rows @ vdot + 50.0 * (rows @ v) + 625.0 * (distances - 0.02)
    near = distances < 0.08
    assert near.any() and not near.all()
    soft, now = math.sqrt(3.0) * law[~near], np.append(vdot, 1.0)
    assert avoidance.limits @ now == pytest.approx(law[near])
    assert avoidance.braking @ now == pytest.approx(soft)


def test_links_are_kept_apart():
    """Oracle: by hand, distance 3 cm: (d/dt + 25)^2 (distance - 2 cm) >= 0."""
    terms = examples.terms_at(examples.random_state(0, 0.0))
    towards = moving("LEFT_SHOULDER_X", 1.0)
    speed, v = -0.3, -0.3 * towards
    params, period = WholeBodyQpParams(), examples.PERIOD
    qp = WholeBodyQp(params, examples.model(), period)
    free = qp.solve(terms._replace(v=v), examples.command(terms))
    rows = np.append(towards, -PARAMS.braking(0.03, towards @ v))[None]
    near = terms._replace(v=v, avoidance=Avoidance(rows, rows[:0]))
    kept = qp.solve(near, examples.command(terms))
    least = -25.0 * (2.0 * speed + 25.0 * 0.01)
    assert kept.qp.solved and towards @ free.vdot < least
    assert towards @ kept.vdot == pytest.approx(least, rel=1e-3)


def test_links_of_somebody_else_s_joints_do_not_count():
    """Oracle: those below its shoulder, which touch the trunk, and no others.

    The other arm touches it as much.
    """
    robot = load_robot("g1")
    diagram, plant, scene = robot.control_diagram()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.SetPositions(context, robot.standing_positions())
    for side, sign in ("left", 1.0), ("right", -1.0):
        roll = plant.GetJointByName(f"{side}_shoulder_roll_joint")
        roll.set_angle(context, -0.1 * sign)
    columns = {
        side: [
            plant.GetJointByName(f"{side}_{name}_joint").velocity_start()
            for name in ("shoulder_pitch", "shoulder_roll", "elbow")
        ]
        for side in ("left", "right")
    }
    for given, near in ((), {"left", "right"}), (["left"], {"right"}):
        names = [f"{side}_shoulder_pitch_joint" for side in given]
        links = CollisionAvoidance(PARAMS, robot, plant, scene, names)
        _, rows = links.distances(context)
        moving = {s for s, at in columns.items() if rows[:, at].any()}
        assert moving == near
