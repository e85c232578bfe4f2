"""The shapes that a new robot gets, as Drake sees them."""

import itertools

import numpy as np
import pytest

from nadia_balance.robot.model import load_robot
from tests.new_robot.biped import Biped, make_once


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Of narrow hips and wide soles, so that the legs are near each other."""
    folder = tmp_path_factory.mktemp("biped")
    biped = Biped(hip=0.09, toe_half_width=0.055, seed=6)
    make_once(biped.write(folder), folder / "made")
    return load_robot(str(folder / "made" / "robot.yaml"), "realistic")


def test_a_sole_has_a_sphere_at_each_corner_and_shoes_above(robot):
    """Oracle: the rectangle; what is lowest of each capsule, in closed form."""
    diagram, plant, scene_graph = robot.control_diagram()
    inspector = scene_graph.model_inspector()
    sole = robot.params.sole
    lowest = []
    foot = plant.GetBodyByName("l_foot")
    for shape in plant.GetCollisionGeometriesForBody(foot):
        X = inspector.GetPoseInFrame(shape)
        solid = inspector.GetShape(shape)
        half = 0.5 * solid.length() if hasattr(solid, "length") else 0.0
        ends = X @ np.array([[0.0, 0.0, z] for z in (-half, half)]).T
        lowest.append(ends[2].min() - solid.radius() - sole.z)
        assert np.abs(ends[1]).max() + solid.radius() < sole.half_width + 0.006
    assert sorted(lowest) == pytest.approx([0.0] * 4 + [0.004] * 2, abs=1e-6)


def test_legs_touch_each_other_and_no_link_its_neighbour(robot):
    """Oracle: the chain of a leg.

    Shins have a sphere of 5 cm only; the capsule is from the knee to the ankle.
    """
    diagram, plant, scene_graph = robot.control_diagram()
    inspector = scene_graph.model_inspector()

    def link(shape) -> str:
        return plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).name()

    candidates = inspector.GetCollisionCandidates()
    pairs = {frozenset(map(link, pair)) for pair in candidates}
    legs = [[f"{n}_{part}" for part in ("thigh", "shin", "foot")] for n in "lr"]
    assert set(map(frozenset, itertools.product(*legs))) <= pairs
    for leg in legs:
        chain = ["pelvis", *leg]
        assert pairs.isdisjoint(map(frozenset, itertools.pairwise(chain)))
