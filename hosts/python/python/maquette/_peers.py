"""Conversion of meshes and points from and to trimesh, Open3D and PyVista.

A library is imported only to create its objects. Attributes keep their names and kinds; `color`, `normal` and `uv` are mapped to the
library's own names. Data that a library does not support is stored as extra data of its mesh if possible; otherwise there is a warning.
"""

from __future__ import annotations

import importlib
import warnings
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional

from . import _arrays, _pictures
from ._mesh import Mesh, Points, vertices_and_faces
from ._value import Part, Value

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._value import _AnyPart, _Indices

    _Parts = Dict[str, _AnyPart]

_PREFIX = "maquette"
"""The prefix of extra data that is stored in a mesh of another library."""

_NORMALS = ("normal", "Normals")
_COLORS = ("color", "RGB", "RGBA", "rgb", "rgba")


def parts_of_mesh(given: Any) -> _Parts:
    """The columns of a mesh of another library, or of any object with vertices and faces."""
    if isinstance(given, Mesh):
        return dict(given.parts)
    library = _library(given)
    if library == "trimesh":
        return _from_trimesh(given)
    if library == "open3d":
        return _from_open3d(given) if hasattr(given, "material") and hasattr(given, "vertex") else _from_legacy_open3d(given)
    if library == "pyvista":
        return _from_pyvista(given)

    faces = getattr(given, "faces", None)
    faces = getattr(given, "triangles", None) if faces is None else faces
    vertices = getattr(given, "vertices", None)
    if vertices is None or faces is None or isinstance(given, Value):
        raise TypeError(f"a mesh needs vertices and faces, or something that has both; {type(given).__name__} has not")
    return vertices_and_faces(vertices, faces)


def parts_of_points(given: Any) -> _Parts:
    """The columns of points of another library, of any object with points or vertices, or of an array."""

    if isinstance(given, Points):
        return dict(given.parts)
    library, of_points = _library(given), Points._positions
    if library == "trimesh":
        parts = of_points(given.vertices)
        if getattr(given, "colors", None) is not None and len(given.colors):
            _add(parts, "point", "color", given.colors, opaque=True)
        return parts
    if library == "pyvista":
        parts = of_points(given.points)
        _add_all(parts, "point", given.point_data)
        return parts
    if library == "open3d" and hasattr(given, "point"):
        parts = of_points(given.point.positions.numpy())
        _add_tensors(parts, "point", given.point, skip=("positions",))
        return parts
    if library == "open3d" and hasattr(given, "colors"):
        parts = of_points(given.points)
        for name, array in (("color", given.colors), ("normal", given.normals)):
            if len(array):
                _add(parts, "point", name, array)
        return parts
    for name in ("points", "vertices"):
        given = getattr(given, name, given)
    return of_points(given)


def _library(given: Any) -> str:
    """The name of the library that an object belongs to; empty if it is not a supported one."""
    for kind in type(given).__mro__:
        name = str(kind.__module__).split(".")[0]
        if name in ("trimesh", "open3d", "pyvista"):
            return name
    return ""


def _add(parts: _Parts, on: str, name: str, array: Any, *, opaque: bool = False) -> None:
    """Adds an attribute, or warns if it cannot be converted. `opaque`: drop alpha."""
    import numpy as np

    from ._mesh import is_own

    if is_own(name):
        reason = "no attribute has this name, which means something else; rename it"
        warnings.warn(f"the attribute `{name}` of {on} elements is left out: {reason}", stacklevel=6)
        return
    array = np.asarray(array)
    if array.ndim == 3 and on == "corner":
        array = array.reshape(-1, array.shape[2])
    elif array.ndim == 2 and array.shape[1] == 1 or array.ndim == 2 and on == "corner" and array.shape[1] == 3:
        array = array.reshape(-1)
    if opaque and array.ndim == 2 and array.shape[1] == 4:
        if array.dtype == np.uint8 and (array[:, 3] != 255).any():
            warnings.warn(f"`{name}` of {on} elements is not opaque; its alpha is left out", stacklevel=6)
        array = array[:, :3]
    part = name if on in ("vertex", "point") else f"{on} {name}"
    try:
        numbers, meaning = _arrays.attribute(name, array)
        parts[part] = Part(part, on, meaning, numbers)
    except ValueError as error:
        warnings.warn(f"the attribute `{name}` of {on} elements is left out: {error}", stacklevel=6)


