"""What travels on links: meshes, range images, curves and all else, as NumPy arrays.

A value never changes. Each access to an array makes a copy: some libraries, such as VTK, Open3D and PyTorch, write into arrays that are
read-only. Keep an array in a variable rather than access it in a loop. The copy is read-only, so that a write that was meant for the value is
an error; `.copy()` of it can be changed and made a new value. NumPy is loaded when the first array is accessed.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Dict, Iterator, List, NamedTuple, Optional, Sequence
from typing import Tuple, Type, TypeVar, Union

from . import _arrays, _maquette, _pictures

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    _Floats = NDArray[np.float64]
    _Indices = NDArray[np.uint32]
    _Bytes = NDArray[np.uint8]
    _Flags = NDArray[np.bool_]

V = TypeVar("V", bound="Value")


class Part(NamedTuple):
    """A named column of numbers of which a value is made."""

    name: str
    """Its name, such as `position`."""
    on: str
    """What its elements are: `vertex`, `corner`, `face`, `edge`, `pixel`, `texel`, `point`, `step`, `entry` or `whole`."""
    meaning: str
    """What its numbers mean: `position` (mm), `direction`, `number`, `level` (sRGB, 0 to 255), `index` (from 0) or `exact`."""
    array: NDArray[Any]
    """The numbers, (n,) or (n, numbers an element); (rows, columns, ..) on pixels. A read-only copy."""


_AnyPart = Union[Part, Tuple[str, Any]]
"""A column as parts of values have it, or what its elements are and an array; None if there is none."""


class _Parts(Mapping[str, Part]):
    """The columns of a value by name; each access copies one."""

    def __init__(self, columns: Sequence[_maquette.Column]) -> None:
        self._columns = {column.name: column for column in columns}

    def __getitem__(self, name: str) -> Part:
        column = self._columns[name]
        return Part(column.name, column.on, column.meaning, _copy(column))

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def names_on(self, on: str) -> List[str]:
        """The names of the columns of these elements."""
        return [name for name, column in self._columns.items() if column.on == on]


class Comparison(NamedTuple):
    """How two values differ."""

    verdict: str
    """`identical`, `same but reordered`, `within tolerance` or `different`."""
    reasons: List[str]
    """What is different, in words."""
    measures: Dict[str, Dict[str, Any]]
    """What was measured, by name, such as `surface`: `max`, `rms`, `p99`, `differing`, `unit`, `worst`."""

    def __bool__(self) -> bool:
        """Whether the values are equal or their differences are allowed."""
        return self.verdict != "different"


def _array_for(array: NDArray[Any], dtype: Any, copy: Optional[bool]) -> NDArray[Any]:
    """An array as `__array__` gives it. Each access is a copy."""
    if copy is False:
        raise ValueError("arrays of values are copies")
    if dtype is None or dtype == array.dtype:
        # Who asks for a copy means to change it.
        return array.copy() if copy else array
    return array.astype(dtype)


def _copy(column: _maquette.Column) -> NDArray[Any]:
    """The numbers of a column as an array that nobody can make writable by its flags."""
    import numpy as np

    array: NDArray[Any] = np.array(column)
    array.flags.writeable = False
    return array.view()


class Value:
    """A value of a graph: what an output, a node or a file gives.

    Two values are equal if their contents are, and `hash` is that of the content. Values can be pickled.
    """

    __slots__ = ("_native", "_parts", "__weakref__")

    KIND: ClassVar[str] = ""

    _native: _maquette.Value
    _parts: Optional[_Parts]

    def __init__(self) -> None:
        raise TypeError("a value is made by its type, as Mesh(vertices, faces), by Value.from_parts, or by a graph")

    @staticmethod
    def from_parts(
        kind: str,
        parts: Mapping[str, Union[Part, Tuple[str, ArrayLike]]],
        facts: Optional[Mapping[str, object]] = None,
    ) -> Value:
        """A value of the type `kind` that is made of columns: by name, either as `parts` of a value has them, or what its elements are and
        an array of numbers.

        `Value.from_parts("Points", {"position": ("point", [[0, 0, 0]])})`. Arrays are (n,), (n, numbers an element) or, on pixels,
        (rows, columns, ..). `facts` are what `facts` of such a value says; those that follow from arrays may be left out.

        Raises ValueError with the part and the number that are wrong.
        """
        import numpy as np

        grid: Tuple[str, Tuple[int, ...]] = ("", ())
        row: Optional[int] = None
        columns: List[Tuple[str, str, str, int, NDArray[np.generic]]] = []
        for name, part in parts.items():
            if isinstance(part, Part):
                on, meaning, array = part.on, part.meaning, _arrays.contiguous(np.asarray(part.array))
            else:
                on, (array, meaning) = part[0], _arrays.column(name, part[0], part[1])
            if on == "pixel":
                if array.ndim < 2:
                    raise ValueError(f"the part `{name}` lies on pixels, so its array has rows and columns")
                if grid[1] not in ((), array.shape[:2]):
                    raise ValueError(f"`{name}` has {array.shape[:2]} rows and columns, where `{grid[0]}` has {grid[1]}")
                grid, row = (name, array.shape[:2]), array.shape[1]
                array = array.reshape(array.shape[0] * array.shape[1], -1)
            if array.ndim not in (1, 2):
                raise ValueError(f"the part `{name}` is (n,) or (n, numbers an element), not {array.shape}")
            width = array.shape[1] if array.ndim == 2 else 1
            columns.append((name, on, meaning, width, array.reshape(-1)))
        return wrap(_maquette.make(kind, columns, list((facts or {}).items()), row))

    def _make(
        self,
        parts: Mapping[str, _AnyPart],
        facts: Optional[Mapping[str, object]] = None,
    ) -> None:
        """Becomes the value that is made of the parts that are not None."""
        given = {name: part for name, part in parts.items() if _array_of(part) is not None}
        self._native = Value.from_parts(self.KIND, given, facts)._native
        self._parts = None

    @property
    def kind(self) -> str:
        """The name of its type in graph files: `Mesh`."""
        return self._native.kind

    @property
    def hash(self) -> str:
        """The hash of its content, 64 hexadecimal digits; that of the command line."""
        return self._native.hash

    @property
    def nbytes(self) -> int:
        """How much memory it holds, in bytes."""
        return self._native.size

    @property
    def facts(self) -> Dict[str, Any]:
        """Counts, sizes and kinds that tests compare first, by name."""
        return self._native.facts()

    @property
    def summary(self) -> Dict[str, Any]:
        """What `maquette inspect` says of it: counts, bounds in mm, topology, by name."""
        return self._native.describe()

    @property
    def parts(self) -> Mapping[str, Part]:
        """All columns of which it is made, by name; each access copies one."""
        return self._columns

    @property
    def _columns(self) -> _Parts:
        if self._parts is None:
            self._parts = _Parts(self._native.columns())
        return self._parts

    def probe(self, column: int, row: int) -> Dict[str, Any]:
        """What is at a pixel; empty where the value has no pixels."""
        return self._native.probe((column, row))

    def to_bytes(self, ending: str) -> bytes:
        """The content of the file of this ending, `"glb"` or `".ply"`: the bytes that `save` writes. What the file cannot tell of the value is
        a warning.

        Raises ValueError if no such file holds this type of values, or several belong together: then `save` writes them.
        """
        files, doubts = self._native.files("value." + ending.lstrip("."))
        for doubt in doubts:
            warnings.warn(doubt, stacklevel=2)
        if len(files) != 1:
            names = ", ".join(name for name, _ in files)
            raise ValueError(f"as `{ending}` this is several files ({names}): save() writes them")
        return files[0][1]

    def save(self, path: Union[str, os.PathLike[str]]) -> List[str]:
        """Writes it to a file, whose ending says how, and gives the paths of all files that were written: the bytes that
        `maquette run --no-provenance` writes. `Run.write` lets files tell where they came from, too.

        What the file cannot tell of the value is a warning, as of `Run.write`. In files a mesh that has a `frame`, since it came out of a
        capture, stands upright: y and z of its `vertices`, which look along the sensor, have the opposite sign there.

        Each file appears whole or not at all, and only plain files are replaced. Raises ValueError if no such file holds this type of
        values, OSError if one cannot be written.
        """
        files, doubts = self._native.save(path)
        for doubt in doubts:
            warnings.warn(f"{os.fspath(path)}: {doubt}", stacklevel=2)
        return [os.fspath(file) for file in files]

    def render(
        self,
        yaw: float = 0.0,
        pitch: float = 0.0,
        *,
        size: Optional[Tuple[int, int]] = None,
        zoom: float = 1.0,
        orthographic: bool = False,
    ) -> Image:
        """A picture of it, the same as `maquette render` makes.

        `yaw` and `pitch` are degrees to the right and above the front, `zoom` is .001 to 1000. `size`: columns and rows of pixels; without it
        800 x 600, or those of a value that is a flat picture.
        Raises ValueError if there is nothing to see.
        """
        for name, number, limit in (("yaw", yaw, 1e9), ("pitch", pitch, 1e9), ("zoom", zoom, 1e3)):
            if not abs(number) <= limit:
                raise ValueError(f"{name} is {number}")
        columns, rows = (1, 1) if size is None else size
        if not 1e-3 <= zoom or not (1 <= columns <= 16384 and 1 <= rows <= 16384):
            raise ValueError(f"a picture has 1 to 16384 pixels a side and a zoom of .001 to 1000, not {size} and {zoom}")
        picture = self._native.render(size, yaw, pitch, zoom, orthographic)
        if picture is None:
            raise ValueError(f"this {self.kind} shows nothing")
        return _wrapped(Image, picture)

    def __eq__(self, other: object) -> bool:
        """Whether their types and contents are equal."""
        return self.hash == other.hash if isinstance(other, Value) else NotImplemented

    def __hash__(self) -> int:
        """From the hash of its content."""
        return int(self.hash[:15], 16)

    def __reduce__(self) -> Tuple[Any, ...]:
        """Values are pickled by their parts."""
        return Value.from_parts, (self.kind, dict(self.parts), self.facts)

    def __repr__(self) -> str:
        """Its type and facts."""
        facts = ", ".join(f"{name}: {fact}" for name, fact in self.facts.items())
        return f"<{self.kind} {facts}>" if facts else f"<{self.kind}>"

    def compare(
        self,
        other: Value,
        *,
        max: Optional[float] = None,
        rms: Optional[float] = None,
        normals: Optional[float] = None,
        attributes: Optional[Mapping[str, float]] = None,
        differing: float = 0.0,
        level: float = 0.0,
        relative: float = 0.0,
        remeshed: bool = False,
    ) -> Comparison:
        """How another value differs from this one, as `maquette compare` says it: its verdict, the reasons, and what was measured.

        `max`, `rms`: the largest distance (mm) or difference, and its root mean square, that are allowed. `normals`: the largest angle, in
        degrees. `attributes`: the largest difference of each, by name. `differing`: the share of pixels that may differ. `level`: the
        difference of a color channel that does not count, 0 to 255. `relative`: the same of numbers, as a share. `remeshed`: whether a mesh
        may have other faces.
        """
        if not isinstance(other, Value):
            raise TypeError(f"expected a value to compare with, found a {type(other).__name__}")
        told = self._native.compare(
            other._native, max, rms, normals, dict(attributes or {}), differing, level, relative, remeshed
        )
        return Comparison(told["verdict"], told["reasons"], {measure.pop("name"): measure for measure in told["measures"]})

    def _picture(self) -> Optional[bytes]:
        """Its picture for notebooks, a PNG file."""
        picture = self._native.render((480, 360), *LOOK)
        return picture.files("it.png")[0][0][1] if picture else None

    def _repr_html_(self) -> str:
        """Its picture, small, with facts and columns, for notebooks."""
        from ._show import value_html

        return value_html(self)

    def _array(self, name: str) -> Any:
        """A column by its name; raises AttributeError if the value has none."""
        part = self.parts.get(name)
        if part is None:
            raise AttributeError(f"this {self.kind} has no `{name}`; it has {', '.join(self.parts)}")
        return part.array

    def _array_if_any(self, name: str) -> Any:
        part = self.parts.get(name)
        return None if part is None else part.array


LOOK = (0.0, 0.0, 1.0, False)
"""From where notebooks see values: yaw, pitch, zoom, orthographic."""


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


class Mesh(Value):
    """Vertices, and faces of three or more corners, with attributes and a texture.

    `vertices`: (n, 3), in mm; or a mesh as a whole: of trimesh, Open3D or PyVista with all that it has, or anything with `.vertices` and `.faces`.
    `faces`: (m, corners) numbers of vertices from 0, or a list of lists where faces have several sizes; counterclockwise from outside.
    `uv`: (n, 2) for vertices, or as many as faces have corners. `texture`: a picture, (rows, columns, 3).
    Further attributes: `Mesh(v, f, heat=..)` of vertices, (n,) to (n, 3); those of corners and faces in dicts of their own. Integers are
    ids from 0 to 4294967295, bools are flags, (n, 3) of uint8 are colors, and all else is numbers. `color` may be of floats from 0 to 1, too.
    `like`: a mesh whose frame, creases and camera this one has.

    Raises ValueError that says which number or corner is wrong.
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
            parts.update(_vertices_and_faces(vertices, faces))
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
        """The same mesh with other vertices, faces, texture or attributes, as `Mesh` takes them: all else stays, the frame of a capture, too.
        What is None is taken away: `mesh.replace(mesh.vertices * 2, heat=None)`.

        Raises ValueError where what stays does not fit, as attributes of faces that were replaced.
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
        """The mesh as a `trimesh.Trimesh` in mm, with all that it has: `Mesh` of it is this mesh again, but for faces of more corners, which are
        triangles then. trimesh must be installed."""
        from . import _peers

        return _peers.to_trimesh(self)

    def to_open3d(self, *, legacy: bool = False) -> Any:
        """The mesh as an `open3d.t.geometry.TriangleMesh` with its attributes and texture, or as an `open3d.geometry.TriangleMesh`, which has fewer
        of them. What Open3D has no place for is a warning; `Mesh(theirs, like=mesh)` takes the frame of a capture and creases from here.
        Open3D must be installed."""
        from . import _peers

        return _peers.to_open3d(self, legacy)

    def to_pyvista(self) -> Any:
        """The mesh as a `pyvista.PolyData` with all that it has: `Mesh` of it is this mesh again. `mesh.texture.pixels` is what
        `pyvista.Texture` takes. PyVista must be installed."""
        from . import _peers

        return _peers.to_pyvista(self)

    @property
    def vertices(self) -> _Floats:
        """The places of its vertices, (n, 3), in mm."""
        array: _Floats = self._array("position")
        return array

    @property
    def faces(self) -> _Indices:
        """The vertices of its faces, (m, corners of a face), counterclockwise from outside.

        Raises ValueError where faces have several sizes: then `corners` and `offsets` have them, and `triangles` cuts them.
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
        """Where each face begins in `corners`, and the end: (m + 1,)."""
        import numpy as np

        sides = self._array_if_any("sides")
        if sides is None:
            corners = self._array("corners")
            return np.arange(len(corners) + 1) * (corners.shape[1] if corners.ndim == 2 else 1)
        return np.concatenate([[0], np.cumsum(sides, dtype=np.int64)])

    @property
    def triangles(self) -> _Indices:
        """Its faces as triangles, (t, 3), those of more corners cut along diagonals within them."""
        import numpy as np

        return np.asarray(self._native.triangles())

    @property
    def edges(self) -> _Indices:
        """The two vertices of each edge, (e, 2), the lower one first."""
        return self._edges()[0]

    @property
    def corner_edge(self) -> _Indices:
        """For each corner the edge that leads from it to the next corner of its face, (corners,)."""
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
        """The lowest and the highest coordinates, (2, 3), in mm; None without vertices."""
        import numpy as np

        vertices = self.vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)]) if len(vertices) else None

    @property
    def area(self) -> float:
        """The area of its faces, in mm²."""
        import numpy as np

        a, b, c = self._triangle_corners()
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        """What its faces enclose, in mm³; negative if they are clockwise from outside, and without a meaning if the mesh is open."""
        import numpy as np

        a, b, c = self._triangle_corners()
        origin = a[:1]
        return float(np.einsum("ij,ij->", a - origin, np.cross(b - origin, c - origin)) / 6)

    def _triangle_corners(self) -> Tuple[_Floats, _Floats, _Floats]:
        """The first, second and third corners of its triangles."""
        vertices, triangles = self.vertices, self.triangles
        return vertices[triangles[:, 0]], vertices[triangles[:, 1]], vertices[triangles[:, 2]]

    @property
    def vertex_normals(self) -> _Floats:
        """A unit vector for each vertex, (n, 3): the mean direction of its faces by area, whatever its attribute `normal` says."""
        import numpy as np

        return np.asarray(self._native.normals())

    @property
    def face_normals(self) -> _Floats:
        """A unit vector for each face, (m, 3), out of its counterclockwise side; 0 where a face has no area."""
        import numpy as np

        a, b, c = self._triangle_corners()
        of_face = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets) - 2)
        vectors = np.zeros((len(self.offsets) - 1, 3))
        np.add.at(vectors, of_face, np.cross(b - a, c - a))
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)

    @property
    def uv(self) -> Optional[_Floats]:
        """Places in the texture, (n, 2) for vertices or (corners, 2), from the lower left; None if there are none."""
        array: Optional[_Floats] = self._array_if_any("uv")
        return self._array_if_any("corner uv") if array is None else array

    @property
    def texture(self) -> Optional[Image]:
        """The picture on it; None if there is none."""
        return _pictures.texture_of(self.parts)


