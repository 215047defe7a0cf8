"""Materials as the engine keeps them: the column `materials` of a mesh. Nothing of Blender is here.

Each part is written with its length before it, as 8 bytes; numbers are little-endian (`src/value/material.rs` and `encoding.rs` of the engine).
"""

from __future__ import annotations

import hashlib
import struct
from typing import Any

# Before more than a picture.
SEVERAL = 2

TRANSPARENCY = ("opaque", "cutoff", "blend")


def encode(materials: list[dict[str, Any]]) -> bytes:
    """Materials without pictures."""
    found = [_part(bytes([SEVERAL])), _count(len(materials))]
    for its in materials:
        kind = TRANSPARENCY.index(its.get("transparency", "opaque"))
        found += [
            _part(its.get("name", "").encode()),
            _part(b"\0"),
            _numbers(its.get("base_color", (1, 1, 1, 1))),
            _numbers((its.get("metallic", 0), its.get("roughness", 0.9), its.get("cutoff", 0))),
            _numbers(its.get("emissive", (0, 0, 0))),
            _part(bytes([kind, its.get("double_sided", True), 0])),
            _count(0),
            _count(0),
        ]
    return b"".join(found)


def _part(bytes: bytes) -> bytes:
    return struct.pack("<Q", len(bytes)) + bytes


def _count(count: int) -> bytes:
    return _part(struct.pack("<Q", count))


def _numbers(numbers: Any) -> bytes:
    return _part(struct.pack(f"<{len(numbers)}d", *numbers))


class _Reader:
    """Takes one part after the other."""

    def __init__(self, bytes: bytes) -> None:
        self.bytes, self.place = bytes, 0

    def part(self) -> bytes:
        (length,) = struct.unpack_from("<Q", self.bytes, self.place)
        self.place += 8 + length
        if self.place > len(self.bytes):
            raise ValueError("expected a part of materials, found their end")
        return self.bytes[self.place - length : self.place]

    def count(self) -> int:
        return int(struct.unpack("<Q", self.part())[0])

    def numbers(self) -> list[float]:
        part = self.part()
        return list(struct.unpack(f"<{len(part) // 8}d", part))

    def column(self) -> bytes:
        self.part()
        self.part()
        self.count()
        return self.part()


def decode(bytes: bytes) -> list[dict[str, Any]]:
    """The materials; `ValueError` if they are not what this version knows.

    A `picture` has `size`, `pixels` (red, green and blue, from the top) and `file`, a name that only it has.
    """
    try:
        return _decode(_Reader(bytes))
    except (struct.error, IndexError) as error:
        raise ValueError(f"expected materials, found {error}") from error


def _decode(reader: _Reader) -> list[dict[str, Any]]:
    if reader.part() != b"\2":
        return []
    found = []
    for _ in range(reader.count()):
        its: dict[str, Any] = {"name": reader.part().decode(), "picture": None}
        if reader.part() == b"\1":
            size = [reader.count(), reader.count()]
            pixels = reader.column()
            if reader.part() == b"\1":
                # The camera that took it: focal lengths and middle.
                reader.part(), reader.part()
            if len(pixels) != 3 * size[0] * size[1]:
                raise ValueError(f"expected a picture of {size[0]} x {size[1]} pixels, found {len(pixels)} bytes")
            its["picture"] = {"size": size, "pixels": pixels, "file": hashlib.blake2b(pixels, digest_size=16).hexdigest()} if pixels else None
        its["base_color"] = reader.numbers()
        its["metallic"], its["roughness"], its["cutoff"] = reader.numbers()
        its["emissive"] = reader.numbers()
        kind, its["double_sided"], its["vertex_colors"] = reader.part()
        its["transparency"] = TRANSPARENCY[kind]
        maps, others = reader.count(), reader.count()
        for _ in range(maps):
            # Kind, file, content, attribute, numbers, filters, and channel with borders.
            reader.part(), reader.part(), reader.column()
            for _ in range(4):
                reader.part()
        for _ in range(2 * others):
            reader.part()
        found.append(its)
    return found
