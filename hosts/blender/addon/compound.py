"""Values with parts, such as `Near(color: "#c33923", distance: 30.0)`: a word of several, and what it takes. Nothing of Blender is here.

Only the part that a user changes is written anew; all others stay as they stand in the text.
"""

from __future__ import annotations

import re
from typing import Any

from . import panel

# The parts of each word, by their names; a part without a name is the only one of its word.
Variants = dict[str, list[panel.Control]]

_WORD = re.compile(r"\s*([A-Za-z_]\w*)\s*")
_NAMED = re.compile(r"\s*([A-Za-z_]\w*)\s*:(?!:)")
# What is skipped as a whole: raw strings, strings, characters and comments.
_WHOLE = re.compile(r'r(#*)".*?"\1|"(?:\\.|[^"\\])*"|\'(?:\\.|[^\'\\])\'|//[^\n]*|/\*.*?\*/', re.DOTALL)


def variants(parameters: dict[str, Any]) -> dict[str, Variants]:
    """The fields of a type of nodes that are values with parts, from its schema."""
    defs = parameters.get("$defs", {})
    found = {}
    for name, field in (parameters.get("properties") or {}).items():
        options = _resolved(field, defs).get("oneOf", ())
        words = dict(it for option in options for it in _words(option, defs))
        if any(words.values()) and all(_words(option, defs) for option in options):
            found[name] = words
    return found


def _resolved(field: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
    return defs.get(str(field.get("$ref", "")).removeprefix("#/$defs/"), field)


def _words(option: dict[str, Any], defs: dict[str, Any]) -> list[tuple[str, list[panel.Control]]]:
    """The word of an option, with its parts; none if it is no such option."""
    if "const" in option:
        return [(option["const"], [])]
    properties = option.get("properties") or {}
    if len(properties) != 1:
        return []
    ((word, its),) = properties.items()
    inner = _resolved(its, defs)
    if inner.get("properties") is not None:
        return [(word, panel.controls({**inner, "$defs": defs}))]
    return [(word, panel.controls({"properties": {"": its}, "required": [""], "$defs": defs}))]


def parse(text: str, known: Variants) -> tuple[str, dict[str, str]]:
    """The word of a value, and its parts that are written, as RON. ValueError if it is another value, such as `Param("select")`."""
    match = _WORD.match(text)
    if not match or match[1] not in known:
        raise ValueError(text)
    rest = text[match.end() :].strip()
    if not rest:
        return match[1], {}
    if not (rest.startswith("(") and rest.endswith(")")):
        raise ValueError(text)
    names = [it.name for it in known[match[1]]]
    found = {}
    for piece in split(rest[1:-1]):
        named = _NAMED.match(piece)
        name, value = (named[1], piece[named.end() :]) if named and names != [""] else ("", piece)
        if name in found or name not in names:
            raise ValueError(text)
        found[name] = value.strip()
    return match[1], found


def split(text: str) -> list[str]:
    """What commas divide, but not those within brackets, strings and comments."""
    pieces, depth, start, at = [], 0, 0, 0
    while at < len(text):
        whole = _WHOLE.match(text, at)
        if whole:
            at = whole.end()
            continue
        if text[at] in "([{":
            depth += 1
        elif text[at] in ")]}":
            depth -= 1
            if depth < 0:
                raise ValueError(text)
        elif text[at] == "," and not depth:
            pieces.append(text[start:at])
            start = at + 1
        at += 1
    if depth:
        raise ValueError(text)
    last = text[start:]
    return [*pieces, last] if last.strip() else pieces


def compose(word: str, parts: dict[str, str], known: Variants) -> str:
    """The value as RON."""
    if not known[word]:
        return word
    written = [(name, text) for name, text in parts.items() if text]
    return f"{word}({', '.join(text if not name else f'{name}: {text}' for name, text in written)})"


def begin(word: str, parts: dict[str, str], known: Variants) -> str:
    """The value of another word, with the parts of the one before that it takes, and something for each that it must have."""
    found = {}
    for control in known[word]:
        if control.name in parts and can_show(control, parts[control.name]):
            found[control.name] = parts[control.name]
        elif control.is_required:
            found[control.name] = _something(control)
    return compose(word, found, known)


def can_show(control: panel.Control, text: str) -> bool:
    """Whether a widget of this kind can show the part."""
    try:
        panel.shown(control, text)
    except ValueError:
        return False
    return True


def default_of(default: Any, known: Variants) -> str:
    """A default of the schema as RON; empty if it has parts that no widget has."""
    if isinstance(default, str):
        return default if default in known else ""
    if not isinstance(default, dict) or len(default) != 1:
        return ""
    ((word, its),) = default.items()
    if word not in known:
        return ""
    values = its if isinstance(its, dict) and [it.name for it in known[word]] != [""] else {"": its}
    parts = {}
    for control in known[word]:
        if control.kind != "ron" and values.get(control.name) is not None:
            parts[control.name] = panel.said(control, values[control.name]) or ""
    return compose(word, parts, known)


def _something(control: panel.Control) -> str:
    """A value for a part that must be there."""
    if control.kind in ("number", "integer"):
        number = max(control.low if control.low is not None else 0, 1 if control.kind == "integer" else 1.0)
        if control.high is not None:
            number = min(number, control.high)
        return panel.ron(control, number)
    values = {"flag": False, "color": "#808080", "vector": [1 if control.is_whole else 1.0] * control.width, "text": "", "file": ""}
    if control.kind == "choice":
        return control.choices[0]
    return panel.ron(control, values[control.kind]) if control.kind in values else ""
