"""Tests that conversions from and to trimesh, Open3D and PyVista lose no data."""

from __future__ import annotations

import ctypes
import pathlib
import subprocess
import sys
import warnings
from typing import Any, Dict

import numpy as np
import pytest

import maquette

V = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
F = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
PICTURE = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
CHANCE = np.random.default_rng(1)


def with_capture(mesh: maquette.Mesh) -> maquette.Mesh:
    """The mesh in the frame of a capture, with creases and a pose."""
    parts: Dict[str, Any] = dict(mesh.parts)
    parts["frame"] = maquette.Part("frame", "whole", "number", np.array([[500.0, 500, 2, 2, 5, 4, 700]]))
    parts["frame pose"] = maquette.Part("frame pose", "whole", "number", np.eye(4).reshape(1, 16))
    parts["creases"] = maquette.Part("creases", "edge", "number", np.array([[0.0, 1, 2.5], [1, 2, 1]]))
    value = maquette.Value.from_parts("Mesh", parts)
    assert isinstance(value, maquette.Mesh) and {"frame", "frame pose", "creases"} <= set(value.parts)
    return value


def meshes() -> Dict[str, maquette.Mesh]:
    plain = maquette.Mesh(V, F)
    rich = maquette.Mesh(
        V,
        F,
        uv=V[:, :2] / 9,
        texture=PICTURE,
        heat=[0.5, -1, 2, np.nan],
        id=[3, 2, 2**32 - 1, 0],
        seen=[True, False, True, True],
        normal=V + 1,
        flow=V * 2,
        face_attributes={"part": [0, 1, 1, 2], "weight": [0.1, 0.2, 0.3, 0.4], "marked": [True, False, False, True]},
        corner_attributes={"k": np.arange(12) / 3, "normal": CHANCE.random((12, 3)), "n": np.arange(12), "up": np.arange(12) > 5},
    )
    return {
        "plain": plain,
        "rich": rich,
        "uv of corners": rich.replace(uv=CHANCE.random((12, 2))),
        "uv of corners alone": plain.replace(uv=CHANCE.random((12, 2))),
        "uv without a picture": plain.replace(uv=V[:, :2]),
        "colors": plain.replace(color=PICTURE[:, 0]),
        "colors and uv": rich.replace(color=PICTURE[:, 0]),
        "colors of faces": plain.replace(face_attributes={"color": PICTURE[:, 0]}),
        "colors of both": plain.replace(color=PICTURE[:, 1], face_attributes={"color": PICTURE[:, 0]}),
        "picture without uv": plain.replace(texture=PICTURE),
        "a vertex alone": maquette.Mesh(np.vstack([V, [[5, 5, 5]]]), F, uv=CHANCE.random((12, 2)), heat=np.arange(5) / 2),
        "captured": with_capture(rich),
        "captured, uv of corners": with_capture(rich.replace(uv=CHANCE.random((12, 2)))),
        "nothing": maquette.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)),
    }


MIXED = maquette.Mesh(
    CHANCE.random((6, 3)), [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4, 5, 3]], heat=np.arange(6) / 2, face_attributes={"part": [1, 2, 3]}
)


def differences(one: maquette.Mesh, other: maquette.Mesh) -> Any:
    told = [name for name in sorted(set(one.parts) | set(other.parts)) if name not in one.parts or name not in other.parts]
    for name in set(one.parts) & set(other.parts):
        a, b = one.parts[name], other.parts[name]
        if a.meaning != b.meaning or a.array.dtype != b.array.dtype or a.array.tobytes() != b.array.tobytes():
            told.append(f"{name}: {a.array.tolist()} {b.array.tolist()}")
    return told


@pytest.mark.every_change
@pytest.mark.parametrize("name", meshes())
def test_a_mesh_of_ours_is_taken_whole(name: str) -> None:
    mesh = meshes()[name]
    assert maquette.Mesh(mesh) == mesh == mesh.replace()
    moved = mesh.replace(mesh.vertices + 1)
    assert set(moved.parts) == set(mesh.parts) and (moved.vertices == mesh.vertices + 1).all()
    assert moved.replace(vertices=mesh.vertices) == mesh