def _add_all(parts: _Parts, on: str, arrays: Mapping[str, Any], skip: Any = ()) -> None:
    """Adds attributes by name; recognizes the names of normals and colors in other libraries."""
    for name in list(arrays):
        if name in skip:
            continue
        known = "normal" if name in _NORMALS else "color" if name in _COLORS else name
        _add(parts, on, known, arrays[name], opaque=known == "color")


def _other_parts(mesh: Mesh) -> List[Part]:
    """The columns of a mesh other than vertices, faces, their attributes and the texture."""
    of_elements = {name for on in ("vertex", "corner", "face", "texel") for name in mesh._columns.names_on(on)}
    return [mesh.parts[name] for name in mesh.parts if name not in of_elements and name != "texture size"]


# trimesh


def to_trimesh(mesh: Mesh) -> Any:
    """Converts a mesh to trimesh."""
    import numpy as np

    trimesh = importlib.import_module("trimesh")
    vertices, triangles = mesh.vertices, np.asarray(mesh.triangles, dtype=np.int64)
    corners, of_face = _triangle_corners(mesh)
    at_corners = mesh.corner_attributes
    vertex = dict(mesh.attributes)
    uv = vertex.pop("uv", None)
    origin: Optional[NDArray[np.int64]] = None
    if uv is None and "uv" in at_corners:
        # trimesh has one texture coordinate for each vertex: split vertices with several.
        uv_at = at_corners["uv"][corners]
        keys = np.concatenate([triangles.reshape(-1, 1).astype(np.float64), uv_at], axis=1)
        alone = np.setdiff1d(np.arange(len(vertices)), triangles)
        keys = np.concatenate([keys, np.stack([alone, 0 * alone, 0 * alone], axis=1)])
        rows, place = np.unique(keys, axis=0, return_inverse=True)
        origin, uv = rows[:, 0].astype(np.int64), rows[:, 1:]
        vertices, triangles = vertices[origin], place.reshape(-1)[: triangles.size].reshape(-1, 3)
        vertex = {name: array[origin] for name, array in vertex.items()}
    face = {name: array[of_face] for name, array in mesh.face_attributes.items()}
    theirs = trimesh.Trimesh(np.array(vertices), np.array(triangles), process=False, validate=False)
    theirs.units = "millimeters"
    texture = mesh.texture
    if uv is not None:
        picture = None if texture is None else importlib.import_module("PIL.Image").fromarray(texture.pixels)
        # Other materials get a default picture if there is none.
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
        theirs.visual = trimesh.visual.TextureVisuals(uv=np.array(uv), material=material)
    elif "color" in vertex:
        theirs.visual = trimesh.visual.ColorVisuals(theirs, vertex_colors=vertex.pop("color"))
    elif "color" in face:
        theirs.visual = trimesh.visual.ColorVisuals(theirs, face_colors=face.pop("color"))
    theirs.vertex_attributes.update({name: np.array(array) for name, array in vertex.items()})
    theirs.face_attributes.update({name: np.array(array) for name, array in face.items()})
    kept = [part for name, part in ((name, mesh.parts[f"corner {name}"]) for name in at_corners) if name != "uv"]
    kept = [part._replace(array=part.array[corners]) for part in kept]
    if texture is not None and uv is None:
        kept += [mesh.parts["texture"], mesh.parts["texture size"]]
    theirs.metadata[_PREFIX] = {
        "parts": [tuple(part) for part in [*kept, *_other_parts(mesh)]],
        "faces": np.array(triangles),
        "origin": origin,
    }
    return theirs


def _triangle_corners(mesh: Mesh) -> Any:
    """The corner of the mesh for each corner of each triangle, and the face for each triangle."""
    import numpy as np

    corners: _Indices = np.asarray(mesh._native.triangle_corners()).reshape(-1)
    of_face = np.repeat(np.arange(len(mesh.offsets) - 1), np.diff(mesh.offsets) - 2)
    return corners, of_face


