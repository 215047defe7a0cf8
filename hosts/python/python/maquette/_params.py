"""What graphs take and give: parameters with their values, inputs and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Dict, Iterator, NamedTuple, Optional, Tuple, TypeVar

T = TypeVar("T")

# A parameter or field of so many numbers is a text of some 10 MB.
_MAX_NUMBERS = 2**20
_MAX_INTEGER = 2**63 - 1


class Param(NamedTuple):
    """A parameter that a graph declares."""

    name: str
    """Its name, as `Graph.run` takes it."""
    kind: str
    """`Number`, `Integer`, `Toggle`, `Color`, `Text`, `Choice` or `Vector`."""
    default: Any
    """Its value if none is given: float, int, bool, str or a list of numbers."""
    min: Optional[float]
    """The least number that it takes."""
    max: Optional[float]
    """The greatest number that it takes."""
    unit: Optional[str]
    """The unit of its number, such as `mm`."""
    choices: Tuple[str, ...]
    """What a `Choice` chooses from."""
    doc: str
    """What it does, in the words of the graph's author."""


class Port(NamedTuple):
    """An input of a graph that is a function of values."""

    name: str
    """Its name, as `inputs` of `Graph.run` takes it."""
    kind: str
    """The type of values that it takes, such as `Mesh`."""
    doc: str
    """What it is, in the words of the graph's author."""


class Output(NamedTuple):
    """Something that a graph gives."""

    name: str
    """Its name: a file, or a value of a graph with inputs."""
    kind: Optional[str]
    """The type of its value; None if it is that of what comes in."""


class Named(Mapping[str, T]):
    """Things by their names, in order."""

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
    """A parameter as its JSON schema has it."""
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


def plain(name: str, value: Any) -> Any:
    """A value of NumPy or Python as a bool, number, text or list. Raises TypeError or ValueError with the parameter's name."""
    if hasattr(value, "tolist") and not isinstance(value, memoryview):
        size = getattr(value, "size", 0)
        if isinstance(size, int) and size > _MAX_NUMBERS:
            raise ValueError(f"`{name}` is an array of {size} numbers; expected at most {_MAX_NUMBERS}")
        value = value.tolist()
    if isinstance(value, (bytes, bytearray, memoryview)):
        raise TypeError(f"`{name}` is a {type(value).__name__}; expected a bool, number, text or list")
    if isinstance(value, (tuple, list)):
        try:
            return [plain(name, item) for item in value]
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
    """Raises ValueError if a text cannot be written to a file, as names of files that are not valid UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        reason = f"character {error.start} is a lone surrogate, as in names of files that are not valid UTF-8"
        raise ValueError(f"`{name}` is {ascii(text)}, which is not valid Unicode: {reason}") from None
