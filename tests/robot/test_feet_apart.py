"""Feet beside each other are as far apart as link avoidance asks for."""

import pytest

from nadia_balance.core.walking.state import Side
from nadia_balance.robot.model import load_robot


def foot_distance(robot, apart):
    """Distance [m] of the feet's shapes, level soles `apart` [m] in y."""
    diagram, plant, scene_graph = robot.control_diagram()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.SetPositions(context, robot.standing_positions(apart))
    scene_context = scene_graph.GetMyContextFromRoot(root)
    query = scene_graph.get_query_output_port().Eval(scene_context)
    feet = (plant.GetBodyByName(robot.foot_bodies[side]) for side in Side)
    left, right = map(plant.GetCollisionGeometriesForBody, feet)
    return min(
        query.ComputeSignedDistancePairClosestPoints(a, b).distance
        for a in left
        for b in right
    )


@pytest.mark.parametrize("name", ["nadia", "atlas", "g1"])
def test_feet_at_the_least_width_keep_their_clearance(name):
    """Oracle: Drake's distance of the shapes of the standing robot's feet."""
    robot = load_robot(name)
    least = robot.point_mass.reach.width_min
    clearance = robot.params.whole_body.avoidance.clearance
    assert foot_distance(robot, least) >= clearance - 1e-3
    assert robot.sole_width + robot.point_mass.sole_clearance <= least + 1e-9
    assert robot.point_mass.detour.beside > least


def test_no_more_than_is_needed_for_the_widest_foot():
    """Oracles: the G1's shoes are 0.07 m wide, 0.02 m on Nadia's legs scale.

    The clearance scales with the leg, 0.69 m in place of 0.88 m.
    """
    reach = load_robot("g1").point_mass.reach
    assert reach.width_min == pytest.approx(0.07 + 0.02 * 0.69 / 0.88, abs=2e-4)
