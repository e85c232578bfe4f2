"""Whatever is done to a Tree, it stays the same robot."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.read_urdf import read_urdf
from tests.new_robot.biped import Biped

NAMES = ("waist", "bow", "l_hip", "l_knee", "l_tilt", "r_roll", "r_ankle")
ANGLES = dict(zip(NAMES, (0.3, -0.2, -0.5, 0.8, 0.2, 0.1, -0.4), strict=True))


@pytest.fixture
def tree(tmp_path):
    return read_urdf(Biped(seed=5).write(tmp_path), [], Notes())


def body(tree, foot="l_foot"):
    """The robot as a heap of points seen from a foot; its CoM, its inertia."""
    poses = tree.poses(ANGLES)
    X_FR = poses[foot].inverse()
    points, inertia = [], np.zeros((3, 3))
    for name, link in sorted(tree.links.items()):
        X_FL = X_FR @ poses[name]
        points += [X_FL @ shape.points().T for shape in link.visuals]
        if link.inertia:
            turned = link.inertia.ReExpress(X_FL.rotation())
            about_foot = turned.Shift(-X_FL.translation())
            inertia += about_foot.CalcRotationalInertia().CopyToFullMatrix3()
    points = np.concatenate(points, axis=1)
    points = points[:, np.lexsort(points.round(6))]
    return points, X_FR @ tree.com(poses), inertia


def weld_frames(tree):
    for joint in [j for j in tree.joints.values() if j.type == "fixed"]:
        tree.weld(joint)


def turn_links(tree):
    for i, link in enumerate(["chest", "r_shin", "l_5"]):
        R = RotationMatrix.MakeZRotation(i + 1.0).MakeXRotation(0.3 + i)
        tree.reframe(link, RigidTransform(R))


def move_base(tree):
    X = RigidTransform(RotationMatrix.MakeYRotation(0.7), [0.1, 0.2, 0.3])
    tree.reframe("pelvis", X)


@pytest.mark.parametrize(
    "change",
    [weld_frames, turn_links, move_base, lambda tree: tree.reroot("l_arm")],
)
def test_it_stays_the_same_robot(tree, change):
    """Oracle: its points, CoM and inertia, seen from a foot, as they were."""
    before = body(tree)
    change(tree)
    for was, now in zip(before, body(tree), strict=True):
        assert now == pytest.approx(was, abs=1e-9)


def test_a_new_root_is_held_by_nothing(tree):
    """Oracle: the joints between it and the pelvis, turned round."""
    tree.reroot("chest")
    assert tree.root == "chest"
    assert [j.name for j in tree.chain("pelvis")] == ["bow", "waist"]
    assert len(list(tree.below("chest"))) == len(tree.links)


def test_what_is_welded_is_where_it_was_bent(tree):
    """Oracle: the foot's pose with the knee at that angle."""
    bent = tree.poses({"l_knee": 0.5})
    expected = bent["l_thigh"].inverse() @ bent["l_foot"]
    tree.weld(tree.joints["l_knee"], 0.5)
    now = tree.poses()
    found = now["l_thigh"].inverse() @ now["l_foot"]
    assert found.IsNearlyEqualTo(expected, 1e-9)
    assert tree.holder("l_shin") == "l_thigh"
