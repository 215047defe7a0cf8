"""Deforms a mesh of trimesh by handles from an array, fills its hole, and converts it back.

    python examples/trimesh_ffd.py OUT.glb
"""

import sys

import numpy as np
import trimesh

import maquette

GRAPH = """Graph(
    format: 1,
    doc: "Pulls a mesh by handles and closes its holes.",
    inputs: {
        "mesh": Mesh(doc: "What is deformed."),
        "handles": Handles(doc: "Where it is pulled, and where it is held."),
    },
    nodes: {
        "pulled": Ffd(mesh: "mesh", layout: "handles", mode: Displacement, background: 0.001),
        "closed": FillHoles(mesh: "pulled", holes: All, method: ThinPlate),
    },
    outputs: { "closed": "closed.mesh" },
)"""


def open_sphere() -> trimesh.Trimesh:
    """A sphere of 30 mm without its lower cap."""
    ball: trimesh.Trimesh = trimesh.creation.icosphere(subdivisions=4, radius=30.0)
    ball.update_faces(ball.triangles_center[:, 1] > -24.0)
    ball.remove_unreferenced_vertices()
    return ball


def handles() -> maquette.Handles:
    """Handles that keep the corners of the bounding box and move the middle of its top up by .4 of its height."""
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T.astype(float)
    at = np.vstack([corners, [[0.5, 1.0, 0.5]]])
    to = at + np.vstack([np.zeros_like(corners), [[0.0, 0.4, 0.0]]])
    sigma = np.full_like(at, 0.25)
    return maquette.Handles(at, to, sigma=sigma)


def main(out: str) -> trimesh.Trimesh:
    before = open_sphere()
    graph = maquette.load("pull.ron", text=GRAPH)
    after = graph.run(inputs={"mesh": before, "handles": handles()}, progress=True)["closed"]
    assert isinstance(after, maquette.Mesh)
    mesh = trimesh.Trimesh(after.vertices, after.faces, process=False)
    print(f"closed: {before.is_watertight} -> {mesh.is_watertight}, height {np.ptp(mesh.vertices[:, 1]):.1f} mm")
    mesh.export(out)
    return mesh


if __name__ == "__main__":
    main(*sys.argv[1:])
