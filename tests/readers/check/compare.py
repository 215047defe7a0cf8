"""Compares the data that a program reads from a file with the data that was written, and describes the difference in a short text.

Programs triangulate polygons, split, merge and reorder vertices. So points are matched by position, and data of corners is compared as the
set of values at each position.
"""

from __future__ import annotations

import collections
import itertools
import math
from typing import Any, Dict, Iterable, List, Optional, Sequence, Tuple

from programs.record import thinned

Record = Dict[str, Any]
Point = Sequence[float]
Values = Dict[Any, List[Point]]

# Tolerances for programs that store bytes and single precision: colors from 0 to 255, texture coordinates, unit normals, and the attribute
# `wear` of the test files.
TOLERANCES = {"colors": 1.5, "face_colors": 1.5, "uv": 2e-4, "normals": 0.02, "wear": 1e-4}
# The tolerance of positions, relative to the largest coordinate: programs print six digits.
PLACE = 1e-5
# The relative tolerance of areas: non-planar polygons may be triangulated in two ways.
AREA = 0.01


def difference(truth: Record, found: Record) -> str:
    """Describes the difference in a text, which is empty if there is none."""
    if "error" in found:
        return found["error"]
    if truth["type"] == "Surface" and "knots" in found:
        return difference_of_surfaces(truth, found)
    if truth["type"] in ("Image", "Mask", "Labels", "Field", "Picture"):
        return difference_of_pictures(truth["picture"], found.get("picture"))
    if not found.get("points"):
        return "no points"
    if any(x is None or not math.isfinite(x) for point in found["points"] for x in point):
        return "points that are not finite"
    # The coordinates in the file may be larger than in the value, before a transform, and are less exact then.
    places = Places(truth["points"], truth.get("size", 0.0))
    ids = [places.find(point) for point in found["points"]]
    if any(it is None for it in ids):
        return describe_motion(truth["points"], found["points"])
    known = [places.find(point) for point in truth["points"]]
    if truth["type"] == "Surface":
        return "control points alone"
    if truth.get("faces"):
        words = difference_of_faces(truth, found, known, ids)
    else:
        words = difference_of_points(truth, found, known, ids)
    return words or difference_of_looks(truth, found, known, ids)


class Places:
    """Finds points by position."""

    def __init__(self, points: Iterable[Point], size: float = 0.0) -> None:
        self.points = list(points)
        self.tolerance = PLACE * max(size, *(abs(x) for point in self.points for x in point)) or PLACE
        self.cells: Dict[Tuple[int, ...], List[int]] = collections.defaultdict(list)
        for index, point in enumerate(self.points):
            if self.find(point) is None:
                self.cells[self.cell(point)].append(index)

    def cell(self, point: Point) -> Tuple[int, ...]:
        return tuple(math.floor(x / (4 * self.tolerance)) for x in point)

    def find(self, point: Point) -> Optional[int]:
        """The index of the first point at this position, or None."""
        near = [sorted({math.floor((x + step) / (4 * self.tolerance)) for step in (-self.tolerance, self.tolerance)}) for x in point]
        for cell in itertools.product(*near):
            for index in self.cells.get(cell, ()):
                if all(abs(a - b) <= self.tolerance for a, b in zip(self.points[index], point)):
                    return index
        return None


def describe_motion(truth: Sequence[Point], found: Sequence[Point]) -> str:
    """Describes the transformation of points that are not at their positions."""
    bounds, others = ([(min(axis), max(axis)) for axis in zip(*points)] for points in (truth, found))
    sizes, other_sizes = ([high - low for low, high in it] for it in (bounds, others))

    def is_near(a: Iterable[float], b: Iterable[float]) -> bool:
        return all(abs(x - y) <= 1e-3 * max(sizes) for x, y in zip(a, b))

    if is_near(itertools.chain(*bounds), itertools.chain(*others)):
        return "positions"
    if is_near(sizes, other_sizes):
        return "moved"
    if is_near(sorted(sizes), sorted(other_sizes)):
        return "turned"
    ratio = max(other_sizes) / max(sizes)
    if ratio and is_near(sorted(sizes), [x / ratio for x in sorted(other_sizes)]):
        return f"scaled by {ratio:.4g}"
    return "positions"


def difference_of_points(truth: Record, found: Record, known: List[int], ids: List[int]) -> str:
    if found.get("faces"):
        return f"{len(found['faces'])} faces"
    if set(ids) != set(known):
        return f"{len(set(ids))} of {len(set(known))} points"
    if truth.get("lines"):
        if "lines" not in found:
            return ""
        if not found["lines"]:
            return "no lines"
        expected, there = (
            {tuple(sorted(pair)) for line in record["lines"] for pair in zip([corners[k] for k in line], [corners[k] for k in line[1:]])}
            for record, corners in ((truth, known), (found, ids))
        )
        return "" if expected == there else "lines"
    return "" if len(ids) == len(known) else f"{len(ids)} of {len(known)} points"


