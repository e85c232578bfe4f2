"""What is written is read again.  Oracle: the reader; PyYAML; by hand."""

import math

import yaml

from nadia_balance.parameters.bounds import bounded, parameters
from nadia_balance.parameters.yaml_reader import load_typed
from nadia_balance.parameters.yaml_writer import dump


@parameters
class Spring:
    """A spring."""

    stiffness: float = bounded(0.1 + 0.2, doc="")
    name: str = bounded("", doc="")


@parameters
class Cart:
    """A cart on springs."""

    springs: list[Spring] = bounded(list, doc="")
    front: Spring = bounded(Spring, doc="")
    loads: dict[str, float] = bounded(dict, doc="")
    seats: int = bounded(4, doc="")
    top_speed: float = bounded(math.inf, finite=False, doc="")
    tow: Spring | None = bounded(None, doc="")


CART = Cart(
    springs=[Spring(stiffness=1e-5), Spring(name="yes: # 010\nname: 3\n")],
    front=Spring(name="1:30"),
    loads={"door": 1.0 / 3.0},
    tow=Spring(name="two\nlines: 3"),
)


def test_leads_back_to_the_last_bit():
    for name in "", "cart":
        text = dump(CART, name)
        assert load_typed(Cart, "", data=text, child_name=name or None) == CART


def test_a_comment_stands_beside_its_value():
    """Oracle: by hand; for YAML it is not there."""
    comments = {"front.name": "flag", "springs": "scenario", "seats": "x"}
    comments["tow.name"] = "text"
    text = dump(CART, "cart", comments)
    assert yaml.safe_load(text) == yaml.safe_load(dump(CART, "cart"))
    lines = {line.strip() for line in text.splitlines()}
    assert {"name: '1:30'  # flag", "springs:  # scenario"} <= lines
    assert "seats: 4  # x" in lines
    assert 'name: "two\\nlines: 3"  # text' in lines
    assert sum("#" in line for line in lines) == 5
