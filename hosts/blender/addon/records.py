"""Records of attributes of Blender that are passed through a graph, so that their types can be restored in the result.

The engine has attributes of vertices, corners and faces, of six kinds. All others are passed in pieces of these kinds. Data of edges is
restored by the vertices at their ends, which are numbered for this purpose. This module does not use Blender.
"""

from __future__ import annotations

import dataclasses
from typing import Any

# The vertex attribute with the numbers of vertices.
NUMBERS = "source vertex"

# The size of the range of vertex numbers of each input.
MAX_VERTICES = 1 << 27

# By type of attribute: the property with the numbers, their type, and their count for each element.
KINDS = {
    "FLOAT": ("value", "f4", 1),
    "INT": ("value", "i4", 1),
    "INT8": ("value", "i4", 1),
    "BOOLEAN": ("value", "?", 1),
    "FLOAT_VECTOR": ("vector", "f4", 3),
    "FLOAT2": ("vector", "f4", 2),
    "FLOAT_COLOR": ("color", "f4", 4),
    "BYTE_COLOR": ("color_srgb", "f4", 4),
    "INT16_2D": ("value", "i4", 2),
    "INT32_2D": ("value", "i4", 2),
    "QUATERNION": ("value", "f4", 4),
    "FLOAT4X4": ("value", "f4", 16),
    "STRING": ("value", "O", 1),
}

# The suffix of the name of a vertex group in a list of attributes.
GROUP = "\n"

# The numbers of texts of attributes.
_texts: dict[bytes, int] = {}


@dataclasses.dataclass
class Record:
    """An attribute of Blender, and the attributes of the engine that represent it."""

    name: str
    # A key of KINDS, or GROUP.
    kind: str
    # `vertex`, `corner` or `face`.
    on: str
    pieces: list[str]


@dataclasses.dataclass
class Source:
    """The data of an object that was passed to the engine, and the data needed to restore it."""

    records: list[Record] = dataclasses.field(default_factory=list)
    materials: list[str] = dataclasses.field(default_factory=list)
    # The ends of edges as vertex numbers, and the attributes of edges: kind and numbers by name.
    ends: Any = None
    edges: dict[str, tuple[str, Any]] = dataclasses.field(default_factory=dict)
    # Descriptions of the data that was not passed.
    lost: list[str] = dataclasses.field(default_factory=list)


def number(text: bytes) -> int:
    """Returns the number of a text, a new one if it has none."""
    return _texts.setdefault(text, len(_texts))


def texts() -> list[bytes]:
    """All texts, in the order of their numbers."""
    return list(_texts)


def levels(colors: Any) -> Any:
    """Converts linear colors to 8-bit sRGB: red, green and blue."""
    import numpy as np

    linear = np.nan_to_num(colors[:, :3].astype("f8")).clip(0, 1)
    return np.rint(255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)).astype("u1")
