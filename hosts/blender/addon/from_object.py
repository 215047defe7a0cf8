"""Converts an object to columns for an input of a graph, and lists what columns cannot hold."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any, Iterator

import bpy

from . import apply, evaluated, looks, pictures
from .records import GROUP, KINDS, MAX_VERTICES, NUMBERS, Record, Source, levels, number

ENGINE_DOMAINS = {"POINT": "vertex", "CORNER": "corner", "FACE": "face"}

# Names that have a meaning in the engine.
RESERVED = {
    "POINT": {"position", "uv", "normal", "color", NUMBERS},
    "CORNER": {"corners", "edge of a corner", "uv", "normal", "color"},
    "FACE": {"corners", "sides", "material"},
}

# Attributes of Blender that are not passed as attributes: they are geometry, or passed in another way.
NOT_ATTRIBUTES = {"position", "material_index", "crease_edge", "custom_normal"}
SEAMS = {"uv_seam", ".uv_seam"}

# Larger integers are rounded in single precision.
MAX_WHOLE = 1 << 24

@dataclasses.dataclass
class Part:
    """A mesh as arrays."""

    places: Any
    ends: Any
    corners: Any
    sides: Any
    # By domain and name: kind and numbers, one row for each element.
    attributes: dict[tuple[str, str], tuple[str, Any]]
    normals: Any
    materials: list[Any]
    uv: str
    color: str

    def count(self, domain: str) -> int:
        """The number of elements of a domain."""
        return len({"POINT": self.places, "EDGE": self.ends, "CORNER": self.corners, "FACE": self.sides}[domain])


def fields(place: Any, start: str, kind: str, given: bpy.types.Object, folder: pathlib.Path, first: int) -> tuple[dict[str, Any], Source]:
    """Writes the data of an object into files and returns the fields of the request `input`. `ValueError` if it does not fit the type.

    `place` is the matrix from the world to the graph; `first` is the number of the first vertex.
    """
    import numpy as np

    part = _join(list(_parts(given, place)))
    source = Source()
    columns: list[dict[str, Any]] = []

    def add(name: str, on: str, meaning: str, width: int, type: str, numbers: Any) -> None:
        file = f"{start}{len(columns)}"
        np.ascontiguousarray(numbers, {"f32": "<f4", "f64": "<f8", "u32": "<u4", "u8": "u1"}[type]).tofile(folder / file)
        prefix = {"corner": "corner ", "face": "face "}.get(on, "") if meaning not in ("index", "position") else ""
        columns.append({"name": prefix + name, "on": on, "meaning": meaning, "width": width, "type": type, "file": file})

    if kind == "Curve":
        order, closed = _chain(part.ends.tolist(), len(part.places))
        add("point", "point", "position", 3, "f32", part.places[order])
        source.lost += [f"attribute {name} (a curve has positions only)" for _, name in part.attributes]
        return {"columns": columns, "facts": {"closed": closed}}, source
    if kind == "Points":
        add("position", "point", "position", 3, "f32", part.places)
        _add_attributes(part, source, lambda name, _on, *rest: add(name, "point", *rest), ["POINT"])
        return {"columns": columns, "facts": {}}, source
    add("position", "vertex", "position", 3, "f32", part.places)
    add("corners", "corner", "index", 1, "u32", part.corners)
    add("sides", "face", "index", 1, "u32", part.sides)
    _add_attributes(part, source, add, ["POINT", "CORNER", "FACE"])
    if part.normals is not None:
        add("normal", "corner", "direction", 3, "f32", part.normals)
    _add_edges(part, source, add, first)
    found: dict[str, Any] = {"columns": columns, "facts": {}}
    if any(part.materials):
        files = pictures.Files(folder, start)
        source.materials = [it.name for it in part.materials if it]
        found["materials"] = [looks.message(it, part.uv, files, source.lost) for it in part.materials]
    if any(part.materials) and len(part.materials) > 1:
        _, numbers = part.attributes.get(("FACE", "material_index"), ("INT", np.zeros((len(part.sides), 1), "i4")))
        add("material", "face", "exact", 1, "u32", numbers.clip(0, len(part.materials) - 1))
    return found, source


def _add_edges(part: Part, source: Source, add: Any, first: int) -> None:
    """Adds creases as a column of the engine. Other data of edges is kept in `source` and restored by the numbers of their vertices."""
    import numpy as np

    of_edges = {name: its for (domain, name), its in part.attributes.items() if domain == "EDGE"}
    kind, creases = of_edges.pop("crease_edge", ("FLOAT", np.zeros(0, "f4")))
    creases = creases.ravel()
    at = np.flatnonzero(creases > 0) if kind == "FLOAT" else []
    if len(at):
        add("creases", "edge", "number", 3, "f64", np.column_stack([part.ends[at], apply.MAX_CREASE * creases[at].astype("f8") ** 2]))
    source.edges = {name: its for name, its in of_edges.items() if _has_values(*its)}
    if source.edges and len(part.places) < MAX_VERTICES:
        add(NUMBERS, "vertex", "exact", 1, "u32", first + np.arange(len(part.places)))
        source.ends = part.ends.astype("i8") + first
    step = np.concatenate([part.corners, part.corners[:0]])
    starts = np.cumsum(part.sides) - part.sides
    following = np.arange(len(step)) + 1
    following[starts + part.sides - 1] = starts
    used = np.sort(np.column_stack([step, step[following]]), axis=1).astype("i8")
    known = used[:, 0] * len(part.places) + used[:, 1]
    ends = np.sort(part.ends, axis=1).astype("i8")
    loose = int((~np.isin(ends[:, 0] * len(part.places) + ends[:, 1], known)).sum())
    if loose:
        source.lost.append(f"{loose} edge{'s' if loose > 1 else ''} without a face")


def _has_values(kind: str, numbers: Any) -> bool:
    """Returns true if an attribute has a value other than zero or empty."""
    return any(numbers.ravel()) if kind == "STRING" else bool(numbers.any())


def _add_attributes(part: Part, source: Source, add: Any, domains: list[str]) -> None:
    import numpy as np

    taken = {domain: set(names) for domain, names in RESERVED.items()}
    for (domain, name), (kind, numbers) in part.attributes.items():
        if domain not in domains or name in NOT_ATTRIBUTES or name == "sharp_face" and not numbers.any():
            continue
        if name == part.uv and domain == "CORNER" and kind == "FLOAT2":
            if not np.isfinite(numbers).all():
                source.lost.append(f"UV map {name} (a coordinate is not finite)")
                continue
            own = "uv"
        elif name == part.color and domain != "FACE" and kind == "BYTE_COLOR":
            own = "color"
        else:
            own = name.removesuffix(GROUP) if kind == "GROUP" else name
            while own in taken[domain]:
                own += ".own"
        pieces = []
        for suffix, *column in _pieces(kind, numbers):
            add(own + suffix, ENGINE_DOMAINS[domain], *column)
            pieces.append(own + suffix)
        taken[domain] |= set(pieces)
        source.records.append(Record(name.removesuffix(GROUP) if kind == "GROUP" else name, kind, ENGINE_DOMAINS[domain], pieces))
        if name == part.color and domain != "FACE" and kind == "FLOAT_COLOR":
            # The engine uses the attribute `color` as the color.
            add("color", ENGINE_DOMAINS[domain], "level", 3, "u8", levels(numbers))
        if kind in ("INT", "INT32_2D") and numbers.min(initial=0) < 0 and np.abs(numbers.astype("i8")).max() > MAX_WHOLE:
            source.lost.append(f"digits of attribute {name} (it has negative numbers, and numbers beyond {MAX_WHOLE})")


def _pieces(kind: str, numbers: Any) -> Iterator[tuple[Any, ...]]:
    """The columns of an attribute: suffix of the name, meaning, width, type and numbers of each."""
    import numpy as np

    if kind == "BOOLEAN":
        yield "", "exact", 1, "u8", numbers
    elif kind in ("INT", "INT8"):
        yield ("", "exact", 1, "u32", numbers) if numbers.min(initial=0) >= 0 else ("", "number", 1, "f64", numbers)
    elif kind == "STRING":
        yield "", "exact", 1, "u32", [number(it) for it in numbers.ravel()]
    elif kind == "BYTE_COLOR":
        yield "", "level", 3, "u8", np.rint(numbers[:, :3] * 255)
        if (numbers[:, 3] != 1).any():
            yield ".alpha", "number", 1, "f32", numbers[:, 3]
    elif kind == "FLOAT_COLOR":
        yield "", "number", 3, "f32", numbers[:, :3]
        if (numbers[:, 3] != 1).any():
            yield ".alpha", "number", 1, "f32", numbers[:, 3]
    else:
        for at in range(0, numbers.shape[1], 3):
            piece = numbers[:, at : at + 3]
            yield f".{at // 3}" if at else "", "number", piece.shape[1], "f64", piece


def _parts(given: bpy.types.Object, place: Any) -> Iterator[Part]:
    """The meshes of an object with its modifiers, and of its instances."""
    with evaluated.graph(given) as depsgraph:
        its = given.evaluated_get(depsgraph)
        found = _part(its, place @ its.matrix_world)
        if found:
            yield found
        has_instances = given.instance_type != "NONE" or any(it.type in ("NODES", "PARTICLE_SYSTEM") for it in given.modifiers)
        for one in evaluated.instances(given, depsgraph) if has_instances else ():
            instance = _part(one.object, place @ one.matrix_world)
            if instance:
                yield instance


def _part(its: bpy.types.Object, place: Any) -> Part | None:
    """The mesh of an evaluated object, transformed by a matrix; None if it has no mesh."""
    import numpy as np

    try:
        mesh = its.to_mesh()
    except RuntimeError:
        # Lights and cameras have no mesh.
        mesh = None
    if mesh is None:
        return None
    try:
        turn, move = np.array(place.to_3x3()), np.array(place.translation)
        places = _numbers(mesh.vertices, "co", "f4", 3) @ turn.T + move
        corners = _numbers(mesh.loops, "vertex_index", "i4").ravel()
        sides = _numbers(mesh.polygons, "loop_total", "i4").ravel()
        attributes = {(domain, name): values for domain, name, values in _attributes(mesh, its)}
        normals = None
        if mesh.has_custom_normals:
            normals = _numbers(mesh.corner_normals, "vector", "f4", 3) @ np.linalg.pinv(turn)
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        if place.determinant() < 0:
            # A mirrored mesh keeps its outside: reverse the order of the corners of each face after the first one.
            starts = np.repeat(np.cumsum(sides) - sides, sides)
            order = starts + (np.repeat(sides, sides) - (np.arange(len(corners)) - starts)) % np.repeat(sides, sides)
            corners, normals = corners[order], None if normals is None else normals[order]
            for key, (kind, numbers) in attributes.items():
                if key[0] == "CORNER":
                    attributes[key] = (kind, numbers[order])
        uv = next((it.name for it in mesh.uv_layers if it.active_render), "")
        colors = mesh.color_attributes
        color = colors[colors.render_color_index].name if 0 <= colors.render_color_index < len(colors) else ""
        # The original materials, since evaluated ones are freed with the next change.
        materials = [it.material.original if it.material else None for it in its.material_slots]
        return Part(places, _numbers(mesh.edges, "vertices", "i4", 2), corners, sides, attributes, normals, materials, uv, color)
    finally:
        its.to_mesh_clear()


def _attributes(mesh: bpy.types.Mesh, owner: bpy.types.Object) -> Iterator[tuple[str, str, tuple[str, Any]]]:
    """Yields domain, name, kind and numbers of attributes, vertex groups and seams."""
    import numpy as np

    for it in mesh.attributes:
        # Anonymous attributes of Geometry Nodes begin with `.a_`.
        is_hidden = it.is_internal or it.name.startswith(".a_")
        if it.name == "position" or it.data_type not in KINDS or is_hidden and it.name not in SEAMS:
            continue
        slot, type, width = KINDS[it.data_type]
        if it.data_type == "STRING":
            numbers = np.array([_bytes(one.value) for one in it.data], object).reshape(-1, 1)
        else:
            numbers = _numbers(it.data, slot, type, width)
        yield it.domain, it.name, (it.data_type, numbers)
    groups = owner.vertex_groups
    if len(groups) and len(mesh.vertices):
        weights = np.zeros((len(groups), len(mesh.vertices)), "f4")
        for vertex in mesh.vertices:
            for one in vertex.groups:
                if one.group < len(groups):
                    weights[one.group, vertex.index] = one.weight
        for group, numbers in zip(groups, weights):
            yield "POINT", group.name + GROUP, ("GROUP", numbers.reshape(-1, 1))


def _bytes(value: Any) -> bytes:
    return value.encode() if isinstance(value, str) else bytes(value)


def _numbers(elements: Any, name: str, type: str, width: int = 1) -> Any:
    import numpy as np

    numbers = np.empty(width * len(elements), type)
    elements.foreach_get(name, numbers)
    return numbers.reshape(-1, width)


def _join(parts: list[Part]) -> Part:
    """Joins several meshes. Missing attributes are zero."""
    import numpy as np

    if not parts:
        raise ValueError("has no mesh")
    if len(parts) == 1:
        return parts[0]
    whole = parts[0]
    slots = list(dict.fromkeys(it for part in parts for it in part.materials or [None]))
    for part in parts:
        own = np.array([slots.index(it) for it in part.materials or [None]])
        _, numbers = part.attributes.get(("FACE", "material_index"), ("INT", np.zeros((len(part.sides), 1), "i4")))
        part.attributes["FACE", "material_index"] = ("INT", own[numbers.clip(0, len(own) - 1)])
    attributes = {}
    for key, (kind, numbers) in {key: its for part in reversed(parts) for key, its in part.attributes.items()}.items():
        empty = np.zeros((0, numbers.shape[1]), numbers.dtype)
        pieces = []
        for part in parts:
            known, piece = part.attributes.get(key, (kind, empty))
            missing = np.full((part.count(key[0]), numbers.shape[1]), b"" if kind == "STRING" else 0, numbers.dtype)
            pieces.append(piece if known == kind and len(piece) else missing)
        attributes[key] = (kind, np.concatenate(pieces))
    firsts = np.cumsum([0, *(len(part.places) for part in parts[:-1])])
    normals = None
    if all(part.normals is not None for part in parts):
        normals = np.concatenate([part.normals for part in parts])
    return Part(
        np.concatenate([part.places for part in parts]),
        np.concatenate([part.ends + first for part, first in zip(parts, firsts)]).astype("i4"),
        np.concatenate([part.corners + first for part, first in zip(parts, firsts)]).astype("i4"),
        np.concatenate([part.sides for part in parts]),
        attributes,
        normals,
        slots,
        next((part.uv for part in parts if part.uv), whole.uv),
        next((part.color for part in parts if part.color), whole.color),
    )


def _chain(edges: list[tuple[int, int]], count: int) -> tuple[list[int], bool]:
    """The vertices in the order of a chain of edges, and true if the chain is closed."""
    beside: list[list[int]] = [[] for _ in range(count)]
    for one, other in edges:
        beside[one].append(other)
        beside[other].append(one)
    tips = [vertex for vertex in range(count) if len(beside[vertex]) == 1]
    order: list[int] = []
    if edges and len(tips) in (0, 2) and all(len(its) in (1, 2) for its in beside):
        before, vertex = -1, (tips or [0])[0]
        while vertex != -1 and (not order or vertex != order[0]):
            order.append(vertex)
            before, vertex = vertex, next((it for it in beside[vertex] if it != before), -1)
    if not order or len(order) != count:
        raise ValueError("is not a single chain of edges, which a curve must be")
    return order, not tips
