"""All classes of values: meshes, range images, curves and others, with their data as NumPy arrays.

The module `_value` has the base class, `_mesh`, `_grids` and `_curves` have the classes; this module maps types to classes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Type

from ._curves import ControlNet, Curve, Direction, Handles, KnotVector, Surface
from ._grids import Field, Image, Labels, Mask, RangeImage
from ._mesh import Mesh, Points
from ._value import Comparison, Part, Value, wrap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ._value import _Floats, _Indices

__all__ = [
    "Comparison",
    "ControlNet",
    "Curve",
    "Direction",
    "Field",
    "Handles",
    "Image",
    "KnotVector",
    "Labels",
    "Mask",
    "Mesh",
    "Part",
    "Points",
    "RangeImage",
    "Region",
    "Surface",
    "Trace",
    "Value",
    "wrap",
]


class Region(Value):
    """A connected set of cells of a range image, with their points. Only graphs create regions."""

    __slots__ = ()
    KIND = "Region"

    @property
    def points(self) -> _Floats:
        """The points of the cells, (n, 3), in mm."""
        array: _Floats = self._array("point")
        return array

    @property
    def cells(self) -> _Indices:
        """The indices of the cells in the range image, row by row, (n,)."""
        array: _Indices = self._array("cell")
        return array


class Trace(Value):
    """The history of an iteration. Only graphs create traces."""

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
        """The root mean square of distances after each step, (n,), in mm."""
        array: _Floats = self._array("rms")
        return array


CLASSES: Dict[str, Type[Value]] = {
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
"""The classes of values by type name."""


def value_of(kind: str, given: Any) -> Value:
    """Converts the argument for an input of this type to a value: returns a value unchanged, or passes the argument to the type's class."""
    if isinstance(given, Value):
        return given
    made = CLASSES.get(kind)
    if made in (None, Region, Trace):
        raise TypeError(f"a {kind} cannot be made of {type(given).__name__}")
    assert made is not None
    return made(**given) if isinstance(given, dict) else made(given)  # type: ignore[call-arg]
