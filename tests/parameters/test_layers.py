"""Which value counts.  Oracle: by hand, all orders of the layers."""

import itertools

import pytest

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.parameters.bounds import bounded, parameters
from nadia_balance.parameters.layers import Layer, merged
from nadia_balance.parameters.scaling import NADIA, Size
from nadia_balance.parameters.yaml_reader import load_typed
from nadia_balance.robot.params import MODELS

HALF = Size(*(0.5 * length for length in NADIA))


@parameters
class Foot:
    """A foot."""

    length: float = bounded(
        0.2, above=0.0, most=5.0, unit="m", doc="its length"
    )
    mass: float = bounded(1.0, doc="its mass")


@parameters
class Leg:
    """A leg."""

    foot: Foot | None = bounded(Foot, doc="its foot")
    toes: list[int] = bounded(list, doc="its toes")
    limits: dict[str, float] = bounded(dict, doc="of its joints")


def of(*layers):
    return merged(Leg, HALF, [Layer(*layer) for layer in layers])


def test_the_last_layer_counts_and_what_it_lacks_is_of_those_before():
    leg, sources = of(
        ("robot", {"foot": {"length": 0.3, "mass": 2.0}, "limits": {"a": 1.0}}),
        ("scenario", {"foot": {"mass": 3.0}, "toes": [1, 2]}),
        ("flag", {"toes": [3], "limits": {"b": 2.0}}),
    )
    assert (leg.foot.length, leg.foot.mass) == (0.3, 3.0)
    assert (leg.toes, leg.limits) == ([3], {"a": 1.0, "b": 2.0})
    assert sources == {
        "foot.length": "robot",
        "foot.mass": "scenario",
        "limits.a": "robot",
        "toes": "flag",
        "limits.b": "flag",
    }


@pytest.mark.parametrize("order", list(itertools.permutations([True, False])))
def test_only_what_counts_is_scaled(order):
    """Oracle: half the size; the last layer says whether it is for Nadia."""
    layers = [
        (str(scaled), {"foot": {"length": 0.4}}, scaled) for scaled in order
    ]
    leg, sources = of(*layers)
    assert leg.foot.length == (0.2 if order[-1] else 0.4)
    assert sources == {"foot.length": str(order[-1])}
    assert of()[0].foot.length == 0.1


def test_none_takes_a_part_away_and_gives_it_back():
    gone, sources = of(("a", {"foot": {"mass": 2.0}}), ("b", {"foot": None}))
    assert gone.foot is None and sources == {"foot": "b"}
    back, sources = of(("b", {"foot": None}), ("c", {"foot": {"mass": 3.0}}))
    assert (back.foot.mass, back.foot.length) == (3.0, 0.1)
    assert sources == {"foot.mass": "c"}


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ({"foot": {"size": 1}}, "foot.size: unknown field"),
        ({"foot": {"mass": "a"}}, "foot.mass = 'a': must be a number"),
        ({"foot": {"length": -1}}, r"foot.length = -1.0: must be in \(0, 5"),
    ],
)
def test_a_bad_layer_is_named(tree, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        of(("a", {}), ("b", tree))


@pytest.mark.parametrize(
    "robots, flag, gain",
    [
        (None, 50.0, 50.0),
        (60.0, 50.0, 50.0),
        (60.0, 80.0, 80.0),
        (60.0, None, 60.0),
    ],
)
def test_a_flag_wins_over_robot_yaml(tmp_path, robots, flag, gain):
    """Oracle: by hand; a run's scenario.yaml tells whose value it is."""
    text = (MODELS / "g1" / "robot.yaml").read_text()
    if robots is not None:
        text = text.replace(
            "whole_body:\n", f"whole_body:\n  posture_gain: {robots}\n"
        )
    text = text.replace("urdf: ", f"urdf: {MODELS}/g1/")
    (tmp_path / "robot.yaml").write_text(text)
    asked = flag and f"{{controller: {{whole_body: {{posture_gain: {flag}}}}}}}"
    scenario = load_scenario(
        "stand", text=asked, robot=str(tmp_path / "robot.yaml")
    )
    assert scenario.controller.whole_body.posture_gain == gain
    source = "scenario_text" if flag else "robot.yaml"
    written = scenario.as_yaml("stand")
    assert f"      posture_gain: {gain}  # {source}\n" in written
    assert "robot: " in written and "yaml  # flag" in written
    read = load_typed(type(scenario), "", data=written, child_name="stand")
    assert read == scenario


def test_an_ideal_robot_is_a_layer_above_its_own():
    ideal = load_scenario("stand", fidelity="ideal")
    assert ideal.controller.whole_body.avoidance is None
    assert ideal.controller.whole_body.loading_time == 0.0
    text = "{controller: {whole_body: {loading_time: 0.1}}}"
    told = load_scenario("stand", text=text, fidelity="ideal")
    assert told.controller.whole_body.loading_time == 0.1
    path = "controller.whole_body.joint_lower_limits.LEFT_KNEE_Y"
    assert told.sources[path] == "robot.yaml"
