"""Materials: those of Blender as graphs are told of them, and those of meshes with several as materials of Blender."""

from __future__ import annotations

import json
import pathlib
from typing import Any, Iterable

import bpy

from . import apply, material_bytes

# The materials that a mesh was given, by the numbers of their slots.
MATERIALS = "maquette_materials"

# What a material was made of.
MESSAGE = "maquette_message"

# What the engine says of all materials of the value, and how many they are.
FACT = "maquette_materials_fact"
COUNT = "maquette_materials_count"


def _shader(material: bpy.types.Material) -> Any:
    """The node that says what a material looks like; None if it has none."""
    # Later Blenders have no other materials, and warn who asks.
    has_nodes = bpy.app.version >= (5, 0) or material.use_nodes
    nodes = material.node_tree.nodes if has_nodes and material.node_tree else ()
    return next((it for it in nodes if it.type == "BSDF_PRINCIPLED"), None)


def message(material: bpy.types.Material | None, lost: list[str]) -> dict[str, Any]:
    """What a graph is told of a material."""
    if material is None:
        return {}
    shader = _shader(material)
    found: dict[str, Any] = {"name": material.name, "double_sided": not material.use_backface_culling}
    if shader is None:
        color = list(material.diffuse_color)
        found |= {"metallic": _part(material.metallic), "roughness": _part(material.roughness)}
    else:
        color = [*shader.inputs["Base Color"].default_value[:3], shader.inputs["Alpha"].default_value]
        strength = shader.inputs["Emission Strength"].default_value
        found |= {name: _part(shader.inputs[name.capitalize()].default_value) for name in ("metallic", "roughness")}
        found["emissive"] = [_part(strength * it) for it in shader.inputs["Emission Color"].default_value[:3]]
        if shader.inputs["Base Color"].links:
            lost.append(f"the picture of material {material.name}")
    found["base_color"] = [_part(it) for it in color]
    if found["base_color"][3] < 1:
        found["transparency"] = "blend"
    return found


def _part(number: float) -> float:
    return min(max(float(number), 0.0), 1.0)


def may_have(told: dict[str, Any], given: Iterable[str]) -> bool:
    """Whether a value may have more than one picture."""
    return any((it["on"], it["name"]) == ("face", "material") for it in told["columns"]) or bool(list(given))


def of_parts(told: dict[str, Any], folder: pathlib.Path) -> list[dict[str, Any]]:
    """The materials of a value that was given as `parts`."""
    column = next((it for it in told.get("columns", ()) if (it["on"], it["name"]) == ("whole", "materials")), None)
    return material_bytes.decode((folder / column["file"]).read_bytes()) if column else []


def show(mesh: bpy.types.Mesh, told: dict[str, Any], folder: pathlib.Path, given: list[str]) -> None:
    """Gives a mesh its materials; None are those that it has. `given` are the names of those of objects at inputs, which come back themselves."""
    messages = told.get("materials", [])
    if messages is None:
        return
    apply.texture(mesh, {**told, "texture": None} if messages else told, folder)
    before = dict(mesh.get(MATERIALS) or {})
    ours: dict[str, Any] = {}
    for slot, its in enumerate(messages):
        was = before.get(str(slot))
        material = bpy.data.materials.get(its["name"]) if its["name"] in given else None
        if material is None and not _is_nothing(its):
            material = _made(mesh, its, before)
        if material:
            ours[str(slot)] = material
        if slot >= len(mesh.materials):
            mesh.materials.append(material)
        elif mesh.materials[slot] == was or was is None and mesh.materials[slot] is None:
            # One that a user has put here stays.
            mesh.materials[slot] = material
    for slot in reversed(range(len(messages), len(mesh.materials))):
        if mesh.materials[slot] and mesh.materials[slot] == before.get(str(slot)):
            mesh.materials.pop(index=slot)
    mesh[FACT], mesh[COUNT] = told.get("materials_fact", ""), len(messages)
    if ours:
        mesh[MATERIALS] = ours
    elif before:
        del mesh[MATERIALS]


def _is_nothing(its: dict[str, Any]) -> bool:
    """Whether nothing is known of a material: that of faces without one beside others."""
    return not its["name"] and not its["picture"] and its["base_color"] == [1, 1, 1, 1]


def _made(mesh: bpy.types.Mesh, its: dict[str, Any], before: dict[str, Any]) -> bpy.types.Material:
    """A material that looks as a message says. What a user has made of a known one stays, but for what the message says now."""
    known = {json.loads(it[MESSAGE])["name"]: it for it in before.values() if it and it.get(MESSAGE)}
    material, picture = known.get(its["name"]), its["picture"]
    its = {**its, "picture": picture["file"] if picture else None}
    was = json.loads(material[MESSAGE]) if material else {}
    if was == its:
        return material
    if material and any(it != mesh and material in it.materials[:] for it in bpy.data.meshes):
        # Copies of the mesh go on to show what they show.
        material = material.copy()
    if material is None:
        material = apply.material(its["name"] or mesh.name)
    _change(material, {name: value for name, value in its.items() if was.get(name) != value})
    if was.get("picture", "") != its["picture"]:
        _put_picture(material, picture)
    material[MESSAGE] = json.dumps(its)
    return material


def _change(material: bpy.types.Material, its: dict[str, Any]) -> None:
    shader = _shader(material)
    values: dict[str, Any] = {}
    if "base_color" in its:
        color = material.diffuse_color = its["base_color"]
        values |= {"Base Color": (*color[:3], 1), "Alpha": color[3]}
    if "metallic" in its:
        values["Metallic"] = material.metallic = its["metallic"]
    if "roughness" in its:
        values["Roughness"] = material.roughness = its["roughness"]
    if "emissive" in its:
        values |= {"Emission Color": (*its["emissive"], 1), "Emission Strength": float(any(its["emissive"]))}
    if "double_sided" in its:
        material.use_backface_culling = not its["double_sided"]
    for name, value in values.items() if shader else ():
        shader.inputs[name].default_value = value


def _put_picture(material: bpy.types.Material, picture: dict[str, Any] | None) -> None:
    """Shows a picture in place of the one that a material shows."""
    import numpy as np

    texture = material.node_tree.nodes.get("Texture")
    if texture is None:
        return
    if picture is None:
        material.node_tree.nodes.remove(texture)
        return
    image = next((it for it in bpy.data.images if it.get("maquette_file") == picture["file"]), None)
    if image is None:
        width, height = picture["size"]
        image = bpy.data.images.new(f"{material.name} texture", width, height)
        rows = np.frombuffer(picture["pixels"], "u1").reshape(height, width, 3)[::-1] / np.float32(255)
        image.pixels.foreach_set(np.dstack([rows, np.ones((height, width), "f4")]).astype("f4").ravel())
        image.pack()
        image["maquette_file"] = picture["file"]
    texture.image = image
