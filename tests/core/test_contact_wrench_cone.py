import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

from nadia_balance.core.contact_wrench_cone import contact_wrench_cone

LENGTH, WIDTH, FRICTION = 0.25, 0.12, 0.6


def wrench_of(forces):
    """[tau, f] about the centre of forces (4, 3) at the sole's corners."""
    corners = np.array(
        [
            [a * 0.5 * LENGTH, b * 0.5 * WIDTH, 0.0]
            for a, b in itertools.product((1, -1), repeat=2)
        ]
    )
    return np.concatenate([np.cross(corners, forces).sum(0), forces.sum(0)])


def generators():
    """Wrenches (16, 6) of the edges of the four corners' pyramids."""
    wrenches = []
    for corner, a, b in itertools.product(range(4), (1, -1), (1, -1)):
        forces = np.zeros((4, 3))
        forces[corner] = [a * FRICTION, b * FRICTION, 1.0]
        wrenches.append(wrench_of(forces))
    return np.array(wrenches)


def test_holds_what_forces_at_the_corners_can_do():
    """Oracle: random corner forces inside their friction pyramids."""
    U = contact_wrench_cone(LENGTH, WIDTH, FRICTION)
    rng = np.random.default_rng(0)
    for _ in range(500):
        forces = np.empty((4, 3))
        forces[:, 2] = rng.exponential(size=4) * (rng.random(4) < 0.7)
        most = FRICTION * forces[:, 2:]
        forces[:, :2] = most * rng.uniform(-1.0, 1.0, size=(4, 2))
        assert np.all(U @ wrench_of(forces) <= 1e-12)


def test_every_edge_of_a_pyramid_is_on_the_boundary():
    """Oracle: an edge has no slack in at least five of the rows."""
    slack = contact_wrench_cone(LENGTH, WIDTH, FRICTION) @ generators().T
    assert slack.max() < 1e-12
    assert np.all((np.abs(slack) < 1e-12).sum(axis=0) >= 5)


def test_holds_nothing_else():
    """Oracle: linear programs that look for corner forces, near the edge."""
    U = contact_wrench_cone(LENGTH, WIDTH, FRICTION)
    edges = generators()
    rng = np.random.default_rng(1)
    verdicts = []
    for _ in range(400):
        inside = rng.exponential(size=16) @ edges
        wrench = inside + rng.normal(size=6) * [0.4, 0.8, 0.5, 5, 5, 1]
        slack = (U @ wrench).max()
        if abs(slack) < 1e-7:
            continue
        found = linprog(np.zeros(16), A_eq=edges.T, b_eq=wrench)
        assert (found.status == 0) == (slack < 0.0)
        verdicts.append(found.status == 0)
    assert 50 < sum(verdicts) < 350


@pytest.mark.parametrize("name", ["length", "width", "friction"])
@pytest.mark.parametrize("value", [0.0, -0.1, np.nan])
def test_refuses_what_is_no_sole(name, value):
    """Oracle: the message names the argument."""
    sizes = {"length": 0.2, "width": 0.1, "friction": 0.5, name: value}
    with pytest.raises(ValueError, match=f"{name} = .*: must be > 0"):
        contact_wrench_cone(**sizes)
