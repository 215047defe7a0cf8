"""The controls of a graph's parameters, from the schema of the engine. Does not use Blender."""

from __future__ import annotations

import dataclasses
import json
import math
import struct
from typing import Any, Iterable


@dataclasses.dataclass(frozen=True)
class Control:
    """The description of a widget for a parameter of a graph, or for a field of a node."""

    name: str
    # `number`, `integer`, `flag`, `choice`, `color`, `vector`, `file`, `text`, or `ron` for all other types, shown as text.
    kind: str
    default: Any
    doc: str = ""
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    # The value in drafts, as JSON; empty if it is the same.
    draft: str = ""
    # The number of components of a vector, and whether they are integers.
    width: int = 0
    is_whole: bool = False
    is_required: bool = False

    @property
    def title(self) -> str:
        """The label."""
        words = self.name.replace("-", " ").capitalize()
        words = f"{words} ({self.unit})" if self.unit else words
        return f"{words}, in drafts {self.draft}" if self.draft else words

    @property
    def is_ranged(self) -> bool:
        """True if it is a number with minimum and maximum, which is shown as a slider."""
        return self.kind in ("number", "integer") and self.low is not None and self.high is not None

    def limits(self) -> dict[str, float]:
        """The range, as keyword arguments for properties of Blender."""
        kind = int if self.kind == "integer" or self.is_whole else float
        ends = {"min": self.low, "max": self.high}
        return {f"{soft}{end}": kind(it) for end, it in ends.items() if it is not None for soft in ("", "soft_")}


def controls(schema: dict[str, Any]) -> list[Control]:
    """The controls of all parameters in their order, without inputs; for the schema of a node type, the controls of its fields."""
    found = []
    for name, field in (schema.get("properties") or {}).items():
        if "port" in field:
            continue
        choices = _choices(field, schema)
        # A vector may have the range of its components.
        ranged = field if "minimum" in field or "maximum" in field else _items(field)[0]
        found.append(
            Control(
                name,
                "choice" if choices else _kind(field),
                field.get("default"),
                field.get("description", ""),
                field.get("unit", ""),
                ranged.get("minimum"),
                ranged.get("maximum"),
                choices,
                json.dumps(field["draft"]["draft"]) if "draft" in field else "",
                *_vector(field),
                name in schema.get("required", ()),
            )
        )
    return found


def _choices(field: dict[str, Any], schema: dict[str, Any]) -> tuple[str, ...]:
    """The choices of a field that only allows words; empty for other fields."""
    if "enum" in field:
        return tuple(field["enum"])
    of = schema.get("$defs", {}).get(str(field.get("$ref", "")).removeprefix("#/$defs/"), {}).get("oneOf", ())
    return tuple(it["const"] for it in of) if all("const" in it for it in of) else ()


def _kind(field: dict[str, Any]) -> str:
    if field.get("format") in ("color", "file"):
        return str(field["format"])
    if _vector(field)[0]:
        return "vector"
    plain = {"number": "number", "integer": "integer", "boolean": "flag", "string": "text"}
    return plain.get(str(field.get("type")), "ron")


# The maximum length of a vector: Blender does not show longer arrays well.
MAX_WIDTH = 4


def _items(field: dict[str, Any]) -> list[dict[str, Any]]:
    """The schemas of the components of an array of fixed length; one empty schema for other fields."""
    count = field.get("minItems", 0)
    items = field.get("prefixItems") or [field.get("items")] * count
    is_fixed = count == field.get("maxItems") == len(items) and all(isinstance(it, dict) for it in items)
    return items if is_fixed and items else [{}]


def _vector(field: dict[str, Any]) -> tuple[int, bool]:
    """The number of components of a vector, 0 for other fields, and true if they are integers."""
    kinds = [it.get("type") for it in _items(field)]
    is_vector = 2 <= len(kinds) <= MAX_WIDTH and len(set(kinds)) == 1 and kinds[0] in ("number", "integer")
    return (len(kinds), kinds[0] == "integer") if is_vector else (0, False)