def _from_trimesh(theirs: Any) -> _Parts:
    """The columns of a mesh of trimesh."""
    import numpy as np

    if hasattr(theirs, "geometry") and hasattr(theirs, "to_mesh"):
        theirs = theirs.to_mesh()
    if not (hasattr(theirs, "vertices") and hasattr(theirs, "faces")):
        raise TypeError(f"a mesh needs vertices and faces, or something that has both; {type(theirs).__name__} has not")
    vertices, faces = np.asarray(theirs.vertices), np.asarray(theirs.faces)
    units = getattr(theirs, "units", None)
    if units is not None:
        try:
            scale = importlib.import_module("trimesh.units").unit_conversion(units, "millimeters")
        except (KeyError, ValueError):
            scale = 1.0
            warnings.warn(f"the unit `{units}` is not known; lengths are taken as mm", stacklevel=5)
        vertices = vertices if scale == 1 else vertices * scale
    kept = theirs.metadata.get(_PREFIX, {}) if isinstance(getattr(theirs, "metadata", None), dict) else {}
    origin, is_same = kept.get("origin"), np.array_equal(kept.get("faces", ()), faces)
    parts: _Parts = {}
    _add_visual(parts, getattr(theirs, "visual", None))
    _add_all(parts, "vertex", getattr(theirs, "vertex_attributes", {}))
    _add_all(parts, "face", getattr(theirs, "face_attributes", {}))
    if origin is not None and is_same and len(origin) == len(vertices):
        merged = _merge_vertices(parts, vertices, faces, origin)
        if merged is not None:
            vertices, faces = merged
    lost = []
    for part in (Part(*it) for it in kept.get("parts", ())):
        if part.on not in ("corner", "edge") or is_same:
            parts.setdefault(part.name, part)
        else:
            lost.append(part.name)
    if lost:
        warnings.warn(f"the faces have changed: {', '.join(lost)} of before are left out", stacklevel=5)
    return {**_arrays_of(vertices, faces), **parts}


def _add_visual(parts: _Parts, visual: Any) -> None:
    """Adds texture coordinates, texture and colors of a mesh of trimesh."""
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        if visual.uv is not None and len(visual.uv):
            _add(parts, "vertex", "uv", visual.uv)
        material = visual.material
        picture = getattr(material, "baseColorTexture", None)
        picture = getattr(material, "image", None) if picture is None else picture
        if picture is not None:
            _add_texture(parts, picture)
    elif kind == "vertex":
        _add(parts, "vertex", "color", visual.vertex_colors, opaque=True)
    elif kind == "face":
        _add(parts, "face", "color", visual.face_colors, opaque=True)


def _merge_vertices(parts: _Parts, vertices: Any, faces: Any, origin: NDArray[np.int64]) -> Any:
    """Merges vertices again that `to_trimesh` has split by texture coordinates, with their attributes; returns vertices and faces, or None
    if split vertices differ now."""
    import numpy as np

    _, first = np.unique(origin, return_index=True)
    names = [name for name, part in parts.items() if _on(part) == "vertex" and name != "uv"]
    arrays = [np.asarray(vertices), *(_array(parts[name]) for name in names)]
    if any(array[first][origin].tobytes() != np.ascontiguousarray(array).tobytes() for array in arrays):
        return None
    for name in names:
        part = parts[name]
        assert isinstance(part, Part)
        parts[name] = part._replace(array=part.array[first])
    uv = parts.pop("uv", None)
    if uv is not None:
        parts["corner uv"] = Part("corner uv", "corner", "number", _array(uv)[faces.reshape(-1)])
    return vertices[first], origin[faces]


def _on(part: _AnyPart) -> str:
    return part.on if isinstance(part, Part) else part[0]


def _array(part: _AnyPart) -> Any:
    return part.array if isinstance(part, Part) else part[1]


def _arrays_of(vertices: Any, faces: Any) -> _Parts:

    return vertices_and_faces(vertices, faces)


# Open3D


def to_open3d(mesh: Mesh, legacy: bool) -> Any:
    """Converts a mesh to Open3D."""
    import numpy as np

    open3d = importlib.import_module("open3d")
    tensor, core = open3d.core.Tensor, open3d.core
    theirs = open3d.t.geometry.TriangleMesh()
    triangles = np.array(mesh.triangles, dtype=np.int32)
    corners, of_face = _triangle_corners(mesh)
    theirs.vertex.positions = tensor(np.array(mesh.vertices), core.float64)
    theirs.triangle.indices = tensor(triangles, core.int32)
    named = {"color": "colors", "normal": "normals"}
    for name, array in mesh.attributes.items():
        theirs.vertex[named.get(name, name)] = tensor(_tall(array))
    for name, array in mesh.face_attributes.items():
        theirs.triangle[named.get(name, name)] = tensor(_tall(array[of_face]))
    for name, array in mesh.corner_attributes.items():
        if name != "uv":
            theirs.triangle[f"corner {name}"] = tensor(np.array(array[corners]).reshape(len(triangles), 3, -1))
    uv = mesh.uv
    if uv is not None:
        places = uv[corners] if "corner uv" in mesh.parts else uv[triangles.reshape(-1)]
        theirs.triangle.texture_uvs = tensor(np.array(places).reshape(-1, 3, 2))
    texture = mesh.texture
    if texture is not None:
        theirs.material.set_default_properties()
        theirs.material.material_name = "defaultLit"
        theirs.material.texture_maps["albedo"] = open3d.t.geometry.Image(tensor(np.array(texture.pixels)))
    lost = [part.name for part in _other_parts(mesh)]
    if legacy:
        lost += [name for name in mesh.attributes if name not in ("color", "normal", "uv")]
        lost += [f"face {name}" for name in mesh.face_attributes]
        lost += [f"corner {name}" for name in mesh.corner_attributes if name != "uv"]
        theirs = _legacy(open3d, theirs, texture)
    if lost:
        warnings.warn(f"Open3D has no place for {', '.join(lost)}: left out", stacklevel=3)
    return theirs