@pytest.mark.parametrize("to", ["to_trimesh", "to_pyvista", "to_open3d"])
@pytest.mark.parametrize("name", meshes())
def test_a_mesh_goes_there_and_comes_back(name: str, to: str) -> None:
    pytest.importorskip(to[3:])
    mesh = meshes()[name]
    if name == "nothing" and to == "to_open3d":
        return
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        theirs = getattr(mesh, to)()
    lost = [str(it.message) for it in told if "has no place" in str(it.message)]
    assert bool(lost) == (to == "to_open3d" and "captured" in name), lost
    assert not differences(maquette.Mesh(theirs, like=mesh if lost else None), mesh)


@pytest.mark.parametrize("to", ["to_trimesh", "to_pyvista", "to_open3d"])
def test_faces_of_more_corners_go_there(to: str) -> None:
    pytest.importorskip(to[3:])
    back = maquette.Mesh(getattr(MIXED, to)())
    if to == "to_pyvista":
        assert not differences(back, MIXED)
    else:
        assert back.faces.tolist() == MIXED.triangles.tolist() and back.face_attributes["part"].tolist() == [1, 1, 2, 3, 3, 3]


@pytest.mark.parametrize("to", ["to_trimesh", "to_pyvista", "to_open3d"])
def test_what_others_do_to_it_does_not_change_the_value(to: str) -> None:
    pytest.importorskip(to[3:])
    for mesh in meshes().values():
        truth = {name: part.array.tobytes() for name, part in mesh.parts.items()}
        theirs = getattr(mesh, to)() if len(mesh.faces) else None
        if theirs is None:
            continue
        if to == "to_trimesh":
            theirs.vertices[:] = 7
            theirs.faces[:] = 0
            arrays = [*theirs.vertex_attributes.values(), *theirs.face_attributes.values()]
        elif to == "to_pyvista":
            theirs.points += 100
            arrays = [table[name] for table in (theirs.point_data, theirs.cell_data, theirs.field_data) for name in table.keys()]
        else:
            theirs.vertex.positions += 100
            arrays = [tensor.numpy() for _, tensor in [*theirs.vertex.items(), *theirs.triangle.items()]]
        for array in arrays:
            array = np.asarray(array)
            if array.size and array.flags.c_contiguous:
                ctypes.memset(array.ctypes.data, 1, array.nbytes)
        assert {name: part.array.tobytes() for name, part in mesh.parts.items()} == truth


def at_corners(mesh: maquette.Mesh, rows: Any) -> Any:
    """Rows of vertices or corners, one for each corner."""
    assert rows is not None
    return rows if len(rows) == len(mesh.corners) else rows[mesh.corners]


