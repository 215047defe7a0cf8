"""Compares deformation, subdivision, interpolation and hole filling with other libraries on the same arrays.

    python examples/peers.py [RUNS]

Prints a table of medians in ms, and the ratio of each time to ours. Every call takes and returns arrays, as in user code; caches of
maquette are not used. Libraries that are not installed are skipped with a message.
"""

from __future__ import annotations

import importlib
import os
import statistics
import sys
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

import maquette

Array = npt.NDArray[Any]
Call = Callable[[], Any]


def library(name: str) -> Any:
    """A library, or None if it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f"{name} is not installed", file=sys.stderr)
        return None


trimesh, pymeshlab, o3d, scipy = (library(name) for name in ("trimesh", "pymeshlab", "open3d", "scipy"))


def ball(rows: int, columns: int) -> Tuple[Array, Array]:
    """A bumpy ball of 50 mm, closed, in triangles."""
    u, v = np.meshgrid(np.arange(columns) * 2 * np.pi / columns, np.linspace(0, np.pi, rows + 2)[1:-1])
    radius = 50 + 3 * np.sin(5 * u) * np.sin(v) ** 2 * np.sin(4 * v)
    grid = np.stack([radius * np.cos(u) * np.sin(v), radius * np.sin(u) * np.sin(v), radius * np.cos(v)], -1)
    at = np.arange(rows * columns).reshape(rows, columns)
    here, below = at[:-1], at[1:]
    right, across = np.roll(here, -1, axis=1), np.roll(below, -1, axis=1)
    sides = [np.stack(corners, -1).reshape(-1, 3) for corners in ((here, below, right), (right, below, across))]
    top, bottom = rows * columns, rows * columns + 1
    first, last = at[0], at[-1]
    caps = [
        np.stack([np.full(columns, top), first, np.roll(first, -1)], -1),
        np.stack([np.full(columns, bottom), np.roll(last, -1), last], -1),
    ]
    poles = np.array([[0, 0, 50.0], [0, 0, -50.0]])
    return np.concatenate([grid.reshape(-1, 3), poles]), np.concatenate(sides + caps)


def median(call: Call, runs: int) -> Tuple[float, Any]:
    """The median time in ms of some calls after a warm-up call, and the last result."""
    call()
    times, given = [], None
    for _ in range(runs):
        start = time.perf_counter()
        given = call()
        times.append((time.perf_counter() - start) * 1000)
    return statistics.median(times), given


def uncached(graph: maquette.Graph, inputs: Dict[str, Any], output: str) -> Call:
    """A call of a graph without cached results."""

    def call() -> Any:
        graph.forget()
        value = graph.run(inputs=inputs)[output]
        assert isinstance(value, maquette.Mesh)
        return value.vertices, value.triangles

    return call


def graph(text: str) -> maquette.Graph:
    return maquette.load("peers.ron", text=f"Graph(format: 1, {text})", cache=None)


class Row:
    """One operation, by maquette and by other libraries."""

    def __init__(self, name: str, ours: Call, others: List[Tuple[str, Any, Callable[[], Call]]]) -> None:
        self.name, self.ours, self.others = name, ours, others

    def print(self, runs: int) -> None:
        ours, given = median(self.ours, runs)
        print(f"| {self.name} | maquette | {ours:.1f} | 1 | |")
        for name, needed, make in self.others:
            if needed is None:
                continue
            try:
                theirs, found = median(make(), runs)
            except Exception as error:  # noqa: BLE001: failures of other libraries are printed.
                print(f"| | {name} | - | - | {type(error).__name__}: {str(error)[:80]} |")
                continue
            print(f"| | {name} | {theirs:.1f} | {theirs / ours:.2f} | {difference(given, found)} |")


def difference(ours: Any, theirs: Any) -> str:
    """The maximum distance of vertices if their numbers agree; otherwise the numbers of triangles."""
    (v, f), (w, g) = ours, theirs
    if len(v) == len(w):
        apart = nearest(np.asarray(w), np.asarray(v)) if f is not None else np.linalg.norm(v - w, axis=1)
        return f"apart by at most {apart.max():.1e} mm"
    return f"{len(f)} triangles, theirs {len(g)}"


def nearest(points: Array, to: Array) -> Array:
    from scipy.spatial import KDTree

    distances: Array = KDTree(to).query(points)[0]
    return distances


def ffd() -> Row:
    vertices, faces = ball(500, 600)
    chance = np.random.default_rng(20070115)
    at = np.stack(np.meshgrid(*[np.linspace(-50, 50, 4)] * 3), -1).reshape(-1, 3)
    to, sigma = at + chance.normal(0, 2, (64, 3)), np.full((64, 3), 16.0)
    handles = maquette.Handles(at, to, sigma=sigma, space="World")
    mesh = maquette.Mesh(vertices, faces)
    pull = graph(
        'inputs: { "mesh": Mesh(), "handles": Handles() }, '
        'nodes: { "it": Ffd(mesh: "mesh", layout: "handles", space: World) }, outputs: { "it": "it" }'
    )

    def with_numpy() -> Any:
        def weights(points: Array) -> Array:
            squares = (points * points).sum(1)[:, None] + (at * at).sum(1) - 2 * (points @ at.T)
            gaussians: Array = np.exp(squares * (-0.5 / sigma[0, 0] ** 2))
            gaussians /= gaussians.sum(1, keepdims=True)
            return gaussians

        # Solve for moves that bring each handle to its target.
        moves = np.linalg.solve(weights(at), to - at)
        out = np.empty_like(vertices)
        for start in range(0, len(vertices), 8192):
            part = vertices[start : start + 8192]
            out[start : start + 8192] = part + weights(part) @ moves
        return out, None

    def ours() -> Any:
        pull.forget()
        value = pull.run(inputs={"mesh": mesh, "handles": handles})["it"]
        assert isinstance(value, maquette.Mesh)
        return value.vertices, None

    return Row(
        f"FFD of {len(vertices)} vertices, 64 handles", ours, [("NumPy, chunks of 8192", np, lambda: with_numpy)]
    )


def subdivision() -> Row:
    vertices, faces = ball(100, 150)
    loop = graph(
        'inputs: { "mesh": Mesh() }, nodes: { "it": Subdivide(mesh: "mesh", scheme: Loop, levels: 2) }, outputs: { "it": "it" }'
    )
    mesh = maquette.Mesh(vertices, faces)

    def with_trimesh() -> Any:
        return trimesh.remesh.subdivide_loop(vertices, faces, iterations=2)

    def with_open3d() -> Any:
        theirs = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
        fine = theirs.subdivide_loop(number_of_iterations=2)
        return np.asarray(fine.vertices), np.asarray(fine.triangles)

    def with_pymeshlab() -> Any:
        theirs = pymeshlab.MeshSet()
        theirs.add_mesh(pymeshlab.Mesh(vertices, faces))
        theirs.meshing_surface_subdivision_loop(iterations=2, threshold=pymeshlab.PercentageValue(0))
        fine = theirs.current_mesh()
        return fine.vertex_matrix(), fine.face_matrix()

    return Row(
        f"Loop subdivision of {len(faces)} triangles, 2 levels",
        uncached(loop, {"mesh": mesh}, "it"),
        [
            ("trimesh", trimesh, lambda: with_trimesh),
            ("Open3D", o3d, lambda: with_open3d),
            ("pymeshlab", pymeshlab, lambda: with_pymeshlab),
        ],
    )


def interpolation() -> Row:
    vertices, faces = ball(100, 150)
    mesh = maquette.Mesh(vertices, faces)
    through = graph(
        'inputs: { "mesh": Mesh() }, nodes: { "it": Interpolate(mesh: "mesh", scheme: Loop) }, outputs: { "it": "it" }'
    )

    def with_scipy() -> Any:
        from scipy.sparse import csc_matrix, diags
        from scipy.sparse.linalg import splu

        n = len(vertices)
        near = csc_matrix((np.ones(faces.size), (faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel())), shape=(n, n))
        valence = np.asarray(near.sum(1)).ravel()
        beta = (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / valence)) ** 2) / valence
        weight = 3 / (8 * beta)
        limit = diags(1 / (weight + valence)) @ (diags(weight) + near)
        return splu(csc_matrix(limit)).solve(vertices), None

    return Row(
        f"control mesh through {len(vertices)} vertices (Loop)",
        uncached(through, {"mesh": mesh}, "it"),
        [("SciPy, sparse LU", scipy, lambda: with_scipy)],
    )


def filling() -> List[Row]:
    vertices, faces = ball(200, 300)
    centers = vertices[faces].mean(1)
    # Two round holes.
    holes = (np.linalg.norm(centers - [0, 0, 50], axis=1) < 12) | (np.linalg.norm(centers - [50, 0, 0], axis=1) < 10)
    faces = faces[~holes]
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    mesh = maquette.Mesh(vertices, faces)

    def ours(method: str) -> Call:
        fill = graph(
            f'inputs: {{ "mesh": Mesh() }}, nodes: {{ "it": FillHoles(mesh: "mesh", method: {method}) }}, outputs: {{ "it": "it.mesh" }}'
        )
        return uncached(fill, {"mesh": mesh}, "it")

    def with_pymeshlab() -> Any:
        theirs = pymeshlab.MeshSet()
        theirs.add_mesh(pymeshlab.Mesh(vertices, faces))
        theirs.meshing_close_holes(maxholesize=1000, newfaceselected=False)
        whole = theirs.current_mesh()
        return whole.vertex_matrix(), whole.face_matrix()

    def with_open3d() -> Any:
        theirs = o3d.t.geometry.TriangleMesh(
            o3d.core.Tensor.from_numpy(vertices), o3d.core.Tensor.from_numpy(faces.astype(np.int64))
        )
        whole = theirs.fill_holes(hole_size=1e6)
        return whole.vertex.positions.numpy(), whole.triangle.indices.numpy()

    def with_trimesh() -> Any:
        whole = trimesh.Trimesh(vertices, faces, process=False)
        trimesh.repair.fill_holes(whole)
        return whole.vertices, whole.faces

    others: List[Tuple[str, Any, Callable[[], Call]]] = [
        ("pymeshlab, flat", pymeshlab, lambda: with_pymeshlab),
        ("Open3D, flat", o3d, lambda: with_open3d),
        ("trimesh, flat", trimesh, lambda: with_trimesh),
    ]
    return [
        Row(f"two holes of {len(faces)} triangles filled smoothly", ours("ThinPlate"), []),
        Row("the same, flat", ours("Flat"), others),
    ]


def versions() -> str:
    named: List[Optional[Any]] = [np, scipy, trimesh, o3d]
    found = [f"{it.__name__} {it.__version__}" for it in named if it is not None]
    return ", ".join(found) + (" pymeshlab" if pymeshlab is not None else "")


def main(runs: str = "7") -> None:
    print(f"Medians of {runs} runs, {os.cpu_count()} threads; {versions()}\n")
    print("| work | by | ms | times ours | result |\n|---|---|---|---|---|")
    for row in [ffd(), subdivision(), interpolation(), *filling()]:
        row.print(int(runs))


if __name__ == "__main__":
    main(*sys.argv[1:])
