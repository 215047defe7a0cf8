"""Tests of manual edits of a live object's mesh: they are kept, transferred, or stop the object with a message until one click."""

from __future__ import annotations

import json
import pathlib
from typing import Any, Callable

import bpy
import numpy as np
import pytest
from test_live import module, positions, settled, until

SMALL = """Graph(
    format: 1,
    params: {
        "levels": Integer(default: 3, min: 0, max: 5, doc: "How fine."),
        "tall": Number(default: 1.0, min: 0.1, max: 9.0, doc: "How tall."),
    },
    nodes: {
        "cage": ReadMesh(path: "cage.obj"),
        "picture": ReadImage(path: "picture.png"),
        "fine": Subdivide(mesh: "cage", scheme: CatmullClark, levels: Param("levels")),
        "shown": Transform(mesh: "fine", scale: (1.0, 1.0, Param("tall"))),
    },
    outputs: { "shown.ply": "shown" },
)
"""

DEFAULTS = {"levels": "3", "tall": "1.0"}

CAGE = "".join(f"v {x} {y} {z}\n" for z in (-9, 9) for y in (-20, 20) for x in (-30, 30)) + (
    "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
)


@pytest.fixture
def small(empty: Any, tmp_path: pathlib.Path) -> bpy.types.Object:
    """A live object with few faces, computed."""
    (tmp_path / "small.ron").write_text(SMALL)
    (tmp_path / "cage.obj").write_text(CAGE)
    picture = bpy.data.images.new("picture", 4, 4)
    picture.filepath_raw, picture.file_format = str(tmp_path / "picture.png"), "PNG"
    picture.save()
    owner = module("live").add(str(tmp_path / "small.ron"), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))
    return owner


def turn(owner: bpy.types.Object, name: str, value: Any) -> None:
    """Moves a slider, and waits for the result."""
    owner[f"maquette {name}"] = value
    # A value that equals the graph's own is not stored.
    until(lambda: json.loads(owner.maquette.values or "{}").get(name, DEFAULTS[name]) == str(value))
    until(lambda: owner.maquette.held or settled(owner))


def decorate(owner: bpy.types.Object) -> None:
    """Makes manual edits of all kinds around one vertex."""
    mesh = owner.data
    owner.vertex_groups.new(name="Pin").add(list(range(100)), 0.75, "REPLACE")
    low, high = positions(owner).min(0), positions(owner).max(0)
    shares = (positions(owner) - low) / (high - low)
    colors = np.column_stack([shares, np.ones(len(shares))]).astype("f4")
    mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT").data.foreach_set("color", colors.ravel())
    corners = np.empty(len(mesh.loops), "i4")
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.uv_layers.new(name="Second").uv.foreach_set("vector", shares[corners][:, :2].astype("f4").ravel())
    mesh.attributes.new("mine", "INT", "FACE").data.foreach_set("value", np.full(len(mesh.polygons), 5, "i4"))
    mesh.materials.append(bpy.data.materials.new("mine"))
    mesh.polygons.foreach_set("material_index", np.full(len(mesh.polygons), len(mesh.materials) - 1, "i4"))
    mesh.edges[5].use_seam = mesh.edges[6].use_edge_sharp = True
    mesh.update()


def work(owner: bpy.types.Object) -> dict[str, Any]:
    """Measures of the remaining edits that do not depend on the number of faces."""
    mesh, places = owner.data, positions(owner)
    weights = np.array([sum(one.weight for one in it.groups) for it in mesh.vertices])
    paint = np.empty(4 * len(mesh.vertices), "f4")
    mesh.attributes["Paint"].data.foreach_get("color", paint)
    second = np.empty(2 * len(mesh.loops), "f4")
    mesh.uv_layers["Second"].uv.foreach_get("vector", second)
    corners = np.empty(len(mesh.loops), "i4")
    mesh.loops.foreach_get("vertex_index", corners)
    low, high = places.min(0), places.max(0)
    shares = (places - low) / (high - low)
    return {
        "groups": [it.name for it in owner.vertex_groups],
        "middle": (places * weights[:, None]).sum(0) / weights.sum(),
        "paint": float(np.abs(paint.reshape(-1, 4)[:, :3] - shares).max()),
        "second": float(np.abs(second.reshape(-1, 2) - shares[corners][:, :2]).max()),
        "mine": {it.value for it in mesh.attributes["mine"].data},
        "slots": {mesh.materials[it.material_index].name for it in mesh.polygons},
        "seams": sum((places[a] - places[b]) @ (places[a] - places[b]) for a, b in (it.vertices for it in mesh.edges if it.use_seam)) ** 0.5,
        "sharp": sum(it.use_edge_sharp for it in mesh.edges),
    }


