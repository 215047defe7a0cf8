"""Tests of renders, exports and scripts that wait for live objects."""

from __future__ import annotations

import pathlib
import sys
from typing import Any, Iterator

import bpy
import numpy as np
import pytest
from test_live import SLOW, folder, module, positions, until  # noqa: F401

from conftest import PACKAGE

# One parameter, the size of a box.
BOX = """Graph(
    format: 1,
    params: {
        "size": Number(default: 10.0, min: 1.0, max: 100.0, doc: "How long a side is."),
    },
    nodes: { "box": Primitive(shape: Box(size: (Param("size"), Param("size"), Param("size")))) },
    outputs: { "box.ply": "box" },
)
"""
THROUGH = """Graph(
    format: 1,
    inputs: { "it": Mesh(doc: "What goes through.") },
    nodes: { "same": Transform(mesh: "it") },
    outputs: { "mesh": "same" },
)
"""


def live(folder: pathlib.Path, text: str, name: str = "box.ron") -> bpy.types.Object:  # noqa: F811
    """A live object of a graph with this text, not computed yet."""
    (folder / name).write_text(text)
    return module("live").add(str(folder / name), bpy.context)


def size(owner: bpy.types.Object) -> float:
    """The size of an object's mesh along x."""
    return round(float(np.ptp(positions(owner)[:, 0])), 1)


