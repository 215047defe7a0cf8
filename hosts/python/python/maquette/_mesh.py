"""Meshes and points, with attributes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Dict, Iterator, Optional, Sequence, Tuple

from . import _arrays, _pictures
from ._value import Part, Value, _AnyPart, _array_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from ._grids import Image
    from ._value import _Floats, _Indices


class Mesh(Value):
    """Vertices, and faces of three or more corners, with attributes and a texture.

    `vertices`: (n, 3), in mm; or a whole mesh: of trimesh, Open3D or PyVista with all of its data, or any object with `.vertices` and
    `.faces`. `faces`: (m, corners) numbers of vertices from 0, or a list of lists if faces have several sizes; counterclockwise from
    outside. `uv`: (n, 2) for vertices, or one row for each corner. `texture`: a picture, (rows, columns, 3). Further keywords are
    attributes of vertices, (n,) to (n, 3): `Mesh(v, f, heat=..)`; those of corners and faces are passed as dicts. Integers are ids from 0
    to 4294967295, bools are flags, (n, 3) of uint8 are colors, and all others are numbers. `color` may also be floats from 0 to 1. `like`:
    a mesh from which frame, creases and camera are copied.

    Raises ValueError with the number or corner that is wrong.
    """

    __slots__ = ()
    KIND = "Mesh"

    def __init__(
        self,
        vertices: Any,
        faces: Any = None,
        *,
        uv: Optional[ArrayLike] = None,
        texture: Any = None,
        corner_attributes: Optional[Mapping[str, ArrayLike]] = None,
        face_attributes: Optional[Mapping[str, ArrayLike]] = None,
        like: Optional[Mesh] = None,
        **attributes: ArrayLike,
    ) -> None:
        parts: Dict[str, _AnyPart] = {}
        if like is not None:
            parts = {name: part for name, part in like.parts.items() if part.on in ("whole", "edge") and name != "texture size"}
        if faces is None:
            from . import _peers

            parts.update(_peers.parts_of_mesh(vertices))
        else:
            parts.update(vertices_and_faces(vertices, faces))
        if uv is not None:
            parts.update(_uv(uv, parts))
        if texture is not None:
            parts.update(_pictures.texture_parts(texture))
        parts.update(_attributes("vertex", attributes))
        parts.update(_attributes("corner", corner_attributes))
        parts.update(_attributes("face", face_attributes))
        self._make(parts)

    def replace(
        self,
        vertices: Any = None,
        faces: Any = None,
        *,
        uv: Any = ...,
        texture: Any = ...,
        corner_attributes: Optional[Mapping[str, Optional[ArrayLike]]] = None,
        face_attributes: Optional[Mapping[str, Optional[ArrayLike]]] = None,
        **attributes: Optional[ArrayLike],
    ) -> Mesh:
        """Returns a copy with other vertices, faces, texture or attributes, in the forms that `Mesh` takes. All else is kept, including the
        frame of a capture. None removes something: `mesh.replace(mesh.vertices * 2, heat=None)`.

        Raises ValueError if kept data does not fit, such as attributes of faces that were replaced.
        """
        parts: Dict[str, _AnyPart] = dict(self.parts)
        if vertices is not None:
            parts["position"] = ("vertex", _arrays.positions("vertices", vertices))
        if faces is not None:
            parts.update(_faces(faces))
        if uv is not ...:
            parts.update({"uv": ("vertex", None), "corner uv": ("corner", None)})
            parts.update({} if uv is None else _uv(uv, parts))
        if texture is not ...:
            parts.update(_pictures.texture_parts(texture))
        parts.update(_attributes("vertex", attributes))
        parts.update(_attributes("corner", corner_attributes))
        parts.update(_attributes("face", face_attributes))
        mesh = Mesh.__new__(Mesh)
        mesh._make(parts)
        return mesh

    def to_trimesh(self) -> Any:
        """Converts to a `trimesh.Trimesh` in mm, with all data. `Mesh` of the result is this mesh again, except that faces are triangles.
        trimesh must be installed."""
        from . import _peers

        return _peers.to_trimesh(self)

    def to_open3d(self, *, legacy: bool = False) -> Any:
        """Converts to an `open3d.t.geometry.TriangleMesh` with attributes and texture, or, with `legacy`, to an
        `open3d.geometry.TriangleMesh`, which has fewer of them. Warns of data that Open3D cannot hold; `Mesh(theirs, like=mesh)` restores
        the frame of a capture and creases. Open3D must be installed."""
        from . import _peers

        return _peers.to_open3d(self, legacy)

    def to_pyvista(self) -> Any:
        """Converts to a `pyvista.PolyData` with all data. `Mesh` of the result is this mesh again. `pyvista.Texture` takes
        `mesh.texture.pixels`. PyVista must be installed."""
        from . import _peers

        return _peers.to_pyvista(self)

    @property
    def vertices(self) -> _Floats:
        """The positions of the vertices, (n, 3), in mm."""
        array: _Floats = self._array("position")
        return array

    @property
    def faces(self) -> _Indices:
        """The vertices of the faces, (m, corners of a face), counterclockwise from outside.

        Raises ValueError if faces have several sizes; use `corners` and `offsets`, or `triangles`, then.
        """
        array: _Indices = self._array("corners")
        if array.ndim != 2:
            raise ValueError("the faces have several sizes: see corners and offsets, or triangles")
        return array

    @property
    def corners(self) -> _Indices:
        """The vertices of all faces, one face after the other, (corners,)."""
        array: _Indices = self._array("corners").reshape(-1)
        return array

    @property
    def offsets(self) -> NDArray[np.int64]:
        """The index in `corners` at which each face begins, and the end: (m + 1,)."""
        import numpy as np

        sides = self._array_if_any("sides")
        if sides is None:
            corners = self._array("corners")
            return np.arange(len(corners) + 1) * (corners.shape[1] if corners.ndim == 2 else 1)
        return np.concatenate([[0], np.cumsum(sides, dtype=np.int64)])

    @property
    def triangles(self) -> _Indices:
        """The faces as triangles, (t, 3); larger faces are divided along diagonals inside of them."""
        import numpy as np

        return np.asarray(self._native.triangles())

    @property
    def edges(self) -> _Indices:
        """The two vertices of each edge, (e, 2), the lower one first."""
        return self._edges()[0]

    @property
    def corner_edge(self) -> _Indices:
        """For each corner the edge from it to the next corner of its face, (corners,)."""
        return self._edges()[1]

    def _edges(self) -> Tuple[_Indices, _Indices]:
        import numpy as np

        edges = self._native.edges()
        assert edges is not None
        return np.asarray(edges[0]), np.asarray(edges[1])

    @property
    def attributes(self) -> Mapping[str, NDArray[Any]]:
        """Attributes of vertices, by name: `mesh.attributes["curvature"]`, (n,) or (n, numbers)."""
        return _Attributes(self, "vertex", ("position",))

    @property
    def corner_attributes(self) -> Mapping[str, NDArray[Any]]:
        """Attributes of corners, by name, in the order of `corners`."""
        return _Attributes(self, "corner", ("corners",))

    @property
    def face_attributes(self) -> Mapping[str, NDArray[Any]]:
        """Attributes of faces, by name."""
        return _Attributes(self, "face", ("corners", "sides"))

    @property
    def bounds(self) -> Optional[_Floats]:
        """The minimum and maximum coordinates, (2, 3), in mm; None without vertices."""
        import numpy as np

        vertices = self.vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)]) if len(vertices) else None

    @property
    def area(self) -> float:
        """The total area of the faces, in mm²."""
        import numpy as np

        a, b, c = self._triangle_corners()
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        """The volume that the faces enclose, in mm³; negative if they are clockwise from outside, and meaningless if the mesh is open."""
        import numpy as np

        a, b, c = self._triangle_corners()
        origin = a[:1]
        return float(np.einsum("ij,ij->", a - origin, np.cross(b - origin, c - origin)) / 6)

    def _triangle_corners(self) -> Tuple[_Floats, _Floats, _Floats]:
        """The positions of the first, second and third corners of the triangles."""
        vertices, triangles = self.vertices, self.triangles
        return vertices[triangles[:, 0]], vertices[triangles[:, 1]], vertices[triangles[:, 2]]

    @property
    def vertex_normals(self) -> _Floats:
        """A unit vector for each vertex, (n, 3): the area-weighted mean normal of its faces, independent of the attribute `normal`."""
        import numpy as np

        return np.asarray(self._native.normals())

    @property
    def face_normals(self) -> _Floats:
        """A unit normal for each face, (m, 3), on its counterclockwise side; 0 for faces without area."""
        import numpy as np

        a, b, c = self._triangle_corners()
        of_face = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets) - 2)
        vectors = np.zeros((len(self.offsets) - 1, 3))
        np.add.at(vectors, of_face, np.cross(b - a, c - a))
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        normals: _Floats = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
        return normals

    @property
    def uv(self) -> Optional[_Floats]:
        """Texture coordinates, (n, 2) for vertices or (corners, 2), from the lower left; None if there are none."""
        array: Optional[_Floats] = self._array_if_any("uv")
        return self._array_if_any("corner uv") if array is None else array

    @property
    def texture(self) -> Optional[Image]:
        """The texture; None if there is none."""
        return _pictures.texture_of(self.parts)


class Points(Value):
    """Points in space. `positions`: (n, 3), in mm; attributes are keywords, as in `Mesh`: `Points(p, normal=..)`.

    Also takes point clouds of trimesh, Open3D and PyVista with all of their data, and any object with `.points` or `.vertices`.
    """

    __slots__ = ()
    KIND = "Points"

    def __init__(self, positions: Any, **attributes: ArrayLike) -> None:
        from . import _peers

        parts = _peers.parts_of_points(positions)
        parts.update(_attributes("point", attributes))
        self._make(parts)

    @staticmethod
    def _positions(given: Any) -> Dict[str, _AnyPart]:
        """The column of points without attributes."""
        return {"position": ("point", _arrays.positions("positions", given))}

    @property
    def positions(self) -> _Floats:
        """The positions, (n, 3), in mm."""
        array: _Floats = self._array("position")
        return array

    @property
    def attributes(self) -> Mapping[str, NDArray[Any]]:
        """Attributes by name, (n,) or (n, numbers)."""
        return _Attributes(self, "point", ("position",))


class _Attributes(Mapping[str, "NDArray[Any]"]):
    """Attributes of one kind of elements, by name."""

    def __init__(self, value: Value, on: str, own: Sequence[str]) -> None:
        prefix = "" if on in ("vertex", "point") else on + " "
        self._parts, self._on = value._columns, on
        self._names = {name[len(prefix) :]: name for name in self._parts.names_on(on) if name not in own}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._names:
            known = ", ".join(self._names) or "none"
            raise KeyError(f"no attribute `{name}` of {self._on} elements; there are: {known}")
        return self._parts[self._names[name]].array

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return repr(dict(self))


OWN_PARTS = ("position", "corners", "sides", "creases", "frame", "pose", "point", "texture size", *_pictures.TEXTURE_PARTS)
"""The names of columns that are not attributes."""


def is_own(name: str) -> bool:
    """Returns True if a column of this name is not an attribute."""
    return name in OWN_PARTS or name.startswith(("corner ", "face "))


def _attributes(on: str, given: Optional[Mapping[str, Any]]) -> Dict[str, _AnyPart]:
    """The columns for attributes of these elements, by the names of columns; None for those to remove."""
    prefix = "" if on in ("vertex", "point") else on + " "
    parts: Dict[str, _AnyPart] = {}
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(f"`{on}_attributes` is a {type(given).__name__}; expected a dict of arrays by name")
    for name, array in (given or {}).items():
        if not isinstance(name, str):
            raise TypeError(f"the name of an attribute is a {type(name).__name__}; expected a str")
        if is_own(name):
            raise ValueError(f"no attribute is called `{name}`, which means something else; give it another name")
        if array is None:
            parts[prefix + name] = (on, None)
        else:
            numbers, meaning = _arrays.attribute(name, array)
            parts[prefix + name] = Part(prefix + name, on, meaning, numbers)
    return parts


def vertices_and_faces(vertices: Any, faces: Any) -> Dict[str, _AnyPart]:
    """The columns of a mesh without attributes."""
    return {"position": ("vertex", _arrays.positions("vertices", vertices)), **_faces(faces)}


def _faces(faces: Any) -> Dict[str, _AnyPart]:
    """The columns for faces."""
    corners = _arrays.faces(faces)
    if isinstance(corners, tuple):
        return {"sides": ("face", corners[0]), "corners": ("corner", corners[1])}
    return {"sides": ("face", None), "corners": ("face", corners)}


def _uv(uv: Any, parts: Mapping[str, _AnyPart]) -> Dict[str, _AnyPart]:
    """The column of texture coordinates: of vertices if the number of rows agrees, else of corners."""
    array = _arrays.reals("uv", uv, (None, 2), "(n, 2)")
    n_vertices, n_corners = len(_array_of(parts["position"])), _array_of(parts["corners"]).size
    if len(array) not in (n_vertices, n_corners):
        raise ValueError(f"uv has {len(array)} places, where there are {n_vertices} vertices and {n_corners} corners")
    if len(array) == n_vertices:
        return {"uv": ("vertex", array), "corner uv": ("corner", None)}
    return {"corner uv": ("corner", array), "uv": ("vertex", None)}
