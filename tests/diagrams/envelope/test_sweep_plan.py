"""A sweep is checked before anything runs, and says what it shares."""

import json
import math

import pytest

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_plan import Cell, Sweep, Trial
from diagrams.mechanisms import MECHANISMS
from diagrams.scenario import load_scenario
from tests.diagrams.envelope.made_up_robot import made_up_sweep


def test_has_a_cell_for_each_of_every_kind():
    """Oracle: the Cartesian product, counted and looked up."""
    moments = Moment("swing", "right", 0.25), Moment("transfer", "left", 0.5)
    sweep = made_up_sweep(moments=moments)
    cells = sweep.cells()
    assert len(cells) == len(set(cells)) == 2 * 2 * 3
    assert Cell("step", moments[1], 210.0) in cells


def test_tries_all_mechanisms_unless_told():
    sweep = Sweep(scenario=load_scenario("push"), scenario_name="push")
    sweep.validate()
    assert [cell.mechanisms for cell in sweep.cells()] == list(MECHANISMS)


@pytest.mark.parametrize(
    ("level", "resolution", "written"),
    [(3, 0.1, "0.3"), (7, 0.02, "0.14"), (29, 0.02, "0.58"), (1, 1.5, "1.5")],
)
def test_pushes_are_round_numbers(level, resolution, written):
    """Oracle: the decimal product by hand; 3 * 0.1 is not 0.3 in binary."""
    sweep = made_up_sweep(search=SearchParams(resolution=resolution))
    trial = Trial(cell=sweep.cells()[0], level=level, replica=0)
    assert str(sweep.delta_v(trial)) == written


def test_replicas_are_a_tick_of_their_plant_apart():
    """Oracle: 10 ms for the point mass, 2 ms for the robot."""
    assert made_up_sweep().period == 0.01
    sweep = made_up_sweep()
    sweep.plant = "humanoid"
    assert sweep.period == 0.002


def test_its_identity_is_plain_json():
    """Oracle: there and back again."""
    identity = made_up_sweep().identity()
    assert json.loads(json.dumps(identity)) == identity


def test_other_cells_make_no_other_identity():
    moments = (Moment("transfer", "left", 0.5),)
    other = made_up_sweep(
        directions=(45.0,), mechanisms=("step_swing",), moments=moments
    )
    other.timeout = 1.0
    assert other.identity() == made_up_sweep().identity()


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("plant", lambda s: setattr(s, "plant", "humanoid")),
        ("scenario", lambda s: setattr(s, "scenario_name", "other")),
        ("seed", lambda s: setattr(s.scenario, "seed", 3)),
        ("parameters", lambda s: setattr(s.scenario, "duration", 9.0)),
        ("resolution", lambda s: setattr(s, "search", SearchParams())),
    ],
)
def test_names_in_its_identity_what_differs(name, change):
    sweep, other = made_up_sweep().identity(), made_up_sweep()
    change(other)
    differ = {
        key for key, value in other.identity().items() if sweep[key] != value
    }
    assert name in differ
    assert differ <= {name, "stride", "replicas", "largest"}


REFUSED = [
    ({"mechanisms": ("luck",)}, "mechanisms = 'luck': must be one of icp_only"),
    ({"mechanisms": ("custom",)}, "mechanisms = 'custom': must be one of icp_"),
    ({"mechanisms": ()}, "mechanisms = '': must name at least one"),
    ({"directions": ()}, "directions = '': must name at least one"),
    ({"directions": (0.0, 360.0)}, "directions = 360.0: must be in [0, 360)"),
    ({"directions": (math.nan,)}, "directions = nan: must be in [0, 360)"),
    ({"directions": (5.0, 5.0)}, "directions = 5.0: must be given only once"),
    ({"moments": ()}, "moments = '': must name at least one"),
    (
        {"search": SearchParams(resolution=0.0)},
        "resolution = 0.0: must be finite and >= 0.0001 m/s",
    ),
    ({"search": SearchParams(replicas=0)}, "replicas = 0: must be >= 1"),
    ({"timeout": 0.0}, "timeout = 0.0: must be in (0, 1e+06] s"),
    ({"timeout": 1e7}, "timeout = 10000000.0: must be in (0, 1e+06] s"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_refuses_what_has_no_meaning(changes, message):
    with pytest.raises(ValueError) as refused:
        made_up_sweep(**changes).validate()
    assert str(refused.value).startswith(message)


def test_refuses_another_plant():
    sweep = made_up_sweep()
    sweep.plant = "paper"
    with pytest.raises(ValueError, match="plant = 'paper': must be one of hum"):
        sweep.validate()


@pytest.mark.parametrize("number", [0, 2])
def test_wants_exactly_one_push(number):
    sweep = made_up_sweep()
    sweep.scenario.pushes *= number
    with pytest.raises(ValueError) as refused:
        sweep.validate()
    assert str(refused.value) == (
        f"scenario_name = 'push': must have exactly one push, has {number}"
    )
