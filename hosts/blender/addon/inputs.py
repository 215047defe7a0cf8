"""Sends objects at the inputs of a graph to the engine, and lists what is lost in the conversion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from . import engine, evaluated, from_object, returned, space
from .client import Answer
from .engine import key
from .records import MAX_VERTICES, Source

if TYPE_CHECKING:
    from .live import State

# The types as which an object can be passed.
TYPES = ("Mesh", "Points", "Curve")


def send(owner: bpy.types.Object, it: State, name: str, kind: str, given: bpy.types.Object) -> None:
    """Sends the mesh of an object with its modifiers to the engine, in the coordinates of the live object."""
    # While a request is pending, its files must not be overwritten.
    if engine.client().folder is None or name in it.sending:
        return
    it.stale.discard(name)
    it.sent[name] = key(given)
    why = _unfit_reason(owner, kind, given)
    fields: dict[str, Any] = {}
    if not why:
        try:
            fields = columns(owner, f"in-{key(owner)}-{name}-", kind, given)
        except ValueError as error:
            why = f"{given.name} {error}"
        except OSError as error:
            if engine.go_to_disk():
                return
            why = f"no room for {given.name}: {error}; free space, then press Reload"
    if why:
        it.inputs.pop(name, None)
        it.unfit[name] = f"{name}: {why}"
        return
    it.unfit.pop(name, None)
    it.sending.add(name)

    def done(answer: Answer) -> None:
        it.sending.discard(name)
        if answer.ok:
            it.inputs[name] = answer["value"]
        else:
            it.inputs.pop(name, None)
            it.unfit[name] = f"{name}: {answer.why}"

    it.sources[name] = fields.pop("source", None) or Source()
    engine.client().ask("input", done, None, type=kind, **fields)


def _unfit_reason(owner: bpy.types.Object, kind: str, given: bpy.types.Object) -> str:
    """The reason why an object cannot be passed, regardless of its mesh; empty if it can."""
    if kind not in TYPES:
        return f"the input takes a value of type {kind}, but an object can only be passed as {', '.join(TYPES[:-1])} or {TYPES[-1]}"
    found, left = set(), [given]
    while left:
        its = left.pop()
        if its == owner:
            return f"{given.name} depends on {owner.name} itself" if given != owner else f"{owner.name} cannot be an input of itself"
        if its not in found:
            found.add(its)
            left += [one.object for one in its.maquette.inputs if one.object]
    return ""


def columns(owner: bpy.types.Object, start: str, kind: str, given: bpy.types.Object) -> dict[str, Any]:
    """Writes the data of an object into files and returns the fields of the request `input`. `ValueError` if it does not fit the type."""
    folder = engine.client().folder
    assert folder
    first = MAX_VERTICES * next((at for at, its in enumerate(owner.maquette.inputs) if its.object == given), 0)
    place = space.transform_of(owner.data).inverted_safe() @ evaluated.world_matrix(owner).inverted_safe()
    fields, source = from_object.fields(place, start, kind, given, folder, first)
    return {**fields, "source": source}


def describe_losses(owner: bpy.types.Object, it: State, entry: dict[str, Any]) -> str:
    """Lists for the user what objects at inputs have and was not passed, and what was passed and is not in the value."""
    sources, lines = it.sources, []
    for its in owner.maquette.inputs:
        if its.object and its.name in sources and sources[its.name].lost:
            lines.append(f"{its.name}: {its.object.name} is passed without {', '.join(sources[its.name].lost)}")
    gone = returned.find_lost(entry, owner.data)
    return "\n".join([*lines, *([f"not in {owner.maquette.output}: {', '.join(gone)}"] if gone else [])])
