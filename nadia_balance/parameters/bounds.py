"""Parameters: their bounds, unit and meaning, written beside their default.

For example:

    @parameters
    class Params:
        '''Of the feedback.'''

        gain: float = bounded(3.0, above=1.0, doc="of the ICP error")

    check(Params(gain=0.5))  # ValueError: gain = 0.5: must be > 1
"""

import dataclasses
import functools
import inspect
import math
import types
from numbers import Integral, Real
from typing import (
    Any,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

T = TypeVar("T")

# What the value of a field must be, by its type, and which classes are that.
KINDS: dict[Any, str] = {
    bool: "true or false",
    float: "a number",
    int: "an integer",
    str: "text (quote it)",
}
_CLASSES: dict[Any, type] = {bool: bool, float: Real, int: Integral, str: str}

# Largest magnitude of a parameter without a bound, by unit, and for all others.
LARGEST = {"s": 10.0, "m": 10.0}
LARGEST_OF_ALL = 1e6


class Bounds(NamedTuple):
    """Allowed values: >= `least`, > `above`, <= `most`, < `below`, `one_of`.

    A side without a bound ends at +-LARGEST of the `unit`; if not `finite`,
    infinity is allowed, too.
    """

    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    one_of: tuple[str, ...] = ()
    finite: bool = True
    unit: str = ""
    of: str = "leg"  # length that it scales with (see Size); empty: none

    def allow(self, value: float) -> bool:
        """True if the number is within these bounds.

        Args:
            value: number, infinity or NaN.

        Returns:
            False for NaN, and beyond LARGEST on a side without a bound.
        """
        return (
            self._is_sane(value)
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
        )

    @property
    def _largest(self) -> float:
        return LARGEST.get(self.unit, LARGEST_OF_ALL)

    def _is_sane(self, value: float) -> bool:
        """False for NaN, and beyond LARGEST on a side without a bound."""
        if math.isinf(value):
            return not self.finite
        given = (
            (self.most, self.below) if value > 0.0 else (self.least, self.above)
        )
        return given != (None, None) or abs(value) <= self._largest

    def rule(self, value: float) -> str:
        """The rule that a number breaks.

        Args:
            value: number outside of these bounds.

        Returns:
            What it must be, such as `in (0, 10] s` or `finite and >= 0`.
        """
        low = self.least if self.above is None else self.above
        high = self.most if self.below is None else self.below
        if math.isfinite(value) and not self._is_sane(value):
            low = -self._largest if low is None else low
            high = self._largest if high is None else high
        if low is None and high is None:
            return "finite" if self.finite else "a number"
        unit = f" {self.unit}" if self.unit else ""
        if low is not None and high is not None:
            opening = "[" if self.above is None else "("
            closing = "]" if self.below is None else ")"
            return f"in {opening}{low:g}, {high:g}{closing}{unit}"
        rule = (
            f"{'<=' if self.below is None else '<'} {high:g}{unit}"
            if low is None
            else f"{'>=' if self.above is None else '>'} {low:g}{unit}"
        )
        is_infinite = self.finite and not math.isfinite(value)
        return f"finite and {rule}" if is_infinite else rule


UNBOUNDED = Bounds()


def bounded(default: Any, *, doc: str = "", **bounds: Any) -> Any:
    """A dataclass field with its default, bounds and meaning.

    None is allowed where the field's type has it.

    Args:
        default: value, or a factory such as `dict` or a class of parameters.
        doc: what it is, in a sentence without the unit; the one source of
            `help()`, the reference page and the JSON schema.
        **bounds: those of Bounds; UNBOUNDED without any.

    Returns:
        The field, for the body of a class.
    """
    metadata = {"bounds": Bounds(**bounds) if bounds else UNBOUNDED, "doc": doc}
    if callable(default):
        return dataclasses.field(default_factory=default, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


# For type checkers `bounded(x)` is a default like any other.
@dataclass_transform(
    kw_only_default=True, field_specifiers=(dataclasses.field,)
)
def parameters(owner: type[T]) -> type[T]:
    """Makes a class of parameters: a dataclass that takes no unknown field.

    Its fields are given by keyword; `help()` tells each by its `doc`.

    Args:
        owner: class with annotated fields (see bounded).

    Returns:
        The dataclass, with slots.
    """
    made = dataclasses.dataclass(kw_only=True, slots=True)(owner)
    made.__doc__ = "\n".join(
        [
            inspect.cleandoc(made.__doc__ or ""),
            "",
            "Attributes:",
            *(
                f"    {field.name}: {meaning(field)}"
                for field in dataclasses.fields(made)  # type: ignore[arg-type]
            ),
        ]
    )
    return made


def meaning(field: "dataclasses.Field[Any]") -> str:
    """What a field is, with its unit.

    Args:
        field: of a class of parameters.

    Returns:
        Its `doc`, and its unit in brackets.
    """
    unit = field.metadata.get("bounds", UNBOUNDED).unit
    doc = field.metadata.get("doc", "")
    return f"{doc} [{unit}]".strip() if unit else doc


def check(params: object, name: str = "") -> None:
    """Checks all fields of a dataclass against their types and bounds.

    Descends into dataclasses, lists and mappings, then calls
    `params.validate_more()`, if defined, for conditions between fields.

    Args:
        params: the dataclass.
        name: name of `params` itself, which messages begin with.

    Raises:
        ValueError: names the first field of another type or out of its bounds,
            its value and the rule, such as `steps[1].length = nan: must be
            finite`.
    """
    kinds = _kinds(cast(Any, type(params)))
    for field in dataclasses.fields(params):  # type: ignore[arg-type]
        _check(
            getattr(params, field.name),
            _join(name, field.name),
            bounds=field.metadata.get("bounds", UNBOUNDED),
            kind=kinds[field.name],
        )
    if hasattr(params, "validate_more"):
        try:
            params.validate_more()
        except ValueError as error:
            raise ValueError(_join(name, str(error))) from None


def check_number(name: str, value: float, **bounds: Any) -> None:
    """Checks an argument that is no field.

    Args:
        name: of the argument, which the message begins with.
        value: the number.
        **bounds: those of Bounds.

    Raises:
        ValueError: it is out of them, or no number.
    """
    _check(value, name, Bounds(**bounds), float)


def check_type(name: str, value: object, kind: type) -> None:
    """Checks the class of an argument.

    Args:
        name: of the argument, which the message begins with.
        value: the argument.
        kind: what it must be.

    Raises:
        ValueError: it is something else.
    """
    require(
        isinstance(value, kind),
        f"{name} = {value!r}: must be a {kind.__name__}",
    )


def require(fulfilled: bool, message: str) -> None:
    """Requires a condition.

    Args:
        fulfilled: the condition.
        message: of the error.

    Raises:
        ValueError: it is not fulfilled.
    """
    if not fulfilled:
        raise ValueError(message)


@functools.cache
def _kinds(owner: type) -> dict[str, Any]:
    """The types of the fields of a dataclass."""
    return get_type_hints(owner)


def not_none(kinds: tuple[Any, ...]) -> Any:
    """The type X of an X | None.

    Args:
        kinds: X and None, in any order.

    Returns:
        X; Any of a union of more.
    """
    others = [kind for kind in kinds if kind is not types.NoneType]
    return others[0] if len(others) == 1 else Any


def _check(value: object, name: str, bounds: Bounds, kind: Any) -> None:
    base, args = get_origin(kind), get_args(kind)
    if base in (Union, types.UnionType):
        if value is not None:
            _check(value, name, bounds, not_none(args))
        return
    if hasattr(value, "tolist"):  # an array or number of NumPy's
        value = value.tolist()
    _check_kind(value, name, kind)
    if dataclasses.is_dataclass(value):
        check(value, name)
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            _check(item, f"{name}[{i}]", bounds, args[0] if args else Any)
    elif isinstance(value, dict):
        for key, item in value.items():
            path = _join(name, str(key))
            _check(item, path, bounds, args[1] if args else Any)
    elif isinstance(value, str):
        require(
            not bounds.one_of or value in bounds.one_of,
            f"{name} = {value!r}: must be one of {', '.join(bounds.one_of)}",
        )
    elif (
        isinstance(value, float | int)
        and not isinstance(value, bool)
        and not bounds.allow(value)
    ):
        raise ValueError(f"{name} = {value}: must be {bounds.rule(value)}")


def _check_kind(value: object, name: str, kind: Any) -> None:
    """ValueError: the value is of another type than its field."""
    base = get_origin(kind) or kind
    if kind in KINDS:
        is_kind = isinstance(value, _CLASSES[kind])
        fits = is_kind and (kind is bool or not isinstance(value, bool))
        require(fits, f"{name} = {value!r}: must be {KINDS[kind]}")
    elif base in (list, dict) or dataclasses.is_dataclass(base):
        classes = (list, tuple) if base is list else base
        require(
            isinstance(value, classes),
            f"{name} = {value!r}: must be a {base.__name__}",
        )


def _join(name: str, part: str) -> str:
    return f"{name}.{part}" if name else part