def canonical(face: Sequence[int]) -> Tuple[int, ...]:
    """The smallest rotation of the corners of a face, with its orientation; several corners may have the same number."""
    return min(tuple(face[k:]) + tuple(face[:k]) for k in range(len(face)))


def difference_of_faces(truth: Record, found: Record, known: List[int], ids: List[int]) -> str:
    faces = [[known[k] for k in face] for face in truth["faces"]]
    used = {it for face in faces for it in face}
    if "faces" not in found:
        missing = len(used - set(ids))
        return f"{len(used) - missing} of {len(used)} vertices" if missing else ""
    if not found["faces"]:
        return "no faces"
    others = [[ids[k] for k in face] for face in found["faces"]]
    there = {it for face in others for it in face}
    if there != used:
        return f"{len(there & used)} of {len(used)} vertices"
    if sorted(map(canonical, map(list, faces))) == sorted(map(canonical, others)):
        return ""
    count = sum(len(face) - 2 for face in faces)
    if len(others) != count:
        return f"{len(others)} of {count} triangles"
    place = truth["points"]
    if all(len(face) == 3 for face in faces):
        backward = sorted(canonical(face[::-1]) for face in others)
        return "inside out" if backward == sorted(map(canonical, map(list, faces))) else "faces"
    area, other_area = (sum(math.hypot(*normal(face, place)) for face in some) for some in (faces, others))
    if abs(other_area - area) > AREA * area:
        return "area"
    size = max(abs(x) for point in place for x in point)
    volume, other_volume = (sum(dot(normal(face, place), place[face[0]]) for face in some) for some in (faces, others))
    sides, other_sides = ([sum(axis) for axis in zip(*(normal(face, place) for face in some))] for some in (faces, others))
    is_same = abs(volume - other_volume) <= AREA * area * size and all(abs(a - b) <= AREA * area for a, b in zip(sides, other_sides))
    return "" if is_same else "inside out"


def normal(face: Sequence[int], place: Sequence[Point]) -> List[float]:
    """The normal of a polygon, whose length is the area."""
    sums = [0.0, 0.0, 0.0]
    for a, b in zip(face, [*face[1:], face[0]]):
        (ax, ay, az), (bx, by, bz) = place[a], place[b]
        sums = [sums[0] + ay * bz - az * by, sums[1] + az * bx - ax * bz, sums[2] + ax * by - ay * bx]
    return [0.5 * x for x in sums]


def dot(a: Point, b: Point) -> float:
    return sum(x * y for x, y in zip(a, b))


def difference_of_looks(truth: Record, found: Record, known: List[int], ids: List[int]) -> str:
    """Compares colors, texture coordinates, normals, an attribute, materials and the texture, as far as the program reports them."""
    for key in ("colors", "uv", "normals", "wear"):
        if truth.get(key) and key in found:
            if not len(found[key]):
                return f"no {key}"
            # If a mesh has as many corners as points, both interpretations are accepted.
            expected = at_places(truth, key, known, [truth.get(f"{key}_on", "points")])[0]
            there = at_places(found, key, ids, ["points", "corners"])
            if not any(agree(expected, it, TOLERANCES[key]) for it in there):
                return words_of_colors(expected, there[0]) if key == "colors" and there else key
    if truth.get("face_colors") and "face_colors" in found:
        if not found["face_colors"]:
            return "no face colors"
        expected, there = (
            {tuple(sorted(corners[k] for k in face)): [color] for face, color in zip(record["faces"], record["face_colors"])}
            for record, corners in ((truth, known), (found, ids))
        )
        if not agree(expected, there, TOLERANCES["face_colors"]):
            return "face colors"
    words = difference_of_materials(truth.get("materials", {}), found.get("materials"))
    if words:
        return words
    if truth.get("picture") and "named_picture" in found:
        return "" if found["named_picture"] else "no picture"
    if truth.get("picture") and "picture" in found:
        words = difference_of_pictures(truth["picture"], found["picture"])
        return words and ("no picture" if words == "no picture" else "picture")
    return ""


