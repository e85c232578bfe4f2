"""The capture regions in a log are those of the controller."""

import numpy as np
import pytest

from nadia_balance.core.body.reachability import circle
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.region_log import RegionCorners, region_rows
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.systems.signals import read
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, asked


def test_a_log_has_the_regions_of_its_times():
    """Oracle: the controller's own port, half-way in the first swing."""
    scenario = load_scenario("push")
    diagram = LipmDiagram(scenario, start_meshcat()[0])
    simulator = start(diagram)
    simulator.AdvanceTo(1.625)
    context = simulator.get_context()
    regions = read(diagram.signals["capture_regions"], context).regions
    rows = diagram.read_logs(context)["capture_regions"]
    assert rows[-1, 0] == pytest.approx(1.625)
    assert np.diff(np.unique(rows[:, 0])) == pytest.approx(0.0625)
    assert np.min(rows[:, 0]) > 0.8  # not before the swing
    last = rows[rows[:, 0] == rows[-1, 0]]
    for n in 1, len(regions):
        assert last[last[:, 1] == n, 2:] == pytest.approx(regions[n - 1])
    assert {*last[:, 1]} == {1.0, float(len(regions))}


@pytest.mark.parametrize(("corners", "kept"), [(8, 8), (64, 64), (65, 33)])
def test_of_a_region_with_many_corners_some_are_kept(corners, kept):
    """Oracle: by hand; those that are kept are corners of the region."""
    block = RegionCorners()
    region = circle(1.0, corners)
    regions = CaptureRegions(regions=(region,))
    vector = answer(block, asked(block, capture_regions=regions), "corners")
    rows = region_rows(np.array([0.25]), vector[None])
    assert rows[:, :2] == pytest.approx(np.tile([0.25, 1.0], (kept, 1)))
    assert {*map(tuple, rows[:, 2:])} <= {*map(tuple, region)}
    assert len({*map(tuple, rows[:, 2:])}) == kept
