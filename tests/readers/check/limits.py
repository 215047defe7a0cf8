"""Known limits of programs, independent of who wrote the file. Each difference is expected; a newer version without it is noticed."""

from __future__ import annotations

import fnmatch
from dataclasses import dataclass


@dataclass(frozen=True)
class Limit:
    """A difference that is expected for some programs and files, with the reason. `files` and `word` may contain `*`."""

    programs: str
    files: str
    word: str
    reason: str

    def is_of(self, program: str, file: str) -> bool:
        return program in self.programs.split() and any(fnmatch.fnmatchcase(file, part) for part in self.files.split())


# The names of files by content.
QUADS_OBJ = "Größe*.obj mesh-pictured.obj mesh-quads.obj mesh-shaded.obj curve.obj"
POLYGONS_OBJ = "mesh-concave.obj mesh-mixed.obj"
POLYGONS_PLY = "mesh-concave.ply mesh-mixed*.ply"
FREE_FORM = "surface*.obj"
PICTURED_3MF = "Größe*.3mf mesh-pictured.3mf mesh-textured.3mf"
COLORS_GLB = "mesh-colors.glb mesh-painted.glb"

LIMITS = [
    Limit("Open3D", QUADS_OBJ, "no points", "of OBJ it reads triangles only, here none"),
    Limit("Open3D", POLYGONS_OBJ, "* of * vertices", "of OBJ it reads triangles only, here some"),
    Limit("Open3D", "*.ply", "no uv", "it reads no texture coordinates from PLY"),
    Limit("Open3D trimesh assimp", COLORS_GLB, "linear colors", "they do not convert the linear colors of glTF, which look too dark"),
    Limit("MeshLab", COLORS_GLB, "colors", "of glTF colors with 16 bits it reads the lower eight, which is noise"),
    Limit("Open3D", "*.xyz", "no colors", "of .xyz it reads positions only; colors are in .xyzrgb, from 0 to 1"),
    Limit("Open3D", "*.xyz", "no normals", "of .xyz it reads positions only; normals are in .xyzn"),
    Limit("MeshLab", "*.xyz", "no colors", "in XYZ it reads the second three numbers as normals"),
    Limit("MeshLab", "mesh-painted.ply", "no wear", "of PLY it reads only attributes with known names"),
    Limit("trimesh", POLYGONS_PLY + " surface-vase.ply", "PLY is unexpected length!", "of binary PLY it reads only lists of the same length"),
    Limit("trimesh CloudCompare three.js", "mesh-concave.obj", "area", "they triangulate polygons of OBJ as fans, which is wrong for concave ones"),
    Limit("MeshLab trimesh", PICTURED_3MF, "no uv", "they read no texture coordinates from 3MF"),
    Limit("MeshLab trimesh assimp", "mesh-painted.3mf", "no colors", "they read no corner colors from 3MF"),
    Limit("assimp", PICTURED_3MF, "uv", "of 3MF it reads one texture coordinate for each vertex"),
    Limit("assimp", "mesh-triangles-corner-uv.ply", "uv", "of PLY it reads one texture coordinate for each vertex"),
    Limit("assimp three.js", "curve.ply", "no lines", "they read no edges from PLY"),
    Limit("PCL", "mesh-colors.obj mesh-painted.obj", "no colors", "pcl_obj2pcd reads no colors"),
    Limit("PCL", "mesh-shaded.obj", "no normals", "pcl_obj2pcd reads no corner normals"),
    Limit("CloudCompare three.js", POLYGONS_PLY, "* of *", "they skip faces of PLY with more than four corners"),
    Limit("CloudCompare", "mesh-colors.obj mesh-painted.obj", "no colors", "it reads no vertex colors from OBJ"),
    Limit("Blender", "mesh-triangles-corner-uv.ply", "no uv", "of PLY it reads texture coordinates of vertices only"),
    Limit("Blender", "points-*.ply", "no normals", "its point clouds have no normals"),
    Limit("three.js", "*.ply", "coarse dark colors", "it stores linear colors in bytes, so that dark ones are rounded"),
    Limit("three.js", "*.png", "8 of 16 bits", "pictures have eight bits in a browser"),
    Limit("three.js", "*.xyz", "no normals", "in XYZ it reads the second three numbers as colors"),
    Limit("three.js", "mesh-materials.obj", "maps * of skin", "it reads no roughness from MTL"),
    Limit("PrusaSlicer", POLYGONS_OBJ, "*Loading of a model file failed.", "of OBJ it reads triangles and quads only"),
    Limit("PrusaSlicer", "curve.obj", "*Loading of a model file failed.", "it does not read lines"),
    Limit("PrusaSlicer", "*.step", "no points", "of STEP it reads solids only"),
    Limit("MeshLab trimesh assimp PCL CloudCompare", FREE_FORM, "control points alone", "free-form surfaces are not supported"),
    # assimp divides the control points by their weights.
    Limit("assimp", FREE_FORM, "scaled by *", "free-form surfaces are not supported"),
    Limit("Open3D Blender", FREE_FORM, "no points", "free-form surfaces are not supported"),
    Limit("three.js", FREE_FORM, "points that are not finite", "free-form surfaces are not supported"),
    Limit("PrusaSlicer", FREE_FORM, "*Loading of a model file failed.", "free-form surfaces are not supported"),
]
