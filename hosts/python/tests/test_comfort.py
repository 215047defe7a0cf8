"""Tests of values in notebooks and plots, depths with a camera, measures of meshes, graphs built in Python, and shared threads."""

from __future__ import annotations

import base64
import pathlib
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import maquette
from maquette import ron

pytestmark = pytest.mark.every_change

CUBE = maquette.Mesh(
    np.array(np.meshgrid([0, 2], [0, 3], [0, 4])).reshape(3, -1).T,
    [[0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5], [0, 2, 3, 1], [4, 5, 7, 6]],
)


def shown(value: maquette.Value) -> Any:
    """The output of a value in a notebook."""
    formatter = pytest.importorskip("IPython.core.formatters").DisplayFormatter()
    return formatter.format(value)[0]


def test_a_notebook_keeps_one_small_picture_of_a_value() -> None:
    image = maquette.Image(np.random.default_rng(0).integers(0, 255, (1500, 2000, 3)).astype(np.uint8))
    for value in (image, CUBE, maquette.Mask(np.eye(900, dtype=bool))):
        html = value._repr_html_()
        assert html.count("<img") == 1 and len(html) < 800_000
        pngs = re.findall(r"base64,([A-Za-z0-9+/=]+)", html)
        assert len(pngs) == 1 and base64.b64decode(pngs[0]).startswith(b"\x89PNG")
        assert not hasattr(value, "_repr_png_")


def test_ipython_shows_a_value_once() -> None:
    assert set(shown(CUBE)) == {"text/html", "text/plain"}


