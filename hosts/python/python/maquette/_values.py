"""What travels on links: meshes, range images, curves and all else, as NumPy arrays.

A value never changes. Each access to an array makes a copy: some libraries, such as VTK, Open3D and PyTorch, write into arrays that are
read-only. Keep an array in a variable rather than access it in a loop. The copy is read-only, so that a write that was meant for the value is
an error; `.copy()` of it can be changed and made a new value. NumPy is loaded when the first array is accessed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Dict, Iterator, List, NamedTuple, Optional, Sequence
from typing import Tuple, Type, TypeVar, Union

from . import _maquette

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

        row: Optional[int] = None
        columns: List[Tuple[str, str, str, int, NDArray[np.generic]]] = []
        for name, part in parts.items():
            if isinstance(part, Part):
                on, meaning, array = part.on, part.meaning, np.ascontiguousarray(part.array)
            else:
                on, (array, meaning) = part[0], _numbers(name, part[1])
            if on == "pixel":
                if array.ndim < 2:
                    raise ValueError(f"the part `{name}` lies on pixels, so its array has rows and columns")
                row = array.shape[1]
                array = array.reshape(array.shape[0] * array.shape[1], -1)
            if array.ndim not in (1, 2):
                raise ValueError(f"the part `{name}` is (n,) or (n, numbers an element), not {array.shape}")
            width = array.shape[1] if array.ndim == 2 else 1
            columns.append((name, on, meaning, width, array.reshape(-1)))
        return wrap(_maquette.make(kind, columns, list((facts or {}).items()), row))

    def _make(
        self,
        parts: Mapping[str, Tuple[str, Any]],
        facts: Optional[Mapping[str, object]] = None,
    ) -> None:
        """Becomes the value that is made of the parts that are not None."""
        given = {name: part for name, part in parts.items() if part[1] is not None}
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
        """The content of the file of this ending, `"glb"` or `".ply"`, as the command line writes it.

        Raises ValueError if no such file holds this type of values, or several belong together: then `save` writes them.
        """
        files = self._native.files("value." + ending.lstrip("."))
        if len(files) != 1:
            names = ", ".join(name for name, _ in files)
            raise ValueError(f"as `{ending}` this is several files ({names}): save() writes them")
        return files[0][1]

    def save(self, path: Union[str, os.PathLike[str]]) -> List[str]:
        """Writes it to a file, whose ending says how, and gives the paths of all files that were written.

        Each file appears whole or not at all, and only plain files are replaced. Raises ValueError if no such file holds this type of
        values, OSError if one cannot be written.
        """
        return [os.fspath(file) for file in self._native.save(path)]

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

    def _repr_png_(self) -> Optional[bytes]:
        """Its picture, for notebooks."""
        picture = self._native.render((480, 360), *LOOK)
        return picture.files("it.png")[0][1] if picture else None

    def _repr_html_(self) -> str:
        """Its picture, facts and columns, for notebooks."""
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

    `vertices`: (n, 3), in mm; or anything with `.vertices` and `.faces` or `.triangles`, as meshes of trimesh and Open3D.
    `faces`: (m, corners) numbers of vertices from 0, or a list of lists where faces have several sizes; counterclockwise from outside.
    `uv`: (n, 2) for vertices, or as many as faces have corners. `texture`: a picture, (rows, columns, 3).
    Further attributes: `Mesh(v, f, heat=..)` of vertices, (n,) to (n, 3); those of corners and faces in dicts of their own. Whole numbers are
    indices, bools are flags, (n, 3) of uint8 are colors, and all else is numbers.

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
        **attributes: ArrayLike,
    ) -> None:
        import numpy as np

        if faces is None:
            whole = vertices
            faces = getattr(whole, "faces", None)
            faces = getattr(whole, "triangles", None) if faces is None else faces
            vertices = getattr(whole, "vertices", None)
            if vertices is None or faces is None:
                kind = type(whole).__name__
                raise TypeError(f"a mesh needs vertices and faces, or something that has both; {kind} has not")
        vertices = np.asarray(vertices, dtype=np.float64)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise ValueError(f"vertices are (n, 3), not {vertices.shape}")
        parts: Dict[str, Tuple[str, Any]] = {"position": ("vertex", vertices)}
        corners = _faces(faces)
        if isinstance(corners, tuple):
            parts["sides"], parts["corners"] = ("face", corners[0]), ("corner", corners[1])
            n_corners = len(corners[1])
        else:
            parts["corners"], n_corners = ("face", corners), corners.size
        if uv is not None:
            uv = np.asarray(uv, dtype=np.float64)
            if len(uv) not in (len(vertices), n_corners):
                raise ValueError(
                    f"uv has {len(uv)} places, where there are {len(vertices)} vertices and {n_corners} corners"
                )
            at_vertices = len(uv) == len(vertices)
            parts["uv" if at_vertices else "corner uv"] = ("vertex" if at_vertices else "corner", uv)
        parts.update({name: ("vertex", array) for name, array in attributes.items()})
        parts.update({f"corner {name}": ("corner", it) for name, it in (corner_attributes or {}).items()})
        parts.update({f"face {name}": ("face", array) for name, array in (face_attributes or {}).items()})
        if texture is not None:
            pixels = texture.pixels if isinstance(texture, Image) else _pixels(texture)
            parts["texture"] = ("texel", pixels.reshape(-1, 3))
            parts["texture size"] = ("whole", np.array([[pixels.shape[1], pixels.shape[0]]], dtype=np.float64))
        self._make(parts)

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
        return np.concatenate([[0], np.cumsum(sides)])

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
    def uv(self) -> Optional[_Floats]:
        """Places in the texture, (n, 2) for vertices or (corners, 2), from the lower left; None if there are none."""
        array: Optional[_Floats] = self._array_if_any("uv")
        return self._array_if_any("corner uv") if array is None else array

    @property
    def texture(self) -> Optional[Image]:
        """The picture on it; None if there is none."""
        pixels, size = self._array_if_any("texture"), self._array_if_any("texture size")
        if pixels is None or size is None:
            return None
        columns, rows = (int(side) for side in size.reshape(-1))
        return Image(pixels.reshape(rows, columns, 3))


class Points(Value):
    """Points in space. `positions`: (n, 3), in mm; attributes as keywords, `Points(p, normal=..)`.

    Takes anything with `.points` or `.vertices`, too, as clouds of Open3D and trimesh.
    """

    __slots__ = ()
    KIND = "Points"

    def __init__(self, positions: Any, **attributes: ArrayLike) -> None:
        import numpy as np

        for name in ("points", "vertices"):
            positions = getattr(positions, name, positions)
        parts = {name: ("point", array) for name, array in attributes.items()}
        self._make({"position": ("point", np.asarray(positions, dtype=np.float64)), **parts})

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
    """A picture. `pixels`: (rows, columns, 3), sRGB from 0 to 255, or a picture of Pillow."""

    __slots__ = ()
    KIND = "Image"

    def __init__(self, pixels: Any) -> None:
        self._make({"color": ("pixel", _pixels(pixels))})

    @property
    def pixels(self) -> _Bytes:
        """Colors, (rows, columns, 3), sRGB from 0 to 255, from the upper left. `PIL.Image.fromarray` takes them as they are."""
        array: _Bytes = self._array("color")
        return array

    def _repr_png_(self) -> Optional[bytes]:
        return self.to_bytes("png")


class Mask(Value):
    """Which pixels belong to something. `inside`: (rows, columns), true or false."""

    __slots__ = ()
    KIND = "Mask"

    def __init__(self, inside: ArrayLike) -> None:
        import numpy as np

        self._make({"inside": ("pixel", np.asarray(inside))})

    @property
    def inside(self) -> _Flags:
        """Whether each pixel belongs to it, (rows, columns)."""
        import numpy as np

        array: _Flags = self._array("inside").view(np.bool_)
        return array


class Field(Value):
    """A number for each pixel. `numbers`: (rows, columns); NaN where there is none."""

    __slots__ = ()
    KIND = "Field"

    def __init__(self, numbers: ArrayLike) -> None:
        self._make({"number": ("pixel", numbers)})

    @property
    def numbers(self) -> NDArray[Any]:
        """The numbers, (rows, columns)."""
        array: NDArray[Any] = self._array("number")
        return array


class Labels(Value):
    """Components of a mask. `label`: (rows, columns), 0 where there is none."""

    __slots__ = ()
    KIND = "Labels"

    def __init__(self, label: ArrayLike) -> None:
        self._make({"label": ("pixel", label)})

    @property
    def label(self) -> _Indices:
        """The component of each pixel, (rows, columns); 0 where there is none."""
        array: _Indices = self._array("label")
        return array


class RangeImage(Value):
    """A grid of points as a sensor saw them. `points`: (rows, columns, 3), in mm, NaN where there is none; z away from the sensor.

    `color`: (rows, columns, 3), sRGB from 0 to 255.
    """

    __slots__ = ()
    KIND = "RangeImage"

    def __init__(self, points: ArrayLike, color: Any = None) -> None:
        color = None if color is None else _pixels(color)
        self._make({"point": ("pixel", points), "color": ("pixel", color)})

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
        parts = {"point": ("point", points), "knots": ("entry", knots), "weight": ("point", weights)}
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
        parts.update({"knots u": ("entry", knots_u), "knots v": ("entry", knots_v)})
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
        self._make({"knots": ("entry", knots)}, {"degree of knots": degree})

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
        parts = {"at": at, "to": to, "sigma": sigma, "weight": weight}
        self._make({name: ("point", array) for name, array in parts.items()}, {"space": space})

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

        vector = np.asarray(vector, dtype=np.float64).reshape(1, -1)
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


def _numbers(name: str, numbers: Any) -> Tuple[NDArray[Any], str]:
    """An array without gaps of one of the kinds of numbers that columns have, and what such numbers mean."""
    import numpy as np

    array, meaning = np.asarray(numbers), "number"
    kind = array.dtype
    if kind.kind == "b":
        array, meaning = array.astype(np.uint8), "exact"
    elif kind == np.uint8 and array.ndim > 1 and array.shape[-1] == 3:
        meaning = "level"
    elif kind.kind in "iu" and kind != np.uint32:
        fits = array.size == 0 or (array.min() >= 0 and array.max() < 2**32)
        array = array.astype(np.uint32 if fits else np.float64)
    elif kind.kind == "f" and kind != np.float32:
        array = array.astype(np.float64, copy=False)
    elif kind.kind not in "uf":
        raise ValueError(f"the part `{name}` holds {kind}, which is no kind of numbers")
    if array.dtype == np.uint32:
        meaning = "index"
    return np.ascontiguousarray(array.astype(array.dtype.newbyteorder("="), copy=False)), meaning


def _faces(faces: Any) -> Any:
    """(m, corners), or the numbers of corners and all corners where faces have several sizes."""
    import numpy as np

    if not isinstance(faces, np.ndarray) and hasattr(faces, "__iter__") and not hasattr(faces, "__array__"):
        lists = [list(face) for face in faces]
        if len({len(face) for face in lists}) > 1:
            sides = np.array([len(face) for face in lists], dtype=np.uint32)
            return sides, _indices([corner for face in lists for corner in face])
        faces = np.array(lists) if lists else np.empty((0, 3), dtype=np.uint32)
    corners = _indices(faces)
    if corners.ndim != 2:
        raise ValueError(f"faces are (m, corners of a face) or lists of corners, not {corners.shape}")
    return corners


def _indices(numbers: Any) -> _Indices:
    import numpy as np

    array = np.asarray(numbers)
    if array.dtype.kind == "f" and array.size == 0:
        array = array.astype(np.uint32)
    if array.dtype.kind not in "iu":
        raise ValueError(f"corners of faces are numbers of vertices, not {array.dtype}")
    if array.size and (array.min() < 0 or array.max() >= 2**32):
        at = np.argmax((array < 0) | (array >= 2**32))
        raise ValueError(f"corner {at} of the faces is {array.reshape(-1)[at]}, which is no vertex")
    return array.astype(np.uint32, copy=False)


def _pixels(picture: Any) -> _Bytes:
    """A picture as (rows, columns, 3) bytes."""
    import numpy as np

    if hasattr(picture, "convert"):
        picture = picture.convert("RGB")
    pixels = np.asarray(picture)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
        raise ValueError(
            f"a picture is (rows, columns, 3) of uint8, sRGB from 0 to 255, not {pixels.shape} of {pixels.dtype}"
        )
    return pixels


def _net(points: ArrayLike, weights: Optional[ArrayLike]) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """The parts and facts of a control net."""
    import numpy as np

    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 3 or points.shape[2] != 3:
        raise ValueError(f"control points are (rows, columns, 3), not {points.shape}")
    parts: Dict[str, Any] = {"point": ("point", points.reshape(-1, 3))}
    if weights is not None:
        parts["weight"] = ("point", np.asarray(weights, dtype=np.float64).reshape(-1))
    return parts, {"control points": points.shape[:2]}


def _clamped(points: int, degree: int) -> _Floats:
    """Knots from 0 to 1, equally spaced inside, each end repeated."""
    import numpy as np

    inside = np.linspace(0.0, 1.0, max(points - degree + 1, 2))
    return np.concatenate([np.zeros(degree), inside, np.ones(degree)])