def _legacy(open3d: Any, theirs: Any, texture: Any) -> Any:
    """Converts a tensor mesh of Open3D to a legacy one."""
    import numpy as np

    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(theirs.vertex.positions.numpy()),
        open3d.utility.Vector3iVector(theirs.triangle.indices.numpy()),
    )
    if "normals" in theirs.vertex:
        mesh.vertex_normals = open3d.utility.Vector3dVector(theirs.vertex.normals.numpy())
    if "colors" in theirs.vertex:
        mesh.vertex_colors = open3d.utility.Vector3dVector(theirs.vertex.colors.numpy() / 255.0)
    if "texture_uvs" in theirs.triangle:
        mesh.triangle_uvs = open3d.utility.Vector2dVector(theirs.triangle.texture_uvs.numpy().reshape(-1, 2))
    if texture is not None:
        # Textures of legacy meshes begin with the lowest row.
        mesh.textures = [open3d.geometry.Image(np.array(texture.pixels[::-1]))]
        mesh.triangle_material_ids = open3d.utility.IntVector([0] * len(mesh.triangles))
    return mesh


def _tall(array: NDArray[Any]) -> NDArray[Any]:
    """A copy of an array as (n, numbers of an element), as Open3D stores attributes."""
    import numpy as np

    return np.array(array).reshape(len(array), -1)


def _add_tensors(parts: _Parts, on: str, tensors: Any, skip: Any = ()) -> None:
    """Adds the named attributes of Open3D."""
    for name in sorted(name for name, _ in tensors.items()):
        if name in skip or str(name).startswith("__"):
            continue
        array = tensors[name].cpu().numpy()
        if on == "face" and name.startswith("corner "):
            _add(parts, "corner", name[len("corner ") :], array)
        else:
            known = {"colors": "color", "normals": "normal"}.get(name, name)
            _add(parts, on, known, array, opaque=known == "color")


def _from_open3d(theirs: Any) -> _Parts:
    """The columns of a mesh of Open3D."""
    import numpy as np

    faces = theirs.triangle.indices.cpu().numpy()
    parts: _Parts = _arrays_of(theirs.vertex.positions.cpu().numpy(), faces)
    _add_tensors(parts, "vertex", theirs.vertex, skip=("positions",))
    _add_tensors(parts, "face", theirs.triangle, skip=("indices", "texture_uvs"))
    if "texture_uvs" in theirs.triangle:
        uv = theirs.triangle.texture_uvs.cpu().numpy().reshape(-1, 2).astype(np.float64)
        at_vertices = parts.get("uv")
        if at_vertices is None or not np.array_equal(_array(at_vertices)[faces.reshape(-1)], uv):
            parts.pop("uv", None)
            parts["corner uv"] = Part("corner uv", "corner", "number", uv)
    maps = dict(theirs.material.texture_maps.items()) if theirs.has_valid_material() else {}
    if "albedo" in maps:
        _add_texture(parts, maps["albedo"].as_tensor().cpu().numpy())
    return parts


def _from_legacy_open3d(theirs: Any) -> _Parts:
    """The columns of a legacy mesh of Open3D."""
    import numpy as np

    parts: _Parts = _arrays_of(np.asarray(theirs.vertices), np.asarray(theirs.triangles))
    if theirs.has_vertex_colors():
        _add(parts, "vertex", "color", theirs.vertex_colors)
    if theirs.has_vertex_normals():
        _add(parts, "vertex", "normal", theirs.vertex_normals)
    if theirs.has_triangle_uvs():
        _add(parts, "corner", "uv", theirs.triangle_uvs)
    # A texture without pixels cannot be converted to an array.
    textures = [np.asarray(texture) for texture in theirs.textures if not texture.is_empty()]
    if textures:
        # Textures of legacy meshes begin with the lowest row.
        _add_texture(parts, textures[0][::-1])
    if len(textures) > 1:
        warnings.warn(f"the mesh has {len(textures)} textures, of which the first one is kept", stacklevel=5)
    return parts


