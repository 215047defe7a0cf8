"""Objects at the inputs of a graph: what the engine is given of them, and what is lost on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from . import engine, evaluated, from_object, returned, space
from .client import Answer
from .engine import key
from .records import MAX_VERTICES, Source

if TYPE_CHECKING:
    from .live import State

# What an object can be given as.
TYPES = ("Mesh", "Points", "Curve")


def send(owner: bpy.types.Object, it: State, name: str, kind: str, given: bpy.types.Object) -> None:
    """Gives the mesh of an object to the engine, its modifiers included, as it lies relative to the live one."""
    # The files of what is on its way are the engine's.
    if engine.client().folder is None or name in it.sending:
        return
    it.stale.discard(name)
    it.sent[name] = key(given)
    why = _unfit(owner, kind, given)
    fields: dict[str, Any] = {}
    if not why:
        try:
            fields = columns(owner, f"in-{key(owner)}-{name}-", kind, given)
        except ValueError as error:
            why = f"{given.name} {error}"
        except OSError as error:
            if engine.go_to_disk():
                return
            why = f"there is no room for {given.name}: {error}; free space, and press Reload"
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


def _unfit(owner: bpy.types.Object, kind: str, given: bpy.types.Object) -> str:
    """Why an object cannot be given, whatever its mesh."""
    if kind not in TYPES:
        return f"it takes a value of the type {kind}, and an object can be given as {', '.join(TYPES[:-1])} or {TYPES[-1]} only"
    found, left = set(), [given]
    while left:
        its = left.pop()
        if its == owner:
            return f"{given.name} is made of {owner.name} itself" if given != owner else f"{owner.name} cannot be made of itself"
        if its not in found:
            found.add(its)
            left += [one.object for one in its.maquette.inputs if one.object]
    return ""


def columns(owner: bpy.types.Object, start: str, kind: str, given: bpy.types.Object) -> dict[str, Any]:
    """Puts what an object has into files and describes them; `ValueError` says what it is not."""
    folder = engine.client().folder
    assert folder
    first = MAX_VERTICES * next((at for at, its in enumerate(owner.maquette.inputs) if its.object == given), 0)
    place = space.applied(owner.data).inverted_safe() @ evaluated.place(owner).inverted_safe()
    fields, source = from_object.fields(place, start, kind, given, folder, first)
    return {**fields, "source": source}


def lost(owner: bpy.types.Object, it: State, told: dict[str, Any]) -> str:
    """What of the objects at inputs was not given, and what of it is not in the value, in lines for people."""
    sources, lines = it.sources, []
    for its in owner.maquette.inputs:
        if its.object and its.name in sources and sources[its.name].lost:
            lines.append(f"{its.name}: {its.object.name} is given without {', '.join(sources[its.name].lost)}")
    gone = returned.lost(told, owner.data)
    return "\n".join([*lines, *([f"not in {owner.maquette.output}: {', '.join(gone)}"] if gone else [])])
