"""Restores data of input objects in the result of a graph: attributes of all types, vertex groups, data of edges, and normals."""

from __future__ import annotations

import dataclasses
from typing import Any

import bpy

from . import space
from .records import KINDS, NUMBERS, Record, Source, levels, texts

DOMAINS = {"vertex": "POINT", "edge": "EDGE", "face": "FACE", "corner": "CORNER"}

# Custom properties of a mesh with the restored vertex groups and the restored attributes of edges.
GROUPS = "maquette_groups"
EDGES = "maquette_edges"


# In Blender before 5.0, setting normals of more corners takes seconds; they are only an attribute there.
MAX_SLOW = 50_000


@dataclasses.dataclass
class RestoredAttribute:
    """An attribute with the type that it had in the input object."""

    record: Record
    numbers: Any
    # The files of its numbers.
    file: str


def restore(columns: Any, sources: list[Source]) -> tuple[list[RestoredAttribute], set[tuple[str, str]]]:
    """Returns the restored attributes, and the columns that they are made of."""
    its = {(column["on"], column["name"]): column for column in columns.entry["columns"]}
    found: dict[tuple[str, str], RestoredAttribute] = {}
    used = {("vertex", NUMBERS)} | ({("corner", "normal")} if normal_column(columns) else set())
    for record in (record for source in sources for record in source.records):
        pieces = [its.get((record.on, name)) for name in record.pieces]
        key = (record.on, record.name)
        if record.pieces == ["uv"] or key in found or not all(pieces):
            continue
        numbers = _numbers(record, [columns.rows(it) for it in pieces])
        if numbers is None:
            # The graph has changed the attribute in a way that its type does not allow.
            continue
        found[key] = RestoredAttribute(record, numbers, " ".join(it["file"] for it in pieces))
        used |= {(record.on, name) for name in record.pieces}
        color = its.get((record.on, "color"))
        if record.kind == "FLOAT_COLOR" and color and (abs(columns.rows(color).astype("i4") - levels(numbers)) <= 1).all():
            # The column `color` was derived from this attribute.
            used.add((record.on, "color"))
    return list(found.values()), used


def _numbers(record: Record, pieces: list[Any]) -> Any:
    """The numbers of an attribute, one row for each element; None if they no longer fit its type."""
    import numpy as np

    kind, first = record.kind, pieces[0]
    if kind == "STRING":
        known = texts()
        is_known = first.dtype.kind in "ui" and (first < len(known)).all()
        return np.array([known[it] for it in first.ravel()], object).reshape(-1, 1) if is_known else None
    if kind == "GROUP":
        return first.astype("f4") if first.shape[1] == 1 else None
    if kind == "BYTE_COLOR":
        if first.dtype != np.uint8 or first.shape[1] != 3:
            return None
        alpha = pieces[1] if len(pieces) > 1 else np.ones((len(first), 1), "f4")
        return np.hstack([first / np.float32(255), alpha]).astype("f4")
    _, type, width = KINDS[kind]
    numbers = np.hstack(pieces)
    if kind == "FLOAT_COLOR" and numbers.shape[1] == 3:
        numbers = np.hstack([numbers, np.ones((len(numbers), 1), "f4")])
    if numbers.shape[1] != width:
        return None
    if type != "f4":
        low, high = {"BOOLEAN": (0, 1), "INT8": (-128, 127), "INT16_2D": (-(2**15), 2**15 - 1)}.get(kind, (-(2**31), 2**32 - 1))
        if not ((numbers >= low) & (numbers <= high) & (numbers == np.rint(numbers))).all():
            return None
    return numbers.astype(type)


def write(attribute: bpy.types.Attribute, kind: str, numbers: Any) -> None:
    """Writes numbers into an attribute."""
    import numpy as np

    slot = KINDS[kind][0]
    if kind == "STRING":
        for element, text in zip(attribute.data, numbers.ravel()):
            element.value = text
    else:
        attribute.data.foreach_set(slot, np.ascontiguousarray(numbers).ravel())


def set_groups(owner: bpy.types.Object, columns: Any, sources: list[Source]) -> None:
    """Updates the restored vertex groups of an object."""
    its = restore(columns, sources)[0] if any(it.kind == "GROUP" for source in sources for it in source.records) else []
    known = dict(owner.data.get(GROUPS) or {})
    found = {it.record.name: it for it in its if it.record.kind == "GROUP"}
    for name, it in found.items():
        group = owner.vertex_groups.get(name)
        if group and known.get(name) == it.file:
            continue
        set_weights(owner, name, it.numbers.ravel())
    for name in known.keys() - found.keys():
        if name in owner.vertex_groups:
            owner.vertex_groups.remove(owner.vertex_groups[name])
    if found or known:
        owner.data[GROUPS] = {name: it.file for name, it in found.items()}


def set_weights(owner: bpy.types.Object, name: str, weights: Any) -> None:
    """Sets the weights of all vertices in a group; vertices with weight 0 are removed from it."""
    import numpy as np

    group = owner.vertex_groups.get(name) or owner.vertex_groups.new(name=name)
    group.remove(list(range(len(weights))))
    order = np.argsort(weights, kind="stable")
    values, starts = np.unique(weights[order], return_index=True)
    for value, members in zip(values.tolist(), np.split(order, starts[1:])):
        if value > 0:
            group.add(members.tolist(), value, "REPLACE")