def test_values_of_pixels_are_arrays_for_numpy_and_plots(tmp_path: pathlib.Path) -> None:
    pixels = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    for value, array in (
        (maquette.Image(pixels), pixels),
        (maquette.Mask(pixels[..., 0] > 9), pixels[..., 0] > 9),
        (maquette.Field(pixels[..., 0]), pixels[..., 0].astype("f4")),
        (maquette.Labels(pixels[..., 0] // 3), pixels[..., 0] // 3),
    ):
        given = np.asarray(value)
        assert (given == array).all() and not given.flags.writeable
        assert np.array(value, dtype=float).dtype == np.float64 and np.array(value).flags.writeable
        assert type(value)(value) == value  # type: ignore[call-arg]


def test_pictures_are_plotted() -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    shown = plt.imshow(maquette.Image(np.arange(60, dtype=np.uint8).reshape(4, 5, 3)))
    assert shown.get_array().shape == (4, 5, 3)


def test_depths_are_points_with_a_camera(tmp_path: pathlib.Path) -> None:
    camera = (500.0, 510.0, 2.0, 1.5)
    depth = np.full((4, 5), 700, np.uint16)
    depth[1, 2] = 0
    image = maquette.RangeImage(depth, camera=camera)
    assert image.camera == camera and np.isnan(image.points[1, 2]).all() and image.facts["valid cells"] == 19
    fx, fy, cx, cy = camera
    x, y, z = image.points[3, 4]
    assert (fx * x / z + cx, fy * y / z + cy, z) == pytest.approx((4, 3, 700))
    for missing in (np.where(depth == 0, np.nan, depth.astype(float)), np.ma.masked_equal(depth, 0)):
        assert maquette.RangeImage(missing, camera=camera) == image
    points = maquette.RangeImage(image.points, camera=camera)
    assert points == image and maquette.RangeImage(image.points).camera is None
    assert image.replace(image.points * 2).camera == camera
    for wrong in (None, (500, 510, 2), (0, 510, 2, 1), (np.nan, 1, 1, 1)):
        with pytest.raises(ValueError, match="camera"):
            maquette.RangeImage(depth, camera=wrong)
    with pytest.raises(ValueError, match="not negative"):
        maquette.RangeImage([[-1.0]], camera=camera)


def test_a_mesh_knows_its_measures() -> None:
    assert CUBE.bounds is not None and CUBE.bounds.tolist() == [[0, 0, 0], [2, 3, 4]]
    assert CUBE.area == pytest.approx(2 * (6 + 8 + 12)) and abs(CUBE.volume) == pytest.approx(24)
    far = CUBE.replace(CUBE.vertices + 1e6)
    assert far.volume == pytest.approx(CUBE.volume)
    normals = CUBE.face_normals
    assert normals.shape == (6, 3) and np.allclose(np.abs(normals).sum(axis=1), 1) and np.allclose(normals.sum(axis=0), 0)
    center = CUBE.vertices.mean(axis=0)
    outward = np.sign(CUBE.volume) * ((CUBE.vertices[CUBE.faces].mean(axis=1) - center) * normals).sum(axis=1)
    assert (outward > 0).all()
    assert np.allclose(np.linalg.norm(CUBE.vertex_normals, axis=1), 1) and CUBE.vertex_normals.shape == (8, 3)
    empty = maquette.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert empty.bounds is None and empty.area == 0 and empty.volume == 0 and empty.face_normals.shape == (0, 3)
    mixed = maquette.Mesh(np.random.default_rng(1).random((5, 3)), [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4]])
    assert mixed.face_normals.shape == (3, 3) and mixed.offsets.dtype == np.int64


def test_values_are_compared_as_by_the_command_line(tmp_path: pathlib.Path, program: Any) -> None:
    same = CUBE.compare(CUBE)
    assert same and same.verdict == "identical" and not same.reasons
    moved = CUBE.replace(CUBE.vertices + [0, 0, 0.5])
    told = CUBE.compare(moved)
    assert not told and told.reasons and told.measures["position"]["max"] == pytest.approx(0.5)
    assert CUBE.compare(moved, max=0.6).verdict == "within tolerance" and not CUBE.compare(moved, max=0.4)
    CUBE.save(tmp_path / "a.ply")
    moved.save(tmp_path / "b.ply")
    for allowed in ("0.4", "0.6"):
        done = program("compare", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "--max", allowed)
        assert bool(CUBE.compare(moved, max=float(allowed))) == (done.returncode == 0)
    with pytest.raises(TypeError):
        CUBE.compare(CUBE.vertices)  # type: ignore[arg-type]


def test_a_graph_is_built_in_python(tmp_path: pathlib.Path) -> None:
    build = maquette.GraphBuilder(doc='Says "so".')
    levels = build.param("levels", ron.Integer(default=1, min=0, max=4, doc="How often."))
    cage = build.input("cage", "Mesh", doc="What is to become smooth.")
    skin = build.node("skin", ron.Subdivide(mesh=cage, scheme=ron.CatmullClark, levels=levels))
    build.output("smooth", build.node("up", ron.Transform(mesh=skin, translate=np.array([0.0, 0, 5]).tolist() and (0, 0, 5))))
    graph = build.load()
    run = graph.run(inputs={"cage": CUBE}, levels=2)
    assert run.value("smooth", maquette.Mesh).faces.shape == (96, 4) and graph.doc == 'Says "so".'
    (tmp_path / "built.ron").write_text(build.text)
    again = maquette.load(tmp_path / "built.ron").run(inputs={"cage": CUBE}, levels=2)
    assert again["smooth"] == run["smooth"]
    with pytest.raises(ValueError, match="already `skin`"):
        build.node("skin", ron.Box())
    with pytest.raises(AttributeError, match="capital"):
        ron.box
    with pytest.raises(TypeError, match="in order or by name"):
        ron.Box(1, size=2)
    for wrong in (object(), float("nan"), "\ud800"):
        with pytest.raises((TypeError, ValueError)):
            ron.Box(size=wrong).__repr__()


def test_every_node_of_a_project_can_be_built(graphs: pathlib.Path) -> None:
    build = maquette.GraphBuilder(doc="The nose.")
    scan = build.node("scan", ron.ReadCapture(color="doll/color.png", range="doll/range.pcd"))
    whole = build.node("whole", ron.FillRange(range=scan["range"]))
    red = build.node("red", ron.Threshold(image=scan["color"], select=ron.Near(color="#c33923", distance=30.0)))
    spots = build.node("spots", ron.Label(mask=red, connectivity=ron.Eight))
    nose = build.node("nose", ron.ExtractRegion(labels=spots, range=whole, pick=ron.Largest))
    build.output("nose.ply", nose)
    path = graphs / "built.ron"
    doll = maquette.load(graphs / "doll.ron", cache=None).run([], nodes="nose")
    assert build.load(path, cache=None).run()["nose.ply"] == doll["nose"]


def test_graphs_share_their_threads() -> None:
    text = """
import os, maquette
count = lambda: len(os.listdir("/proc/self/task"))
text = 'Graph(format: 1, nodes: {"b": Primitive(shape: Box(size: (1, 2, 3)))}, outputs: {"b.ply": "b"})'
graphs = [maquette.load("it.ron", text=text, cache=None) for _ in range(50)]
for graph in graphs: graph.run()
print(count())
more = [maquette.load("it.ron", text=text, cache=None, threads=3) for _ in range(50)]
for graph in more: graph.run()
print(count())
child = os.fork()
if child == 0:
    ok = graphs[0].run()["b.ply"] == graphs[1].run()["b.ply"]
    os._exit(0 if ok else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    first, second, child = map(int, done.stdout.split())
    import os

    assert first <= 2 * (os.cpu_count() or 1) + 4 and second <= first + 4 and child == 0
