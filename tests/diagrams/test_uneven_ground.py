"""Oracles: the regions' own planes; the robot's limits; flat ground."""

import numpy as np
import pytest

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.results.log import Log, steps
from nadia_balance.robot.model import RobotModel, load_robot
from tests.diagrams.simulated import run_of, soon, soon_pushed

STILE = """
regions:
- {name: near, vertices: [[0.3, 1], [-1, 1], [-1, -1], [0.3, -1]]}
- {name: up, height: 0.18, vertices: [[0.6, 1], [0.3, 1], [0.3, -1], [0.6, -1]]}
- {name: far, vertices: [[2, 1], [0.6, 1], [0.6, -1], [2, -1]]}
"""
FOOTHOLDS = {  # of the first three steps; one on each row of the pile
    name: f"gait: {{footholds: [{{side: right, x: {one}, y: -0.125}}, "
    f"{{x: {two}, y: 0.125}}, {{side: right, x: {three}, y: -0.125}}]}}"
    for name, (one, two, three) in {
        "stairs": (0.15, 0.45, 0.76),
        "cinder_blocks": (0.51, 0.92, 1.33),
        "tilted_blocks": (0.13, 0.13, 0.51),
    }.items()
}


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return load_robot("nadia")


def walked(scenario) -> Log:
    """The log of its run, which obeys all limits."""
    found = run_of(scenario).summary
    assert found["outcome"] == "recovered", found["reason"]
    return run_of(scenario).logs


def soles_at(robot, log, time):
    """X_WF of both soles at a `time`."""
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    row = np.searchsorted(log["t"], time)
    plant.SetPositionsAndVelocities(context, log["state"][row])
    return {
        side: plant.GetBodyByName(body).EvalPoseInWorld(context)
        @ robot.X_FootSole[side]
        for side, body in robot.foot_bodies.items()
    }


@pytest.mark.parametrize(
    ("name", "duration", "top"),
    [
        ("stairs", 5.0, 0.18),
        ("cinder_blocks", 4.3, 0.45),
        ("tilted_blocks", 4.3, 0.15),
    ],
    ids=["18 cm up and down", "to the top of Fig. 11", "15 degrees"],
)
def test_soles_stand_on_the_planes_of_their_regions(
    tmp_path, robot, name, duration, top
):
    """Oracle: heights and normals of the regions, 0.2 s after landing.

    The pile of Fig. 11 is climbed with ICP feedback alone, as in the paper.
    """
    (tmp_path / "stile.yaml").write_text(STILE)
    stile = f"terrain: {{name: {tmp_path}/stile.yaml}}, "
    text = f"{{{stile if name == 'stairs' else ''}{FOOTHOLDS[name]}}}"
    scenario = soon(load_scenario(name, text=text, duration=duration))
    alone = scenario.mechanisms == "icp_only"
    assert alone == (name == "cinder_blocks")
    log = walked(scenario)
    ground, heights = scenario.terrain.ground(robot.sole), []
    assert len(steps(log)) == 3
    for step in steps(log):
        away = step.achieved.p_WF - step.commanded.p_WF
        assert np.hypot(*away[:2]) < 0.005
        after = log["t"][step.swing.last] + 0.2
        X_WF = soles_at(robot, log, after)[step.side]
        p_WF = X_WF.translation()
        region = ground.region_under(ground.pose(p_WF[:2], 0.0, 0.0))
        expected = region.heights(p_WF[None, :2])[0]
        assert p_WF[2] == pytest.approx(expected, abs=0.002)
        heights.append(expected)
        normal = X_WF.rotation().matrix()[:, 2]
        assert np.arccos(normal @ region.unit_normal) < np.radians(0.5)
    assert max(heights) == pytest.approx(top, abs=0.05)


def test_walks_on_tiles_that_it_takes_for_flat_ground(robot):
    """Oracle: by hand: its feet stand higher and lower, and tilted.

    The last of them is on a tile of 3.1 degrees, onto which it turns in the
    first 0.05 s after its touchdown.
    """
    log = walked(soon(load_scenario("tiles", duration=4.4)))
    stood = [(log["t"][s.swing.last] + 0.05, s.side) for s in steps(log)]
    soles = [soles_at(robot, log, time)[side] for time, side in stood]
    heights = [X_WF.translation()[2] for X_WF in soles]
    assert np.ptp(heights) > 0.015
    tilts = [np.arccos(X_WF.rotation().matrix()[2, 2]) for X_WF in soles]
    assert max(tilts) > np.radians(2.0)


def test_one_region_everywhere_gives_the_motion_of_flat_ground(tmp_path):
    """Oracle: the run on flat ground; a region rounds a foothold (3e-17 m)."""
    side = "vertices: [[-20, -20], [20, -20], [20, 20], [-20, 20]]"
    (tmp_path / "large.yaml").write_text(f"regions: [{{name: a, {side}}}]")
    name = tmp_path / "large.yaml"
    scenarios = soon_pushed(), soon_pushed(f"{{terrain: {{name: {name}}}}}")
    flat, large = (run_of(scenario).logs for scenario in scenarios)
    assert np.linalg.norm(steps(flat)[0].adjustment) > 0.1
    for name in (n for n in flat if flat[n].dtype.kind == "f"):
        np.testing.assert_allclose(large[name], flat[name], atol=1e-6)
