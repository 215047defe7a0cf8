"""MeshLab, by its Python module."""

import pathlib
import tempfile

import numpy as np
import pymeshlab
import record
from PIL import Image


def read(path: pathlib.Path) -> record.Record:
    meshes = pymeshlab.MeshSet()
    # PTX: read all points, without faces between them.
    words = {"pointcull": False, "anglecull": False, "usecolor": True} if path.suffix == ".ptx" else {}
    meshes.load_new_mesh(str(path), **words)
    mesh = meshes.current_mesh()
    points = mesh.vertex_matrix()
    matrix = mesh.transform_matrix()
    points = points @ matrix[:3, :3].T + matrix[:3, 3]
    if path.suffix in (".glb", ".ptx"):
        points = 1000 * points
    found = {"points": points, "faces": [list(map(int, face)) for face in mesh.polygonal_face_list()] if mesh.face_number() else []}
    found["colors"] = [[round(255 * x) for x in color[:3]] for color in mesh.vertex_color_matrix()] if mesh.has_vertex_color() else []
    # MeshLab has face colors of triangles only, even if it keeps polygons.
    are_triangles = len(found["faces"]) == mesh.face_number()
    found["face_colors"] = 255 * mesh.face_color_matrix()[:, :3] if mesh.has_face_color() and are_triangles else []
    found["uv"] = []
    # If both exist, vertex coordinates belong to some parts of the scene only.
    if mesh.has_vertex_tex_coord() and not mesh.has_wedge_tex_coord():
        found["uv"] = mesh.vertex_tex_coord_matrix()
    elif mesh.has_wedge_tex_coord():
        found["uv"] = mesh.wedge_tex_coord_matrix()
        # Wedge coordinates belong to triangles.
        found["faces"] = mesh.face_matrix()
    if not mesh.face_number():
        found["normals"] = mesh.vertex_normal_matrix()
    try:
        found["wear"] = mesh.vertex_custom_scalar_attribute_array("wear").reshape(-1, 1)
    except pymeshlab.pmeshlab.PyMeshLabException:
        found["wear"] = []
    found["picture"] = []
    for name, image in mesh.textures().items() if mesh.texture_number() else ():
        if name != "dummy.png":
            found["picture"] = pixels(image)
    return found


def pixels(image: "pymeshlab.Image") -> list:
    """The pixels of an image, which MeshLab can only save to a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "picture.png"
        image.save(str(path))
        return np.asarray(Image.open(path).convert("RGB"))


record.main(read)
