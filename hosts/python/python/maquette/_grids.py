"""Values of pixels: pictures, masks, fields, labels and range images."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Dict, Optional, Sequence, Tuple

from . import _arrays, _pictures
from ._value import Value, _AnyPart, _array_for

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from ._value import _Bytes, _Flags, _Floats, _Indices


class Image(Value):
    """A picture. `pixels`: (rows, columns, 3) of uint8 or uint16, sRGB from 0 to 255 or 65535, or a picture of Pillow. As in files, 16 bits
    are reduced to the upper 8, and alpha is dropped."""

    __slots__ = ()
    KIND = "Image"

    def __init__(self, pixels: Any) -> None:
        self._make({"color": ("pixel", _pictures.pixels_of(pixels))})

    @property
    def pixels(self) -> _Bytes:
        """Colors, (rows, columns, 3), sRGB from 0 to 255, from the upper left; suitable for `PIL.Image.fromarray`."""
        array: _Bytes = self._array("color")
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """The pixels, for NumPy and functions that take arrays, such as `plt.imshow`."""
        return _array_for(self.pixels, dtype, copy)


class Mask(Value):
    """A selection of pixels. `inside`: (rows, columns), true or false."""

    __slots__ = ()
    KIND = "Mask"

    def __init__(self, inside: ArrayLike) -> None:
        self._make({"inside": ("pixel", _grid("inside", inside, None))})

    @property
    def inside(self) -> _Flags:
        """True for each selected pixel, (rows, columns)."""
        import numpy as np

        array: _Flags = self._array("inside").view(np.bool_)
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """True for each selected pixel, for NumPy and functions that take arrays."""
        return _array_for(self.inside, dtype, copy)


class Field(Value):
    """A number for each pixel. `numbers`: (rows, columns), stored in single precision; NaN or masked if missing.

    Warns if floats are rounded; integers that would be rounded are refused.
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
        """The numbers, for NumPy and functions that take arrays."""
        return _array_for(self.numbers, dtype, copy)


class Labels(Value):
    """Components of a mask. `label`: (rows, columns), integers from 0; 0 or masked for pixels without a component.

    Components are numbered from 1 in the order of their first pixel, row by row; warns if that changes numbers.
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
        """The component of each pixel, (rows, columns); 0 for none."""
        array: _Indices = self._array("label")
        return array

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> NDArray[Any]:
        """The component of each pixel, for NumPy and functions that take arrays."""
        return _array_for(self.label, dtype, copy)


class RangeImage(Value):
    """A grid of points, as a sensor captures them. `points`: (rows, columns, 3), in mm, NaN or masked if missing; z away from the sensor, y
    down.

    `points` may also be depths, (rows, columns), in mm, 0 if missing; then `camera` is required. `color`: (rows, columns, 3), sRGB from 0
    to 255. `camera`: focal lengths and principal point in pixels, (fx, fy, cx, cy), with pixel centers at integers.
    """

    __slots__ = ()
    KIND = "RangeImage"

    def __init__(self, points: ArrayLike, color: Any = None, *, camera: Optional[Sequence[float]] = None) -> None:
        import numpy as np

        pinhole = None if camera is None else _arrays.reals("camera", camera, (4,), "(fx, fy, cx, cy)")
        if pinhole is not None and not np.isfinite(pinhole).all():
            raise ValueError(f"`camera`: {_arrays.place(~np.isfinite(pinhole))} is not finite")
        if pinhole is not None and not (pinhole[:2] > 0).all():
            raise ValueError(f"the focal lengths of `camera` are {pinhole[0]} and {pinhole[1]}; expected numbers greater than 0")
        grid = _arrays.numbers("points", points, missing=float("nan"))
        if grid.ndim == 2:
            grid = _unproject(grid, pinhole)
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
        """Returns a copy with other points or colors, with the same number of rows and columns. Camera, pose and all else are kept."""
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
        """Focal lengths and principal point in pixels, (fx, fy, cx, cy); None if unknown."""
        array = self._array_if_any("camera")
        if array is None:
            return None
        fx, fy, cx, cy = array.reshape(-1).tolist()
        return fx, fy, cx, cy

    @property
    def points(self) -> _Floats:
        """Positions, (rows, columns, 3), in mm; NaN if missing."""
        array: _Floats = self._array("point")
        return array

    @property
    def color(self) -> Optional[_Bytes]:
        """Colors, (rows, columns, 3), sRGB from 0 to 255; None if there are none."""
        array: Optional[_Bytes] = self._array_if_any("color")
        return array

    @property
    def filled(self) -> _Flags:
        """True for cells that were filled and not captured, (rows, columns)."""
        import numpy as np

        array: _Flags = self._array("filled").view(np.bool_)
        return array


def _grid(name: str, given: Any, missing: Optional[float]) -> NDArray[Any]:
    """Converts numbers of pixels, (rows, columns)."""
    array = _arrays.numbers(name, given, missing=missing)
    if array.ndim != 2:
        raise ValueError(f"`{name}` is (rows, columns), not {array.shape}")
    return array


def _unproject(depth: NDArray[Any], camera: Optional[_Floats]) -> _Floats:
    """Computes points from the depths of a camera."""
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
