"""Manual edits of the mesh of a live object: they are kept, or transferred by position to a new mesh, or the object stops being live.

Vertex groups, UV maps, colors, other attributes, material slots of faces, sharp edges, seams and shape keys can be transferred. Moves of
single vertices and changes of topology, such as applied modifiers and joined objects, cannot.
"""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

import bpy

from . import apply, returned, space
from .records import KINDS

# An attribute that only Convert and Apply Modifier drop (Blender 5.0 and newer), so that its absence shows that they were used.
MARK = ".a_maquette"

# Custom property of a mesh with checksums of its topology and positions as they came from the graph.
SUMS = "maquette_sums"

# Edits are transferred if most of the new vertices are within this fraction of the mesh's size from the old mesh.
MAX_DISTANCE = 0.05

# An edge corresponds to an old edge if its ends and its middle are within this fraction of the mean edge length from it. Subdivision moves
# a surface by some hundredths of that length; edges that only touch each other are a whole length apart.
MAX_EDGE_DISTANCE = 0.2

CONVERTED = "it was converted, or a modifier was applied"
EDITED = "faces or vertices were edited by hand, joined, or made by a modifier"


def mark(mesh: bpy.types.Mesh) -> None:
    """Marks a mesh, so that `is_marked` detects a conversion."""
    if MARK not in mesh.attributes:
        mesh.attributes.new(MARK, "BOOLEAN", "POINT")


def is_marked(mesh: bpy.types.Mesh) -> bool:
    """Returns true if the mesh was not converted since `mark`."""
    return MARK in mesh.attributes


def remember(mesh: bpy.types.Mesh) -> None:
    """Stores the checksums of a mesh, and marks it."""
    mesh[SUMS] = _checksums(mesh)
    mark(mesh)


def is_touched(mesh: bpy.types.Mesh) -> tuple[bool, bool]:
    """Returns two flags: the topology was edited since `remember`, and vertices were moved."""
    known = list(mesh.get(SUMS) or ())
    if len(known) != 2 or not mesh.get(apply.FACES):
        return False, False
    faces, places = _checksums(mesh)
    return faces != known[0], places != known[1]


def _checksums(mesh: bpy.types.Mesh) -> list[str]:
    import numpy as np

    places = np.empty(3 * len(mesh.vertices), "f4")
    mesh.vertices.foreach_get("co", places)
    corners = np.empty(len(mesh.loops), "i4")
    mesh.loops.foreach_get("vertex_index", corners)
    starts = np.empty(len(mesh.polygons), "i4")
    mesh.polygons.foreach_get("loop_start", starts)
    ends = np.empty(2 * len(mesh.edges), "i4")
    mesh.edges.foreach_get("vertices", ends)
    faces = [len(places), len(corners), len(starts), len(ends), *(_checksum(its.view("u4")) for its in (corners, starts, ends))]
    return [" ".join(map(str, faces)), str(_checksum(places.view("u4")))]


def _checksum(numbers: Any) -> int:
    """A checksum that depends on each number and on their order."""
    import numpy as np

    width = 1021
    whole = len(numbers) // width * width
    rows = numbers[:whole].reshape(-1, width).sum(axis=0, dtype="u8")
    rest = numbers[whole:].astype("u8")
    # Flipping faces only swaps numbers, so the weights of neighbors must not differ by a constant.
    ramp = np.arange(1, width + 1, dtype="u8") ** np.uint64(3) * np.uint64(2654435761) % np.uint64(2**32)
    return int((rows * ramp).sum()) + int((rest * ramp[: len(rest)]).sum())


