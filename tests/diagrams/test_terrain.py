"""Oracles: shapely, flat ground, messages by hand."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.body.ground import Ground, GroundError, Region
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.plan.gait import Gait, StepVector, walking_start
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.terrain import Terrain
from nadia_balance.parameters.scaling import Size, scaled
from nadia_balance.results.log import ground_regions, steps
from tests.diagrams.simulated import run_of
from tests.example_walks import MODEL, SOLE
from tests.results.made_up_run import summary_of


def test_stairs_fit_the_robot_that_climbs_them():
    """Oracle: by hand; T1's leg of 0.558 m and sole of 0.223 m, and its rise.

    The footholds of the scenario are scaled alike: in the middle of treads.
    """
    size = Size(leg=0.558, sole_length=0.223, sole_width=0.1)
    sole = rectangle(size.sole_length, size.sole_width)
    stairs = load_scenario("stairs")
    stairs.terrain.rise = 0.08
    regions = stairs.terrain.ground(sole, size).regions
    assert [r.height for r in regions[:3]] == pytest.approx([0.0, 0.08, 0.16])
    across, along = np.ptp(regions[1].polygon, axis=0)[::-1]
    assert along == pytest.approx(0.32 * 0.223 / 0.25)
    assert across == pytest.approx(1.2 * 0.558 / 0.88)
    stairs.terrain.rise = None
    regions = stairs.terrain.ground(sole, size).regions
    assert regions[1].height == pytest.approx(0.18 * 0.558 / 0.88)
    holds = scaled(stairs.gait, size).footholds[1:5]
    for hold, region in zip(holds, regions[1:5], strict=True):
        assert hold.x == pytest.approx(region.polygon[:, 0].mean(), abs=2e-3)


@pytest.mark.parametrize(("hole", "crossed"), [(0.7, True), (0.8, False)])
def test_a_hole_wider_than_the_reach_is_said_before_the_run(hole, crossed):
    """Oracle: by hand: half a sole and 2 cm on each side make 1 m of 0.71 m."""
    regions = [
        Region(name=f"{x}", vertices=[[x, -1], [x + 2, -1], [x + 2, 1], [x, 1]])
        for x in (-1.0, 1.0 + hole)
    ]
    model = replace(MODEL, ground=Ground(tuple(regions), SOLE))
    gait = Gait(num_steps=9, step=StepVector(length=0.3))
    if crossed:
        last = walking_start(gait, model).schedule.footsteps[-1]
        assert last.pose.p_WF[0] > 1.0 + hole
        return
    with pytest.raises(ValueError, match=r"a hole of 1.090 m, .* reach of 1.0"):
        walking_start(gait, model)


@pytest.mark.parametrize(
    ("name", "degrees", "delta_v"),
    [
        ("stepping_stones", 0, 0.8),
        ("stepping_stones", 180, 1.0),
        ("stepping_stones", 90, 0.5),
        ("atlas_stepping_stones", 0, 0.6),
        ("atlas_stepping_stones", 300, 0.6),
    ],
)
def test_whole_soles_land_on_stones(name, degrees, delta_v):
    """Oracle: shapely; 1 cm from the edge, the controller keeps 2 cm."""
    scenario = load_scenario(name, duration=9.0, lipm_period=0.02)
    (push,) = scenario.pushes
    push.direction_deg, push.delta_v = degrees, delta_v
    run = run_of(scenario, "lipm")
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
    scenario = load_scenario("stepping_stones", duration=9.0, lipm_period=0.02)
    ground = replace(scenario.terrain, error=GroundError(place=0.3), margin=0.0)
    scenario = scenario.changed(terrain=ground)
    run = run_of(scenario, "lipm")
    assert run.fall_reason.endswith("foot beside its region")


def test_what_cannot_be_walked_is_refused(tmp_path):
    """Oracle: by hand: what knows no heights, or no regions; a bad start."""
    with pytest.raises(ValueError, match="must be a YAML file, or one of flat"):
        Terrain(name="nowhere").ground(SOLE)
    scenario = load_scenario("push", terrain=Terrain(name="stairs"))
    with pytest.raises(ValueError, match="'stairs': must be level.*point mass"):
        LipmDiagram(scenario)
    scenario = load_scenario("push", terrain=Terrain(name="gap", rise=0.1))
    with pytest.raises(ValueError, match="rise = 0.1: must be null, as gap "):
        HumanoidDiagram(scenario)
    flat = load_scenario("push", terrain=Terrain(rise=0.1))
    with pytest.raises(ValueError, match="rise = 0.1: must be null on flat"):
        HumanoidDiagram(flat)
    high = "{name: a, height: 0.1, vertices: [[-9, -9], [9, -9], [0, 9]]}"
    (tmp_path / "high.yaml").write_text(f"regions: [{high}]")
    high = Terrain(name=str(tmp_path / "high.yaml"))
    scenario = load_scenario("push", terrain=high)
    with pytest.raises(ValueError, match="left foot at the start: its region"):
        HumanoidDiagram(scenario)
    text = "{terrain: {name: tiles, seen: false, error: {height: 0.01}}}"
    with pytest.raises(ValueError, match=r"terrain.error = .* seen = False"):
        load_scenario("push", text=text)
