"""A new robot reaches what its robot.yaml says that it does."""

import numpy as np
import pytest

from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.bounds import scaled
from nadia_balance.new_robot.make import make_robot
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.reach import reaches
from tests.new_robot.biped import Biped


@pytest.fixture(scope="module")
def stiff(tmp_path_factory):
    """A biped whose ankles roll by 11 degrees only."""
    folder = tmp_path_factory.mktemp("stiff")
    make_robot(Biped(ankle_roll=0.2).write(folder), folder / "made")
    return load_robot(str(folder / "made" / "robot.yaml"))


def test_its_ankles_keep_it_from_nadias_width(stiff):
    """Oracle: whole-body inverse kinematics, beyond the reach and within."""
    own = stiff.point_mass.reach
    nadias = scaled(ReachabilityParams(), stiff.params.size)
    assert own.length_forward < nadias.length_forward * 1.001
    assert reaches(stiff, np.array([0.0, own.width_max]))
    assert not reaches(stiff, np.array([0.0, nadias.width_max]))
