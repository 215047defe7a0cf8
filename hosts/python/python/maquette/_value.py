"""What all values have in common: a type, a hash, columns, pictures and files.

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


def _array_of(part: _AnyPart) -> Any:
    return part.array if isinstance(part, Part) else part[1]


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
        from ._grids import Image

        picture = self._native.render(size, yaw, pitch, zoom, orthographic)
        if picture is None:
            raise ValueError(f"this {self.kind} shows nothing")
        return wrapped(Image, picture)

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


def wrap(native: _maquette.Value) -> Value:
    """The value as its class; as a plain `Value` if its type comes from a pack of others."""
    from ._values import CLASSES

    return wrapped(CLASSES.get(native.kind, Value), native)


def wrapped(kind: Type[V], native: _maquette.Value) -> V:
    """The value as one of this class."""
    value = kind.__new__(kind)
    value._native = native
    value._parts = None
    return value