def test_work_stays_on_the_same_faces_and_is_carried_over_to_others(small: bpy.types.Object) -> None:
    decorate(small)
    first = work(small)
    assert first["paint"] == first["second"] == 0 and first["sharp"] == 1
    turn(small, "tall", 1.1)
    same = work(small)
    assert {**same, "middle": 0, "paint": 0, "second": 0, "seams": 0} == {**first, "middle": 0, "paint": 0, "second": 0, "seams": 0}
    turn(small, "tall", 1.0)
    for levels in (4, 3):
        faces = len(small.data.polygons)
        turn(small, "levels", levels)
        assert not small.maquette.held and len(small.data.polygons) != faces
        now = work(small)
        assert (now["groups"], now["mine"], now["slots"]) == (["Pin"], {5}, {"mine"})
        assert np.abs(now["middle"] - first["middle"]).max() < 3, (levels, now, first)
        assert now["paint"] < 0.05 and now["second"] < 0.05, (levels, now)
        assert not small.data.validate(verbose=True)


def test_sharp_edges_and_seams_are_carried_to_the_edges_along_them(empty: Any, tmp_path: pathlib.Path) -> None:
    by_hand = module("by_hand")
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=4)
    owner = bpy.context.object
    mesh = owner.data
    row = [it for it in mesh.edges if all(abs(mesh.vertices[end].co.y) < 1e-6 for end in it.vertices)]
    assert len(row) == 4
    for it in row:
        it.use_seam = it.use_edge_sharp = True
    mesh.update()
    taken = by_hand.collect(owner)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, size=4)
    fine = bpy.context.object.data

    def numbers(elements: Any, name: str, kind: str, width: int = 1) -> Any:
        found = np.empty(width * len(elements), kind)
        elements.foreach_get(name, found)
        return found.reshape(-1, width)

    why, carried = by_hand.plan(
        taken,
        numbers(fine.vertices, "co", "f4", 3).astype("f8"),
        numbers(fine.loops, "vertex_index", "i4").ravel(),
        numbers(fine.polygons, "loop_total", "i4").ravel(),
        numbers(fine.edges, "vertices", "i4", 2),
    )
    assert not why
    fine.polygons.foreach_set("use_smooth", [True] * len(fine.polygons))
    by_hand.restore(bpy.context.object, carried)
    for name in ("use_seam", "use_edge_sharp"):
        marked = [it for it in fine.edges if getattr(it, name)]
        assert len(marked) == 8 and all(abs(fine.vertices[end].co.y) < 1e-6 for it in marked for end in it.vertices)


