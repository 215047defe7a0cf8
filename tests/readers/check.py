"""Opens PLY files with the programs that people have, and compares counts and positions with what the file holds.

python check.py FOLDER ASSIMP: prints a table of file x program; a word in place of `ok` says what differs.
"""

from __future__ import annotations

import pathlib
import subprocess
import sys
from typing import Callable, Dict, Optional

import numpy as np
import open3d
import plyfile
import pymeshlab
import trimesh


class Content:
    """What a program finds in a file. None where the program does not tell."""

    def __init__(self, points: Optional[np.ndarray], faces: Optional[int], bounds: Optional[np.ndarray] = None) -> None:
        self.points, self.faces = points, faces
        self.bounds = np.array([points.min(0), points.max(0)]) if points is not None and len(points) else bounds


def by_plyfile(path: pathlib.Path) -> Content:
    """The truth: a reader that takes the format by its letter."""
    file = plyfile.PlyData.read(str(path))
    vertex = file["vertex"]
    points = np.column_stack([vertex["x"], vertex["y"], vertex["z"]]).astype(float)
    return Content(points, len(file["face"]) if "face" in file else 0)


def by_open3d(path: pathlib.Path) -> Content:
    mesh = open3d.io.read_triangle_mesh(str(path))
    points = np.asarray(mesh.vertices)
    cloud = np.asarray(open3d.io.read_point_cloud(str(path)).points)
    if not np.array_equal(points, cloud):
        raise ValueError(f"as a mesh it has {len(points)} points, as a cloud {len(cloud)}")
    # It cuts faces into triangles.
    return Content(points, None)


def by_pymeshlab(path: pathlib.Path) -> Content:
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    mesh = meshes.current_mesh()
    return Content(mesh.vertex_matrix(), None)


def by_trimesh(path: pathlib.Path) -> Content:
    mesh = trimesh.load(path, process=False)
    if isinstance(mesh, trimesh.Scene):
        raise ValueError("it is a scene")
    points = np.asarray(mesh.vertices)
    # At seams of texture coordinates it makes several vertices of one.
    return Content(np.unique(points, axis=0) if "corner-uv" in path.stem else points, None)


def by_assimp(path: pathlib.Path) -> Content:
    """It gives corners vertices of their own, so that only faces and bounds can be compared. Without `-r` it refuses every point cloud."""
    done = subprocess.run(["assimp", "info", str(path), "-r"], capture_output=True, text=True)
    if done.returncode != 0:
        raise ValueError((done.stdout + done.stderr).strip().splitlines()[-1])
    lines = [line.split() for line in done.stdout.splitlines()]
    bounds = [[float(word.strip("()")) for word in line[2:5]] for line in lines if line[1:2] == ["point"]]
    minimum, maximum = bounds[:2]
    faces = next(int(line[1]) for line in lines if line[:1] == ["Faces:"])
    return Content(None, faces, np.array([minimum, maximum]))


# What a program cannot open, whoever wrote it: a file is expected to fail there, so that a newer version is noticed.
LIMITS = {("trimesh", "mixed"): "PLY is unexpected length!"}

PROGRAMS: Dict[str, Callable[[pathlib.Path], Content]] = {
    "Open3D": by_open3d,
    "pymeshlab": by_pymeshlab,
    "trimesh": by_trimesh,
    "assimp": by_assimp,
}


def difference(truth: Content, found: Content) -> str:
    """What differs, in a word; empty if nothing does."""
    if found.points is not None:
        if len(found.points) != len(truth.points):
            return f"{len(found.points)} of {len(truth.points)} vertices"
        same = np.allclose(found.points, truth.points, atol=1e-5)
        if not same and not np.allclose(found.points, np.unique(truth.points, axis=0), atol=1e-5):
            return "positions"
    if found.faces is not None and truth.faces and found.faces != truth.faces:
        return f"{found.faces} of {truth.faces} faces"
    if found.bounds is not None and not np.allclose(found.bounds, truth.bounds, rtol=1e-4, atol=1e-4):
        return "bounds"
    return ""


def main(folder: pathlib.Path) -> int:
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    files = sorted(folder.resolve().rglob("*.ply"))
    width = max(len(file.name) for file in files)
    print(" " * width, *(f"{name:12}" for name in PROGRAMS))
    failures = 0
    for file in files:
        truth, row = by_plyfile(file), []
        for name, program in PROGRAMS.items():
            try:
                word = difference(truth, program(file)) or "ok"
            except Exception as error:
                word = " ".join(str(error).split())
            limit = next((why for (who, part), why in LIMITS.items() if who == name and part in file.stem), "ok")
            failures += word != limit
            row.append(f"{'not read' if word == limit != 'ok' else word:12}")
        print(f"{file.name:{width}}", *row)
    print(f"{len(files) * len(PROGRAMS) - failures} passed, {failures} failed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