def prepare(owner: bpy.types.Object, columns: apply.Columns, folder: pathlib.Path, may_lose: bool) -> tuple[Work | None, str]:
    """Returns the manual edits transferred to the mesh of a value, or None if there are none, and the reason if they would be lost.

    With `may_lose`, edits that cannot be transferred are dropped.
    """
    import numpy as np

    mesh = owner.data
    are_edited, are_moved = is_touched(mesh)
    file = dict(mesh.get(apply.FILES) or {}).get(apply.POSITIONS, "")
    if are_edited or are_moved and not space.learn_transform(mesh, folder, file, mesh.get(space.APPLIED_AXES) or owner.maquette.axes):
        return None, EDITED
    if not mesh.get(apply.FACES) or not apply.will_differ(mesh, columns):
        return None, ""
    work = collect(owner)
    if work.is_empty:
        return None, ""
    if is_animated(mesh):
        return None, "" if may_lose else "the topology has changed, and animated or driven shape keys cannot be transferred"
    whole = columns.numbers_of("position")
    whole = space.transform_positions(mesh, np.empty(0, "f4") if whole is None else whole).reshape(-1, 3).astype("f8")
    corners, sides, ends = columns.numbers_of("corners", "<i4"), columns.sides(), columns.numbers_of("edges", "<i4")
    corners, ends = (np.empty(0, "i4") if it is None else it for it in (corners, ends))
    why, carried = plan(work, whole, corners, sides, ends.reshape(-1, 2))
    return carried, "" if may_lose else why


@dataclasses.dataclass
class Key:
    """A shape key: its settings, and the offset of each vertex."""

    settings: dict[str, Any]
    relative: str
    moves: Any


@dataclasses.dataclass
class Work:
    """The manual edits of a mesh."""

    # Domain, name, type and numbers of attributes.
    attributes: list[tuple[str, str, str, Any]]
    # Names and weights of vertex groups.
    groups: dict[str, Any]
    keys: list[Key]
    # The edited mesh: vertices, corners and edges, and the corners and faces of its triangles.
    places: Any = None
    corners: Any = None
    ends: Any = None
    triangles: Any = None
    polygons: Any = None

    @property
    def is_empty(self) -> bool:
        """True if there are no edits to transfer."""
        return not (self.attributes or self.groups or self.keys)


def collect(owner: bpy.types.Object) -> Work:
    """Collects the manual edits of an object's mesh."""
    import numpy as np

    mesh = owner.data
    files = dict(mesh.get(apply.FILES) or {})
    made = {key.partition(" ")[2] for key in files} | set(mesh.get(returned.EDGES) or ()) | {"position", "crease_edge", "custom_normal", MARK}
    if "edge crease_edge" not in files:
        made.discard("crease_edge")
    attributes = []
    for it in mesh.attributes:
        is_seam = it.name.endswith("uv_seam")
        if it.name in made or it.data_type not in KINDS or it.is_internal and not is_seam:
            continue
        slot, type, width = KINDS[it.data_type]
        if it.data_type == "STRING":
            numbers = np.array([one.value for one in it.data], object)
        else:
            numbers = np.empty(len(it.data) * width, type)
            it.data.foreach_get(slot, numbers)
        # Blender's own attributes carry no information if they are all zero.
        if numbers.any() or not (is_seam or it.name in ("material_index", "sharp_face", "sharp_edge", "crease_edge")):
            attributes.append((it.domain, it.name, it.data_type, numbers.reshape(-1, width)))
    groups = {}
    own = [it for it in owner.vertex_groups if it.name not in (mesh.get(returned.GROUPS) or {})]
    if own and len(mesh.vertices):
        weights = np.zeros((max(it.index for it in owner.vertex_groups) + 1, len(mesh.vertices)), "f4")
        for vertex in mesh.vertices:
            for one in vertex.groups:
                weights[one.group, vertex.index] = one.weight
        groups = {it.name: weights[it.index].reshape(-1, 1) for it in own}
    keys = []
    for block in mesh.shape_keys.key_blocks if mesh.shape_keys else ():
        names = ("name", "mute", "slider_min", "slider_max", "value", "vertex_group", "interpolation")
        moves = _numbers(block.data, "co", "f4", 3) - _numbers(mesh.shape_keys.reference_key.data, "co", "f4", 3)
        keys.append(Key({name: getattr(block, name) for name in names}, block.relative_key.name, moves))
    work = Work(attributes, groups, keys)
    if work.is_empty:
        return work
    mesh.calc_loop_triangles()
    work.triangles = _numbers(mesh.loop_triangles, "loops", "i4", 3)
    work.polygons = _numbers(mesh.loop_triangles, "polygon_index", "i4").ravel()
    work.places = _numbers(mesh.vertices, "co", "f4", 3)
    work.corners = _numbers(mesh.loops, "vertex_index", "i4").ravel()
    work.ends = _numbers(mesh.edges, "vertices", "i4", 2)
    return work


