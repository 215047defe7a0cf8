"""The controls of a graph, from the schema that the engine gives. Nothing of Blender is here."""

from __future__ import annotations

import dataclasses
import json
import math
import struct
from typing import Any, Iterable


@dataclasses.dataclass(frozen=True)
class Control:
    """A parameter of a graph."""

    name: str
    # `number`, `integer`, `flag`, `choice`, `color`, `file`, `text`; all others are `ron`: a text of RON.
    kind: str
    default: Any
    doc: str = ""
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    # What drafts have instead, as JSON; empty if they have the same.
    draft: str = ""

    @property
    def title(self) -> str:
        """What stands beside it."""
        words = self.name.replace("-", " ").capitalize()
        words = f"{words} ({self.unit})" if self.unit else words
        return f"{words}, in drafts {self.draft}" if self.draft else words

    @property
    def is_ranged(self) -> bool:
        """Whether it is a number between two others: a slider."""
        return self.kind in ("number", "integer") and self.low is not None and self.high is not None

    def limits(self) -> dict[str, float]:
        """Its range, as widgets of Blender have it."""
        kind = int if self.kind == "integer" else float
        ends = {"min": self.low, "max": self.high}
        return {f"{soft}{end}": kind(it) for end, it in ends.items() if it is not None for soft in ("", "soft_")}


def controls(schema: dict[str, Any]) -> list[Control]:
    """The parameters in their order; inputs are none. Those of a type of nodes are its fields."""
    found = []
    for name, field in (schema.get("properties") or {}).items():
        if "port" in field:
            continue
        choices = _choices(field, schema)
        found.append(
            Control(
                name,
                "choice" if choices else _kind(field),
                field.get("default"),
                field.get("description", ""),
                field.get("unit", ""),
                field.get("minimum"),
                field.get("maximum"),
                choices,
                json.dumps(field["draft"]["draft"]) if "draft" in field else "",
            )
        )
    return found


def _choices(field: dict[str, Any], schema: dict[str, Any]) -> tuple[str, ...]:
    """The words that a field may be; none if it may be anything else."""
    if "enum" in field:
        return tuple(field["enum"])
    of = schema.get("$defs", {}).get(str(field.get("$ref", "")).removeprefix("#/$defs/"), {}).get("oneOf", ())
    return tuple(it["const"] for it in of) if all("const" in it for it in of) else ()


def _kind(field: dict[str, Any]) -> str:
    if field.get("format") in ("color", "file"):
        return str(field["format"])
    plain = {"number": "number", "integer": "integer", "boolean": "flag", "string": "text"}
    return plain.get(str(field.get("type")), "ron")


def single(number: float) -> float:
    """A number as widgets of Blender keep it."""
    try:
        return float(struct.unpack("f", struct.pack("f", number))[0])
    except OverflowError:
        return number


def number_text(number: float) -> str:
    """The shortest text of a number: of what a widget made single, the one that the user saw."""
    texts = (f"{number:.{digits}g}" for digits in range(1, 10)) if single(number) == number else ()
    short = next((text for text in texts if single(float(text)) == number), number)
    # With a point or an exponent, as the engine's language has numbers.
    return repr(float(short))


def rgb(text: str) -> list[float] | None:
    """Red, green and blue of `"#c33923"`, from 0 to 1; None for a color with more or less to it."""
    digits = text.removeprefix("#")
    try:
        return [int(digits[it : it + 2], 16) / 255 for it in (0, 2, 4)] if len(digits) == 6 else None
    except ValueError:
        return None


def hexadecimal(color: Iterable[float]) -> str:
    """The text of a color."""
    return "#" + "".join(f"{round(min(max(it, 0.0), 1.0) * 255):02x}" for it in color)


def is_same(control: Control, value: Any, known: Any) -> bool:
    """Whether a widget that shows `known` holds `value` because nobody touched it."""
    if control.kind == "number":
        return single(float(value)) == single(float(known))
    if control.kind == "color":
        return _color(value).lower() == _color(known).lower()
    return bool(value == known)


def _color(value: Any) -> str:
    return value if isinstance(value, str) else hexadecimal(value)


def said(control: Control, value: Any) -> str | None:
    """The value of a widget as RON; None if it is none: users can make anything of a property."""
    try:
        return ron(control, value)
    except (TypeError, ValueError, OverflowError):
        return None


def ron(control: Control, value: Any) -> str:
    """The value of a widget as RON."""
    if control.kind == "number":
        if not math.isfinite(value):
            raise ValueError(value)
        return number_text(float(value))
    if control.kind == "integer":
        return str(int(value))
    if control.kind == "flag":
        return "true" if value else "false"
    if control.kind == "choice":
        return str(value)
    if control.kind == "color":
        return json.dumps(_color(value))
    if control.kind in ("file", "text"):
        # JSON's quotes and escapes are RON's but for the number of a character.
        return json.dumps(str(value), ensure_ascii=False)
    return str(value)


def shown(control: Control, text: str | None) -> Any:
    """What a widget shows for a value as RON; for None its default. ValueError if it can be shown as RON alone."""
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
    if control.kind in ("color", "file", "text"):
        return json.loads(text)
    return text
