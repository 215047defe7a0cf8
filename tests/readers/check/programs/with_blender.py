"""Blender as a Python module, with the default options of its importers."""

import pathlib

import bpy
import numpy as np
import record


def read(path: pathlib.Path) -> record.Record:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.suffix in (".png", ".tiff"):
        image = bpy.data.images.load(str(path))
        if image.size[0] == 0:
            raise ValueError("no picture")
        # Blender converts pictures with more than eight bits to linear colors, unless they are non-color data.
        image.colorspace_settings.name = "Non-Color" if image.is_float else image.colorspace_settings.name
        return {"picture": pixels(image)}
    importers = {
        ".obj": bpy.ops.wm.obj_import,
        ".ply": bpy.ops.wm.ply_import,
        ".stl": bpy.ops.wm.stl_import,
        ".glb": bpy.ops.import_scene.gltf,
    }
    importers[path.suffix](filepath=str(path))
    bpy.context.view_layer.update()
    found = {"points": [], "faces": [], "lines": [], "colors": [], "uv": [], "normals": [], "wear": [], "picture": [], "materials": {}}
    curves = [it.type for it in bpy.context.scene.objects if it.type in ("CURVE", "SURFACE")]
    if curves:
        raise ValueError(f"as {len(curves)} of its own {curves[0].lower()}s")
    for it in bpy.context.scene.objects:
        if it.type == "MESH":
            add(it, found)
    points = np.array(found["points"]).reshape(-1, 3)
    if path.suffix in (".obj", ".glb"):
        # Blender has z up; these files have y up.
        turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
        points = points @ turn.T * (1000 if path.suffix == ".glb" else 1)
        found["normals"] = np.array(found["normals"]).reshape(-1, 3) @ turn.T
    return {**found, "points": points}


def add(thing: "bpy.types.Object", found: record.Record) -> None:
    mesh, world = thing.data, np.array(thing.matrix_world)
    first = len(found["points"])
    found["points"] += [list(world[:3, :3] @ vertex.co + world[:3, 3]) for vertex in mesh.vertices]
    found["faces"] += [[first + k for k in polygon.vertices] for polygon in mesh.polygons]
    found["lines"] += [[first + k for k in edge.vertices] for edge in mesh.edges if not mesh.polygons]
    layer = mesh.color_attributes.active_color
    if layer is not None:
        found["colors"] += [[255 * x for x in entry.color_srgb[:3]] for entry in layer.data]
    if "wear" in mesh.attributes:
        found["wear"] += [[entry.value] for entry in mesh.attributes["wear"].data]
    if mesh.uv_layers.active is not None:
        found["uv"] += [list(entry.uv) for entry in mesh.uv_layers.active.data]
    if mesh.has_custom_normals:
        turn = world[:3, :3] / np.linalg.norm(world[:3, 0])
        found["normals"] += [list(turn @ normal.vector) for normal in mesh.corner_normals]
    for slot, material in enumerate(mesh.materials):
        if material is not None:
            triangles = sum(len(it.vertices) - 2 for it in mesh.polygons if it.material_index == slot)
            found["materials"][material.name] = {"triangles": triangles, **shading(material)}
    for material in filter(None, mesh.materials):
        for link in material.node_tree.links if material.node_tree else ():
            image = getattr(link.from_node, "image", None)
            if link.to_socket.name == "Base Color" and image and image.size[0]:
                found["picture"] = pixels(image)


def shading(material: "bpy.types.Material") -> record.Record:
    """The kinds of textures linked to the inputs of the shader, and the base color."""
    shader = next((it for it in material.node_tree.nodes if it.type == "BSDF_PRINCIPLED"), None)
    if shader is None:
        return {}
    kinds = {"Base Color": "color", "Emission Color": "emission", "Normal": "normals", "Roughness": "roughness"}
    maps = [kind for name, kind in kinds.items() if shader.inputs[name].links]
    return {"maps": maps, "color": list(shader.inputs["Base Color"].default_value[:3])}


def pixels(image: "bpy.types.Image") -> np.ndarray:
    """Rows from the top, in the units of the file: bytes, 16 bits in PNG, or floats."""
    width, height = image.size
    scale = 255 if not image.is_float else 65535 if image.file_format == "PNG" else 1
    return scale * np.array(image.pixels[:]).reshape(height, width, -1)[::-1, :, :3]


record.main(read)
