"""Tests of values from arrays and arrays from values: they are copied and complete, and invalid ones are refused."""

from __future__ import annotations

import gc
import os
import pathlib
import pickle

import numpy as np
import pytest

import maquette

CORNERS = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
ROOT = pathlib.Path(__file__).resolve().parents[3]
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def memory() -> int:
    """The memory of this process, in bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_each_access_copies_and_the_value_holds_its_numbers_once() -> None:
    side = 2100
    grid = np.dstack([*np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float)), np.zeros((side, side))])
    value = maquette.RangeImage(grid)
    value.facts
    gc.collect()
    before = memory()
    array = value.points
    assert array.nbytes > 100e6 and memory() - before < 1.1 * array.nbytes
    assert not np.shares_memory(array, value.points) and not np.shares_memory(array, value.parts["point"].array)
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0, 0] = 1.0
    with pytest.raises(ValueError):
        array.flags.writeable = True
    size = array.nbytes
    del array
    gc.collect()
    assert memory() - before < 0.1 * size, "an array goes with the last name that it has"
    array = value.points
    del value
    gc.collect()
    assert array[7, 5].tolist() == [5.0, 7.0, 0.0]
    copy = array.copy()
    copy[0, 0, 2] = 3.0
    assert maquette.RangeImage(copy).points[0, 0, 2] == 3.0


def test_memory_is_given_back_with_the_last_array() -> None:
    value = maquette.Field(np.random.default_rng(1).random((3600, 3600)))
    array = value.numbers
    held, size = memory(), array.nbytes
    del value, array
    gc.collect()
    assert size > 50e6 and held - memory() > 0.8 * size


def test_a_mesh_has_its_faces_edges_and_attributes() -> None:
    mesh = maquette.Mesh(CORNERS, FACES, heat=[1, 2, 3, 4], normal=CORNERS + 1, face_attributes={"part": [0, 1, 1, 0]})
    assert mesh.vertices.tolist() == CORNERS.tolist() and mesh.faces.tolist() == FACES.tolist()
    assert mesh.faces.dtype == np.uint32 and mesh.offsets.tolist() == [0, 3, 6, 9, 12]
    assert mesh.edges.shape == (6, 2) and (mesh.edges[:, 0] < mesh.edges[:, 1]).all()
    corners = mesh.corners.reshape(-1, 3)
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2))
    assert (mesh.edges[mesh.corner_edge] == sides).all()
    assert set(mesh.attributes) == {"heat", "normal"} and mesh.attributes["heat"].tolist() == [1, 2, 3, 4]
    assert mesh.face_attributes["part"].tolist() == [0, 1, 1, 0]
    with pytest.raises(KeyError, match="heat"):
        mesh.attributes["het"]


def test_faces_may_have_several_sizes() -> None:
    mesh = maquette.Mesh(np.random.default_rng(1).random((5, 3)), [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4]])
    assert mesh.offsets.tolist() == [0, 4, 7, 10] and mesh.corners.tolist() == [0, 1, 2, 3, 0, 1, 4, 1, 2, 4]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 4], [1, 2, 4]]
    with pytest.raises(ValueError, match="several sizes"):
        mesh.faces


def test_a_textured_mesh_goes_out_and_in(tmp_path: pathlib.Path) -> None:
    picture = np.zeros((2, 3, 3), dtype=np.uint8)
    picture[0, 1] = [255, 128, 0]
    mesh = maquette.Mesh(CORNERS, FACES, uv=CORNERS[:, :2] / 9, texture=picture)
    assert mesh.texture is not None and mesh.texture.pixels.tolist() == picture.tolist()
    mesh.save(tmp_path / "it.glb")
    read = maquette.read(tmp_path / "it.glb")
    assert isinstance(read, maquette.Mesh) and read.texture == mesh.texture and read.uv is not None
    assert sorted(os.path.basename(it) for it in mesh.save(tmp_path / "it.obj")) == ["it.mtl", "it.obj", "it.png"]
    with pytest.raises(ValueError, match="several files"):
        mesh.to_bytes("obj")


def test_a_value_is_saved_whole_or_not_at_all_and_replaces_plain_files_alone(tmp_path: pathlib.Path) -> None:
    mesh = maquette.Mesh(CORNERS, FACES)
    assert mesh.save(tmp_path / "new/it.ply") == [str(tmp_path / "new/it.ply")]
    (tmp_path / "mine.ply").write_text("mine")
    (tmp_path / "link.ply").symlink_to(tmp_path / "mine.ply")
    with pytest.raises(OSError, match="link.ply.*a link"):
        mesh.save(tmp_path / "link.ply")
    assert (tmp_path / "mine.ply").read_text() == "mine"
    with pytest.raises(ValueError, match="glb"):
        mesh.save(tmp_path / "it.xyz")
    assert sorted(os.listdir(tmp_path)) == ["link.ply", "mine.ply", "new"]
    mesh.save(tmp_path / "mine.ply")
    assert (tmp_path / "mine.ply").read_bytes() == mesh.to_bytes("ply")


@pytest.mark.parametrize(
    "make",
    [
        lambda: maquette.Mesh(CORNERS, FACES, heat=[1.5, 2, 3, 4], part=[1, 2, 3, 4], seen=CORNERS[:, 0] > 0, color=FACES.astype("u1")),
        lambda: maquette.read(ROOT / "graphs/doll/coarse.obj"),
        lambda: maquette.Mesh(np.random.default_rng(1).random((5, 3)), [[0, 1, 2, 3], [0, 1, 4]]),
        lambda: maquette.Points(CORNERS, size=np.arange(4.0)),
        lambda: maquette.Image(np.arange(60, dtype=np.uint8).reshape(4, 5, 3)),
        lambda: maquette.Mask(np.eye(3, dtype=bool)),
        lambda: maquette.Field([[1.0, np.nan], [2.0, 3.0]]),
        lambda: maquette.Labels(np.array([[0, 1], [2, 2]])),
        lambda: maquette.RangeImage(np.random.default_rng(1).random((4, 5, 3)), np.zeros((4, 5, 3), np.uint8)),
        lambda: maquette.Curve(CORNERS, closed=True),
        lambda: maquette.Curve(CORNERS, knots=[0, 0, 0, 0, 1, 1, 1, 1], weights=[1, 2, 2, 1]),
        lambda: maquette.ControlNet(np.random.default_rng(1).random((4, 5, 3))),
        lambda: maquette.Surface(np.random.default_rng(1).random((4, 5, 3)), np.ones((4, 5)), degree=(2, 3)),
        lambda: maquette.KnotVector([0, 0, 1, 1], degree=1),
        lambda: maquette.Handles(CORNERS / 9, CORNERS / 8, weight=[1, 2, 3, 4], space="World"),
        lambda: maquette.Direction([0, 3, 4]),
    ],
)
def test_every_value_is_made_shown_and_pickled(make: object) -> None:
    value = make()  # type: ignore[operator]
    again = pickle.loads(pickle.dumps(value))
    assert type(again) is type(value) and again == value and hash(again) == hash(value)
    assert maquette.Value.from_parts(value.kind, value.parts, value.facts) == value
    assert value.kind in repr(value) and "<table>" in value._repr_html_()
    for name in dir(type(value)):
        if isinstance(getattr(type(value), name), property) and not (name == "faces" and "sides" in value.parts):
            getattr(value, name)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: maquette.Mesh(CORNERS, [[0, 1, 9]]), "9"),
        (lambda: maquette.Mesh(CORNERS, [[0, 1, -1]]), "corner 2"),
        (lambda: maquette.Mesh(CORNERS, [[0.0, 1.0, 2.0]]), "float"),
        (lambda: maquette.Mesh(CORNERS[:, :2], FACES), r"\(4, 2\)"),
        (lambda: maquette.Mesh(CORNERS * np.nan, FACES), "NaN|finite|number"),
        (lambda: maquette.Mesh(CORNERS, FACES, heat=[1, 2]), "heat"),
        (lambda: maquette.Mesh(CORNERS, FACES, uv=[[0, 0]]), "uv has 1"),
        (lambda: maquette.Mesh(CORNERS, FACES, name=["a", "b", "c", "d"]), "name"),
        (lambda: maquette.Mesh(object()), "vertices and faces"),
        (lambda: maquette.Image(np.zeros((2, 2))), "rows, columns, 3"),
        (lambda: maquette.Image(np.zeros((2, 2, 3))), "uint8"),
        (lambda: maquette.Mask([[0, 2]]), "inside"),
        (lambda: maquette.Curve(CORNERS, knots=[3, 2, 1, 0, 0, 0, 0, 0]), "knot"),
        (lambda: maquette.Handles(CORNERS, CORNERS[:2]), "to"),
        (lambda: maquette.Handles(CORNERS, space="Sphere"), "Box, Cube or World"),
        (lambda: maquette.Direction([0, 0, 0]), "."),
        (lambda: maquette.Value.from_parts("Mash", {}), "Mash"),
        (lambda: maquette.Value.from_parts("Points", {"position": ("vortex", CORNERS)}), "vortex"),
        (lambda: maquette.Value.from_parts("Points", {}), "position"),
        (lambda: maquette.Value.from_parts("Points", {"a": maquette.Part("a", "point", "heat", CORNERS)}), "heat"),
        (lambda: maquette.Value(), "made by"),
        (lambda: maquette.Mesh(CORNERS, FACES).to_bytes("xyz"), "glb"),
        (lambda: maquette.Mesh(CORNERS, FACES).render(size=(0, 5)), "pixels"),
        (lambda: maquette.Mesh(CORNERS, FACES).render(yaw=float("nan")), "yaw"),
    ],
)
def test_what_is_wrong_is_refused_with_the_place(wrong: object, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        wrong()  # type: ignore[operator]


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", [">f8", "<f8", "f4", "f2", "i8", "u1"])
def test_arrays_of_any_layout_are_understood(order: str, kind: str) -> None:
    plain = maquette.Mesh(CORNERS, FACES)
    vertices = np.asarray(CORNERS.astype(kind), order=order)  # type: ignore[call-overload]
    assert maquette.Mesh(vertices, np.asarray(FACES, order=order)) == plain  # type: ignore[call-overload]
    assert maquette.Mesh(np.repeat(vertices, 2, axis=0)[::2], FACES.astype(">i2")) == plain


def test_the_input_may_change_afterwards() -> None:
    vertices = CORNERS.copy()
    mesh = maquette.Mesh(vertices, FACES)
    vertices[:] = 0
    assert mesh.vertices.tolist() == CORNERS.tolist()


def test_a_picture_is_the_same_as_that_of_the_command_line(graphs: pathlib.Path, program, tmp_path: pathlib.Path) -> None:  # type: ignore[no-untyped-def]
    picture = tmp_path / "it.png"
    done = program("render", str(graphs / "doll/coarse.obj"), str(picture), "--camera", "35,10,2")
    assert done.returncode == 0, done.stderr
    mesh = maquette.read(graphs / "doll/coarse.obj")
    assert mesh.render(35, 10, zoom=2).to_bytes("png") == picture.read_bytes()


def test_a_probe_says_what_is_at_a_pixel(graphs: pathlib.Path) -> None:
    picture = maquette.read(graphs / "doll/color.png")
    assert picture.probe(10, 20) and not maquette.Points(CORNERS).probe(0, 0)