def set_edges(mesh: bpy.types.Mesh, columns: Any, sources: list[Source]) -> None:
    """Restores attributes of edges on the edges between the same vertices."""
    import numpy as np

    column = next((it for it in columns.entry["columns"] if (it["on"], it["name"]) == ("vertex", NUMBERS)), None)
    known = set(mesh.get(EDGES) or ())
    found: dict[str, tuple[str, Any]] = {}
    if column and any(source.edges for source in sources) and len(mesh.edges):
        numbers = columns.numbers(column).astype("i8")
        _, which, counts = np.unique(numbers, return_inverse=True, return_counts=True)
        # The number of a vertex that was split into several is ambiguous.
        numbers = np.where(counts[which] == 1, numbers, -1)
        ends = np.sort(numbers[columns.numbers_of("edges", "<i4").reshape(-1, 2)], axis=1)
        wanted = ends[:, 0] * 2**32 + ends[:, 1]
        for source in sources:
            if not source.edges:
                continue
            own = np.sort(source.ends, axis=1)
            own = own[:, 0] * 2**32 + own[:, 1]
            order = np.argsort(own)
            place = order[np.minimum(np.searchsorted(own[order], wanted), len(own) - 1)]
            is_known = (own[place] == wanted) & (ends[:, 0] >= 0)
            for name, (kind, values) in source.edges.items():
                empty = np.full((len(wanted), values.shape[1]), b"" if kind == "STRING" else 0, values.dtype)
                had, whole = found.get(name, (kind, empty))
                if had == kind:
                    whole[is_known] = values[place[is_known]]
                    found[name] = (kind, whole)
    for name in known - found.keys():
        attribute = mesh.attributes.get(name)
        if attribute and attribute.domain == "EDGE":
            mesh.attributes.remove(attribute)
    for name, (kind, whole) in found.items():
        if name.endswith("uv_seam"):
            mesh.edges.foreach_set("use_seam", whole.ravel().astype("?"))
        else:
            attribute = mesh.attributes.get(name)
            if attribute is None or attribute.domain != "EDGE" or attribute.data_type != kind:
                attribute = mesh.attributes.new(name, kind, "EDGE")
            write(attribute, kind, whole)
    if found or known:
        mesh[EDGES] = list(found)


def normal_column(columns: Any) -> dict[str, Any] | None:
    """The column of corner normals, if setting them is fast enough; else None."""
    column = next((it for it in columns.entry["columns"] if (it["on"], it["name"]) == ("corner", "normal")), None)
    is_quick = column and (bpy.app.version >= (5, 0) or column["count"] < MAX_SLOW)
    return column if is_quick and column["count"] else None


def set_normals(mesh: bpy.types.Mesh, columns: Any) -> None:
    """Sets the corner normals of a value, or removes them if it has none."""
    import numpy as np

    column, attribute = normal_column(columns), mesh.attributes.get("custom_normal")
    if bpy.app.version < (5, 0):
        numbers = space.transform_normals(mesh, columns.rows(column)) if column else np.zeros((len(mesh.loops), 3), "f4")
        # `normals_split_custom_set` marks edges as sharp; restore the existing marks.
        sharp = np.empty(len(mesh.edges), "?")
        mesh.edges.foreach_get("use_edge_sharp", sharp)
        mesh.normals_split_custom_set(numbers.tolist())
        mesh.edges.foreach_set("use_edge_sharp", sharp)
        return
    if attribute and not (column and (attribute.domain, attribute.data_type) == ("CORNER", "FLOAT_VECTOR")):
        mesh.attributes.remove(attribute)
        attribute = None
    if column:
        attribute = attribute or mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", np.ascontiguousarray(space.transform_normals(mesh, columns.rows(column))).ravel())


def find_lost(entry: dict[str, Any], mesh: bpy.types.Mesh) -> list[str]:
    """The names of data of input objects that the value lacks."""
    have = {(column["on"], column["name"]) for column in entry["columns"]}
    edges = set(mesh.get(EDGES) or ())
    found: list[str] = []
    for source in entry.get("sources", ()):
        found += [record.name for record in source.records if any((record.on, piece) not in have for piece in record.pieces)]
        found += [_words(name) for name in source.edges if name not in edges or not has_edge_values(mesh, name)]
    return list(dict.fromkeys(found))


def has_edge_values(mesh: bpy.types.Mesh, name: str) -> bool:
    """Returns true if an attribute has a value other than zero or empty."""
    attribute = mesh.attributes.get(name)
    if attribute is None:
        return False
    if attribute.data_type == "STRING":
        return any(it.value for it in attribute.data)
    import numpy as np

    slot, type, width = KINDS[attribute.data_type]
    numbers = np.empty(width * len(attribute.data), type)
    attribute.data.foreach_get(slot, numbers)
    return bool(numbers.any())


def _words(name: str) -> str:
    return {"sharp_edge": "sharp edges", "uv_seam": "seams", ".uv_seam": "seams"}.get(name, name)


def uv_name(sources: list[Source]) -> str:
    """The name of the UV map for texture coordinates."""
    return next((record.name for source in sources for record in source.records if record.pieces == ["uv"]), "UVMap")
