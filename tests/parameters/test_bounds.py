"""Oracles: messages by hand; the table of all parameters in parameters.txt."""

import dataclasses
import importlib
import math
import pkgutil
import pydoc
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from nadia_balance import core
from nadia_balance.parameters.bounds import (
    UNBOUNDED,
    bounded,
    check,
    parameters,
)

NAN, INF = math.nan, math.inf


@dataclass(kw_only=True)
class Part:
    """One field of each kind of bound."""

    least: float = bounded(1.0, least=0.0, unit="m")
    above: float = bounded(1.0, above=0.5)
    most: float = bounded(1.0, most=2.0, unit="s")
    below: float = bounded(1.0, below=2.0)
    within: float = bounded(1.0, least=0.0, below=2.0, unit="m/s")
    between: int = bounded(3, above=2, most=10)
    endless: float = bounded(INF, above=0.0, finite=False)
    word: str = bounded("left", one_of=("left", "right"))
    maybe: float | None = bounded(None, above=0.0)
    plain: float = 0.0
    switch: bool = True


@dataclass(kw_only=True)
class Whole:
    """Parts in all the places in which they can be."""

    part: Part = field(default_factory=Part)
    parts: list[Part] = field(default_factory=list)
    angles: dict[str, float] = field(default_factory=dict)
    low: float = 0.0
    high: float = 1.0

    def validate_more(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"low = {self.low}: must be < high = {self.high}")


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("least", -0.1, ">= 0 m"),
        ("above", 0.5, "> 0.5"),
        ("above", NAN, "finite and > 0.5"),
        ("most", 2.1, "<= 2 s"),
        ("below", 2.0, "< 2"),
        ("within", -0.1, "in [0, 2) m/s"),
        ("between", 2, "in (2, 10]"),
        ("endless", NAN, "> 0"),
        ("maybe", 0.0, "> 0"),
        ("plain", INF, "finite"),
        # Beyond what is sane, where there is no bound.
        ("least", 11.0, "in [0, 10] m"),
        ("plain", 2e6, "in [-1e+06, 1e+06]"),
        # Values of another type than the field's.
        ("plain", None, "a number"),
        ("plain", True, "a number"),
        ("between", 3.5, "an integer"),
        ("between", np.float64(3.5), "an integer"),
        ("switch", 1, "true or false"),
        ("word", 3, "text (quote it)"),
        ("maybe", (), "a number"),
    ],
)
def test_tells_field_value_and_what_is_allowed(name, value, rule):
    """Oracle: the message, by hand."""
    with pytest.raises(ValueError) as error:
        check(Part(**{name: value}))
    assert str(error.value) == f"{name} = {value}: must be {rule}"


def test_accepts_what_is_allowed():
    """Oracle: no error at the bounds, nor for None, or numbers of NumPy's."""
    part = Part(least=0.0, most=2.0, within=0, between=10, word="right")
    check(Part(least=np.float32(0.5), between=np.int64(3)))
    check(Whole(part=part, parts=[Part(maybe=1.0, between=3, switch=False)]))


@pytest.mark.parametrize(
    ("whole", "message"),
    [
        (Whole(part=Part(above=0.0)), "part.above = 0.0: must be > 0.5"),
        (
            Whole(parts=[Part(), Part(plain=NAN)]),
            "parts[1].plain = nan: must be finite",
        ),
        (Whole(angles={"KNEE": INF}), "angles.KNEE = inf: must be finite"),
        (Whole(low=2.0), "low = 2.0: must be < high = 1.0"),
        (Whole(part=3), "part = 3: must be a Part"),
        (Whole(parts=3), "parts = 3: must be a list"),
        (Whole(angles={"KNEE": "1"}), "angles.KNEE = '1': must be a number"),
    ],
)
def test_tells_the_way_to_the_field(whole, message):
    """Oracle: the message, by hand; below a name of one's own as well."""
    for name, prefix in ("", ""), ("whole", "whole."):
        with pytest.raises(ValueError) as error:
            check(whole, name)
        assert str(error.value) == prefix + message


def parameter_table():
    """Each parameter of core, its default and what is allowed, by line."""
    for info in pkgutil.walk_packages(core.__path__, f"{core.__name__}."):
        module = importlib.import_module(info.name)
        for name, kind in vars(module).items():
            if (
                isinstance(kind, type)
                and dataclasses.is_dataclass(kind)
                and kind.__module__ == module.__name__
                and not kind.__dataclass_params__.frozen
            ):
                for part in dataclasses.fields(kind):
                    value = getattr(kind(), part.name)
                    bounds = part.metadata.get("bounds", UNBOUNDED)
                    rule = bounds.one_of or bounds.rule(0.0)
                    if bounds is UNBOUNDED:
                        rule = ""
                    if not dataclasses.is_dataclass(value):
                        yield f"{name}.{part.name} = {value!r}  {rule}".strip()
                    else:
                        values = dataclasses.asdict(value)
                        yield f"{name}.{part.name} = {values}"


def test_defaults_and_bounds_are_those_that_were_tuned():
    """Oracle: parameters.txt, with which the limits in docs/results hold.

    After a change that is meant: write `parameter_table()` into the file.
    """
    known = Path(__file__).with_name("parameters.txt").read_text("utf-8")
    assert sorted(parameter_table()) == sorted(known.splitlines())


def test_a_class_of_parameters_tells_its_fields_and_takes_no_other():
    """Oracles: `help()`, which reads the docstring; Python's slots."""

    @parameters
    class Spring:
        """A spring."""

        stiffness: float = bounded(2.0, above=0.0, unit="N", doc="a metre")

    assert "stiffness: a metre [N]" in pydoc.render_doc(Spring)
    spring = Spring(stiffness=3.0)
    with pytest.raises(AttributeError, match="stifness"):
        spring.stifness = 1.0
    with pytest.raises(TypeError, match="stifness"):
        Spring(stifness=1.0)