class Points(Value):
    """Points in space. `positions`: (n, 3), in mm; attributes as keywords, `Points(p, normal=..)`, as those of `Mesh`.

    Takes clouds of trimesh, Open3D and PyVista with all that they have, too, and anything with `.points` or `.vertices`.
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
        """Places, (n, 3), in mm."""
        array: _Floats = self._array("position")
        return array

    @property
    def attributes(self) -> Mapping[str, NDArray[Any]]:
        """Attributes by name, (n,) or (n, numbers)."""
        return _Attributes(self, "point", ("position",))


class Image(Value):
    """A picture. `pixels`: (rows, columns, 3) of uint8 or uint16, sRGB from 0 to 255 or 65535, or a picture of Pillow. As in files, 16 bits are
    cut to the upper 8 and alpha is dropped."""

    __slots__ = ()
    KIND = "Image"

    def __init__(self, pixels: Any) -> None:
        self._make({"color": ("pixel", _pictures.pixels_of(pixels))})

    @property
    def pixels(self) -> _Bytes:
        """Colors, (rows, columns, 3), sRGB from 0 to 255, from the upper left. `PIL.Image.fromarray` takes them as they are."""
        array: _Bytes = self._array("color")
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """Its pixels, for NumPy and what takes arrays, such as `plt.imshow`."""
        return _array_for(self.pixels, dtype, copy)


class Mask(Value):
    """Which pixels belong to something. `inside`: (rows, columns), true or false."""

    __slots__ = ()
    KIND = "Mask"

    def __init__(self, inside: ArrayLike) -> None:
        self._make({"inside": ("pixel", _grid("inside", inside, None))})

    @property
    def inside(self) -> _Flags:
        """Whether each pixel belongs to it, (rows, columns)."""
        import numpy as np

        array: _Flags = self._array("inside").view(np.bool_)
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """Whether each pixel belongs to it, for NumPy and what takes arrays."""
        return _array_for(self.inside, dtype, copy)


class Field(Value):
    """A number for each pixel. `numbers`: (rows, columns), kept in single precision; NaN or masked where there is none.

    Floats that are rounded are a warning, integers that would be are refused.
    """

    __slots__ = ()
    KIND = "Field"

    def __init__(self, numbers: ArrayLike) -> None:
        self._make({"number": ("pixel", _grid("numbers", _arrays.singles("numbers", numbers), None))})

    @property
    def numbers(self) -> NDArray[Any]:
        """The numbers, (rows, columns)."""
        array: NDArray[Any] = self._array("number")
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """Its numbers, for NumPy and what takes arrays."""
        return _array_for(self.numbers, dtype, copy)


class Labels(Value):
    """Components of a mask. `label`: (rows, columns), integers from 0; 0 or masked where there is none.

    They are numbered from 1 in the order in which the rows meet them: other numbers are a warning.
    """

    __slots__ = ()
    KIND = "Labels"

    def __init__(self, label: ArrayLike) -> None:
        label = _grid("label", label, 0)
        if label.dtype.kind != "f":
            label = _arrays.ids("label", label)
        self._make({"label": ("pixel", label)})
        other = self.label != label
        if other.any():
            row, column = divmod(int(other.argmax()), label.shape[1])
            words = f"`label`: {_arrays.place(other)} is {label[row, column]}, kept as {self.label[row, column]}"
            warnings.warn(f"{words}: components are numbered in the order of rows", stacklevel=2)

    @property
    def label(self) -> _Indices:
        """The component of each pixel, (rows, columns); 0 where there is none."""
        array: _Indices = self._array("label")
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """The component of each pixel, for NumPy and what takes arrays."""
        return _array_for(self.label, dtype, copy)


class RangeImage(Value):
    """A grid of points as a sensor saw them. `points`: (rows, columns, 3), in mm, NaN or masked where there is none; z away from the sensor, y down.

    `points` may be depths, too, (rows, columns), in mm, 0 where there is none: then `camera` says how they lie. `color`: (rows, columns, 3), sRGB
    from 0 to 255. `camera`: its focal lengths and principal point in pixels, (fx, fy, cx, cy), pixel centers at integers.
    """

    __slots__ = ()
    KIND = "RangeImage"

    def __init__(self, points: ArrayLike, color: Any = None, *, camera: Optional[Sequence[float]] = None) -> None:
        pinhole = None if camera is None else _arrays.reals("camera", camera, (4,), "(fx, fy, cx, cy)")
        if pinhole is not None and not (pinhole[:2] > 0).all():
            raise ValueError(f"the focal lengths of `camera` are {pinhole[0]} and {pinhole[1]}; expected numbers greater than 0")
        grid = _arrays.numbers("points", points, missing=float("nan"))
        if grid.ndim == 2:
            grid = _unprojected(grid, pinhole)
        grid = _arrays.reals("points", grid, (None, None, 3), "(rows, columns, 3), or (rows, columns) of depths")
        parts: Dict[str, _AnyPart] = {"point": ("pixel", grid)}
        if color is not None:
            pixels = _pictures.pixels_of(color)
            if pixels.shape[:2] != grid.shape[:2]:
                raise ValueError(f"`color` has {pixels.shape[:2]} rows and columns, where `points` has {grid.shape[:2]}")
            parts["color"] = ("pixel", pixels)
        if pinhole is not None:
            parts["camera"] = ("whole", pinhole.reshape(1, 4))
        self._make(parts)

    def replace(self, points: Optional[ArrayLike] = None, *, color: Any = ...) -> RangeImage:
        """The same range image with other points or colors of as many rows and columns: camera, pose and all else stay."""
        parts: Dict[str, _AnyPart] = dict(self.parts)
        if points is not None:
            grid = _arrays.reals("points", points, (None, None, 3), "(rows, columns, 3)", missing=True)
            parts["point"] = ("pixel", grid)
        if color is not ...:
            parts["color"] = ("pixel", None if color is None else _pictures.pixels_of(color))
        image = RangeImage.__new__(RangeImage)
        image._make(parts)
        return image

    @property
    def camera(self) -> Optional[Tuple[float, float, float, float]]:
        """Its focal lengths and principal point in pixels, (fx, fy, cx, cy); None if they are not known."""
        array = self._array_if_any("camera")
        if array is None:
            return None
        fx, fy, cx, cy = array.reshape(-1).tolist()
        return fx, fy, cx, cy

    @property
    def points(self) -> _Floats:
        """Places, (rows, columns, 3), in mm; NaN where there is none."""
        array: _Floats = self._array("point")
        return array

    @property
    def color(self) -> Optional[_Bytes]:
        """Colors, (rows, columns, 3), sRGB from 0 to 255; None if there are none."""
        array: Optional[_Bytes] = self._array_if_any("color")
        return array

    @property
    def filled(self) -> _Flags:
        """Which cells were filled and not seen, (rows, columns)."""
        import numpy as np

        array: _Flags = self._array("filled").view(np.bool_)
        return array


class Region(Value):
    """A connected set of cells of a range image, with their points. Made by graphs."""

    __slots__ = ()
    KIND = "Region"

    @property
    def points(self) -> _Floats:
        """The places of its cells, (n, 3), in mm."""
        array: _Floats = self._array("point")
        return array

    @property
    def cells(self) -> _Indices:
        """The numbers of its cells in the range image, row by row, (n,)."""
        array: _Indices = self._array("cell")
        return array


class Curve(Value):
    """A line through points, or a B-spline. `points`: (n, 3), in mm; with `knots` they are control points of a curve of `degree`."""

    __slots__ = ()
    KIND = "Curve"

    def __init__(
        self,
        points: ArrayLike,
        *,
        closed: bool = False,
        knots: Optional[ArrayLike] = None,
        degree: int = 3,
        weights: Optional[ArrayLike] = None,
    ) -> None:
        parts: Dict[str, _AnyPart] = {"point": ("point", _arrays.positions("points", points))}
        if knots is not None:
            parts["knots"] = ("entry", _row("knots", knots))
        if weights is not None:
            parts["weight"] = ("point", _row("weights", weights))
        self._make(parts, {"closed": closed, **({} if knots is None else {"degree of knots": degree})})

    @property
    def points(self) -> _Floats:
        """Its points, or its control points, (n, 3), in mm."""
        array: _Floats = self._array("point")
        return array

    @property
    def knots(self) -> Optional[_Floats]:
        """The knots of a B-spline; None for a line through its points."""
        array: Optional[_Floats] = self._array_if_any("knots")
        return array


class _Net(Value):
    """What has control points in rows and columns."""

    __slots__ = ()

    @property
    def points(self) -> _Floats:
        """Its control points, (rows, columns, 3), in mm."""
        array: _Floats = self._array("point").reshape(*self.facts["control points"], 3)
        return array

    @property
    def weights(self) -> _Floats:
        """Their weights, (rows, columns)."""
        array: _Floats = self._array("weight").reshape(self.facts["control points"])
        return array


class ControlNet(_Net):
    """A net of control points. `points`: (rows, columns, 3), in mm; `weights`: (rows, columns)."""

    __slots__ = ()
    KIND = "ControlNet"

    def __init__(self, points: ArrayLike, weights: Optional[ArrayLike] = None) -> None:
        self._make(*_net(points, weights))


class Surface(_Net):
    """A NURBS surface. `points`: (rows, columns, 3), in mm; `weights`: (rows, columns); knots along columns (u) and rows (v).

    Without knots they are equally spaced and clamped, so that the surface begins and ends in its control points.
    """

    __slots__ = ()
    KIND = "Surface"

    def __init__(
        self,
        points: ArrayLike,
        weights: Optional[ArrayLike] = None,
        *,
        degree: Tuple[int, int] = (3, 3),
        knots_u: Optional[ArrayLike] = None,
        knots_v: Optional[ArrayLike] = None,
    ) -> None:
        parts, facts = _net(points, weights)
        rows, columns = facts["control points"]
        knots_u = _clamped(rows, degree[0]) if knots_u is None else knots_u
        knots_v = _clamped(columns, degree[1]) if knots_v is None else knots_v
        parts.update({"knots u": ("entry", _row("knots_u", knots_u)), "knots v": ("entry", _row("knots_v", knots_v))})
        self._make(parts, {**facts, "degree of knots u": degree[0], "degree of knots v": degree[1]})

    @property
    def knots(self) -> Tuple[_Floats, _Floats]:
        """The knots along u and along v."""
        return self._array("knots u"), self._array("knots v")


class KnotVector(Value):
    """Knots of a B-spline of some degree: numbers that never decrease."""

    __slots__ = ()
    KIND = "KnotVector"

    def __init__(self, knots: ArrayLike, degree: int = 3) -> None:
        self._make({"knots": ("entry", _row("knots", knots))}, {"degree of knots": degree})

    @property
    def knots(self) -> _Floats:
        """The knots, (n,)."""
        array: _Floats = self._array("knots")
        return array


class Handles(Value):
    """Handles of a free-form deformation. `at`: where they are, (n, 3); `to`: where they are moved, (n, 3), `at` without it.

    `sigma`: (n, 3), how far each reaches along the axes; 0 for the default. `weight`: (n,). `space`: `Box` (0 to 1 in the bounding box of
    what is deformed), `Cube` (0 to 1 in the smallest cube around it) or `World` (mm).
    """

    __slots__ = ()
    KIND = "Handles"

    def __init__(
        self,
        at: ArrayLike,
        to: Optional[ArrayLike] = None,
        *,
        sigma: Optional[ArrayLike] = None,
        weight: Optional[ArrayLike] = None,
        space: str = "Box",
    ) -> None:
        parts: Dict[str, _AnyPart] = {"at": ("point", _arrays.positions("at", at))}
        for name, array in (("to", to), ("sigma", sigma)):
            if array is not None:
                parts[name] = ("point", _arrays.positions(name, array))
        if weight is not None:
            parts["weight"] = ("point", _row("weight", weight))
        self._make(parts, {"space": space})

    @property
    def at(self) -> _Floats:
        """Where they are, (n, 3)."""
        array: _Floats = self._array("at")
        return array

    @property
    def to(self) -> _Floats:
        """Where they are moved, (n, 3)."""
        array: _Floats = self._array("to")
        return array


class Direction(Value):
    """A direction. `vector`: three numbers, of any length but 0."""

    __slots__ = ()
    KIND = "Direction"

    def __init__(self, vector: ArrayLike) -> None:
        import numpy as np

        vector = _arrays.reals("vector", vector, (3,), "three numbers").reshape(1, 3)
        length = np.linalg.norm(vector)
        self._make({"direction": ("whole", vector / length if length > 0 else vector)})

    @property
    def vector(self) -> _Floats:
        """The direction, (3,), of length 1."""
        array: _Floats = self._array("direction").reshape(3)
        return array


class Trace(Value):
    """How an iteration went. Made by graphs."""

    __slots__ = ()
    KIND = "Trace"

    @property
    def iteration(self) -> NDArray[Any]:
        """The number of each step, (n,)."""
        array: NDArray[Any] = self._array("iteration")
        return array

    @property
    def max(self) -> _Floats:
        """The largest distance after each step, (n,), in mm."""
        array: _Floats = self._array("max")
        return array

    @property
    def rms(self) -> _Floats:
        """The root of the mean square of distances after each step, (n,), in mm."""
        array: _Floats = self._array("rms")
        return array


_CLASSES: Dict[str, Type[Value]] = {
    kind.KIND: kind
    for kind in (
        ControlNet,
        Curve,
        Direction,
        Field,
        Handles,
        Image,
        KnotVector,
        Labels,
        Mask,
        Mesh,
        Points,
        RangeImage,
        Region,
        Surface,
        Trace,
    )
}


def wrap(native: _maquette.Value) -> Value:
    """The value as its class; as a plain `Value` if its type comes from a pack of others."""
    return _wrapped(_CLASSES.get(native.kind, Value), native)


def _wrapped(kind: Type[V], native: _maquette.Value) -> V:
    value = kind.__new__(kind)
    value._native = native
    value._parts = None
    return value


def value_of(kind: str, given: Any) -> Value:
    """What is given for an input of this type, as a value: one already, or what the type's class takes."""
    if isinstance(given, Value):
        return given
    made = _CLASSES.get(kind)
    if made in (None, Region, Trace):
        raise TypeError(f"a {kind} cannot be made of {type(given).__name__}")
    assert made is not None
    return made(**given) if isinstance(given, dict) else made(given)  # type: ignore[call-arg]