def test_what_trimesh_reads_is_what_maquette_reads(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    rich = meshes()["rich"]
    rich.save(tmp_path / "it.glb")
    ours = maquette.read(tmp_path / "it.glb", maquette.Mesh)
    for theirs in (trimesh.load(tmp_path / "it.glb", force="mesh", process=False), trimesh.load(tmp_path / "it.glb", process=False)):
        mesh = maquette.Mesh(theirs)
        # trimesh uses metres, and keeps the vertices of the file, one for each corner.
        assert np.allclose(at_corners(mesh, mesh.vertices), at_corners(ours, ours.vertices), atol=1e-4)
        assert mesh.bounds is not None and mesh.bounds.max() > 8
        assert mesh.texture is not None and ours.texture is not None and mesh.texture == ours.texture
        assert np.allclose(at_corners(mesh, mesh.uv), at_corners(ours, ours.uv), atol=1e-6)


@pytest.mark.parametrize(("unit", "scale"), [("m", 1000), ("meters", 1000), ("mm", 1), ("inches", 25.4), ("cm", 10), (None, 1)])
def test_units_of_trimesh_become_mm(unit: Any, scale: float) -> None:
    trimesh = pytest.importorskip("trimesh")
    theirs = trimesh.Trimesh(V, F, process=False)
    theirs.units = unit
    assert np.allclose(maquette.Mesh(theirs).vertices, V * scale)


def test_colors_and_attributes_of_trimesh_come_in() -> None:
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box()
    box.visual.vertex_colors = [255, 0, 0, 255]
    box.vertex_attributes["heat"] = np.arange(8.0)
    box.face_attributes["side"] = np.arange(12)
    mesh = maquette.Mesh(box)
    assert mesh.attributes["color"].tolist() == [[255, 0, 0]] * 8 and mesh.attributes["heat"].tolist() == list(range(8))
    assert mesh.face_attributes["side"].tolist() == list(range(12))
    cloud = trimesh.PointCloud(V, colors=[[1, 2, 3, 255]] * 4)
    assert maquette.Points(cloud).attributes["color"].tolist() == [[1, 2, 3]] * 4
    box.vertex_attributes["label"] = np.arange(8) - 1
    box.visual.vertex_colors = [255, 0, 0, 128]
    with pytest.warns(UserWarning) as told:
        assert "label" not in maquette.Mesh(box).attributes
    assert {"label" in str(it.message) or "opaque" in str(it.message) for it in told} == {True} and len(told) == 2


@pytest.mark.parametrize("name", ["position", "corners", "sides", "creases", "frame", "corner x", "face x"])
def test_attributes_with_names_of_columns_are_left_out_with_a_warning(name: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box()
    box.vertex_attributes[name] = np.ones((8, 3))
    with pytest.warns(UserWarning, match=name):
        mesh = maquette.Mesh(box)
    assert (mesh.vertices == box.vertices).all() and not mesh.attributes
    pyvista = pytest.importorskip("pyvista")
    theirs = pyvista.Sphere()
    theirs.clear_data()
    theirs.point_data[name] = np.ones((theirs.n_points, 3))
    with pytest.warns(UserWarning, match=name):
        mesh = maquette.Mesh(theirs)
    assert np.allclose(mesh.vertices, theirs.points)


def test_what_trimesh_changed_comes_in_changed() -> None:
    pytest.importorskip("trimesh")
    rich = with_capture(meshes()["rich"].replace(uv=CHANCE.random((12, 2))))
    theirs = rich.to_trimesh()
    theirs.apply_scale(2)
    scaled = maquette.Mesh(theirs)
    assert not differences(scaled.replace(scaled.vertices / 2), rich)
    theirs = rich.to_trimesh()
    theirs.update_faces([True, False, True, True])
    with pytest.warns(UserWarning, match="faces have changed: .*corner k"):
        fewer = maquette.Mesh(theirs)
    assert len(fewer.faces) == 3 and fewer.face_attributes["part"].tolist() == [0, 1, 2] and "frame" in fewer.parts
    theirs = rich.to_trimesh()
    theirs.vertices[0] += 1
    assert maquette.Mesh(theirs).uv is not None


def test_open3d_of_both_kinds() -> None:
    open3d = pytest.importorskip("open3d")
    mesh = maquette.Mesh(V, F, uv=CHANCE.random((12, 2)), texture=PICTURE, color=PICTURE[:, 0], normal=V + 1)
    theirs = mesh.to_open3d(legacy=True)
    assert isinstance(theirs, open3d.geometry.TriangleMesh) and not differences(maquette.Mesh(theirs), mesh)
    with pytest.warns(UserWarning, match="heat.*face part"):
        mesh.replace(heat=[1.0, 2, 3, 4], face_attributes={"part": [1, 2, 3, 4]}).to_open3d(legacy=True)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(V))
    cloud.colors = open3d.utility.Vector3dVector(PICTURE[:, 0] / 255)
    cloud.normals = open3d.utility.Vector3dVector(V + 1)
    points = maquette.Points(cloud)
    assert points.attributes["color"].tolist() == PICTURE[:, 0].tolist() and points.attributes["normal"].tolist() == (V + 1).tolist()
    assert maquette.Points(open3d.t.geometry.PointCloud.from_legacy(cloud)).attributes["color"].tolist() == PICTURE[:, 0].tolist()


@pytest.mark.parametrize("ending", ["obj", "glb"])
def test_what_open3d_reads_has_the_picture_and_uv_of_the_file(ending: str, tmp_path: pathlib.Path) -> None:
    open3d = pytest.importorskip("open3d")
    mesh = maquette.Mesh(V, F, uv=CHANCE.random((12, 2)), texture=PICTURE)
    path = str(tmp_path / f"it.{ending}")
    mesh.save(path)
    for theirs in (open3d.io.read_triangle_mesh(path), open3d.t.io.read_triangle_mesh(path)):
        back = maquette.Mesh(theirs)
        assert back.texture == mesh.texture and back.uv is not None and mesh.uv is not None
        assert np.allclose(np.sort(back.uv, axis=0), np.sort(mesh.uv, axis=0), atol=1e-5)


def test_pyvista_meshes_and_clouds_come_in() -> None:
    pyvista = pytest.importorskip("pyvista")
    cube = pyvista.Cube().compute_normals(split_vertices=True)
    cube.cell_data["side"] = np.arange(6)
    mesh = maquette.Mesh(cube)
    assert mesh.faces.shape == (6, 4) and mesh.face_attributes["side"].tolist() == list(range(6)) and "normal" in mesh.attributes
    assert maquette.Mesh(pyvista.Sphere()).faces.shape[1] == 3
    assert maquette.Mesh(pyvista.Plane().texture_map_to_plane()).uv is not None
    cloud = pyvista.PolyData(V)
    cloud["heat"] = np.arange(4.0)
    assert maquette.Points(cloud).attributes["heat"].tolist() == [0, 1, 2, 3]
    with pytest.raises(TypeError, match="extract_surface"):
        maquette.Mesh(pyvista.ImageData(dimensions=(2, 2, 2)))


@pytest.mark.every_change
def test_a_frame_stays_when_vertices_move(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    model = maquette.load(graphs / "doll.ron").run(levels=0).value("model.ply", maquette.Mesh)
    assert {"frame", "texture camera"} <= set(model.replace(model.vertices + [0, 0, 1]).parts)
    for moved in (model.replace(model.vertices + [0, 0, 1]), maquette.Mesh(model.vertices + [0, 0, 1], model.faces, like=model)):
        assert moved.parts["frame"].array.tobytes() == model.parts["frame"].array.tobytes()
        model.save(tmp_path / "a.ply")
        moved.save(tmp_path / "b.ply")
        a, b = (maquette.read(tmp_path / name, maquette.Mesh).vertices for name in ("a.ply", "b.ply"))
        assert np.allclose(a - [0, 0, 1], b, atol=1e-3)


@pytest.mark.every_change
def test_what_is_replaced_must_fit_and_none_takes_away() -> None:
    rich = meshes()["rich"]
    with pytest.raises(ValueError, match="entries|elements"):
        rich.replace(faces=F[:3])
    kept = rich.replace(
        faces=F[:3],
        face_attributes=dict.fromkeys(rich.face_attributes),
        corner_attributes=dict.fromkeys(rich.corner_attributes),
    )
    assert len(kept.faces) == 3 and not kept.face_attributes and not kept.corner_attributes and kept.texture == rich.texture
    assert set(rich.attributes) - set(rich.replace(heat=None, uv=None).attributes) == {"heat", "uv"}
    assert rich.replace(texture=None).texture is None and rich.replace(faces=[[0, 1, 2, 3]], **{"face_attributes": dict.fromkeys(rich.face_attributes), "corner_attributes": dict.fromkeys(rich.corner_attributes)}).faces.shape == (1, 4)
    mixed = MIXED.replace(faces=[[0, 1, 2], [2, 3, 4], [3, 4, 5]])
    assert mixed.faces.shape == (3, 3) and mixed.face_attributes["part"].tolist() == [1, 2, 3]


@pytest.mark.every_change
def test_no_library_is_imported_before_it_is_asked_for() -> None:
    text = """
import sys, maquette, numpy as np
mesh = maquette.Mesh(np.eye(3), [[0, 1, 2]]); mesh.replace(mesh.vertices); maquette.Mesh(mesh); maquette.Points(mesh.vertices)
class Foreign: vertices, faces = mesh.vertices, mesh.faces
maquette.Mesh(Foreign())
print([name for name in ("trimesh", "open3d", "pyvista", "vtkmodules", "PIL", "scipy") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
