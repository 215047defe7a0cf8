"""The parameter values of a live object: those that users have set, as RON, and the widgets that show them.

A value that was never set is not stored, and follows the graph's default. Widgets are custom properties, which hold numbers exactly and can
be keyed and driven. Blender does not notify about their changes, so the last value written to each widget is stored, too: a widget with
another value was changed by a user, a script or an animation, possibly before the graph was read.
"""

from __future__ import annotations

import json
from typing import Any, Iterable

import bpy

from . import panel

# The prefix of the custom properties of widgets.
WIDGET = "maquette "


def _read(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def stored(owner: bpy.types.Object) -> dict[str, str]:
    """The stored values, as RON."""
    return {str(name): str(text) for name, text in _read(owner.maquette.values).items()}


def store(owner: bpy.types.Object, values: dict[str, str]) -> None:
    """Replaces all stored values."""
    owner.maquette.values = json.dumps(values) if values else ""


def is_known(name: str, loaded: Any) -> bool:
    """Returns true if a graph has a parameter `name`, or the node of `node.field`."""
    return name in (loaded["schema"].get("properties") or {}) or name.partition(".")[0] in loaded["nodes"] and "." in name


def take_touched(owner: bpy.types.Object, controls: Iterable[panel.Control]) -> None:
    """Stores the values of widgets that were changed."""
    given, known = _read(owner.maquette.widgets), stored(owner)
    if not given and owner.maquette.shown:
        # The object is from a version that did not store widget values: treat its widgets as unchanged.
        return
    touched = {}
    for control in controls:
        value = to_json(owner.get(WIDGET + control.name))
        if value is None or is_same(value, given.get(control.name)):
            continue
        said = panel.try_ron(control, _value(control, value))
        if said is None:
            continue
        touched[control.name] = value
        if control.default is not None and panel.is_same(control, _value(control, value), panel.widget_value(control, None)):
            known.pop(control.name, None)
        else:
            known[control.name] = said
    if touched:
        owner.maquette.widgets = json.dumps(given | touched)
        if known != stored(owner):
            store(owner, known)


def make_widgets(owner: bpy.types.Object, controls: Iterable[panel.Control]) -> None:
    """Creates or updates the widgets."""
    given, known = {}, stored(owner)
    for control in controls:
        name = WIDGET + control.name
        value = widget(control, known.get(control.name))
        if value is None:
            continue
        given[control.name] = value
        if name not in owner.keys() or type(to_json(owner[name])) is not type(value) or not is_same(to_json(owner[name]), value):
            owner[name] = value
        owner.id_properties_ui(name).update(description=control.doc, **_shape(control, value))
    for gone in _read(owner.maquette.widgets).keys() - given.keys():
        owner.pop(WIDGET + gone, None)
    owner.maquette.widgets = json.dumps(given)


def animated_values(owner: bpy.types.Object, its: bpy.types.Object, controls: Iterable[panel.Control]) -> dict[str, str]:
    """The values of the evaluated object `its` that differ from its original `owner` because of animation or drivers."""
    found = {}
    for control in controls:
        value = to_json(its.get(WIDGET + control.name))
        if value is None or is_same(value, to_json(owner.get(WIDGET + control.name))):
            continue
        said = panel.try_ron(control, _value(control, value))
        if said is not None:
            found[control.name] = said
    return found


def reset(owner: bpy.types.Object, name: str) -> None:
    """Removes a stored value and its widget, also if the graph has no such parameter."""
    known = stored(owner)
    known.pop(name, None)
    store(owner, known)
    owner.pop(WIDGET + name, None)


def widget(control: panel.Control, text: str | None) -> Any:
    """The widget value for RON; for None, or for RON that a widget cannot show, the value of the default."""
    try:
        value = panel.widget_value(control, text)
    except ValueError:
        value = panel.widget_value(control, None)
    if value is None:
        return None
    if control.kind == "color":
        return panel.rgb(value) or value
    if control.kind == "choice":
        return control.choices.index(value)
    if control.kind == "vector":
        return [int(it) if control.is_whole else float(it) for it in value]
    return float(value) if control.kind == "number" else value


def _value(control: panel.Control, value: Any) -> Any:
    """The value of a widget. The widget of a choice holds its number; scripts may also write the word."""
    if control.kind != "choice":
        return value
    if isinstance(value, str):
        return value
    return control.choices[value] if 0 <= int(value) < len(control.choices) else None


def _shape(control: panel.Control, value: Any) -> dict[str, Any]:
    """The range, the default and the subtype of a widget."""
    default = widget(control, None)
    shape: dict[str, Any] = {"default": value if default is None else default}
    if type(shape["default"]) is not type(value):
        # A color in another form than the default.
        shape["default"] = value
    if control.kind == "choice":
        return {**shape, "items": [(it, it, "", 0, place) for place, it in enumerate(control.choices)]}
    if control.kind in ("number", "integer"):
        return shape | control.limits()
    if control.kind == "vector":
        return shape | control.limits() | ({} if control.is_whole else {"subtype": "XYZ"})
    if isinstance(value, list):
        return shape | {"subtype": "COLOR_GAMMA", "min": 0.0, "max": 1.0, "soft_min": 0.0, "soft_max": 1.0}
    return shape


def to_json(value: Any) -> Any:
    """Converts a custom property to a type of JSON."""
    return value.to_list() if hasattr(value, "to_list") else value


def is_same(one: Any, other: Any) -> bool:
    """Returns true if two widget values are equal in single precision, in which Blender's widgets store numbers."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(is_same, one, other))
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        return panel.to_single(float(one)) == panel.to_single(float(other))
    return bool(one == other)