def test_work_that_has_no_place_stops_the_object_until_the_user_goes_on(small: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    decorate(small)
    first = positions(small).copy()
    (tmp_path / "far.ron").write_text('Graph(format: 1, nodes: { "it": ReadMesh(path: "far.obj") }, outputs: { "far.ply": "it" })')
    (tmp_path / "far.obj").write_text("v 9000 0 0\nv 9001 0 0\nv 9000 1 0\nf 1 2 3\n")
    small.maquette.graph = str(tmp_path / "far.ron")
    until(lambda: small.maquette.held)
    assert "Pin" in small.maquette.held and "no longer follows its graph" in module("live").state(small).message
    assert (positions(small) == first).all() and work(small)["sharp"] == 1
    assert bpy.ops.maquette.go_on() == {"FINISHED"}
    until(lambda: settled(small) and len(small.data.vertices) == 3)
    assert not small.maquette.held


@pytest.fixture
def keyed(small: bpy.types.Object) -> bpy.types.Object:
    """A live object with a shape key that moves some of its vertices."""
    small.shape_key_add(name="Basis")
    smile = small.shape_key_add(name="Smile")
    for at in range(200):
        smile.data[at].co.x += 5
    smile.value, smile.slider_max = 0.5, 2.0
    return small


def seen(owner: bpy.types.Object) -> Any:
    """The evaluated vertices."""
    bpy.context.view_layer.update()
    evaluated = owner.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    found = np.empty(3 * len(mesh.vertices), "f4")
    mesh.vertices.foreach_get("co", found)
    evaluated.to_mesh_clear()
    return found.reshape(-1, 3)


def test_shape_keys_follow_the_graph(keyed: bpy.types.Object) -> None:
    was = seen(keyed)
    turn(keyed, "tall", 2.0)
    assert np.abs(seen(keyed) - was).max() > 4
    moves = seen(keyed) - positions(keyed)
    assert np.abs(moves[:200] - [2.5, 0, 0]).max() < 1e-3 and np.abs(moves[200:]).max() < 1e-3
    for levels in (2, 4):
        turn(keyed, "levels", levels)
        blocks = keyed.data.shape_keys.key_blocks
        assert [(it.name, it.value, it.slider_max) for it in blocks][1] == ("Smile", 0.5, 2.0)
        assert {len(it.data) for it in blocks} == {len(keyed.data.vertices)}
        moves = seen(keyed) - positions(keyed)
        assert 1.2 < np.abs(moves).max() < 2.6, levels
    # Animated shape keys cannot be transferred.
    keyed.data.shape_keys.key_blocks["Smile"].keyframe_insert("value", frame=1)
    count = len(keyed.data.vertices)
    turn(keyed, "levels", 3)
    assert "animated" in keyed.maquette.held and len(keyed.data.vertices) == count
    assert bpy.ops.maquette.go_on() == {"FINISHED"}
    until(lambda: settled(keyed) and len(keyed.data.vertices) != count)
    assert not keyed.data.shape_keys


def apply_array(owner: bpy.types.Object) -> None:
    owner.modifiers.new("array", "ARRAY")
    assert bpy.ops.object.modifier_apply(modifier="array") == {"FINISHED"}


def apply_displacement(owner: bpy.types.Object) -> None:
    owner.modifiers.new("displace", "DISPLACE")
    assert bpy.ops.object.modifier_apply(modifier="displace") == {"FINISHED"}


def join(owner: bpy.types.Object) -> None:
    bpy.ops.mesh.primitive_cube_add()
    owner.select_set(True)
    bpy.context.view_layer.objects.active = owner
    assert bpy.ops.object.join() == {"FINISHED"}


def flip(owner: bpy.types.Object) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.flip_normals()
    bpy.ops.object.mode_set(mode="OBJECT")


def sculpt(owner: bpy.types.Object) -> None:
    owner.data.vertices[5].co.z += 100


def convert_with_a_modifier(owner: bpy.types.Object) -> None:
    owner.modifiers.new("array", "ARRAY")
    assert bpy.ops.object.convert(target="MESH") == {"FINISHED"}


@pytest.mark.parametrize("does", [apply_array, apply_displacement, join, flip, sculpt, convert_with_a_modifier])
def test_an_edited_mesh_stops_its_object_and_one_click_goes_on(small: bpy.types.Object, does: Callable[..., None]) -> None:
    first = positions(small).copy()
    does(small)
    until(lambda: settled(small) or small.maquette.held)
    edited = positions(small).copy()
    assert edited.shape != first.shape or (edited != first).any() or does is flip
    turn(small, "tall", 2.0)
    assert small.maquette.held and (positions(small) == edited).all()
    assert "no longer follows its graph" in module("live").hindrance(small)
    assert bpy.ops.maquette.go_on() == {"FINISHED"}
    until(lambda: settled(small) and len(small.data.vertices) == len(first))
    assert not small.maquette.held and np.abs(positions(small) - first).max() > 4


def test_convert_to_mesh_makes_it_static(small: bpy.types.Object) -> None:
    first = positions(small).copy()
    until(lambda: module("live").state(small).marked)
    assert bpy.ops.object.convert(target="MESH") == {"FINISHED"}
    turn(small, "tall", 2.0)
    # Before 5.0, a conversion of a mesh without modifiers leaves no trace.
    is_static = bpy.app.version >= (5, 0)
    assert bool((positions(small) == first).all()) == ("converted" in module("live").hindrance(small)) == is_static


def test_work_on_a_mesh_that_would_be_empty_stops_the_object(small: bpy.types.Object) -> None:
    decorate(small)
    small.maquette.output = "picture"
    until(lambda: small.maquette.held)
    assert work(small)["groups"] == ["Pin"]


def test_a_mesh_of_another_file_is_not_written(small: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    library = str(tmp_path / "library.blend")
    bpy.ops.wm.link(filepath=f"{library}/Object/small", directory=f"{library}/Object/", filename="small")
    owner = bpy.data.objects["small"]
    owner.select_set(True)
    bpy.context.view_layer.objects.active = owner
    bpy.ops.object.make_local(type="SELECT_OBJECT")
    owner = bpy.context.view_layer.objects.active
    assert owner.data.library
    linked = owner.data
    until(lambda: settled(owner))
    places = positions(owner).copy()
    turn(owner, "tall", 2.0)
    assert not owner.data.library and (positions(owner) != places).any()
    found = np.empty(3 * len(linked.vertices), np.float32)
    linked.vertices.foreach_get("co", found)
    assert (found.reshape(-1, 3) == places).all()
