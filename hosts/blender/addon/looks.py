"""Materials: converts those of Blender to messages of the engine, and messages to materials of Blender."""

from __future__ import annotations

import json
import pathlib
from typing import Any

import bpy

from . import apply, pictures

# Custom property of a mesh with the materials that this module has assigned, by slot.
MATERIALS = "maquette_materials"

# Custom property of a material with the message that it was made of, as JSON.
MESSAGE = "maquette_message"


def _shader(material: bpy.types.Material) -> Any:
    """The Principled BSDF node of a material; None if it has none."""
    # In Blender 5.0 and newer, all materials have nodes, and `use_nodes` is deprecated.
    has_nodes = bpy.app.version >= (5, 0) or material.use_nodes
    nodes = material.node_tree.nodes if has_nodes and material.node_tree else ()
    return next((it for it in nodes if it.type == "BSDF_PRINCIPLED"), None)


def message(material: bpy.types.Material | None, uv: str, files: pictures.Files, lost: list[str]) -> dict[str, Any]:
    """Converts a material to a message of the engine. `uv` is the UV map that is `uv` there. Appends to `lost` what is not converted."""
    if material is None:
        return {}
    shader = _shader(material)
    found: dict[str, Any] = {"name": material.name, "double_sided": not material.use_backface_culling}
    if shader is None:
        color = list(material.diffuse_color)
        found |= {"metallic": _clamp(material.metallic), "roughness": _clamp(material.roughness)}
    else:
        maps, others = pictures.maps(shader, uv, files)
        lost += [f"the link of {name} of the material {material.name}" for name in others]
        color = [*shader.inputs["Base Color"].default_value[:3], shader.inputs["Alpha"].default_value]
        if "base color" in maps:
            color[:3] = [1.0] * 3
        strength = shader.inputs["Emission Strength"].default_value
        emissive = [1.0] * 3 if "emissive" in maps else shader.inputs["Emission Color"].default_value[:3]
        # A linked map replaces the number.
        numbers = {name: 1.0 if name in maps else shader.inputs[name.capitalize()].default_value for name in ("metallic", "roughness")}
        found |= {name: _clamp(number) for name, number in numbers.items()}
        found |= {"maps": maps, "emissive": [_clamp(strength * it) for it in emissive]}
        if shader.inputs["Alpha"].links and "Alpha" not in others:
            color[3], found["transparency"] = 1.0, "blend"
    found["base_color"] = [_clamp(it) for it in color]
    if found["base_color"][3] < 1:
        found["transparency"] = "blend"
    return found


def _clamp(number: float) -> float:
    return min(max(float(number), 0.0), 1.0)


def show(mesh: bpy.types.Mesh, entry: dict[str, Any], folder: pathlib.Path, given: list[str]) -> None:
    """Assigns materials to a mesh. `given` are the names of materials of objects at inputs, which are assigned themselves."""
    messages = entry.get("materials", [])
    apply.texture(mesh, {**entry, "texture": None} if messages else entry, folder)
    before = dict(mesh.get(MATERIALS) or {})
    ours: dict[str, Any] = {}
    for slot, its in enumerate(messages):
        was = before.get(str(slot))
        material = bpy.data.materials.get(its["name"]) if its["name"] in given else None
        if material is None and not _is_default(its):
            material = _make_material(mesh, its, before, folder)
        if material:
            ours[str(slot)] = material
        if slot >= len(mesh.materials):
            mesh.materials.append(material)
        elif mesh.materials[slot] == was or was is None and mesh.materials[slot] is None:
            # A material that a user has put into the slot stays.
            mesh.materials[slot] = material
    for slot in reversed(range(len(messages), len(mesh.materials))):
        if mesh.materials[slot] and mesh.materials[slot] == before.get(str(slot)):
            mesh.materials.pop(index=slot)
    if ours:
        mesh[MATERIALS] = ours
    elif before:
        del mesh[MATERIALS]


def _is_default(its: dict[str, Any]) -> bool:
    """Returns true for the material of faces without a material."""
    return not its["name"] and not its.get("picture") and its["base_color"] == [1, 1, 1, 1]


def _make_material(mesh: bpy.types.Mesh, its: dict[str, Any], before: dict[str, Any], folder: pathlib.Path) -> bpy.types.Material:
    """Creates or updates the material of a message. Changes by the user are kept, except of properties that have changed in the message."""
    known = {json.loads(it[MESSAGE])["name"]: it for it in before.values() if it and it.get(MESSAGE)}
    material = known.get(its["name"])
    was = json.loads(material[MESSAGE]) if material else {}
    if was == its:
        return material
    if material and any(it != mesh and material in it.materials[:] for it in bpy.data.meshes):
        # Copies of the mesh keep the old material.
        material = material.copy()
    if material is None:
        material = apply.material(its["name"] or mesh.name)
    _change(material, {name: value for name, value in its.items() if was.get(name) != value})
    shader = _shader(material)
    if shader:
        _put_pictures(material, shader, was, its, folder)
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


def _put_pictures(material: bpy.types.Material, shader: Any, was: dict[str, Any], its: dict[str, Any], folder: pathlib.Path) -> None:
    """Updates the image textures that have changed in the message."""

    def all_of(message: dict[str, Any]) -> dict[str, Any]:
        maps = dict(message.get("maps", {}))
        base = maps.pop("base color", {})
        if base and message["transparency"] != "opaque":
            maps["opacity"] = base
        if message.get("picture"):
            # The picture to show: the map multiplied by the color.
            maps["base color"] = {**base, **message["picture"]}
        return maps

    old, new = all_of(was), all_of(its)
    for kind in pictures.SOCKETS:
        if kind in new and old.get(kind) == new[kind] or kind not in new and kind not in old and was:
            continue
        image = apply.image(f"{material.name} {kind}", new[kind], folder) if kind in new else None
        pictures.show(material, shader, apply.TEXTURE_NODE if kind == "base color" else kind, kind, image, new.get(kind, {}))
