"""Tests of graph paths relative to the Blender file when that is saved elsewhere, moved, appended and linked."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy
import pytest
from test_live import module
from test_waiting import BOX, live, size


@pytest.fixture
def saved(empty: Any, tmp_path: pathlib.Path) -> bpy.types.Object:
    """A live object and its tree in a file in the folder of the graph."""
    (tmp_path / "a").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a/file.blend"))
    (tmp_path / "a/box.ron").write_text(BOX)
    assert bpy.ops.maquette.add(filepath=str(tmp_path / "a/box.ron")) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    # The preferences decide, as for opened images.
    assert owner.maquette.graph == "//box.ron"
    module("tree").tree_of_graph(owner.maquette.graph)
    module("waiting").update()
    owner["maquette size"] = 20.0
    module("waiting").update()
    bpy.ops.wm.save_mainfile()
    return owner


def tree() -> bpy.types.NodeTree:
    return next(it for it in bpy.data.node_groups if it.bl_idname == "MaquetteTree")


def new_file(folder: pathlib.Path) -> None:
    folder.mkdir(exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "other.blend"))


def follows(owner: bpy.types.Object) -> bool:
    """Returns true if the object shows the result of a new value."""
    owner["maquette size"] = 77.0
    module("waiting").update()
    return size(owner) == 77.0


def test_b7_a_file_that_is_saved_elsewhere_finds_its_graphs(saved: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    (tmp_path / "b/c").mkdir(parents=True)
    copy = str(tmp_path / "b/copy.blend")
    bpy.ops.wm.save_as_mainfile(filepath=copy, copy=True)
    # The open file is unchanged.
    assert saved.maquette.graph == "//box.ron" and tree().maquette_graph == "//box.ron"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "b/c/file.blend"), relative_remap=True)
    assert saved.maquette.graph == "//../../a/box.ron" and tree().maquette_graph == "//../../a/box.ron"
    assert follows(saved)
    bpy.ops.wm.open_mainfile(filepath=copy)
    assert bpy.data.objects["box"].maquette.graph == "//../a/box.ron" and tree().maquette_graph == "//../a/box.ron"
    assert follows(bpy.data.objects["box"])


def test_b7_a_project_that_moves_is_found(saved: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    (tmp_path / "a").rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved/file.blend"))
    assert follows(bpy.data.objects["box"]) and bpy.data.objects["box"].maquette.graph == "//box.ron"
    # Also with an absolute path: the graph is found relative to the file.
    bpy.data.objects["box"].maquette.graph = tree().maquette_graph = str(tmp_path / "moved/box.ron")
    bpy.ops.wm.save_mainfile()
    (tmp_path / "moved").rename(tmp_path / "again")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "again/file.blend"))
    assert follows(bpy.data.objects["box"])
    module("engine").poll()
    assert pathlib.Path(bpy.path.abspath(tree().maquette_graph)) == tmp_path / "again/box.ron"


@pytest.mark.parametrize("is_moved", [False, True])
def test_b7_what_is_appended_finds_its_graph(saved: bpy.types.Object, tmp_path: pathlib.Path, is_moved: bool) -> None:
    source = tmp_path / "a"
    if is_moved:
        source = source.rename(tmp_path / "elsewhere")
    new_file(tmp_path / "b")
    folder = f"{source}/file.blend/Object/"
    bpy.ops.wm.append(filepath=f"{folder}box", directory=folder, filename="box")
    owner = bpy.data.objects["box"]
    module("engine").poll()
    assert owner.maquette.graph == f"//../{source.name}/box.ron" and follows(owner)


@pytest.mark.parametrize("kind", ["SELECT_OBJECT", "SELECT_OBDATA"])
def test_b7_what_is_linked_and_made_local_finds_its_graph_and_leaves_the_other_files_mesh_alone(
    saved: bpy.types.Object, tmp_path: pathlib.Path, kind: str
) -> None:
    new_file(tmp_path / "b")
    folder = f"{tmp_path}/a/file.blend/Object/"
    bpy.ops.wm.link(filepath=f"{folder}box", directory=folder, filename="box")
    owner = bpy.data.objects["box"]
    assert owner.library and owner not in module("live").objects()
    linked = owner.data
    bpy.context.view_layer.objects.active = owner
    owner.select_set(True)
    bpy.ops.object.make_local(type=kind)
    owner = bpy.data.objects["box"]
    module("engine").poll()
    assert not owner.library and bpy.path.abspath(owner.maquette.graph).endswith("box.ron")
    assert follows(owner) and not owner.data.library
    if kind == "SELECT_OBJECT":
        assert linked.library and linked != owner.data and max(it.co.x for it in linked.vertices) == 10.0
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "b/other.blend"))
    assert size(bpy.data.objects["box"]) == 77.0


def test_b7_the_first_save_makes_paths_relative_as_the_preferences_say(empty: Any, tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, BOX)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "one.blend"))
    assert owner.maquette.graph == "//box.ron"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    filepaths = bpy.context.preferences.filepaths
    owner = live(tmp_path, BOX)
    filepaths.use_relative_paths = False
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
        assert owner.maquette.graph == str(tmp_path / "box.ron")
    finally:
        filepaths.use_relative_paths = True


def test_b7_paths_are_made_absolute_and_relative(saved: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    for is_relative, path in ((False, str(tmp_path / "a/box.ron")), (True, "//box.ron")):
        assert bpy.ops.maquette.make_paths(is_relative=is_relative) == {"FINISHED"}
        assert saved.maquette.graph == path and tree().maquette_graph == path
        assert follows(saved)
    bpy.ops.maquette.make_paths(is_relative=False)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "elsewhere.blend"))
    assert saved.maquette.graph == str(tmp_path / "a/box.ron")