def to_single(number: float) -> float:
    """Rounds a number to single precision, as Blender's properties do."""
    try:
        return float(struct.unpack("f", struct.pack("f", number))[0])
    except OverflowError:
        return number


def number_text(number: float) -> str:
    """The shortest text of a number; for a number rounded to single precision, the text that the user has seen."""
    texts = (f"{number:.{digits}g}" for digits in range(1, 10)) if to_single(number) == number else ()
    short = next((text for text in texts if to_single(float(text)) == number), number)
    # With a point or an exponent, as RON requires for floating-point numbers.
    return repr(float(short))


def rgb(text: str) -> list[float] | None:
    """Red, green and blue of `"#c33923"`, from 0 to 1; None for other forms of colors."""
    digits = text.removeprefix("#")
    try:
        return [int(digits[it : it + 2], 16) / 255 for it in (0, 2, 4)] if len(digits) == 6 else None
    except ValueError:
        return None


def hexadecimal(color: Iterable[float]) -> str:
    """The text of a color, such as `#c33923`."""
    return "#" + "".join(f"{round(min(max(it, 0.0), 1.0) * 255):02x}" for it in color)


def is_same(control: Control, value: Any, known: Any) -> bool:
    """Returns true if `value` is `known` after rounding by a widget, so that the user has not changed it."""
    if control.kind == "number":
        return to_single(float(value)) == to_single(float(known))
    if control.kind == "color":
        return _color(value).lower() == _color(known).lower()
    if control.kind == "vector":
        return [to_single(float(it)) for it in value] == [to_single(float(it)) for it in known]
    return bool(value == known)


def _color(value: Any) -> str:
    return value if isinstance(value, str) else hexadecimal(value)


def try_ron(control: Control, value: Any) -> str | None:
    """The value of a widget as RON; None if it is invalid, since scripts can write anything into a property."""
    try:
        return ron(control, value)
    except (TypeError, ValueError, OverflowError):
        return None


def ron(control: Control, value: Any) -> str:
    """The value of a widget as RON; raises if it is invalid."""
    if control.kind == "number":
        if not math.isfinite(value):
            raise ValueError(value)
        return number_text(float(value))
    if control.kind == "integer":
        return str(int(value))
    if control.kind == "flag":
        return "true" if value else "false"
    if control.kind == "choice":
        if value not in control.choices:
            raise ValueError(value)
        return str(value)
    if control.kind == "vector":
        return vector_text(value, control)
    if control.kind == "color":
        return json.dumps(_color(value))
    if control.kind in ("file", "text"):
        # Strings of JSON are valid in RON, except for escapes of characters by number.
        return json.dumps(str(value), ensure_ascii=False)
    return str(value)


def widget_value(control: Control, text: str | None) -> Any:
    """The value of a widget for RON, or for the default if `text` is None. `ValueError` if a widget cannot show it."""
    if text is None:
        return control.default if control.kind != "ron" else json.dumps(control.default)
    if control.kind == "number":
        return float(text)
    if control.kind == "integer":
        return int(text)
    if control.kind in ("flag", "choice"):
        words = {it: it for it in control.choices} if control.choices else {"true": True, "false": False}
        if text not in words:
            raise ValueError(text)
        return words[text]
    if control.kind == "vector":
        return vector(control, text)
    if control.kind in ("color", "file", "text"):
        return json.loads(text)
    return text


def vector_text(value: Iterable[float], control: Control) -> str:
    """A vector as RON."""
    numbers = list(value)
    if len(numbers) != control.width or not all(map(math.isfinite, numbers)):
        raise ValueError(value)
    return f"({', '.join(str(int(it)) if control.is_whole else number_text(float(it)) for it in numbers)})"


def vector(control: Control, text: str) -> list[Any]:
    """Parses a vector in RON. `ValueError` if a component is not a number."""
    inner = text.strip()
    if not (inner.startswith("(") and inner.endswith(")")):
        raise ValueError(text)
    texts = inner[1:-1].rstrip().removesuffix(",").split(",")
    if len(texts) != control.width:
        raise ValueError(text)
    return [int(it) if control.is_whole else float(it) for it in texts]
