"""YAML that fits gives dataclasses, YAML that does not one readable line."""

import itertools
import re
from dataclasses import dataclass, field

import pytest
from pydrake.multibody.plant import MultibodyPlantConfig

from nadia_balance.parameters.yaml_reader import load_typed


@dataclass(kw_only=True)
class Wheel:
    radius: float = 0.3


@dataclass(kw_only=True)
class Cart:
    name: str = "cart"
    seats: int = 1
    electric: bool = False
    load: float | None = None
    spare: Wheel = field(default_factory=Wheel)
    wheels: list[Wheel] = field(default_factory=list)
    angles: dict[str, float] = field(default_factory=dict)
    either: Wheel | MultibodyPlantConfig = field(default_factory=Wheel)
    plant: MultibodyPlantConfig = field(default_factory=MultibodyPlantConfig)


ALL = """
name: truck
seats: 3.0
electric: true
load: 1e3  # text for YAML 1.1
spare: {radius: 1}
wheels: [{}, {radius: .4}]
angles: {door: 0.5}
either: !Wheel {radius: 2.0}
plant: {time_step: 0.002}
"""


def refusal(text: str, **source) -> str:
    """What the user reads; always one line."""
    with pytest.raises(ValueError) as error:
        load_typed(Cart, "cart.yaml", data=text, **source)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("cart.yaml: ")
    return message.removeprefix("cart.yaml: ")


def test_reads_every_kind_of_field():
    """Oracle: the same, built by hand."""
    cart = load_typed(Cart, "cart.yaml", data=ALL)
    assert cart.plant.time_step == 0.002
    cart.plant = by_default = MultibodyPlantConfig()
    assert cart == Cart(
        name="truck",
        seats=3,
        electric=True,
        load=1000.0,
        spare=Wheel(radius=1.0),
        wheels=[Wheel(), Wheel(radius=0.4)],
        angles={"door": 0.5},
        either=Wheel(radius=2.0),
        plant=by_default,
    )


def test_keeps_the_defaults_and_leaves_them_alone():
    defaults = Cart(name="bus", seats=40)
    cart = load_typed(Cart, "cart.yaml", data="seats: 50", defaults=defaults)
    assert (cart.name, cart.seats) == ("bus", 50)
    assert defaults.seats == 40


# Each alias stands for ten of the one before.
MILLION = "[&a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]" + "".join(
    f", &{b} [{', '.join(10 * ['*' + a])}]"
    for a, b in itertools.pairwise("abcdef")
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("3", "file = 3: must be a mapping"),
        ("seats: 2.5", "seats = 2.5: must be an integer"),
        ("name: 3", "name = 3: must be text"),
        ("spare: {radius: true}", "spare.radius = True: must be a number"),
        ("spare: {size: 1}", "spare.size: unknown field, must be one of rad"),
        ("wheels: [{}, 4]", r"wheels\[1\] = 4: must be a mapping"),
        ("angles: {door: a}", "angles.door = 'a': must be a number"),
        ("plant: {step: 1}", "plant.step: unknown field, must be one of time"),
        ("a: b: c", "malformed YAML: .*line 1, column 5: "),
        ("name: 2020-13-45", "malformed YAML: .*month must be in 1..12"),
        (600 * "[", "malformed YAML: .*recursion"),
        ("{seats: 1, seats: 2}", ".*seats: must be given only once"),
        ("{load: 1:30}", ".*1:30: must be a number without ':'"),
        ("{load: 017}", ".*017: must be a number without ':' or a leading 0"),
        (f"{MILLION}]", ".*must have at most 100000 values"),
    ],
)
def test_names_the_field_or_the_place_and_what_is_allowed(text, message):
    """Oracle: by hand; YAML itself allows the last three."""
    assert re.match(message, refusal(text))


def test_lists_the_children_that_there_are():
    """Oracle: the names at the top of the YAML."""
    message = refusal("small: {}\nlarge: {}", child_name="huge")
    assert message == "'huge': must be one of small, large"
    assert "must be a mapping" in refusal("[small]", child_name="small")
    named = refusal("small: {seats: a}", child_name="small")
    assert named.startswith("small.seats = 'a': ")


def test_a_file_that_cannot_be_read(tmp_path):
    """Oracle: bytes that are no UTF-8; a name that there is not."""
    path = tmp_path / "cart.yaml"
    path.write_bytes(b"name: \xff\xfe")
    with pytest.raises(ValueError, match="cart.yaml: .*utf-8"):
        load_typed(Cart, "cart.yaml", filename=path)
    with pytest.raises(FileNotFoundError):
        load_typed(Cart, "cart.yaml", filename=tmp_path / "none.yaml")
