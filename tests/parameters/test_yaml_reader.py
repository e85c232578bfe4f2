"""YAML that fits gives dataclasses, YAML that does not one readable line."""

import itertools
import re
from dataclasses import dataclass, field

import pytest

from nadia_balance.parameters.yaml_reader import load_typed, typed


@dataclass(kw_only=True)
class Wheel:
    radius: float = 0.3


@dataclass(kw_only=True)
class Tyre:
    radius: float = 0.3
    bars: float = 2.0


@dataclass(kw_only=True)
class Cart:
    name: str = "cart"
    seats: int = 1
    electric: bool = False
    load: float | None = None
    spare: Wheel = field(default_factory=Wheel)
    wheels: list[Wheel] = field(default_factory=list)
    angles: dict[str, float] = field(default_factory=dict)


ALL = """
name: truck
seats: 3.0
electric: true
load: 1e3  # text for YAML 1.1
spare: {radius: 1}
wheels: [{}, {radius: .4}]
angles: {door: 0.5}
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
    assert cart == Cart(
        name="truck",
        seats=3,
        electric=True,
        load=1000.0,
        spare=Wheel(radius=1.0),
        wheels=[Wheel(), Wheel(radius=0.4)],
        angles={"door": 0.5},
    )


def test_keeps_the_defaults_of_the_class_above():
    """Oracle: by hand: a bicycle's wheel has another radius than a wheel."""

    @dataclass(kw_only=True)
    class Bicycle:
        front: Tyre = field(default_factory=lambda: Tyre(radius=0.35))

    bicycle = load_typed(Bicycle, "bicycle.yaml", data="front: {bars: 4}")
    assert bicycle.front == Tyre(radius=0.35, bars=4.0)


def test_what_is_of_its_type_already_is_taken():
    """Oracle: the same object; another kind of object is refused."""
    wheel = Wheel(radius=0.5)
    assert typed(Cart, {"spare": wheel}).spare is wheel
    with pytest.raises(ValueError, match="^spare = Tyre.*must be a mapping"):
        typed(Cart, {"spare": Tyre()})


def test_much_yaml_is_refused_before_it_is_read():
    """Oracle: the limits; read at once, these would take minutes."""
    many = "".join(f"key{i}: 0\n" for i in range(60_000))
    assert "must have at most 100000 values" in refusal(many)
    assert "must have at most 1000000 characters" in refusal("0," * 3_000_000)


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
        ("a: b: c", "malformed YAML: .*line 1, column 5: "),
        ("name: 2020-13-45", "malformed YAML: .*month must be in 1..12"),
        (600 * "[", "malformed YAML: must be nested at most 50 deep"),
        ("{seats: 1, seats: 2}", ".*seats: must be given only once"),
        ("{load: 1:30}", ".*1:30: must be a number without ':'"),
        ("{load: 017}", ".*017: must be a number without ':' or a leading 0"),
        (f"{MILLION}]", ".*must have at most 100000 values"),
        ("spare: &a {spare: *a}", ".*must have at most 100000 values"),
        (f"load: {10**400}", "load = 10{30}.*: must be a number"),
    ],
)
def test_names_the_field_or_the_place_and_what_is_allowed(text, message):
    """Oracle: by hand; YAML itself allows the last five."""
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
