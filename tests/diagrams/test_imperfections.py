"""A robot that is not as its controller believes."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from tests.diagrams.simulated import EARLY, simulated


def diagram(text: str) -> HumanoidDiagram:
    return HumanoidDiagram(load_scenario("walk_in_place", text=text))


def test_walks_in_place_with_all_of_them():
    """Oracle: it does not fall, and no foot moves but up and down."""
    result = simulated(
        f"{{duration: 2.4, {EARLY % 'num_steps: 2'}, seed: 3, imperfections: "
        "{joint_noise: 0.0005, joint_speed_noise: 0.02, pelvis_noise: 0.001, "
        "pelvis_speed_noise: 0.02, delay: 0.012, friction_ratio: 0.5, "
        "torso_mass_ratio: 1.1}}"
    )
    feet = result.logs["foot_poses"].reshape(-1, 2, 4)
    assert np.max(np.abs(feet[-1, :, :2] - feet[0, :, :2])) < 0.03
    assert result.logs["t"][-1] == pytest.approx(2.4)


def test_a_heavy_torso_weighs_as_much_more():
    """Oracle: the masses of the URDF; the controller's robot is as before."""
    built = diagram("{imperfections: {torso_mass_ratio: 1.1}}")
    context = Simulator(built).get_mutable_context()
    built.set_initial_state(context)
    plant, own = built.plant, built.plant.GetMyContextFromRoot(context)
    torso = plant.GetBodyByName(built.robot.torso_body)
    expected = built.robot.mass + 0.1 * torso.default_mass()
    assert plant.CalcTotalMass(own) == pytest.approx(expected)


def test_slippery_ground_is_slippery_for_every_shape():
    """Oracle: 0.8 of the models, halved."""
    built = diagram("{imperfections: {friction_ratio: 0.5}}")
    inspector = built.scene_graph.model_inspector()
    pairs = inspector.GetCollisionCandidates()
    found = {
        inspector.GetProximityProperties(shape)
        .GetProperty("material", "coulomb_friction")
        .dynamic_friction()
        for pair in pairs
        for shape in pair
    }
    assert found == {0.4}
