"""Tests that other libraries accept the arrays of values, and that values accept their arrays."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

import maquette


@pytest.fixture
def mesh(graphs: pathlib.Path) -> maquette.Mesh:
    value = maquette.load(graphs / "doll.ron").run("model.ply")["model.ply"]
    assert isinstance(value, maquette.Mesh)
    return value


def test_trimesh(mesh: maquette.Mesh) -> None:
    trimesh = pytest.importorskip("trimesh")
    theirs = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert np.isclose(theirs.area, mesh_area(mesh))
    assert maquette.Mesh(theirs) == maquette.Mesh(mesh.vertices, mesh.faces)
    cloud = trimesh.PointCloud(mesh.vertices)
    assert maquette.Points(cloud).positions.shape == mesh.vertices.shape


def mesh_area(mesh: maquette.Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_scipy(mesh: maquette.Mesh) -> None:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(mesh.vertices).query(mesh.vertices[:100])
    assert (distance == 0).all() and (mesh.vertices[nearest] == mesh.vertices[:100]).all()
    edges, n = mesh.edges, len(mesh.vertices)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    assert connected_components(graph, directed=False)[0] >= 1


def test_pillow(graphs: pathlib.Path, mesh: maquette.Mesh) -> None:
    from PIL import Image

    value = maquette.read(graphs / "doll/color.png")
    assert isinstance(value, maquette.Image)
    picture = Image.fromarray(value.pixels)
    assert picture.size == (value.pixels.shape[1], value.pixels.shape[0])
    assert maquette.Image(picture) == maquette.Image(value.pixels) == maquette.Image(Image.open(graphs / "doll/color.png"))


def test_pymeshlab(mesh: maquette.Mesh) -> None:
    pymeshlab = pytest.importorskip("pymeshlab")
    theirs = pymeshlab.Mesh(mesh.vertices, mesh.faces)
    assert theirs.vertex_number() == len(mesh.vertices)
    # The library stores single precision.
    back = maquette.Mesh(theirs.vertex_matrix(), theirs.face_matrix())
    assert (back.faces == mesh.faces).all() and np.allclose(back.vertices, mesh.vertices, atol=1e-4)


def test_matplotlib(mesh: maquette.Mesh, tmp_path: pathlib.Path) -> None:
    import matplotlib.pyplot as plt

    figure = plt.figure()
    figure.add_subplot(projection="3d").plot_trisurf(*mesh.vertices.T, triangles=mesh.faces[:500])
    figure.savefig(tmp_path / "it.png")
    assert (tmp_path / "it.png").stat().st_size > 1000
