"""What programs cannot do, whoever wrote the file. Each is expected, so that a newer version that can is noticed."""

from __future__ import annotations

import fnmatch
from dataclasses import dataclass


@dataclass(frozen=True)
class Limit:
    """A word that is expected of some programs about some files, and why. `files` and `word` may have `*`."""

    programs: str
    files: str
    word: str
    reason: str

    def is_of(self, program: str, file: str) -> bool:
        return program in self.programs.split() and any(fnmatch.fnmatchcase(file, part) for part in self.files.split())


# The names of files by what is in them.
QUADS_OBJ = "Größe*.obj mesh-pictured.obj mesh-quads.obj mesh-shaded.obj curve.obj"
POLYGONS_OBJ = "mesh-concave.obj mesh-mixed.obj"
POLYGONS_PLY = "mesh-concave.ply mesh-mixed*.ply"
FREE_FORM = "surface*.obj"
PICTURED_3MF = "Größe*.3mf mesh-pictured.3mf mesh-textured.3mf"
COLORS_GLB = "mesh-colors.glb mesh-painted.glb"

LIMITS = [
    Limit("Open3D", QUADS_OBJ, "no points", "of OBJ it takes triangles alone, here none"),
    Limit("Open3D", POLYGONS_OBJ, "* of * vertices", "of OBJ it takes triangles alone, here some"),
    Limit("Open3D", "*.ply", "no uv", "of PLY it takes no texture coordinates"),
    Limit("Open3D trimesh assimp", COLORS_GLB, "linear colors", "the linear colors of glTF come as they are, and look too dark"),
    Limit("MeshLab", COLORS_GLB, "colors", "of glTF colors of 16 bits it takes the lower eight, which is noise"),
    Limit("Open3D", "*.xyz", "no colors", "of .xyz it takes places alone, of .xyzrgb colors from 0 to 1"),
    Limit("Open3D", "*.xyz", "no normals", "of .xyz it takes places alone, of .xyzn normals"),
    Limit("MeshLab", "*.xyz", "no colors", "in XYZ it takes the second three numbers for normals"),
    Limit("MeshLab", "mesh-painted.ply", "no wear", "of PLY it takes attributes whose names it knows"),
    Limit("trimesh", POLYGONS_PLY, "PLY is unexpected length!", "of binary PLY it takes lists of one length alone"),
    Limit("trimesh CloudCompare three.js", "mesh-concave.obj", "area", "polygons of OBJ become fans, which is wrong for concave ones"),
    Limit("MeshLab trimesh", PICTURED_3MF, "no uv", "of 3MF they take no texture coordinates"),
    Limit("MeshLab trimesh assimp", "mesh-painted.3mf", "no colors", "of 3MF they take no colors of corners"),
    Limit("assimp", PICTURED_3MF, "uv", "of 3MF it takes one texture coordinate for each vertex"),
    Limit("assimp", "mesh-triangles-corner-uv.ply", "uv", "of PLY it takes one texture coordinate for each vertex"),
    Limit("assimp three.js", "curve.ply", "no lines", "of PLY no edges are taken"),
    Limit("PCL", "mesh-colors.obj mesh-painted.obj", "no colors", "pcl_obj2pcd takes no colors"),
    Limit("PCL", "mesh-shaded.obj", "no normals", "pcl_obj2pcd takes no normals of corners"),
    Limit("CloudCompare three.js", POLYGONS_PLY, "* of *", "of PLY faces with more than four corners are left out"),
    Limit("CloudCompare", "mesh-colors.obj mesh-painted.obj", "no colors", "of OBJ it takes no colors of vertices"),
    Limit("Blender", "mesh-triangles-corner-uv.ply", "no uv", "of PLY it takes texture coordinates of vertices alone"),
    Limit("Blender", "points-*.ply", "no normals", "its points have no normals"),
    Limit("Blender", "surface-vase.ply", "normals", "it gives corners of faces without an area other normals"),
    Limit("three.js", "*.ply", "coarse dark colors", "it keeps linear colors in bytes, so that dark ones are rounded"),
    Limit("three.js", "*.png", "8 of 16 bits", "pictures have eight bits in a browser"),
    Limit("three.js", "*.xyz", "no normals", "in XYZ it takes the second three numbers for colors"),
    Limit("three.js", "mesh-materials.obj", "maps * of skin", "of MTL it takes no roughness"),
    Limit("PrusaSlicer", POLYGONS_OBJ, "*Loading of a model file failed.", "of OBJ it takes triangles and quads alone"),
    Limit("PrusaSlicer", "curve.obj", "*Loading of a model file failed.", "it prints no lines"),
    Limit("PrusaSlicer", "*.step", "no points", "of STEP it takes solids alone"),
    Limit("MeshLab trimesh assimp PCL CloudCompare", FREE_FORM, "control points alone", "free-form surfaces are not known"),
    # It divides them by their weights.
    Limit("assimp", FREE_FORM, "scaled by *", "free-form surfaces are not known"),
    Limit("Open3D Blender", FREE_FORM, "no points", "free-form surfaces are not known"),
    Limit("three.js", FREE_FORM, "points that are not finite", "free-form surfaces are not known"),
    Limit("PrusaSlicer", FREE_FORM, "*Loading of a model file failed.", "free-form surfaces are not known"),
]
