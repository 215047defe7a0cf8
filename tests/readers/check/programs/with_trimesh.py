"""trimesh."""

import pathlib

import numpy as np
import record
import trimesh


def read(path: pathlib.Path) -> record.Record:
    scene = trimesh.load(path, process=False)
    if isinstance(scene, trimesh.PointCloud):
        colors = np.asarray(scene.colors)
        return {"points": scene.vertices, "faces": [], "colors": colors[:, :3] if len(colors) else []}
    if isinstance(scene, trimesh.path.Path3D):
        return {"points": scene.vertices, "lines": [entity.points for entity in scene.entities]}
    if isinstance(scene, trimesh.Trimesh):
        return looks(scene, np.eye(4))
    parts = [scene.graph[node] for node in scene.graph.nodes_geometry]
    if len(parts) > 1 and path.stem == "mesh-materials":
        return of_parts(scene, parts)
    if len(parts) != 1:
        raise ValueError(f"{len(parts)} meshes")
    matrix, name = parts[0]
    found = looks(scene.geometry[name], matrix)
    factor = {"meters": 1000.0}.get(scene.units, 1.0)
    return {**found, "points": factor * found["points"]}


def of_parts(scene: trimesh.Scene, parts: list) -> record.Record:
    """A mesh for each material."""
    found = {"points": [], "faces": [], "uv": [], "materials": {}}
    factor = {"meters": 1000.0}.get(scene.units, 1.0)
    for matrix, name in parts:
        mesh = scene.geometry[name]
        part, first = looks(mesh, matrix), len(found["points"])
        found["points"] += (factor * part["points"]).tolist()
        found["faces"] += (part["faces"] + first).tolist()
        found["uv"] += np.asarray(part["uv"]).tolist()
        found["picture"] = part["picture"] if len(part["picture"]) else found.get("picture", [])
        material = mesh.visual.material
        entry = {"triangles": len(mesh.faces)}
        kinds = {"color": "baseColorTexture", "emission": "emissiveTexture", "normals": "normalTexture", "roughness": "metallicRoughnessTexture"}
        if isinstance(material, trimesh.visual.material.PBRMaterial):
            entry["maps"] = [kind for kind, key in kinds.items() if getattr(material, key) is not None]
            entry["color"] = [x / 255 for x in (material.baseColorFactor if material.baseColorFactor is not None else [255] * 4)[:3]]
        found["materials"][material.name] = entry
    return found


def looks(mesh: trimesh.Trimesh, matrix: np.ndarray) -> record.Record:
    found = {"points": mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], "faces": mesh.faces}
    turn = matrix[:3, :3] / np.linalg.norm(matrix[:3, 0])
    # Only normals of the file; trimesh would calculate missing ones from the faces.
    found["normals"] = mesh.vertex_normals @ turn.T if "vertex_normals" in mesh._cache else []
    visual, kind = mesh.visual, mesh.visual.kind
    others = {**mesh.vertex_attributes, **(getattr(visual, "vertex_attributes", None) or {})}
    colors = np.asarray(visual.vertex_colors if kind == "vertex" else others.get("color", []))
    scale = {"float64": 255, "float32": 255, "uint16": 1 / 257}.get(str(colors.dtype), 1)
    found["colors"] = scale * colors[:, :3] if len(colors) else []
    found["face_colors"] = visual.face_colors[:, :3] if kind == "face" else []
    material = getattr(visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    uv = getattr(visual, "uv", None)
    found["uv"] = uv if uv is not None else []
    found["picture"] = np.asarray(image.convert("RGB")) if image is not None else []
    # Custom attributes of PLY are in the metadata.
    data = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
    names = getattr(getattr(data, "dtype", None), "names", None) or data
    found["wear"] = np.asarray(data["wear"], float).reshape(-1, 1) if "wear" in names else []
    return found


record.main(read)
