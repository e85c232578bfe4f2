"""Oracle: what a Meshcat that remembers was told."""

from nadia_balance.core.ground import Ground
from nadia_balance.core.walking import FootPose
from nadia_balance.systems.ground_view import GroundView
from tests.core.test_ground import square
from tests.example_walks import SOLE
from tests.fake_meshcat import FakeMeshcat


def test_the_region_of_the_next_step_is_darker():
    """Oracle: by hand; none is where the foothold is on none."""
    meshcat = FakeMeshcat()
    stones = square("a"), square("wall", 1.0, obstacle=True), square("b", 2.0)
    view = GroundView(meshcat, "g", Ground(stones, SOLE))
    assert sorted(meshcat.objects) == ["g/0", "g/2", "g/in_use_0", "g/in_use_2"]
    for x, time in (0.0, 0.0), (2.0, 1.0), (5.0, 2.0):
        view.draw(FootPose([x, 0.0, 0.0]), time)
    for path, shown in (
        ("g/0", [True] * 3),
        ("g/2", [True] * 3),
        ("g/in_use_0", [True, False, False]),
        ("g/in_use_2", [False, True, False]),
    ):
        assert [meshcat.at(path, "visible", t) for t in (0, 1, 2)] == shown
