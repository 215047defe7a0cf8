"""Opens the outputs of `maquette run graphs/doll.ron` with other programs and checks axes, orientation, texture and position.

Usage: upright.py FOLDER [trimesh|bpy ..]. The doll faces the viewer: most of its faces point along z, its ears are on top, and its red nose
is nearest to the viewer.
"""

import sys
from pathlib import Path


def with_trimesh(path):
    import trimesh

    mesh = trimesh.load(path, force="mesh", process=False)
    scale = 1000.0 if path.suffix == ".glb" else 1.0
    picture = getattr(mesh.visual, "material", None)
    picture = getattr(picture, "image", None) or getattr(picture, "baseColorTexture", None)
    return mesh.vertices * scale, mesh.face_normals, mesh.area_faces, picture is not None


def with_bpy(path):
    import bpy
    import numpy as np

    bpy.ops.wm.read_factory_settings(use_empty=True)
    load = {
        ".obj": lambda: bpy.ops.wm.obj_import(filepath=str(path), forward_axis="NEGATIVE_Z", up_axis="Y"),
        ".ply": lambda: bpy.ops.wm.ply_import(filepath=str(path), forward_axis="NEGATIVE_Z", up_axis="Y"),
        ".stl": lambda: bpy.ops.wm.stl_import(filepath=str(path), forward_axis="NEGATIVE_Z", up_axis="Y"),
        ".glb": lambda: bpy.ops.import_scene.gltf(filepath=str(path)),
    }
    load[path.suffix]()
    bpy.context.view_layer.update()
    found = [it for it in bpy.context.scene.objects if it.type == "MESH"]
    mesh, world = found[0].data, np.array(found[0].matrix_world)
    points = np.array([v.co for v in mesh.vertices]) @ world[:3, :3].T + world[:3, 3]
    normals = np.array([p.normal for p in mesh.polygons]) @ world[:3, :3].T
    areas = np.array([p.area for p in mesh.polygons])
    # Blender has z up, and its front view is along y.
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
    scale = 1000.0 if path.suffix == ".glb" else 1.0
    nodes = [n for m in mesh.materials if m and m.use_nodes for n in m.node_tree.nodes]
    return points @ turn.T * scale, normals @ turn.T, areas, any(n.type == "TEX_IMAGE" for n in nodes)


def main(folder, programs):
    import numpy as np

    failures = 0
    reference = None
    for program in programs:
        for path in sorted(Path(folder).glob("model.*")):
            if path.suffix not in (".obj", ".ply", ".stl", ".glb"):
                continue
            points, normals, areas, has_picture = {"trimesh": with_trimesh, "bpy": with_bpy}[program](path)
            low, high = points.min(0), points.max(0)
            facing = float((normals[:, 2] * areas).sum() / (np.linalg.norm(normals, axis=1) * areas).sum())
            top = points[points[:, 1] > high[1] - 0.15 * (high[1] - low[1])]
            wrong = []
            if facing < 0.4:
                wrong.append(f"faces look along z by {facing:.2f}")
            # Only the ears are on top, and they are far apart.
            if np.ptp(top[:, 0]) < 0.6 * (high[0] - low[0]):
                wrong.append("the ears are not on top")
            if path.suffix in (".obj", ".glb") and not has_picture:
                wrong.append("no picture")
            reference = reference if reference is not None else (low, high)
            if np.abs(np.array([low, high]) - np.array(reference)).max() > 0.05:
                wrong.append(f"its bounds are {low} to {high}, those of the first file {reference}")
            print(f"{program:8} {path.name:10} {len(points):7} vertices, facing {facing:.2f}: {'; '.join(wrong) or 'ok'}")
            failures += bool(wrong)
    return failures


sys.exit(main(sys.argv[1], sys.argv[2:] or ["trimesh", "bpy"]))
