"""Curves, surfaces, handles and directions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Optional, Tuple

from . import _arrays
from ._value import Value, _AnyPart

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ._value import _Floats


class Curve(Value):
    """A polyline, or a B-spline. `points`: (n, 3), in mm; with `knots` they are the control points of a curve of `degree`."""

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
        """The points, or the control points, (n, 3), in mm."""
        array: _Floats = self._array("point")
        return array

    @property
    def knots(self) -> Optional[_Floats]:
        """The knots of a B-spline; None for a polyline."""
        array: Optional[_Floats] = self._array_if_any("knots")
        return array


class _Net(Value):
    """A value with control points in rows and columns."""

    __slots__ = ()

    @property
    def points(self) -> _Floats:
        """The control points, (rows, columns, 3), in mm."""
        array: _Floats = self._array("point").reshape(*self.facts["control points"], 3)
        return array

    @property
    def weights(self) -> _Floats:
        """The weights of the control points, (rows, columns)."""
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

    By default, the knots are equally spaced and clamped, so that the surface begins and ends in its control points.
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
        knots_u = _clamped_knots(rows, degree[0]) if knots_u is None else knots_u
        knots_v = _clamped_knots(columns, degree[1]) if knots_v is None else knots_v
        parts.update({"knots u": ("entry", _row("knots_u", knots_u)), "knots v": ("entry", _row("knots_v", knots_v))})
        self._make(parts, {**facts, "degree of knots u": degree[0], "degree of knots v": degree[1]})

    @property
    def knots(self) -> Tuple[_Floats, _Floats]:
        """The knots along u and along v."""
        return self._array("knots u"), self._array("knots v")


class KnotVector(Value):
    """The knots of a B-spline with a degree: numbers that never decrease."""

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
    """Handles of a free-form deformation. `at`: positions, (n, 3); `to`: target positions, (n, 3), by default `at`.

    `sigma`: (n, 3), the reach of each handle along the axes; 0 for the default. `weight`: (n,). `space`: `Box` (0 to 1 in the bounding box
    of the deformed value), `Cube` (0 to 1 in the smallest cube around it) or `World` (mm).
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
        """The positions of the handles, (n, 3)."""
        array: _Floats = self._array("at")
        return array

    @property
    def to(self) -> _Floats:
        """The target positions, (n, 3)."""
        array: _Floats = self._array("to")
        return array


class Direction(Value):
    """A direction. `vector`: three numbers, of any length except 0."""

    __slots__ = ()
    KIND = "Direction"

    def __init__(self, vector: ArrayLike) -> None:
        import numpy as np

        vector = _arrays.reals("vector", vector, (3,), "three numbers")
        if not np.isfinite(vector).all():
            raise ValueError(f"`vector`: {_arrays.place(~np.isfinite(vector))} is not finite")
        # Scaled first, since the squares of very large and very small numbers overflow and underflow.
        largest = np.abs(vector).max()
        scaled = vector / largest if largest > 0 else vector
        length = np.linalg.norm(scaled)
        self._make({"direction": ("whole", (scaled / length if length > 0 else scaled).reshape(1, 3))})

    @property
    def vector(self) -> _Floats:
        """The direction, (3,), of length 1."""
        array: _Floats = self._array("direction").reshape(3)
        return array


def _net(points: ArrayLike, weights: Optional[ArrayLike]) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """The parts and facts of a control net."""
    points = _arrays.reals("points", points, (None, None, 3), "(rows, columns, 3)")
    parts: Dict[str, Any] = {"point": ("point", points.reshape(-1, 3))}
    if weights is not None:
        rows, columns, _ = points.shape
        parts["weight"] = ("point", _arrays.reals("weights", weights, (rows, columns), f"({rows}, {columns})").reshape(-1))
    return parts, {"control points": (points.shape[0], points.shape[1])}


def _clamped_knots(points: int, degree: int) -> _Floats:
    """Clamped knots from 0 to 1, equally spaced inside."""
    import numpy as np

    inside = np.linspace(0.0, 1.0, max(points - degree + 1, 2))
    return np.concatenate([np.zeros(degree), inside, np.ones(degree)])


def _row(name: str, given: Any) -> _Floats:
    return _arrays.reals(name, given, (None,), "(n,)")