@pytest.fixture
def rendered(tmp_path: pathlib.Path, empty: Any) -> Iterator[list[tuple[int, Any]]]:
    """A scene of three frames with a camera; collects the result of `look` for each rendered frame."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.location = camera, (0, 0, 2)
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 1, "CPU"
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.filepath = str(tmp_path / "frame")
    found: list[tuple[int, Any]] = []

    def after(scene: bpy.types.Scene, *_given: Any) -> None:
        owner = max((it for it in bpy.data.objects if it.maquette.graph), key=lambda it: it.name)
        found.append((scene.frame_current, size(owner), len(owner.data.polygons)))

    bpy.app.handlers.render_post.append(after)
    yield found
    bpy.app.handlers.render_post.remove(after)


def key_size(owner: bpy.types.Object) -> None:
    """Animates the size: 10 in the first frame, 30 in the third."""
    for frame, value in ((1, 10.0), (3, 30.0)):
        owner["maquette size"] = value
        owner.keyframe_insert('["maquette size"]', frame=frame)
    linear(owner)


def linear(owner: bpy.types.ID) -> None:
    action = owner.animation_data.action
    curves = action.fcurves if hasattr(action, "fcurves") else action.layers[0].strips[0].channelbags[0].fcurves
    for curve in curves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def test_b3_each_frame_of_an_animation_is_rendered_with_its_own_result(rendered: list[Any], tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, BOX)
    module("waiting").update()
    key_size(owner)
    bpy.ops.render.render(animation=True)
    assert [it[:2] for it in rendered] == [(1, 10.0), (2, 20.0), (3, 30.0)]
    # The stored values are unchanged, and the scene shows its own frame.
    bpy.context.scene.frame_set(2)
    assert size(owner) == 20.0
    rendered.clear()
    bpy.ops.render.render()
    assert [it[:2] for it in rendered] == [(2, 20.0)]


def test_b3_a_driven_value_is_followed_in_each_frame(rendered: list[Any], tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, BOX)
    module("waiting").update()
    owner.driver_add('["maquette size"]').driver.expression = "frame * 7"
    bpy.ops.render.render(animation=True)
    assert [it[:2] for it in rendered] == [(1, 7.0), (2, 14.0), (3, 21.0)]


@pytest.mark.parametrize("how", ["seen", "hidden", "eye", "no render", "collection", "no scene"])
def test_b3_an_input_is_followed_as_the_dependency_graph_evaluates_it(rendered: list[Any], tmp_path: pathlib.Path, how: str) -> None:
    owner = live(tmp_path, THROUGH)
    bpy.ops.mesh.primitive_cube_add(size=1)
    cube = bpy.context.object
    array = cube.modifiers.new("array", "ARRAY")
    for frame, count in ((1, 1), (2, 2), (3, 3)):
        array.count = count
        array.keyframe_insert("count", frame=frame)
        cube.scale.x = frame
        cube.keyframe_insert("scale", frame=frame)
    if how == "hidden":
        cube.hide_viewport = cube.hide_render = True
    elif how == "eye":
        cube.hide_set(True)
    elif how == "no render":
        cube.hide_render = True
    elif how in ("collection", "no scene"):
        for it in list(cube.users_collection):
            it.objects.unlink(cube)
    if how == "collection":
        other = bpy.data.collections.new("other")
        bpy.context.scene.collection.children.link(other)
        other.objects.link(cube)
        bpy.context.view_layer.layer_collection.children["other"].exclude = True
    until(lambda: "it" in owner.maquette.inputs)
    owner.maquette.inputs["it"].object = cube
    wanted = {frame: (1000.0 * frame * frame, 6 * frame) for frame in (1, 2, 3)}
    bpy.ops.render.render(animation=True)
    assert {frame: tuple(its) for frame, *its in rendered} == wanted
    for frame in (2, 1, 3):
        bpy.context.scene.frame_set(frame)
        assert (size(owner), len(owner.data.polygons)) == wanted[frame]
    # The temporary objects are removed.
    assert not [it for kind in (bpy.data.scenes, bpy.data.node_groups) for it in kind if it.name.startswith("maquette")]


def test_b3_a_hidden_live_object_at_an_input_of_another_one_has_its_frame(rendered: list[Any], tmp_path: pathlib.Path) -> None:
    last = live(tmp_path, THROUGH, "through.ron")
    first = live(tmp_path, BOX)
    until(lambda: "it" in last.maquette.inputs and first.maquette.shown)
    key_size(first)
    first.hide_viewport = first.hide_render = True
    last.maquette.inputs["it"].object = first
    bpy.ops.render.render(animation=True)
    assert [it[:2] for it in rendered] == [(1, 10.0), (2, 20.0), (3, 30.0)]


def test_b3_a_script_waits(empty: Any, tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, BOX)
    owner["maquette size"] = 25.0
    sys.modules[PACKAGE].update()
    assert size(owner) == 25.0
    owner["maquette size"] = 26.0
    assert bpy.ops.maquette.update() == {"FINISHED"} and size(owner) == 26.0
    # A file that was just written is read.
    (tmp_path / "box.ron").write_text(BOX.replace('(Param("size"),', '(Expr("2 * size"),'))
    sys.modules[PACKAGE].update()
    assert size(owner) == 52.0
    # Reasons why objects cannot be shown are reported.
    (tmp_path / "box.ron").write_text(BOX.replace("Primitive", "Primitve"))
    with pytest.raises(RuntimeError, match="box: .*Primitve"):
        sys.modules[PACKAGE].update()
    with pytest.raises(RuntimeError, match="Primitve"):
        bpy.ops.maquette.update()
    assert size(owner) == 52.0
    (tmp_path / "box.ron").unlink()
    with pytest.raises(RuntimeError, match="box: cannot read the graph"):
        sys.modules[PACKAGE].update()
    (tmp_path / "box.ron").write_text(BOX)
    sys.modules[PACKAGE].update()
    assert size(owner) == 26.0


def test_b3_waiting_ends_after_its_timeout(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    owner = live(folder, SLOW, "slow.ron")
    module("waiting").update()
    owner["maquette levels"] = 4
    with pytest.raises(TimeoutError, match="slow"):
        sys.modules[PACKAGE].update(timeout=0.3)
    module("live").cancel(owner)
    until(lambda: module("live").state(owner).run is None)
    assert "out of date" in module("live").state(owner).message
    owner["maquette levels"] = 0
    module("waiting").update()
    assert not module("live").state(owner).message


def test_b3_frames_are_baked_into_a_file_that_needs_no_graph(empty: Any, tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, BOX)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    module("waiting").update()
    key_size(owner)
    with pytest.raises(RuntimeError, match="save it, or choose a file"):
        bpy.ops.maquette.bake_frames()
    assert bpy.ops.maquette.bake_frames(filepath=str(tmp_path / "frames.abc")) == {"FINISHED"}
    baked = bpy.data.objects["box frames"]
    assert not baked.maquette.graph
    bpy.data.objects.remove(owner)
    (tmp_path / "box.ron").unlink()
    for frame, wide in ((1, 10.0), (2, 20.0), (3, 30.0)):
        scene.frame_set(frame)
        its = baked.evaluated_get(bpy.context.evaluated_depsgraph_get())
        assert round(max(it.co.x for it in its.data.vertices) - min(it.co.x for it in its.data.vertices), 3) == wide