def _add_texture(parts: _Parts, picture: Any) -> None:
    """Adds a texture without its alpha, or warns if it cannot be converted."""
    import numpy as np

    if isinstance(picture, np.ndarray):
        tall = picture.reshape(*picture.shape[:2], -1)
        picture = tall[..., :3] if tall.shape[2] >= 3 else np.repeat(tall[..., :1], 3, axis=2)
    try:
        pictures = _pictures.texture_parts(picture)
    except ValueError as error:
        warnings.warn(f"the picture of the mesh is left out: {error}", stacklevel=6)
        return
    parts.update({name: part for name, part in pictures.items() if part[1] is not None})


# PyVista


def to_pyvista(mesh: Mesh) -> Any:
    """Converts a mesh to PyVista."""
    import numpy as np

    pyvista = importlib.import_module("pyvista")
    offsets, corners = mesh.offsets, mesh.corners.astype(np.int64)
    # In VTK, each face begins with the number of its corners.
    flat = np.insert(corners, offsets[:-1], np.diff(offsets))
    theirs = pyvista.PolyData(np.array(mesh.vertices), faces=flat) if len(flat) else pyvista.PolyData(np.array(mesh.vertices))
    for name, array in mesh.attributes.items():
        theirs.point_data[name] = np.array(array)
    if "uv" in mesh.attributes:
        theirs.point_data.active_texture_coordinates_name = "uv"
    for name, array in mesh.face_attributes.items():
        theirs.cell_data[name] = np.array(array)
    rest = [mesh.parts[f"corner {name}"] for name in mesh.corner_attributes] + _other_parts(mesh)
    rest += [mesh.parts[name] for name in ("texture", "texture size") if name in mesh.parts]
    for part in rest:
        array = np.array(part.array)
        array = array.astype(np.uint8) if array.dtype == np.bool_ else array
        theirs.field_data[f"{_PREFIX}|{part.on}|{part.meaning}|{part.name}"] = array
    return theirs


def _from_pyvista(theirs: Any) -> _Parts:
    """The columns of a mesh of PyVista."""
    import numpy as np

    if not hasattr(theirs, "faces") or not hasattr(theirs, "lines"):
        raise TypeError(f"a mesh of PyVista is a PolyData, not a {type(theirs).__name__}; its `extract_surface()` is one")
    flat = np.asarray(theirs.faces)
    sides = _sides(flat)
    starts = np.cumsum(sides + 1) - sides - 1
    corners = np.delete(flat, starts)
    faces: Any
    if len(sides) and (sides == sides[0]).all():
        faces = corners.reshape(-1, sides[0])
    else:
        faces = np.split(corners, np.cumsum(sides)[:-1]) if len(sides) else []
    parts: _Parts = _arrays_of(theirs.points, faces)
    uv = theirs.point_data.active_texture_coordinates_name
    _add_all(parts, "vertex", theirs.point_data, skip=(uv,))
    if uv is not None:
        _add(parts, "vertex", "uv", theirs.point_data[uv])
    if theirs.n_cells == len(sides):
        _add_all(parts, "face", theirs.cell_data)
    else:
        more = f", and {', '.join(theirs.cell_data)} of cells" if len(theirs.cell_data) else ""
        warnings.warn(f"cells that are no faces are left out{more}", stacklevel=5)
    lost = []
    for name in list(theirs.field_data):
        word, *rest = str(name).split("|", 3)
        if word != _PREFIX or len(rest) != 3:
            continue
        on, meaning, part = rest
        array = np.asarray(theirs.field_data[name])
        if on == "corner" and len(array) != len(corners) or on == "edge" and array[:, :2].max(initial=0) >= len(theirs.points):
            lost.append(part)
        elif on == "whole":
            parts[part] = Part(part, on, meaning, array.reshape(1, -1))
        else:
            parts[part] = Part(part, on, meaning, array)
    if lost:
        warnings.warn(f"the faces have changed: {', '.join(lost)} of before are left out", stacklevel=5)
    return parts


def _sides(flat: NDArray[Any]) -> NDArray[Any]:
    """The number of corners of each face in a list of VTK."""
    import numpy as np

    if len(flat) and len(flat) % (flat[0] + 1) == 0 and (flat[:: flat[0] + 1] == flat[0]).all():
        return np.full(len(flat) // (flat[0] + 1), flat[0])
    sides, at = [], 0
    while at < len(flat):
        sides.append(flat[at])
        at += int(flat[at]) + 1
    return np.array(sides, dtype=np.int64)