_OWN_PARTS = ("position", "corners", "sides", "creases", "frame", "pose", "point", "texture size", *_pictures.TEXTURE_PARTS)
"""Names of columns that are no attributes."""


def _attributes(on: str, given: Optional[Mapping[str, Any]]) -> Dict[str, _AnyPart]:
    """The columns for attributes of these elements, by the names of columns; those that are None are to be taken away."""
    prefix = "" if on in ("vertex", "point") else on + " "
    parts: Dict[str, _AnyPart] = {}
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(f"`{on}_attributes` is a {type(given).__name__}; expected a dict of arrays by name")
    for name, array in (given or {}).items():
        if not isinstance(name, str):
            raise TypeError(f"the name of an attribute is a {type(name).__name__}; expected a str")
        if name in _OWN_PARTS or name.startswith(("corner ", "face ")):
            raise ValueError(f"no attribute is called `{name}`, which means something else; give it another name")
        if array is None:
            parts[prefix + name] = (on, None)
        else:
            numbers, meaning = _arrays.attribute(name, array)
            parts[prefix + name] = Part(prefix + name, on, meaning, numbers)
    return parts


def _vertices_and_faces(vertices: Any, faces: Any) -> Dict[str, _AnyPart]:
    """The columns of a mesh without attributes."""
    return {"position": ("vertex", _arrays.positions("vertices", vertices)), **_faces(faces)}


