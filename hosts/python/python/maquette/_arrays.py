"""Conversion of array arguments: invalid arrays are refused with the position and the number that is wrong.

Numbers are bools, integers and floats of any size, byte order and layout. Texts, complex numbers, dates and objects are refused. Masked
numbers are missing: they become NaN where values allow missing numbers, and are refused everywhere else.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Optional, Tuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._value import _Floats, _Indices

MAX_INDEX = 2**32 - 1
"""The largest integer that columns can hold."""

_MAX_EXACT = 2**53
"""All integers up to this one are exact in double precision."""


def numbers(name: str, given: Any, *, missing: Optional[float] = None) -> NDArray[Any]:
    """Converts to an array of bools, integers or floats; masked numbers become `missing`, or are refused if it is None."""
    import numpy as np

    array = given if isinstance(given, np.ma.MaskedArray) else np.asarray(given)
    if array.size == 0 and array.dtype.kind == "O":
        array = array.astype(np.float64)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"`{name}` holds {array.dtype}; expected numbers")
    if isinstance(array, np.ma.MaskedArray):
        mask = np.ma.getmaskarray(array)
        if mask.any():
            if missing is None:
                raise ValueError(f"`{name}`: {place(mask)} is masked; expected a number")
            whole = array.dtype.kind in "iu" and float(missing).is_integer()
            kind = array.dtype if whole else np.promote_types(array.dtype, np.float32)
            filled: NDArray[Any] = array.data.astype(kind)
            filled[mask] = missing
            return filled
        return np.asarray(array.data)
    return array


def place(wrong: NDArray[np.bool_]) -> str:
    """The position of the first wrong number of an array, as `number 3` or `number (2, 1)`."""
    import numpy as np

    at = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
    return f"number {at[0]}" if len(at) == 1 else f"number ({', '.join(map(str, at))})"


def reals(name: str, given: Any, shape: Tuple[Optional[int], ...], words: str, *, missing: bool = False) -> _Floats:
    """Converts to an array of double precision of this shape, where None is any length; with `missing`, masked numbers become NaN."""
    import numpy as np

    array = numbers(name, given, missing=float("nan") if missing else None)
    if array.dtype.kind == "b":
        raise ValueError(f"`{name}` holds bools; expected numbers")
    if array.size == 0 and array.shape == (0,):
        array = array.reshape([length or 0 for length in shape])
    fits = array.ndim == len(shape) and all(want in (None, has) for want, has in zip(shape, array.shape))
    if not fits:
        raise ValueError(f"`{name}` is {words}, not {array.shape}")
    return array.astype(np.float64, copy=False)


def positions(name: str, given: Any) -> _Floats:
    """Converts positions, (n, 3)."""
    return reals(name, given, (None, 3), "(n, 3)")


def attribute(name: str, given: Any) -> Tuple[NDArray[Any], str]:
    """Converts an attribute; returns its numbers and their meaning: bools are flags, integers are ids from 0, `color` and (n, 3) of uint8
    are colors, and floats are numbers, where masked ones become NaN."""
    import numpy as np

    is_float = getattr(getattr(given, "dtype", None), "kind", "") == "f"
    array = numbers(name, given, missing=float("nan") if is_float else None)
    kind, width = array.dtype.kind, array.shape[-1] if array.ndim == 2 else 1
    if array.ndim not in (1, 2):
        raise ValueError(f"`{name}` is (n,), (n, 2) or (n, 3), not {array.shape}")
    wanted = {"uv": 2, "normal": 3}.get(name, width)
    if width != wanted:
        raise ValueError(f"`{name}` is (n, {wanted}), not {array.shape}")
    if name == "color":
        return colors(name, array), "level"
    if kind == "b" and width == 1:
        return array.reshape(-1).astype(np.uint8), "exact"
    if kind == "b":
        raise ValueError(f"`{name}` holds bools and is (n,), not {array.shape}")
    if array.dtype == np.uint8 and width == 3 and name != "normal":
        return array, "level"
    if kind in "iu" and width == 1:
        return ids(name, array.reshape(-1)), "index"
    if kind in "iu":
        return exact(name, array), "number"
    return array.astype(np.float64, copy=False), "number"


def ids(name: str, array: NDArray[Any]) -> _Indices:
    """Converts integers to ids without a change of their values. Raises ValueError with the first one that does not fit."""
    import numpy as np

    wrong = (array < 0) | (array > MAX_INDEX) if array.dtype != np.uint32 else np.zeros(0, bool)
    if wrong.any():
        number = array.reshape(-1)[int(np.argmax(wrong))]
        raise ValueError(
            f"`{name}`: {place(wrong)} is {number}; whole numbers are ids from 0 to {MAX_INDEX}: "
            "give floats where they are measures or have a sign, as `.astype(float)` makes them"
        )
    return array.astype(np.uint32, copy=False)


def exact(name: str, array: NDArray[Any]) -> _Floats:
    """Converts integers to floats. Raises ValueError with the first one that is not exact."""
    import numpy as np

    wrong = (array > _MAX_EXACT) | (array < -_MAX_EXACT) if array.dtype.itemsize == 8 else np.zeros(0, bool)
    if wrong.any():
        number = array.reshape(-1)[int(np.argmax(wrong))]
        raise ValueError(f"`{name}`: {place(wrong)} is {number}, which double precision rounds")
    return array.astype(np.float64)


def singles(name: str, given: Any) -> NDArray[np.float32]:
    """Converts to single precision; masked numbers become NaN. Warns of the first rounded float; refuses numbers that do not fit."""
    import numpy as np

    array = numbers(name, given, missing=float("nan"))
    if array.dtype.kind == "b":
        raise ValueError(f"`{name}` holds bools; expected numbers")
    with np.errstate(over="ignore"):
        single = array.astype(np.float32)
    if array.dtype.itemsize <= 2 or array.dtype == np.float32:
        return single
    if array.dtype.kind == "f":
        wrong = single != array
        if wrong.any():
            wrong &= array == array
    else:
        wrong = (single != array.astype(np.float64)) | (array > _MAX_EXACT) | (array < -_MAX_EXACT)
    if not wrong.any():
        return single
    number = array.reshape(-1)[int(np.argmax(wrong))]
    words = f"`{name}`: {place(wrong)} is {number}"
    if array.dtype.kind in "iu" or (np.isinf(single) & np.isfinite(array)).any():
        raise ValueError(f"{words}, which single precision does not hold")
    kept = single.reshape(-1)[int(np.argmax(wrong))]
    warnings.warn(f"{words}, kept as {kept!s} of single precision; `.astype(numpy.float32)` says so", stacklevel=4)
    return single


def colors(name: str, array: NDArray[Any]) -> NDArray[np.uint8]:
    """Converts colors to (n, 3) of uint8, sRGB from 0 to 255; floats are sRGB from 0 to 1. A fourth number must be opaque alpha."""
    import numpy as np

    if array.ndim != 2 or array.shape[1] not in (3, 4) or array.dtype != np.uint8 and array.dtype.kind != "f":
        raise ValueError(
            f"`{name}` is (n, 3), of uint8 from 0 to 255 or of floats from 0 to 1, not {array.shape} of {array.dtype}"
        )
    if array.dtype.kind == "f":
        wrong = ~((array >= 0) & (array <= 1))
        if wrong.any():
            number = array.reshape(-1)[int(np.argmax(wrong))]
            raise ValueError(f"`{name}`: {place(wrong)} is {number}; colors of floats are from 0 to 1")
        array = np.rint(array * 255).astype(np.uint8)
    if array.shape[1] == 4:
        if (array[:, 3] != 255).any():
            raise ValueError(f"`{name}` has colors that are not opaque; give three numbers each")
        array = array[:, :3]
    return array


def faces(given: Any) -> Any:
    """Converts faces to an array (m, corners), or to a tuple of face sizes and all corners if faces have several sizes."""
    import numpy as np

    if not isinstance(given, np.ndarray) and hasattr(given, "__iter__") and not hasattr(given, "__array__"):
        lists = [list(face) for face in given]
        if len({len(face) for face in lists}) > 1:
            sides = np.array([len(face) for face in lists], dtype=np.uint32)
            return sides, corners([corner for face in lists for corner in face])
        given = np.array(lists) if lists else np.empty((0, 3), dtype=np.uint32)
    array = corners(given)
    if array.ndim != 2:
        raise ValueError(f"faces are (m, corners of a face) or lists of corners, not {array.shape}")
    return array


def corners(given: Any) -> _Indices:
    """Converts numbers of vertices."""
    import numpy as np

    array = numbers("faces", given)
    if array.dtype.kind == "f" and array.size == 0:
        array = array.astype(np.uint32)
    if array.dtype.kind not in "iu":
        raise ValueError(f"corners of faces are numbers of vertices, not {array.dtype}")
    if array.size and (array.min() < 0 or array.max() > MAX_INDEX):
        at = np.argmax((array < 0) | (array > MAX_INDEX))
        raise ValueError(f"corner {at} of the faces is {array.reshape(-1)[at]}, which is no vertex")
    return array.astype(np.uint32, copy=False)


def column(name: str, on: str, given: Any) -> Tuple[NDArray[Any], str]:
    """Converts to a type of numbers that columns have; returns the array and the meaning of its numbers."""
    import numpy as np

    array, meaning = numbers(name, given), "number"
    kind = array.dtype
    if kind.kind == "b":
        array, meaning = array.astype(np.uint8), "exact"
    elif kind == np.uint8 and array.ndim > 1 and array.shape[-1] == 3:
        meaning = "level"
    elif kind.kind in "iu":
        is_attribute = on in ("vertex", "corner", "face", "point") and (array.ndim == 1 or array.shape[-1] == 1)
        fits = array.size == 0 or (array.min() >= 0 and array.max() <= MAX_INDEX)
        if is_attribute or kind != np.uint8:
            array = ids(name, array) if fits or is_attribute else exact(name, array)
    elif kind != np.float32:
        array = array.astype(np.float64, copy=False)
    if array.dtype == np.uint32:
        meaning = "index"
    return contiguous(array), meaning


def contiguous(array: NDArray[Any]) -> NDArray[Any]:
    """A contiguous, aligned array in native byte order; bools become bytes."""
    import numpy as np

    array = np.require(array, array.dtype.newbyteorder("="), ["C", "A"])
    return array.view(np.uint8) if array.dtype.kind == "b" else array
