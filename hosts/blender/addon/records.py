"""Attributes of Blender on their way through a graph: how each was given, so that it comes back as it was.

The engine has attributes of vertices, corners and faces, of six kinds. All others are given in pieces of these kinds. What edges have comes back
with their ends, which are numbered for this. Nothing of Blender is here.
"""

from __future__ import annotations

import dataclasses
from typing import Any

# The attribute of vertices that numbers them.
NUMBERS = "source vertex"

# Each input has numbers of its own: so many.
MAX_VERTICES = 1 << 27

# Where Blender has the numbers of an attribute, of which type, and how many an element has.
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

# Behind the name of a vertex group where it stands among attributes.
GROUP = "\n"

# Texts of attributes by their numbers.
_texts: dict[bytes, int] = {}


@dataclasses.dataclass
class Record:
    """An attribute of Blender, and the attributes of the engine that it was given as."""

    name: str
    # A key of KINDS, or GROUP.
    kind: str
    # `vertex`, `corner` or `face`.
    on: str
    pieces: list[str]


@dataclasses.dataclass
class Source:
    """What was given of an object, and what it needs to come back."""

    records: list[Record] = dataclasses.field(default_factory=list)
    materials: list[str] = dataclasses.field(default_factory=list)
    # Ends of edges as numbers of vertices, and what the edges have: kind and numbers by name.
    ends: Any = None
    edges: dict[str, tuple[str, Any]] = dataclasses.field(default_factory=dict)
    # What was not given, in words.
    lost: list[str] = dataclasses.field(default_factory=list)


def number(text: bytes) -> int:
    """The number of a text."""
    return _texts.setdefault(text, len(_texts))


def texts() -> list[bytes]:
    """All texts by their numbers."""
    return list(_texts)


def levels(colors: Any) -> Any:
    """Linear colors as 8-bit sRGB, red, green and blue."""
    import numpy as np

    linear = np.nan_to_num(colors[:, :3].astype("f8")).clip(0, 1)
    return np.rint(255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)).astype("u1")
