"""Values of the engine as meshes of Blender: columns of numbers go from files into attributes without a copy in Python."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy

# What a mesh remembers of the columns that it was made of: their files are named by what is in them.
FACES = "maquette_faces"
FILES = "maquette_files"

# Columns that are the mesh itself.
OWN = {"position", "corners", "sides", "edges", "edge of a corner", "uv"}

DOMAINS = {"vertex": "POINT", "edge": "EDGE", "face": "FACE", "corner": "CORNER"}


class Columns:
    """The columns of a value, mapped from the files of the engine's folder."""

    def __init__(self, told: dict[str, Any], folder: pathlib.Path) -> None:
        self.told = told
        self.folder = folder
        self.by_name = {it["name"]: it for it in reversed(told["columns"])}

    def numbers(self, column: dict[str, Any], kind: str | None = None) -> Any:
        """The numbers one after the other; `kind` is another type of the same size."""
        import numpy as np

        if not column["count"]:
            return np.empty(0, kind or "f4")
        kinds = {"f32": "<f4", "f64": "<f8", "u32": "<u4", "u8": "u1"}
        return np.memmap(self.folder / column["file"], dtype=kind or kinds[column["type"]], mode="r")

    def named(self, name: str, kind: str | None = None) -> Any:
        """The numbers of a column; None if there is no such column."""
        column = self.by_name.get(name)
        return None if column is None else self.numbers(column, kind)

    def count(self, name: str) -> int:
        """How many elements a column has."""
        return int(self.by_name[name]["count"]) if name in self.by_name else 0

    def faces(self) -> str:
        """The files that say which vertices belong together."""
        names = ["corners", "sides", "edges"]
        return " ".join(f"{it}={self.by_name[it]['file']}" for it in names if it in self.by_name) + f" {self.told.get('sides')}"


def apply(mesh: bpy.types.Mesh, told: dict[str, Any], folder: pathlib.Path) -> None:
    """Makes the mesh what a value is; only what differs is written."""
    columns = Columns(told, folder)
    faces = f"{columns.count('position')} {columns.faces()}"
    if mesh.get(FACES) != faces or len(mesh.vertices) != columns.count("position"):
        mesh.clear_geometry()
        _topology(mesh, columns)
        mesh[FACES], mesh[FILES] = faces, {}
    known = dict(mesh[FILES])
    mesh[FILES] = _attributes(mesh, columns, known)
    # Edges are given, so that none has to be found.
    mesh.update()


def _topology(mesh: bpy.types.Mesh, columns: Columns) -> None:
    import numpy as np

    mesh.vertices.add(columns.count("position"))
    ends = columns.named("edges", "<i4")
    if ends is not None and len(ends):
        mesh.edges.add(len(ends) // 2)
        mesh.attributes[".edge_verts"].data.foreach_set("value", ends)
    corners = columns.named("corners", "<i4")
    if corners is None or not len(corners):
        return
    mesh.loops.add(len(corners))
    mesh.attributes[".corner_vert"].data.foreach_set("value", corners)
    mesh.attributes[".corner_edge"].data.foreach_set("value", columns.named("edge of a corner", "<i4"))
    sides = columns.told["sides"]
    if sides is None:
        starts = np.cumsum(columns.named("sides"), dtype=np.int32)
        starts = np.concatenate([np.zeros(1, np.int32), starts[:-1]])
    else:
        starts = np.arange(0, len(corners), sides, dtype=np.int32)
    mesh.polygons.add(len(starts))
    mesh.polygons.foreach_set("loop_start", starts)


def _attributes(mesh: bpy.types.Mesh, columns: Columns, known: dict[str, str]) -> dict[str, str]:
    """Writes the columns whose files are not known; gives the files of all."""
    files = {}
    if known.get("position") != columns.by_name["position"]["file"]:
        mesh.attributes["position"].data.foreach_set("vector", columns.named("position"))
    files["position"] = columns.by_name["position"]["file"]
    uv = columns.by_name.get("uv")
    if uv and uv["on"] == "corner":
        files["corner UVMap"] = uv["file"]
        layer = mesh.uv_layers.get("UVMap") or mesh.uv_layers.new(name="UVMap", do_init=False)
        if known.get("corner UVMap") != uv["file"]:
            layer.uv.foreach_set("vector", columns.numbers(uv))
    elements = {"vertex": mesh.vertices, "edge": mesh.edges, "face": mesh.polygons, "corner": mesh.loops}
    for column in columns.told["columns"]:
        name, on = column["name"], elements.get(column["on"], ())
        # Creases are on some edges only.
        if name in OWN or not column["count"] or column["count"] != len(on):
            continue
        key = f"{column['on']} {name}"
        files[key] = column["file"]
        if known.get(key) != column["file"]:
            _attribute(mesh, columns, column)
    for key in known.keys() - files.keys():
        on, _, name = key.partition(" ")
        attribute = mesh.attributes.get(name)
        # One of the same name may be on other elements now.
        if attribute and attribute.domain == DOMAINS.get(on) and not attribute.is_required:
            mesh.attributes.remove(attribute)
    return files


def _attribute(mesh: bpy.types.Mesh, columns: Columns, column: dict[str, Any]) -> None:
    import numpy as np

    width, domain = column["width"], DOMAINS[column["on"]]
    numbers = columns.numbers(column)
    if column["type"] in ("u8", "u32"):
        # Blender's whole numbers have a sign.
        kind, slot, numbers = "INT", "value", numbers.astype(np.int32)
    elif width == 3 and column["meaning"] == "color":
        kind, slot = "FLOAT_COLOR", "color"
        numbers = np.insert(numbers.reshape(-1, 3), 3, 1, axis=1).ravel()
    else:
        kinds = {1: ("FLOAT", "value"), 2: ("FLOAT2", "vector"), 3: ("FLOAT_VECTOR", "vector"), 4: ("FLOAT_COLOR", "color")}
        if width not in kinds:
            return
        kind, slot = kinds[width]
    if column["type"] in ("u8", "u32") and width != 1:
        return
    attribute = mesh.attributes.get(column["name"])
    if attribute and (attribute.data_type, attribute.domain) != (kind, domain):
        if attribute.is_required:
            return
        mesh.attributes.remove(attribute)
        attribute = None
    attribute = attribute or mesh.attributes.new(column["name"], kind, domain)
    if attribute:
        attribute.data.foreach_set(slot, np.ascontiguousarray(numbers))


def texture(mesh: bpy.types.Mesh, told: dict[str, Any], folder: pathlib.Path) -> None:
    """Gives a mesh a material with its texture, once; what a user makes of that stays."""
    picture = told.get("texture")
    if not picture:
        return
    name = f"{mesh.name} texture"
    image = next((it for it in bpy.data.images if it.get("maquette_file") == picture["file"]), None)
    if image is None:
        image = bpy.data.images.load(str(folder / picture["file"]))
        image.name = name
        image.pack()
        image["maquette_file"] = picture["file"]
    material = next((it for it in mesh.materials if it and it.get("maquette")), None)
    if material is None:
        material = bpy.data.materials.new(mesh.name)
        material["maquette"] = True
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        shader = next(it for it in nodes if it.type == "BSDF_PRINCIPLED")
        shader.inputs["Roughness"].default_value = 0.8
        shown = nodes.new("ShaderNodeTexImage")
        shown.name = "Texture"
        shown.location = (shader.location.x - 320, shader.location.y)
        links.new(shown.outputs["Color"], shader.inputs["Base Color"])
        mesh.materials.append(material)
    shown = material.node_tree.nodes.get("Texture")
    if shown and shown.image != image:
        shown.image = image
