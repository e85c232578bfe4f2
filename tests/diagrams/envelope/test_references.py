"""Oracle: figures read off the paper's Fig. 10 and the limits, by hand."""

import pytest

from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT, references
from diagrams.mechanisms import MECHANISMS

KNOWN = references("nadia", "push", MOMENT)


@pytest.mark.parametrize(
    ("mechanisms", "direction", "paper", "limit"),
    [
        ("icp_only", 0.0, 0.27, 0.44),
        ("step", 330.0, 0.68, 0.84),
        ("step_swing", 90.0, 0.20, 0.33),
        ("step_swing_transfer", 210.0, 0.95, 2.00),
        ("all_with_cross_over", 120.0, 0.30, 0.71),
    ],
)
def test_knows_the_figures(mechanisms, direction, paper, limit):
    assert KNOWN.paper[mechanisms][direction] == paper
    assert KNOWN.limit[mechanisms][direction] == limit


@pytest.mark.parametrize("table", [KNOWN.paper, KNOWN.limit])
def test_has_twelve_directions_for_each_of_the_mechanisms(table):
    assert list(table) == list(MECHANISMS)
    for curve in table.values():
        assert list(curve) == [30.0 * i for i in range(12)]


def test_nobody_is_better_than_the_best_there_can_be():
    """Oracle: the meaning of a limit."""
    for mechanisms, curve in KNOWN.paper.items():
        for direction, value in curve.items():
            assert value < KNOWN.limit[mechanisms][direction]


@pytest.mark.parametrize(
    ("robot", "scenario", "moment"),
    [
        ("atlas", "push", "right swing 25 %"),
        ("/somewhere/nadia/robot.yaml", "push", "right swing 25 %"),
        ("nadia", "backward_shove", "right swing 25 %"),
        ("nadia", "push", "left swing 25 %"),
        ("nadia", "push", "right transfer 25 %"),
        ("nadia", "push", "right swing 26 %"),
    ],
)
def test_others_are_compared_with_nothing(robot, scenario, moment):
    known = references(robot, scenario, Moment.parse(moment))
    assert not known
    assert known.paper == known.limit == {}