def difference_of_materials(truth: Record, found: Optional[Record]) -> str:
    """Compares materials by name, as far as the program reports them."""
    if not truth or found is None:
        return ""
    if sorted(truth) != sorted(found):
        return f"materials {sorted(found)}"
    for name, expected in truth.items():
        for key, value in found[name].items():
            wanted = expected.get(key)
            if key == "color":
                is_same = wanted is None or all(abs(a - b) <= 0.01 for a, b in zip(wanted, value))
            else:
                is_same = wanted == value
            if not is_same:
                return f"{key} {value} of {name}"
    return ""


def words_of_colors(expected: Values, found: Values) -> str:
    """Describes the difference of colors."""
    linear = {key: list(map(linear_color, colors)) for key, colors in expected.items()}
    if agree(linear, found, TOLERANCES["colors"]):
        return "linear colors"
    others = {key: list(map(linear_color, colors)) for key, colors in found.items()}
    return "coarse dark colors" if agree(linear, others, TOLERANCES["colors"]) else "colors"


def linear_color(color: Point) -> List[float]:
    """Converts an sRGB color to linear light, from 0 to 255."""
    def channel(x: float) -> float:
        return x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4

    return [255 * channel(max(x, 0.0) / 255) for x in color]


def at_places(record: Record, key: str, ids: List[int], on: List[str]) -> List[Values]:
    """The values at each position that faces use, or at all positions if there are no faces, read as values of points and of corners."""
    values, corners = record[key], [k for face in record.get("faces") or [] for k in face]
    found = []
    for indices in (corners if it == "corners" else range(len(ids)) for it in on):
        if len(values) == len(indices):
            used = set(corners or indices)
            places: Values = collections.defaultdict(list)
            for k, value in zip(indices, values):
                if k in used:
                    places[ids[k]].append(value)
            found.append(places)
    return found


def agree(expected: Values, found: Values, tolerance: float) -> bool:
    """Returns true if each value at a position is close to one of the other values there."""
    def covered(some: List[Point], by: List[Point]) -> bool:
        return all(any(all(abs(a - b) <= tolerance for a, b in zip(it, other)) for other in by) for it in some)

    return set(expected) == set(found) and all(covered(expected[k], found[k]) and covered(found[k], expected[k]) for k in expected)


def difference_of_pictures(truth: List[List[Any]], found: Optional[Record]) -> str:
    """Compares a picture with that of a record, where large ones are subsampled."""
    if not found or not found["rows"]:
        return "no picture"
    size = [len(truth[0]), len(truth)]
    if size != found["size"]:
        return f"{found['size'][0]} x {found['size'][1]} pixels"
    pixels, others = pixels_of(thinned(truth)["rows"]), pixels_of(found["rows"])
    greatest = max(x for pixel in pixels for x in pixel)
    is_whole = all(x == int(x) for pixel in pixels for x in pixel)
    tolerance = 1.5 if is_whole and greatest > 1 else 1e-5 * greatest
    for expected, there in zip(pixels, others):
        there = there[:3] if len(there) > 2 else there[:1]
        expected = [expected[0]] * len(there) if len(expected) < len(there) else expected
        if len(expected) > len(there):
            return "no colors"
        if any(abs(a - b) > tolerance for a, b in zip(expected, there)):
            is_coarse = all(abs(a - 257 * b) <= 257 for pixel, other in zip(pixels, others) for a, b in zip(pixel, other))
            return "8 of 16 bits" if is_coarse and is_whole else "levels"
    return ""


def pixels_of(rows: List[List[Any]]) -> List[Sequence[float]]:
    return [pixel if isinstance(pixel, (list, tuple)) else [pixel] for row in rows for pixel in row]


def difference_of_surfaces(truth: Record, found: Record) -> str:
    """Compares control points in their order, weights up to a factor, and knots."""
    tolerance = PLACE * max(abs(x) for point in truth["points"] for x in point)
    if len(truth["points"]) != len(found["points"]):
        return f"{len(found['points'])} of {len(truth['points'])} control points"
    if any(abs(a - b) > tolerance for p, q in zip(truth["points"], found["points"]) for a, b in zip(p, q)):
        return "control points"
    if any(abs(a / truth["weights"][0] - b / found["weights"][0]) > 1e-9 for a, b in zip(truth["weights"], found["weights"])):
        return "weights"
    for expected, knots in zip(truth["knots"], found["knots"]):
        # The first and the last knot have no effect and may have any value.
        knots = [knots[1], *knots[1:-1], knots[-2]]
        there = [len(knots), min(knots), max(knots), sum(knots) / len(knots)]
        if any(abs(a - b) > 1e-9 for a, b in zip(flat(expected), there)):
            return "knots"
    return ""


def flat(numbers: Iterable[Any]) -> List[float]:
    """Unpacks numbers in lists of one element."""
    return [it[0] if isinstance(it, list) else it for it in numbers]