def _faces(faces: Any) -> Dict[str, _AnyPart]:
    """The columns for faces."""
    corners = _arrays.faces(faces)
    if isinstance(corners, tuple):
        return {"sides": ("face", corners[0]), "corners": ("corner", corners[1])}
    return {"sides": ("face", None), "corners": ("face", corners)}


def _uv(uv: Any, parts: Mapping[str, _AnyPart]) -> Dict[str, _AnyPart]:
    """The column for places in the texture: of vertices, if there are as many, else of corners."""
    array = _arrays.reals("uv", uv, (None, 2), "(n, 2)")
    n_vertices, n_corners = len(_array_of(parts["position"])), _array_of(parts["corners"]).size
    if len(array) not in (n_vertices, n_corners):
        raise ValueError(f"uv has {len(array)} places, where there are {n_vertices} vertices and {n_corners} corners")
    if len(array) == n_vertices:
        return {"uv": ("vertex", array), "corner uv": ("corner", None)}
    return {"corner uv": ("corner", array), "uv": ("vertex", None)}


def _array_of(part: _AnyPart) -> Any:
    return part.array if isinstance(part, Part) else part[1]


def _grid(name: str, given: Any, missing: Optional[float]) -> NDArray[Any]:
    """Numbers of pixels, (rows, columns)."""
    array = _arrays.numbers(name, given, missing=missing)
    if array.ndim != 2:
        raise ValueError(f"`{name}` is (rows, columns), not {array.shape}")
    return array


