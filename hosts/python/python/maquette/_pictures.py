"""Conversion of pictures, and textures of meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Mapping, Optional, Tuple

from . import _arrays

if TYPE_CHECKING:
    from ._grids import Image
    from ._value import Part, _Bytes

TEXTURE_PARTS = ("texture", "texture size", "texture camera")
"""The columns of a mesh that belong to its texture."""


def pixels_of(picture: Any) -> _Bytes:
    """Converts a picture to (rows, columns, 3) bytes, sRGB: an array of 8 or 16 bits, a picture of Pillow or an `Image`.

    As in files, 16 bits are reduced to the upper 8, floats of Pillow are linear light from 0 to 1, and alpha is dropped.
    """
    import numpy as np

    pixels = getattr(picture, "pixels", None)
    if isinstance(pixels, np.ndarray):
        picture = pixels
    elif hasattr(picture, "convert") and hasattr(picture, "mode"):
        picture = _from_pillow(picture)
    array = _arrays.numbers("picture", picture)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind != "u" or array.dtype.itemsize > 2:
        raise ValueError(
            "a picture is (rows, columns, 3) of uint8 or uint16, sRGB from 0 to 255 or 65535, "
            f"not {array.shape} of {array.dtype}"
        )
    return array if array.dtype == np.uint8 else (array >> 8).astype(np.uint8)


def _from_pillow(picture: Any) -> Any:
    """Converts a picture of Pillow to an array; Pillow's own `convert` would clip 16 bits and floats."""
    import numpy as np

    mode = str(picture.mode)
    if mode.startswith("I"):
        gray = np.asarray(picture)
        if gray.size and not (0 <= int(gray.min()) and int(gray.max()) <= 65535):
            raise ValueError(f"a picture of the mode {mode} has numbers from 0 to 65535, found {gray.min()} to {gray.max()}")
        return np.repeat(gray.astype(np.uint16)[..., None], 3, axis=2)
    if mode == "F":
        light = np.asarray(picture, dtype=np.float64)
        if not ((light >= 0) & (light <= 1)).all():
            raise ValueError("a picture of the mode F has light from 0 to 1; scale it, or make a Field of it")
        curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        return np.repeat(np.rint(255 * curve).astype(np.uint8)[..., None], 3, axis=2)
    return np.asarray(picture.convert("RGB"))


def texture_parts(texture: Any) -> Dict[str, Tuple[str, Any]]:
    """The columns of a mesh for a texture; None for columns of a previous texture to remove."""
    import numpy as np

    parts: Dict[str, Tuple[str, Any]] = {name: ("texel", None) for name in TEXTURE_PARTS}
    if texture is not None:
        pixels = pixels_of(texture)
        parts["texture"] = ("texel", pixels.reshape(-1, 3))
        parts["texture size"] = ("whole", np.array([[pixels.shape[1], pixels.shape[0]]], dtype=np.float64))
        camera = texture.parts.get("camera") if hasattr(texture, "parts") else None
        if camera is not None:
            parts["texture camera"] = ("whole", camera.array)
    return parts


def texture_of(parts: Mapping[str, Part]) -> Optional[Image]:
    """The texture of a mesh with these columns."""
    from ._grids import Image
    from ._value import Value

    if "texture" not in parts or "texture size" not in parts:
        return None
    columns, rows = (int(side) for side in parts["texture size"].array.reshape(-1))
    of_image = {"color": ("pixel", parts["texture"].array.reshape(rows, columns, 3))}
    if "texture camera" in parts:
        of_image["camera"] = ("whole", parts["texture camera"].array)
    image = Value.from_parts("Image", of_image)
    assert isinstance(image, Image)
    return image
