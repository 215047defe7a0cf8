"""The base class of all values: type, hash, columns, pictures and files.

A value never changes. Each access to an array makes a copy, since some libraries, such as VTK, Open3D and PyTorch, write even into
read-only arrays. Keep an array in a variable instead of accessing it in a loop. The copy is read-only, so that an attempt to change the
value is an error; a `.copy()` of it can be changed and made a new value. NumPy is imported on the first access to an array.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Dict, Iterator, List, NamedTuple, Optional, Sequence
from typing import Tuple, Type, TypeVar, Union

from . import _arrays, _maquette

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from ._grids import Image

    _Floats = NDArray[np.float64]
    _Indices = NDArray[np.uint32]
    _Bytes = NDArray[np.uint8]
    _Flags = NDArray[np.bool_]

V = TypeVar("V", bound="Value")


class Part(NamedTuple):
    """A named column of numbers of a value."""

    name: str
    """Its name, such as `position`."""
    on: str
    """The kind of its elements: `vertex`, `corner`, `face`, `edge`, `pixel`, `texel`, `point`, `step`, `entry` or `whole`."""
    meaning: str
    """The meaning of its numbers: `position` (mm), `direction`, `number`, `level` (sRGB, 0 to 255), `index` (from 0) or `exact`."""
    array: NDArray[Any]
    """The numbers, (n,) or (n, numbers of an element); (rows, columns, ..) on pixels. A read-only copy."""


_AnyPart = Union[Part, Tuple[str, Any]]
"""A column as a `Part`, or the kind of its elements and an array, which is None if there is no such column."""


def _array_of(part: _AnyPart) -> Any:
    return part.array if isinstance(part, Part) else part[1]


class _Parts(Mapping[str, Part]):
    """The columns of a value by name; each access makes a copy."""

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
    """The result of a comparison of two values."""

    verdict: str
    """`identical`, `same but reordered`, `within tolerance` or `different`."""
    reasons: List[str]
    """The differences, as text."""
    measures: Dict[str, Dict[str, Any]]
    """The measures by name, such as `surface`: `max`, `rms`, `p99`, `differing`, `unit`, `worst`."""

    def __bool__(self) -> bool:
        """True if the values are equal or their differences are allowed."""
        return self.verdict != "different"


def _array_for(array: NDArray[Any], dtype: Any, copy: Optional[bool]) -> NDArray[Any]:
    """The result of `__array__` for an array, which is a copy already."""
    if copy is False:
        raise ValueError("arrays of values are copies")
    if dtype is None or dtype == array.dtype:
        # A requested copy must be writable.
        return array.copy() if copy else array
    return array.astype(dtype)


def _copy(column: _maquette.Column) -> NDArray[Any]:
    """The numbers of a column as an array that cannot be made writable by its flags."""
    import numpy as np

    array: NDArray[Any] = np.array(column)
    array.flags.writeable = False
    return array.view()


class Value:
    """A value of an output, a node or a file.

    Two values are equal if their types and contents are equal; `hash` is the hash of the content. Values can be pickled.
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
        """Creates a value of the type `kind` from columns by name. A column is a `Part`, as in `parts` of a value, or a tuple of the kind
        of its elements and an array of numbers.

        `Value.from_parts("Points", {"position": ("point", [[0, 0, 0]])})`. Arrays are (n,), (n, numbers of an element) or, on pixels,
        (rows, columns, ..). `facts` are those of `Value.facts`; facts that follow from arrays may be omitted.

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
        """Initializes this value from the parts that are not None."""
        given = {name: part for name, part in parts.items() if _array_of(part) is not None}
        self._native = Value.from_parts(self.KIND, given, facts)._native
        self._parts = None

    @property
    def kind(self) -> str:
        """The name of its type in graph files: `Mesh`."""
        return self._native.kind

    @property
    def hash(self) -> str:
        """The hash of its content, 64 hexadecimal digits, the same as on the command line."""
        return self._native.hash

    @property
    def nbytes(self) -> int:
        """The size in memory, in bytes."""
        return self._native.size

    @property
    def facts(self) -> Dict[str, Any]:
        """Counts, sizes and kinds, by name."""
        return self._native.facts()

    @property
    def summary(self) -> Dict[str, Any]:
        """The facts that `maquette inspect` prints, by name: counts, bounds in mm, topology."""
        return self._native.describe()

    @property
    def parts(self) -> Mapping[str, Part]:
        """All columns by name; each access makes a copy."""
        return self._columns

    @property
    def _columns(self) -> _Parts:
        if self._parts is None:
            self._parts = _Parts(self._native.columns())
        return self._parts

    def probe(self, column: int, row: int) -> Dict[str, Any]:
        """The data of a pixel, by name; empty if the value has no pixels."""
        return self._native.probe((column, row))

    def to_bytes(self, ending: str) -> bytes:
        """The content of a file with this extension, `"glb"` or `".ply"`: the bytes that `save` writes. Warns of data that the file cannot
        hold.

        Raises ValueError if such files cannot hold this type of value, or if the value needs several files, which `save` writes.
        """
        files, doubts = self._native.files("value." + ending.lstrip("."))
        for doubt in doubts:
            warnings.warn(doubt, stacklevel=2)
        if len(files) != 1:
            names = ", ".join(name for name, _ in files)
            raise ValueError(f"as `{ending}` this is several files ({names}): save() writes them")
        return files[0][1]

    def save(self, path: Union[str, os.PathLike[str]]) -> List[str]:
        """Writes the value to a file in the format of its extension, with the bytes that `maquette run --no-provenance` writes. Returns the
        paths of all written files. `Run.write` also stores the provenance.

        Warns of data that the file cannot hold, as `Run.write` does. A mesh with a `frame`, which comes from a capture, has other axes in
        files, with y up: the signs of y and z are the opposite of those of its `vertices`, which are in the axes of the sensor.

        Each file is written completely or not at all, and only regular files are replaced. Raises ValueError if such files cannot hold this
        type of value, OSError if a file cannot be written.
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
        """Renders the value, with the same result as `maquette render`.

        `yaw` and `pitch` are degrees to the right and above the front, `zoom` is .001 to 1000. `size`: columns and rows of pixels, by
        default 800 x 600, or the size of a value that is a flat picture. Raises ValueError if the value cannot be shown.
        """
        for name, number, limit in (("yaw", yaw, 1e9), ("pitch", pitch, 1e9), ("zoom", zoom, 1e3)):
            if not abs(number) <= limit:
                raise ValueError(f"{name} is {number}")
        columns, rows = (1, 1) if size is None else size
        if not 1e-3 <= zoom or not (1 <= columns <= 16384 and 1 <= rows <= 16384):
            raise ValueError(f"a picture has 1 to 16384 pixels a side and a zoom of .001 to 1000, not {size} and {zoom}")
        from ._grids import Image

        picture = self._native.render(size, yaw, pitch, zoom, orthographic)
        if picture is None:
            raise ValueError(f"this {self.kind} shows nothing")
        return wrap_as(Image, picture)

    def __eq__(self, other: object) -> bool:
        """True if types and contents are equal."""
        return self.hash == other.hash if isinstance(other, Value) else NotImplemented

    def __hash__(self) -> int:
        """Derived from the hash of the content."""
        return int(self.hash[:15], 16)

    def __reduce__(self) -> Tuple[Any, ...]:
        """Pickles a value as its parts."""
        return Value.from_parts, (self.kind, dict(self.parts), self.facts)

    def __repr__(self) -> str:
        """The type and the facts."""
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
        """Compares another value with this one, as `maquette compare` does: returns the verdict, the reasons and the measures.

        `max`, `rms`: the maximum distance (mm) or difference, and the maximum root mean square. `normals`: the maximum angle, in degrees.
        `attributes`: the maximum difference of each attribute, by name. `differing`: the fraction of pixels that may differ. `level`: the
        difference of color channels to ignore, 0 to 255. `relative`: the relative difference of numbers to ignore. `remeshed`: allow a mesh
        to have other faces.
        """
        if not isinstance(other, Value):
            raise TypeError(f"expected a value to compare with, found a {type(other).__name__}")
        told = self._native.compare(
            other._native, max, rms, normals, dict(attributes or {}), differing, level, relative, remeshed
        )
        return Comparison(told["verdict"], told["reasons"], {measure.pop("name"): measure for measure in told["measures"]})

    def _picture(self) -> Optional[bytes]:
        """The picture for notebooks, as PNG."""
        picture = self._native.render((480, 360), *LOOK)
        return picture.files("it.png")[0][0][1] if picture else None

    def _repr_html_(self) -> str:
        """A small picture, facts and columns, for notebooks."""
        from ._show import value_html

        return value_html(self)

    def _array(self, name: str) -> Any:
        """The array of a column; raises AttributeError if the value has no such column."""
        part = self.parts.get(name)
        if part is None:
            raise AttributeError(f"this {self.kind} has no `{name}`; it has {', '.join(self.parts)}")
        return part.array

    def _array_if_any(self, name: str) -> Any:
        part = self.parts.get(name)
        return None if part is None else part.array


LOOK = (0.0, 0.0, 1.0, False)
"""The camera for pictures in notebooks: yaw, pitch, zoom, orthographic."""


def wrap(native: _maquette.Value) -> Value:
    """Wraps a native value in the class of its type; in `Value` if its type comes from another pack."""
    from ._values import CLASSES

    return wrap_as(CLASSES.get(native.kind, Value), native)


def wrap_as(kind: Type[V], native: _maquette.Value) -> V:
    """Wraps a native value in this class."""
    value = kind.__new__(kind)
    value._native = native
    value._parts = None
    return value
