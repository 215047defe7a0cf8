"""Writes values of the engine into meshes of Blender: columns of numbers go from mapped files into attributes, without a copy in Python."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy

from . import returned, space
from .returned import DOMAINS

# Custom properties of a mesh with the files of the columns that it was made of. The files are named by their content.
FACES = "maquette_faces"
FILES = "maquette_files"
NORMALS = "maquette_normals"

# The key of the positions in FILES.
POSITIONS = "vertex position"

# Custom properties of a mesh with its material, and with the file of the material's texture; empty if there is none.
MATERIAL = "maquette_material"
TEXTURE = "maquette_texture"

# The name of the shader node with the texture of a material.
TEXTURE_NODE = "Texture"

# Columns that are written as geometry of the mesh, not as attributes.
MESH_COLUMNS = {
    ("vertex", "position"),
    ("corner", "corners"),
    ("face", "sides"),
    ("edge", "edges"),
    ("corner", "edge of a corner"),
    ("corner", "uv"),
    ("edge", "creases"),
}

# Names of attributes that Blender reserves, and the maximum length of other names in bytes, with room for a suffix.
RESERVED_NAMES = ("position", "UVMap", "crease_edge", "id", "material_index", "sharp_edge", "sharp_face")
MAX_NAME = 48

# Creases in Blender are from 0 to 1, where 1 is always sharp. The engine counts the subdivisions that stay sharp, and 10 is always sharp.
MAX_CREASE = 10


class Columns:
    """The columns of a value, mapped from the files of the engine's folder."""

    def __init__(self, entry: dict[str, Any], folder: pathlib.Path) -> None:
        self.entry = entry
        self.folder = folder
        self.own = {it["name"]: it for it in reversed(entry["columns"]) if (it["on"], it["name"]) in MESH_COLUMNS}

    def numbers(self, column: dict[str, Any], kind: str | None = None) -> Any:
        """The numbers of a column as a flat array; `kind` is another type of the same size."""
        import numpy as np

        if not column["count"]:
            return np.empty(0, kind or "f4")
        kinds = {"f32": "<f4", "f64": "<f8", "u32": "<u4", "u8": "u1"}
        return np.memmap(self.folder / column["file"], dtype=kind or kinds[column["type"]], mode="r")

    def rows(self, column: dict[str, Any]) -> Any:
        """The numbers of a column, one row for each element."""
        return self.numbers(column).reshape(-1, column["width"])

    def numbers_of(self, name: str, kind: str | None = None) -> Any:
        """The numbers of the column `name`, or None if there is no such column."""
        column = self.own.get(name)
        return None if column is None else self.numbers(column, kind)

    def sides(self) -> Any:
        """The number of corners of each face."""
        import numpy as np

        sides = self.entry["sides"]
        if sides is None:
            return self.numbers_of("sides", "<i4") if "sides" in self.own else np.empty(0, "i4")
        return np.full(self.count("corners") // sides, sides, "i4")

    def count(self, name: str) -> int:
        """The number of elements of a column, 0 if there is no such column."""
        return int(self.own[name]["count"]) if name in self.own else 0

    def faces(self) -> str:
        """A key of the topology: the files of the columns with vertex indices."""
        names = ["corners", "sides", "edges"]
        return " ".join(f"{it}={self.own[it]['file']}" for it in names if it in self.own) + f" {self.entry.get('sides')}"


def apply(mesh: bpy.types.Mesh, entry: dict[str, Any], folder: pathlib.Path) -> None:
    """Updates the mesh to a value; writes only what differs."""
    columns = Columns(entry, folder)
    faces = _faces(columns)
    if will_differ(mesh, columns):
        mesh.clear_geometry()
        _topology(mesh, columns)
        mesh[FACES], mesh[FILES], mesh[NORMALS] = faces, {}, ""
    known = dict(mesh[FILES])
    mesh[FILES] = _attributes(mesh, columns, known)
    returned.set_edges(mesh, columns, columns.entry.get("sources", []))
    # The edges are written already, so Blender need not calculate them.
    mesh.update()
    _normals(mesh, columns)


def _faces(columns: Columns) -> str:
    return f"{columns.count('position')} {columns.faces()}"


def will_differ(mesh: bpy.types.Mesh, columns: Columns) -> bool:
    """Returns true if the topology of the value differs from that of the mesh."""
    return mesh.get(FACES) != _faces(columns) or not _is_unchanged(mesh, columns)


def _is_unchanged(mesh: bpy.types.Mesh, columns: Columns) -> bool:
    """Returns true if the topology of the mesh is still that of the columns: users may have edited it."""
    import numpy as np

    def is_same(elements: Any, name: str, attribute: str) -> bool:
        wanted = columns.numbers_of(name, "<i4")
        if wanted is None or not len(elements):
            return not len(elements) and not columns.count(name)
        found = mesh.attributes[attribute].data
        numbers = np.empty(len(wanted), np.int32)
        if numbers.size != len(found) * columns.own[name]["width"]:
            return False
        found.foreach_get("value", numbers)
        return bool((numbers == wanted).all())

    is_counted = len(mesh.vertices) == columns.count("position")
    return is_counted and is_same(mesh.loops, "corners", ".corner_vert") and is_same(mesh.edges, "edges", ".edge_verts")


def _topology(mesh: bpy.types.Mesh, columns: Columns) -> None:
    import numpy as np

    mesh.vertices.add(columns.count("position"))
    ends = columns.numbers_of("edges", "<i4")
    if ends is not None and len(ends):
        mesh.edges.add(len(ends) // 2)
        mesh.attributes[".edge_verts"].data.foreach_set("value", ends)
    corners = columns.numbers_of("corners", "<i4")
    if corners is None or not len(corners):
        return
    mesh.loops.add(len(corners))
    mesh.attributes[".corner_vert"].data.foreach_set("value", corners)
    mesh.attributes[".corner_edge"].data.foreach_set("value", columns.numbers_of("edge of a corner", "<i4"))
    sides = columns.entry["sides"]
    if sides is None:
        starts = np.cumsum(columns.numbers_of("sides"), dtype=np.int32)
        starts = np.concatenate([np.zeros(1, np.int32), starts[:-1]])
    else:
        starts = np.arange(0, len(corners), sides, dtype=np.int32)
    mesh.polygons.add(len(starts))
    mesh.polygons.foreach_set("loop_start", starts)


def _attributes(mesh: bpy.types.Mesh, columns: Columns, known: dict[str, str]) -> dict[str, str]:
    """Writes the positions, and the columns whose files differ from `known`; returns the files of all columns."""
    import numpy as np

    files = {}
    if len(mesh.vertices):
        mesh.attributes["position"].data.foreach_set("vector", space.transform_positions(mesh, columns.numbers_of("position")))
        files[POSITIONS] = columns.own["position"]["file"]
    sources = columns.entry.get("sources", [])
    uv = columns.own.get("uv")
    if uv and uv["on"] == "corner":
        name = returned.uv_name(sources)
        files[f"corner {name}"] = uv["file"]
        layer = mesh.uv_layers.get(name)
        if layer is None or known.get(f"corner {name}") != uv["file"]:
            layer = layer or mesh.uv_layers.new(name=name, do_init=False)
            layer.uv.foreach_set("vector", columns.numbers(uv))
    typed, used = returned.restore(columns, sources)
    elements = {"vertex": mesh.vertices, "edge": mesh.edges, "face": mesh.polygons, "corner": mesh.loops}
    for it in typed:
        its = it.record
        if its.kind == "GROUP" or len(it.numbers) != len(elements[its.on]):
            continue
        key = f"{its.on} {its.name}"
        files[key] = it.file
        if known.get(key) != it.file or its.name not in mesh.attributes:
            attribute = attribute_of(mesh, its.name, its.kind, DOMAINS[its.on])
            if attribute:
                returned.write(attribute, its.kind, it.numbers)
    material = next((it for it in columns.entry["columns"] if (it["on"], it["name"]) == ("face", "material")), None)
    count = len(columns.entry.get("materials", ()))
    if material and count:
        used.add(("face", "material"))
        files["face material_index"] = material["file"]
        if known.get("face material_index") != material["file"]:
            numbers = columns.numbers(material, "<i4")
            mesh.polygons.foreach_set("material_index", np.where((0 <= numbers) & (numbers < count), numbers, 0).astype("i4"))
    for name, column in _unique_names(columns, used).items():
        # Attributes may exist on some of the elements only.
        if not column["count"] or column["count"] != len(elements[column["on"]]):
            continue
        key = f"{column['on']} {name}"
        files[key] = column["file"]
        if known.get(key) != column["file"] or name not in mesh.attributes:
            _attribute(mesh, columns, column, name)
    creases = columns.own.get("creases")
    if creases:
        files["edge crease_edge"] = creases["file"]
        if known.get("edge crease_edge") != creases["file"]:
            _creases(mesh, columns)
    for key in known.keys() - files.keys():
        on, _, name = key.partition(" ")
        attribute = mesh.attributes.get(name)
        # An attribute of the same name may be on another domain now.
        if attribute and attribute.domain == DOMAINS.get(on) and not attribute.is_required:
            mesh.attributes.remove(attribute)
    return files


def _normals(mesh: bpy.types.Mesh, columns: Columns) -> None:
    """Writes the normals of corners. Blender stores them relative to calculated normals, so they depend on the positions, too."""
    column = returned.normal_column(columns)
    now = f"{column['file']} {columns.own['position']['file']} {list(mesh.get(space.APPLIED) or ())}" if column else ""
    if now != mesh.get(NORMALS, ""):
        returned.set_normals(mesh, columns)
        mesh[NORMALS] = now


def _unique_names(columns: Columns, used: set[tuple[str, str]]) -> dict[str, dict[str, Any]]:
    """The attributes by unique names, as Blender needs them. Vertex attributes come first and keep their names; others may get a suffix."""
    found: dict[str, dict[str, Any]] = {}
    for column in columns.entry["columns"]:
        on, name = column["on"], column["name"]
        if (on, name) in MESH_COLUMNS or on not in DOMAINS or (on, name) in used:
            continue
        name = name.encode()[:MAX_NAME].decode(errors="ignore")
        while name in found or name in RESERVED_NAMES:
            name = f"{name}.{on}"
        found[name] = column
    return found


def _creases(mesh: bpy.types.Mesh, columns: Columns) -> None:
    """Writes creases. The column has rows of two vertices and the sharpness of their edge, sorted by the vertices."""
    import numpy as np

    def number(ends: Any) -> Any:
        low, high = np.sort(ends.astype(np.int64), axis=1).T
        return low * len(mesh.vertices) + high

    creases = columns.numbers_of("creases").reshape(-1, 3)
    known, edges = number(creases[:, :2]), number(columns.numbers_of("edges", "<i4").reshape(-1, 2))
    place = np.minimum(np.searchsorted(known, edges), len(known) - 1)
    sharpness = np.where(known[place] == edges, creases[place, 2], 0)
    attribute = mesh.attributes.get("crease_edge") or mesh.attributes.new("crease_edge", "FLOAT", "EDGE")
    attribute.data.foreach_set("value", np.sqrt(np.minimum(sharpness / MAX_CREASE, 1)).astype(np.float32))


def _attribute(mesh: bpy.types.Mesh, columns: Columns, column: dict[str, Any], name: str) -> None:
    import numpy as np

    width, domain = column["width"], DOMAINS[column["on"]]
    numbers = columns.numbers(column)
    if column["type"] == "u8" and width == 3:
        kind, slot = "BYTE_COLOR", "color_srgb"
        numbers = np.insert(numbers.reshape(-1, 3) / np.float32(255), 3, 1, axis=1).ravel()
    elif column["type"] in ("u8", "u32"):
        if width != 1:
            return
        # Integers are signed in Blender.
        kind, slot, numbers = "INT", "value", numbers.astype(np.int32)
    else:
        kinds = {1: ("FLOAT", "value"), 2: ("FLOAT2", "vector"), 3: ("FLOAT_VECTOR", "vector"), 4: ("FLOAT_COLOR", "color")}
        if width not in kinds:
            return
        kind, slot = kinds[width]
    attribute = attribute_of(mesh, name, kind, domain)
    if attribute:
        attribute.data.foreach_set(slot, np.ascontiguousarray(numbers))


def attribute_of(mesh: bpy.types.Mesh, name: str, kind: str, domain: str) -> bpy.types.Attribute | None:
    """Finds or creates an attribute of a type on a domain; None if the mesh requires another attribute of this name."""
    attribute = mesh.attributes.get(name)
    if attribute and (attribute.data_type, attribute.domain) != (kind, domain):
        if attribute.is_required:
            return None
        mesh.attributes.remove(attribute)
        attribute = None
    return attribute or mesh.attributes.new(name, kind, domain)


def texture(mesh: bpy.types.Mesh, entry: dict[str, Any], folder: pathlib.Path) -> None:
    """Gives a mesh a material with its texture. Changes of the material by the user are kept, also while the value has no texture."""
    picture = entry.get("texture")
    was, mesh[TEXTURE] = mesh.get(TEXTURE, ""), picture["file"] if picture else ""
    known = mesh.get(MATERIAL)
    if not picture:
        for slot in reversed(range(len(mesh.materials))):
            if was and known and mesh.materials[slot] == known:
                mesh.materials.pop(index=slot)
        return
    shows = image(f"{mesh.name} texture", picture, folder)
    if known is None:
        known = mesh[MATERIAL] = material(mesh.name)
    if not was:
        mesh.materials.append(known)
    shown = known.node_tree.nodes.get(TEXTURE_NODE)
    if not shown or shown.image == shows:
        return
    if shown.image and any(it != mesh and known in it.materials[:] for it in bpy.data.meshes):
        # Copies of the mesh use the same material and must keep the old texture.
        slots = [slot for slot, it in enumerate(mesh.materials) if it == known]
        known = mesh[MATERIAL] = known.copy()
        shown = known.node_tree.nodes[TEXTURE_NODE]
        for slot in slots:
            mesh.materials[slot] = known
    old, shown.image = shown.image, shows
    if old and old.get("maquette_file") and not old.users:
        bpy.data.images.remove(old)


def image(name: str, picture: dict[str, Any], folder: pathlib.Path) -> bpy.types.Image:
    """Loads a picture file of the engine and packs it into the Blender file."""
    found = next((it for it in bpy.data.images if it.get("maquette_file") == picture["file"]), None)
    if found is None:
        found = bpy.data.images.load(str(folder / picture["file"]))
        found.name = name
        found.pack()
        found["maquette_file"] = picture["file"]
    return found


def material(name: str) -> bpy.types.Material:
    """Creates a material with a texture node."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = next(it for it in nodes if it.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = 0.8
    shown = nodes.new("ShaderNodeTexImage")
    shown.name = TEXTURE_NODE
    shown.location = (shader.location.x - 320, shader.location.y)
    links.new(shown.outputs["Color"], shader.inputs["Base Color"])
    return made
