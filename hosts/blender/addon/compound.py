"""Enum values with fields, such as `Near(color: "#c33923", distance: 30.0)`: a word (the variant) and its parts. Does not use Blender.

Only the part that a user changes is written again; all other parts keep their text.
"""

from __future__ import annotations

import re
from typing import Any

from . import panel

# The parts of each word; a part with an empty name is the only, unnamed one.
Variants = dict[str, list[panel.Control]]

_WORD = re.compile(r"\s*([A-Za-z_]\w*)\s*")
_NAMED = re.compile(r"\s*([A-Za-z_]\w*)\s*:(?!:)")
# Tokens in which brackets and commas have no meaning: raw strings, strings, characters and comments.
_WHOLE = re.compile(r'r(#*)".*?"\1|"(?:\\.|[^"\\])*"|\'(?:\\.|[^\'\\])\'|//[^\n]*|/\*.*?\*/', re.DOTALL)


def variants(parameters: dict[str, Any]) -> dict[str, Variants]:
    """Returns the fields of a node type that have words with parts, from its schema."""
    defs = parameters.get("$defs", {})
    found = {}
    for name, field in (parameters.get("properties") or {}).items():
        options = _resolve(field, defs).get("oneOf", ())
        words = dict(it for option in options for it in _words(option, defs))
        if any(words.values()) and all(_words(option, defs) for option in options):
            found[name] = words
    return found


def _resolve(field: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
    return defs.get(str(field.get("$ref", "")).removeprefix("#/$defs/"), field)


def _words(option: dict[str, Any], defs: dict[str, Any]) -> list[tuple[str, list[panel.Control]]]:
    """Returns the word of an option of the schema with its parts; empty if it is another kind of option."""
    if "const" in option:
        return [(option["const"], [])]
    properties = option.get("properties") or {}
    if len(properties) != 1:
        return []
    ((word, its),) = properties.items()
    inner = _resolve(its, defs)
    if inner.get("properties") is not None:
        return [(word, panel.controls({**inner, "$defs": defs}))]
    return [(word, panel.controls({"properties": {"": its}, "required": [""], "$defs": defs}))]


def parse(text: str, known: Variants) -> tuple[str, dict[str, str]]:
    """Splits a value into its word and its written parts, as RON. `ValueError` for other values, such as `Param("select")`."""
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
    """Splits a text at commas, except within brackets, strings and comments."""
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
    """Formats a word and its parts as RON."""
    if not known[word]:
        return word
    written = [(name, text) for name, text in parts.items() if text]
    return f"{word}({', '.join(text if not name else f'{name}: {text}' for name, text in written)})"


def change_word(word: str, parts: dict[str, str], known: Variants) -> str:
    """Returns the value of another word as RON: with the previous parts that it accepts, and placeholders for missing required parts."""
    found = {}
    for control in known[word]:
        if control.name in parts and can_show(control, parts[control.name]):
            found[control.name] = parts[control.name]
        elif control.is_required:
            found[control.name] = _placeholder(control)
    return compose(word, found, known)


def can_show(control: panel.Control, text: str) -> bool:
    """Returns true if a widget of this kind can show the text."""
    try:
        panel.widget_value(control, text)
    except ValueError:
        return False
    return True


def default_of(default: Any, known: Variants) -> str:
    """Formats a default of the schema as RON; empty if no widgets can show it."""
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
            parts[control.name] = panel.try_ron(control, values[control.name]) or ""
    return compose(word, parts, known)


def _placeholder(control: panel.Control) -> str:
    """A placeholder for a required part, as RON."""
    if control.kind in ("number", "integer"):
        number = max(control.low if control.low is not None else 0, 1 if control.kind == "integer" else 1.0)
        if control.high is not None:
            number = min(number, control.high)
        return panel.ron(control, number)
    values = {"flag": False, "color": "#808080", "vector": [1 if control.is_whole else 1.0] * control.width, "text": "", "file": ""}
    if control.kind == "choice":
        return control.choices[0]
    return panel.ron(control, values[control.kind]) if control.kind in values else ""
