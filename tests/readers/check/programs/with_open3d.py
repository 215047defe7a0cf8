"""Open3D."""

import pathlib

import numpy as np
import open3d
import record

open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)


def read(path: pathlib.Path) -> record.Record:
    if path.suffix == ".png":
        image = np.asarray(open3d.io.read_image(str(path)))
        return {"picture": image}
    cloud = open3d.io.read_point_cloud(str(path), remove_nan_points=True) if path.suffix in (".ply", ".pcd", ".xyz") else None
    mesh = open3d.io.read_triangle_mesh(str(path)) if path.suffix not in (".pcd", ".xyz") else None
    if mesh is None or (cloud is not None and len(mesh.triangles) == 0):
        points = np.asarray(cloud.points)
        return {"points": points, "faces": [], "colors": 255 * np.asarray(cloud.colors), "normals": np.asarray(cloud.normals)}
    points = np.asarray(mesh.vertices)
    if cloud is not None and not np.array_equal(points, np.asarray(cloud.points)):
        raise ValueError(f"{len(points)} points as a mesh, {len(cloud.points)} as a cloud")
    textures = [texture for texture in map(np.asarray, mesh.textures) if texture.ndim == 3]
    return {
        # GLB is in meters.
        "points": 1000 * points if path.suffix == ".glb" else points,
        "faces": np.asarray(mesh.triangles),
        "colors": 255 * np.asarray(mesh.vertex_colors),
        "normals": np.asarray(mesh.vertex_normals),
        "uv": np.asarray(mesh.triangle_uvs),
        # Open3D has the lowest row first.
        "picture": textures[0][::-1] if textures else [],
    }


record.main(read)
