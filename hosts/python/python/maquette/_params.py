"""Descriptions of parameters, inputs and outputs of graphs, and checks of parameter values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Dict, Iterator, NamedTuple, Optional, Tuple, TypeVar

T = TypeVar("T")

# The maximum count of numbers of a parameter or field, whose text is about 10 MB then.
_MAX_NUMBERS = 2**20
_MAX_INTEGER = 2**63 - 1


class Param(NamedTuple):
    """A parameter of a graph."""

    name: str
    """Its name, as in `Graph.run`."""
    kind: str
    """`Number`, `Integer`, `Toggle`, `Color`, `Text`, `Choice` or `Vector`."""
    default: Any
    """The default value: float, int, bool, str or a list of numbers."""
    min: Optional[float]
    """The minimum, if any."""
    max: Optional[float]
    """The maximum, if any."""
    unit: Optional[str]
    """The unit, such as `mm`."""
    choices: Tuple[str, ...]
    """The alternatives of a `Choice`."""
    doc: str
    """The description by the graph's author."""


class Port(NamedTuple):
    """An input of a graph that is a function of values."""

    name: str
    """Its name, as in `inputs` of `Graph.run`."""
    kind: str
    """The type of its values, such as `Mesh`."""
    doc: str
    """The description by the graph's author."""


class Output(NamedTuple):
    """An output of a graph."""

    name: str
    """Its name: a file, or a value of a graph with inputs."""
    kind: Optional[str]
    """The type of its value; None if it depends on the inputs."""


class Named(Mapping[str, T]):
    """An ordered mapping of descriptions by name."""

    def __init__(self, what: str, things: Dict[str, T]) -> None:
        self._what, self._things = what, things

    def __getitem__(self, name: str) -> T:
        try:
            return self._things[name]
        except KeyError:
            known = ", ".join(self._things) or "none"
            raise KeyError(f"no {self._what} `{name}`; there are: {known}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._things)

    def __len__(self) -> int:
        return len(self._things)

    def __repr__(self) -> str:
        return "\n".join(repr(thing) for thing in self._things.values()) or f"no {self._what}"

    def _repr_html_(self) -> str:
        from ._show import named_html

        return named_html(self._what, list(self._things.values()))


def param_of(name: str, field: Dict[str, Any]) -> Param:
    """Creates the description of a parameter from its JSON schema."""
    kinds = {"number": "Number", "integer": "Integer", "boolean": "Toggle", "array": "Vector"}
    kind = kinds.get(field.get("type", ""), "Text")
    if "enum" in field:
        kind = "Choice"
    elif field.get("format") == "color":
        kind = "Color"
    limits = field.get("items", {}) if kind == "Vector" else field
    return Param(
        name,
        kind,
        field.get("default"),
        limits.get("minimum"),
        limits.get("maximum"),
        field.get("unit"),
        tuple(field.get("enum", ())),
        field.get("description", ""),
    )


def to_plain(name: str, value: Any) -> Any:
    """Converts a value of NumPy or Python to a bool, number, text or list. Raises TypeError or ValueError with the parameter's name."""
    if hasattr(value, "tolist") and not isinstance(value, memoryview):
        size = getattr(value, "size", 0)
        if isinstance(size, int) and size > _MAX_NUMBERS:
            raise ValueError(f"`{name}` is an array of {size} numbers; expected at most {_MAX_NUMBERS}")
        value = value.tolist()
    if isinstance(value, (bytes, bytearray, memoryview)):
        raise TypeError(f"`{name}` is a {type(value).__name__}; expected a bool, number, text or list")
    if isinstance(value, (tuple, list)):
        try:
            return [to_plain(name, item) for item in value]
        except RecursionError:
            raise ValueError(f"`{name}` is a list that is nested too deeply") from None
    if isinstance(value, str):
        check_text(name, value)
        return value
    if isinstance(value, bool) or isinstance(value, int) and abs(value) <= _MAX_INTEGER:
        return value
    try:
        number = float(value)
    except OverflowError:
        raise ValueError(f"`{name}` has more digits than any number in a graph") from None
    except (TypeError, ValueError):
        raise TypeError(f"`{name}` is a {type(value).__name__}, which no parameter is") from None
    if number != number or number in (float("inf"), float("-inf")):
        raise ValueError(f"`{name}` is {number}")
    return number


def check_text(name: str, text: str) -> None:
    """Raises ValueError if a text cannot be written to a file, such as a file name that is not valid UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        reason = f"character {error.start} is a lone surrogate, as in names of files that are not valid UTF-8"
        raise ValueError(f"`{name}` is {ascii(text)}, which is not valid Unicode: {reason}") from None
