"""Oracles: hand-computed frames; numpy's own refusal to write."""

import copy
import importlib
import math
import pkgutil
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace

import numpy as np
import pytest

from nadia_balance import core
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    rectangle,
)

POSE = FootPose([1.0, 2.0, 0.5], math.pi / 2)
FEET = FootPoses(FootPose([0.0, 0.1, 0.0]), FootPose([0.0, -0.1, 0.0]))
START = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))


def schedule(phase=Phase.SWING, side=Side.LEFT):
    """Nothing to do but that phase."""
    return ContactSchedule(phase, side, 0.7, FEET, (), START)


def test_points_go_to_the_world_and_back():
    """Oracle: by hand, a quarter turn; then the identity."""
    points = np.array([[0.2, 0.0], [0.0, 0.1]])
    world = POSE.to_world(points)
    assert world == pytest.approx(np.array([[1.0, 2.2], [0.9, 2.0]]))
    assert POSE.to_sole(world) == pytest.approx(points)


@pytest.mark.parametrize("side", list(Side))
def test_sides_are_opposite(side):
    """Oracle: twice the other side is this side; left is +y."""
    assert side.other.other is side
    assert side.sign == -side.other.sign
    assert Side.LEFT.sign == 1


@pytest.mark.parametrize(
    ("phase", "left", "right"),
    [
        (Phase.STANDING, True, True),
        (Phase.TRANSFER, True, True),
        (Phase.SWING, True, False),
    ],
)
def test_only_the_swing_foot_is_in_the_air(phase, left, right):
    """Oracle: by hand, the left foot supports."""
    now = schedule(phase)
    assert now.in_contact(Side.LEFT) is left
    assert now.in_contact(Side.RIGHT) is right


@pytest.mark.parametrize("support", list(Side))
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_legs_are_crossed_beyond_the_centre_line(support, yaw):
    """Oracle: by hand, in the frame of the support foot."""
    stance = FootPose([1.0, 2.0, 0.0], yaw)
    for out, crossed in ((0.01, False), (-0.01, True)):
        offset = np.array([[-0.3, support.other.sign * out]])
        other = FootPose(np.append(stance.to_world(offset), 0.0), yaw)
        feet = FootPoses(stance, stance).with_foot(support.other, other)
        taken = replace(schedule(), support_side=support, feet=feet)
        assert taken.legs_crossed is crossed


def test_a_foot_can_be_moved_and_the_other_stays():
    """Oracle: identity of the values."""
    moved = FEET.with_foot(Side.RIGHT, POSE)
    assert moved[Side.RIGHT] is POSE
    assert moved[Side.LEFT] is FEET.left


def test_values_cannot_be_changed():
    """Oracle: Python's and numpy's errors."""
    with pytest.raises(ValueError, match="read-only"):
        POSE.p_WF[0] = 3.0
    with pytest.raises(FrozenInstanceError):
        POSE.yaw = 0.0
    source = np.zeros(3)
    pose = FootPose(source)
    source[0] = 1.0  # belongs to the caller, who may go on using it
    assert pose.p_WF[0] == 0.0


@pytest.mark.parametrize(
    "value", [POSE, FEET, START, schedule(), WalkingState(schedule())]
)
def test_clones_share_the_value(value):
    """Oracle: identity; numpy would make the copies writeable again."""
    assert copy.deepcopy(value) is value


def test_remaining_time_is_never_negative():
    """Oracle: by hand."""
    assert WalkingState(schedule(), 0.2).remaining_time == pytest.approx(0.5)
    assert WalkingState(schedule(), 0.8).remaining_time == 0.0


def test_rectangle_goes_round_counter_clockwise():
    """Oracle: the shoelace formula gives length times width."""
    x, y = rectangle(0.25, 0.12).T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    assert area == pytest.approx(0.25 * 0.12)


def dataclasses_of_core():
    """All that there are in nadia_balance.core, by name."""
    for info in pkgutil.iter_modules(core.__path__):
        module = importlib.import_module(f"{core.__name__}.{info.name}")
        for name, value in vars(module).items():
            if isinstance(value, type) and is_dataclass(value):
                yield name, value


def test_what_holds_arrays_is_not_compared_by_them():
    """Oracle: the annotations; the == of arrays is no answer, but an error."""
    holders = {
        name
        for name, value in dataclasses_of_core()
        if any("array" in str(item.type).lower() for item in fields(value))
    }
    compared = {
        name
        for name, value in dataclasses_of_core()
        if value.__eq__ is not object.__eq__
    }
    assert {"FootPose", "SwingGeometry", "IcpPlan"} <= holders
    assert holders & compared == set()


def test_equal_numbers_in_two_places_are_two_values():
    """Oracle: by hand: identity; comparison and hash are no errors."""
    again = FootPoses(FootPose([0.0, 0.1, 0.0]), FEET.right)
    assert (again != FEET) and (FEET == FootPoses(FEET.left, FEET.right))
    states = {WalkingState(schedule()), WalkingState(schedule())}
    assert len(states) == 1
