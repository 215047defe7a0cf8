"""The values of a live object: those that users set, as RON, and the widgets that show them.

A value that nobody touched is not kept, and follows the graph's default. Widgets are custom properties, which hold numbers exactly and can be
keyed and driven. Nothing tells of their changes, so what a widget was last given is kept beside it: a widget that holds anything else was
touched, by a user, a script or an animation, also before the graph was read.
"""

from __future__ import annotations

import json
from typing import Any, Iterable

import bpy

from . import panel

# Custom properties of widgets begin with this.
WIDGET = "maquette "


def _read(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def kept(owner: bpy.types.Object) -> dict[str, str]:
    """The values that were set, as RON."""
    return {str(name): str(text) for name, text in _read(owner.maquette.values).items()}


def keep(owner: bpy.types.Object, values: dict[str, str]) -> None:
    """Sets these values and no others."""
    owner.maquette.values = json.dumps(values) if values else ""


def is_known(name: str, loaded: Any) -> bool:
    """Whether a graph has a parameter of this name, or the node of `node.field`."""
    return name in (loaded["schema"].get("properties") or {}) or name.partition(".")[0] in loaded["nodes"] and "." in name


def take(owner: bpy.types.Object, controls: Iterable[panel.Control]) -> None:
    """Keeps the values of widgets that were touched, and of no others."""
    given, known = _read(owner.maquette.widgets), kept(owner)
    if not given and owner.maquette.shown:
        # The object is from a version that kept no widgets: what it holds is taken as untouched.
        return
    touched = {}
    for control in controls:
        value = plain(owner.get(WIDGET + control.name))
        if value is None or is_same(value, given.get(control.name)):
            continue
        said = panel.said(control, _value(control, value))
        if said is None:
            continue
        touched[control.name] = value
        if control.default is not None and panel.is_same(control, _value(control, value), panel.shown(control, None)):
            known.pop(control.name, None)
        else:
            known[control.name] = said
    if touched:
        owner.maquette.widgets = json.dumps(given | touched)
        if known != kept(owner):
            keep(owner, known)


def put(owner: bpy.types.Object, controls: Iterable[panel.Control]) -> None:
    """Makes widgets that show the values."""
    given, known = {}, kept(owner)
    for control in controls:
        name = WIDGET + control.name
        value = widget(control, known.get(control.name))
        if value is None:
            continue
        given[control.name] = value
        if name not in owner.keys() or type(plain(owner[name])) is not type(value) or not is_same(plain(owner[name]), value):
            owner[name] = value
        owner.id_properties_ui(name).update(description=control.doc, **_shape(control, value))
    for gone in _read(owner.maquette.widgets).keys() - given.keys():
        owner.pop(WIDGET + gone, None)
    owner.maquette.widgets = json.dumps(given)


def evaluated(owner: bpy.types.Object, its: bpy.types.Object, controls: Iterable[panel.Control]) -> dict[str, str]:
    """The values of the evaluated object `its` that its original `owner` does not have: an animation or a driver gives them."""
    found = {}
    for control in controls:
        value = plain(its.get(WIDGET + control.name))
        if value is None or is_same(value, plain(owner.get(WIDGET + control.name))):
            continue
        said = panel.said(control, _value(control, value))
        if said is not None:
            found[control.name] = said
    return found


def reset(owner: bpy.types.Object, name: str) -> None:
    """Forgets a value, whether the graph has such a parameter or not."""
    known = kept(owner)
    known.pop(name, None)
    keep(owner, known)
    owner.pop(WIDGET + name, None)


def widget(control: panel.Control, text: str | None) -> Any:
    """What the widget of a control holds for a value as RON; for None, or a value that it cannot show, the default."""
    try:
        value = panel.shown(control, text)
    except ValueError:
        value = panel.shown(control, None)
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
    """What a widget says: of a choice the word, for which scripts may write the word itself."""
    if control.kind != "choice":
        return value
    if isinstance(value, str):
        return value
    return control.choices[value] if 0 <= int(value) < len(control.choices) else None


def _shape(control: panel.Control, value: Any) -> dict[str, Any]:
    """The range, the default and the look of a widget."""
    default = widget(control, None)
    shape: dict[str, Any] = {"default": value if default is None else default}
    if type(shape["default"]) is not type(value):
        # A color of another form than the default's.
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


def plain(value: Any) -> Any:
    """A custom property as JSON has it."""
    return value.to_list() if hasattr(value, "to_list") else value


def is_same(one: Any, other: Any) -> bool:
    """Whether two widgets hold the same; Blender's own widgets make numbers single."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(is_same, one, other))
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        return panel.single(float(one)) == panel.single(float(other))
    return bool(one == other)
