"""Robots as they are built: real drives, imperfections, and another one."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from tests.diagrams.simulated import EARLY, diagram_of, simulated

PERIOD = 0.004
SHOVE = "pushes: [{delta_v: 0.3, at: 0.1 s, direction_deg: 90}]"
SHOVED = f"{{fidelity: %s, duration: 0.5, {SHOVE}}}"


def test_real_torques_lag_behind_the_commanded():
    """Oracle: a first-order lag of 40 Hz in closed form, from tick to tick.

    The joints are slower than half their limit.  The robot stands at first,
    and its drives hold it.  An ideal robot has none.
    """
    realistic, ideal = SHOVED % "realistic", SHOVED % "ideal"
    logs = simulated(realistic).logs
    commanded, torques = logs["actuation"], logs["torques"]
    left = math.exp(-2.0 * math.pi * 40.0 * PERIOD)
    expected = commanded + left * (torques - commanded)
    assert simulated(realistic).summary["max_joint_speed_ratio"] < 0.5
    assert torques[1:] == pytest.approx(expected[:-1], abs=1e-9)
    assert np.array_equal(torques[0], commanded[0])
    logs = simulated(ideal).logs
    assert not diagram_of(ideal).HasSubsystemNamed("joint_drives")
    assert np.array_equal(logs["torques"], logs["actuation"])
    assert simulated(ideal).summary["max_joint_speed_ratio"] == 0.0


def test_walks_in_place_with_all_imperfections():
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


def test_atlas_recovers_from_what_the_paper_shows_for_nadia():
    """Oracle: Fig. 10 of the Nadia paper, inward, all mechanisms [m/s].

    With Nadia's scenarios and gains; twice its mass, the CoM a third higher.
    Outward: see test_stories.  The QP meets torque limits to 1e-8 (qp.py).
    """
    found = simulated(
        "{robot: atlas, mechanisms: all_with_cross_over, duration: 4.2, "
        f"{EARLY % 'num_steps: 4'}, pushes: "
        "[{delta_v: 0.41, at: right swing 25 %, direction_deg: 90.0}]}"
    ).summary
    assert found["recovered"], found["reason"]
    assert found["steps_after_push"] >= 3
    assert found["max_torque_ratio"] <= 1.0 + 1e-8