def _numbers(elements: Any, name: str, type: str, width: int = 1) -> Any:
    import numpy as np

    numbers = np.empty(width * len(elements), type)
    elements.foreach_get(name, numbers)
    return numbers.reshape(-1, width)


class Carrier:
    """Transfers data from an old mesh to a new one by position."""

    def __init__(self, work: Work, places: Any, corners: Any, sides: Any, ends: Any) -> None:
        """`places`, `corners`, `sides` and `ends` are the positions, corners, face sizes and edges of the new mesh."""
        import numpy as np
        from mathutils.bvhtree import BVHTree

        self.work, self.ends, self.places = work, ends, places
        self.size = float(np.linalg.norm(np.ptp(work.places, axis=0))) if len(work.places) else 0.0
        self.is_near = False
        # The nearest triangles and the barycentric coordinates in them, by domain.
        self.found: dict[str, tuple[Any, Any]] = {}
        if not len(work.triangles) or not len(places):
            return
        tree = BVHTree.FromPolygons(work.places.tolist(), work.corners[work.triangles].tolist(), all_triangles=True)
        self.found["POINT"], distances = self._nearest(tree, places, places)
        self.is_near = bool((distances <= MAX_DISTANCE * self.size).mean() > 0.5)
        starts = np.cumsum(sides) - sides
        middles = np.add.reduceat(places[corners], starts, axis=0) / sides[:, None] if len(sides) else places[:0]
        domains = {domain for domain, *_ in work.attributes}
        if "CORNER" in domains:
            # Slightly inside of the face, since UV maps are discontinuous between faces.
            inside = places[corners] * 0.9 + np.repeat(middles, sides, axis=0) * 0.1
            self.found["CORNER"], _ = self._nearest(tree, inside, places[corners])
        if "FACE" in domains:
            self.found["FACE"], _ = self._nearest(tree, middles, middles)

    def _nearest(self, tree: Any, searched: Any, places: Any) -> tuple[tuple[Any, Any], Any]:
        """Finds the triangles nearest to `searched`, the barycentric coordinates of `places` in them, and the distances."""
        import numpy as np

        hits = [tree.find_nearest(place) for place in searched.tolist()]
        which = np.array([it[2] for it in hits], "i4")
        distances = np.array([it[3] for it in hits], "f8")
        a, b, c = (self.work.places[self.work.corners[self.work.triangles[which, k]]].astype("f8") for k in range(3))
        u, v, w = b - a, c - a, places - a
        uu, uv, vv, wu, wv = ((x * y).sum(1) for x, y in ((u, u), (u, v), (v, v), (w, u), (w, v)))
        area = np.maximum(uu * vv - uv * uv, 1e-300)
        shares = np.empty((len(which), 3))
        shares[:, 1] = (vv * wu - uv * wv) / area
        shares[:, 2] = (uu * wv - uv * wu) / area
        shares[:, 0] = 1 - shares[:, 1] - shares[:, 2]
        shares = np.clip(np.nan_to_num(shares), 0, 1)
        shares[np.abs(shares) < 1e-6] = 0
        total = shares.sum(1, keepdims=True)
        return (which, np.where(total > 0, shares / np.where(total > 0, total, 1), 1 / 3)), distances

    def carry(self, domain: str, kind: str, numbers: Any) -> Any:
        """Returns the numbers of the new elements."""
        import numpy as np

        if domain == "EDGE":
            return self._carry_edges(numbers)
        which, shares = self.found[domain]
        if domain == "FACE":
            return numbers[self.work.polygons[which]]
        elements = self.work.triangles[which]
        if domain == "POINT":
            elements = self.work.corners[elements]
        if kind == "GROUP" or KINDS[kind][1] == "f4" and kind not in ("QUATERNION", "FLOAT4X4"):
            return sum(shares[:, k : k + 1] * numbers[elements[:, k]] for k in range(3)).astype("f4")
        return numbers[np.take_along_axis(elements, shares.argmax(1)[:, None], 1).ravel()]

    def _carry_edges(self, numbers: Any) -> Any:
        """Returns the numbers of the new edges: those of the old edge along which each lies, or zeros."""
        import numpy as np
        from mathutils.bvhtree import BVHTree

        found = np.full((len(self.ends), numbers.shape[1]), b"" if numbers.dtype == object else 0, numbers.dtype)
        marked = np.flatnonzero([any(row) for row in numbers])
        if not len(marked):
            return found
        sides = self.work.ends[marked]
        tree = BVHTree.FromPolygons(self.work.places.tolist(), np.column_stack([sides, sides[:, 1]]).tolist())
        one, other = self.places[self.ends[:, 0]], self.places[self.ends[:, 1]]
        reach = max(MAX_EDGE_DISTANCE * float(np.linalg.norm(one - other, axis=1).mean()), 1e-9)
        lies_on = np.array([tree.find_nearest(place, reach)[2] is not None for place in self.places.tolist()])
        for edge in np.flatnonzero(lies_on[self.ends].all(1)).tolist():
            hit = tree.find_nearest(((one[edge] + other[edge]) / 2).tolist(), reach)
            if hit[2] is not None:
                found[edge] = numbers[marked[hit[2]]]
        return found