def _row(name: str, given: Any) -> _Floats:
    return _arrays.reals(name, given, (None,), "(n,)")


def _unprojected(depth: NDArray[Any], camera: Optional[_Floats]) -> _Floats:
    """The points at these depths, which a camera saw."""
    import numpy as np

    if camera is None:
        raise ValueError("`points` is (rows, columns): depths need camera=(fx, fy, cx, cy), in pixels")
    if depth.dtype.kind == "b":
        raise ValueError("`points` holds bools; expected depths")
    z = depth.astype(np.float64)
    if (z < 0).any():
        raise ValueError(f"`points`: {_arrays.place(z < 0)} is {z[z < 0][0]}; depths are not negative")
    z[z == 0] = np.nan
    fx, fy, cx, cy = camera
    rows, columns = np.arange(z.shape[0])[:, None], np.arange(z.shape[1])
    return np.stack([(columns - cx) / fx * z, (rows - cy) / fy * z, z], axis=-1)


def _net(points: ArrayLike, weights: Optional[ArrayLike]) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """The parts and facts of a control net."""
    points = _arrays.reals("points", points, (None, None, 3), "(rows, columns, 3)")
    parts: Dict[str, Any] = {"point": ("point", points.reshape(-1, 3))}
    if weights is not None:
        rows, columns, _ = points.shape
        parts["weight"] = ("point", _arrays.reals("weights", weights, (rows, columns), f"({rows}, {columns})").reshape(-1))
    return parts, {"control points": (points.shape[0], points.shape[1])}


def _clamped(points: int, degree: int) -> _Floats:
    """Knots from 0 to 1, equally spaced inside, each end repeated."""
    import numpy as np

    inside = np.linspace(0.0, 1.0, max(points - degree + 1, 2))
    return np.concatenate([np.zeros(degree), inside, np.ones(degree)])
