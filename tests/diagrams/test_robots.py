"""Robots as they are built, with imperfections."""

import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario


def test_it_is_as_heavy_and_the_ground_as_slippery_as_told():
    """Oracles: the masses of the URDF; 0.8 of the models, halved."""
    text = "{imperfections: {torso_mass_ratio: 1.1, friction_ratio: 0.5}}"
    built = HumanoidDiagram(load_scenario("walk_in_place", text=text))
    context = Simulator(built).get_mutable_context()
    built.set_initial_state(context)
    plant, own = built.plant, built.plant.GetMyContextFromRoot(context)
    torso = plant.GetBodyByName(built.robot.torso_body)
    expected = built.robot.mass + 0.1 * torso.default_mass()
    assert plant.CalcTotalMass(own) == pytest.approx(expected)
    inspector = built.scene_graph.model_inspector()
    found = {
        inspector.GetProximityProperties(shape)
        .GetProperty("material", "coulomb_friction")
        .dynamic_friction()
        for pair in inspector.GetCollisionCandidates()
        for shape in pair
    }
    assert found == {0.4}