def plan(work: Work, places: Any, corners: Any, sides: Any, ends: Any) -> tuple[str, Work | None]:
    """Returns the edits transferred to a new mesh, or the reason why this is impossible."""
    import numpy as np

    carrier = Carrier(work, places, corners, sides, ends)
    names = [name for _, name, _, _ in work.attributes] + list(work.groups) + [it.settings["name"] for it in work.keys[1:]]
    words = f"the topology has changed, and the new mesh is too far from the old one to transfer {', '.join(names)}"
    if not carrier.is_near:
        return words, None
    attributes = [(domain, name, kind, carrier.carry(domain, kind, numbers)) for domain, name, kind, numbers in work.attributes]
    groups = {name: carrier.carry("POINT", "GROUP", weights) for name, weights in work.groups.items()}
    keys = [Key(it.settings, it.relative, carrier.carry("POINT", "FLOAT_VECTOR", it.moves)) for it in work.keys]
    before = [it[3] for it in work.attributes] + list(work.groups.values()) + [it.moves for it in work.keys[1:]]
    after = [it[3] for it in attributes] + list(groups.values()) + [it.moves for it in keys[1:]]
    gone = [name for name, had, has in zip(names, before, after) if had.any() and not has.any()]
    if gone:
        return f"the topology has changed, and the new mesh has nothing where {', '.join(gone)} was", None
    return "", dataclasses.replace(work, attributes=attributes, groups=groups, keys=keys, places=np.asarray(places))


def is_animated(mesh: bpy.types.Mesh) -> bool:
    """Returns true if shape keys are animated or driven, so that they cannot be created again."""
    return bool(mesh.shape_keys and mesh.shape_keys.animation_data)


def restore(owner: bpy.types.Object, work: Work) -> None:
    """Applies transferred edits to a mesh with new topology."""
    import numpy as np

    mesh = owner.data
    for domain, name, kind, numbers in work.attributes:
        if name.endswith("uv_seam"):
            mesh.edges.foreach_set("use_seam", numbers.ravel().astype("?"))
            continue
        attribute = apply.attribute_of(mesh, name, kind, domain)
        if attribute:
            returned.write(attribute, kind, numbers)
    for name, weights in work.groups.items():
        returned.set_weights(owner, name, weights.ravel())
    for it in work.keys:
        block = owner.shape_key_add(name=it.settings["name"], from_mix=False)
        block.data.foreach_set("co", np.ascontiguousarray(work.places + it.moves, "f4").ravel())
    for it in work.keys:
        block = mesh.shape_keys.key_blocks[it.settings["name"]]
        block.relative_key = mesh.shape_keys.key_blocks[it.relative]
        for name, value in it.settings.items():
            setattr(block, name, value)


def move_keys(mesh: bpy.types.Mesh, before: Any) -> None:
    """Moves shape keys by the movement of the vertices since `before`."""
    places = _numbers(mesh.vertices, "co", "f4", 3)
    for block in mesh.shape_keys.key_blocks:
        block.data.foreach_set("co", (_numbers(block.data, "co", "f4", 3) + (places - before)).ravel())


def positions(mesh: bpy.types.Mesh) -> Any:
    """The positions of the vertices without the effect of shape keys."""
    its = mesh.shape_keys.reference_key.data if mesh.shape_keys else mesh.vertices
    return _numbers(its, "co", "f4", 3)
