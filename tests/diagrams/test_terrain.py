"""Oracles: shapely, flat ground, messages by hand."""

import numpy as np
import pytest
import shapely

from nadia_balance.core.body.ground import GroundError
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.terrain import Terrain
from nadia_balance.results.log import ground_regions, steps
from tests.diagrams.simulated import run_of
from tests.example_walks import SOLE
from tests.results.made_up_run import summary_of

LARGE = """
regions:
- {name: large, vertices: [[-20, -20], [20, -20], [20, 20], [-20, 20]]}
"""


def pushed(direction_deg, delta_v):
    """Walks on the stones and is pushed."""
    scenario = load_scenario("stepping_stones", duration=9.0)
    (push,) = scenario.pushes
    push.direction_deg, push.delta_v = direction_deg, delta_v
    return run_of(scenario, "lipm")


@pytest.mark.parametrize(
    ("direction_deg", "delta_v"), [(0, 0.8), (180, 1.0), (90, 0.5)]
)
def test_whole_soles_land_on_stones(direction_deg, delta_v):
    """Oracle: shapely; 1 cm from the edge, the controller keeps 2 cm."""
    run = pushed(direction_deg, delta_v)
    assert run.fell_at is None and not run.error
    stones = [shapely.Polygon(r) for r in ground_regions(run.logs)]
    inside = []
    taken = steps(run.logs)
    assert max(np.linalg.norm(s.adjustment) for s in taken) > 0.07
    for step in taken:
        sole = shapely.Polygon(step.achieved.to_world(run.logs["sole"]))
        (stone,) = (stone for stone in stones if stone.covers(sole))
        inside.append(stone.exterior.distance(sole))
    assert min(inside) > 0.01
    found = summary_of(run.logs)["min_edge_distances_m"]
    assert found == pytest.approx(inside, abs=1e-9)


def test_a_foot_beside_what_it_took_for_a_stone_ends_the_run():
    """Oracle: by hand; the controller takes the stones to be elsewhere."""
    scenario = load_scenario("stepping_stones", duration=9.0)
    scenario.terrain.error = GroundError(place=0.3)
    scenario.terrain.margin = 0.0
    run = run_of(scenario, "lipm")
    assert run.fall_reason.endswith("foot beside its region")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("regions: [{name: a, corners: 3}]", r"regions\[0\].corners: unknown"),
        ("regions: [{name: a, vertices: [[0, 0], [1, 0]]}]", "region 'a'"),
    ],
)
def test_says_what_is_wrong_with_a_file(tmp_path, text, message):
    """Oracle: by hand."""
    path = tmp_path / "regions.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        Terrain(name=str(path)).ground(SOLE)
    with pytest.raises(ValueError, match="must be a YAML file, or one of flat"):
        Terrain(name="nowhere").ground(SOLE)


def test_what_cannot_be_walked_is_refused(tmp_path):
    """Oracle: by hand: what knows no heights, or no regions; a bad start."""
    scenario = load_scenario("push")
    scenario.terrain.name = "stairs"
    with pytest.raises(ValueError, match="'stairs': must be level.*point mass"):
        LipmDiagram(scenario)
    scenario.engine = "mujoco"
    with pytest.raises(ValueError, match="'stairs': must be level.*for MuJoCo"):
        HumanoidDiagram(scenario)
    scenario.engine = "drake"
    (tmp_path / "high.yaml").write_text(LARGE[:-2] + ", height: 0.1}")
    scenario.terrain.name = str(tmp_path / "high.yaml")
    with pytest.raises(ValueError, match="left foot at the start: its region"):
        HumanoidDiagram(scenario)
    text = "{terrain: {name: tiles, seen: false, error: {height: 0.01}}}"
    with pytest.raises(
        ValueError, match=r"terrain.error = .*with seen = False"
    ):
        load_scenario("push", text=text)
    text = "{terrain: {name: gap}, controller: {icp_step_qp: {}}, "
    text += "mechanisms: feedback_step}"
    with pytest.raises(ValueError, match="'gap': must be flat with"):
        load_scenario("push", text=text)
