"""Tests with too little memory for the engine's data: containers often have 64 MB of `/dev/shm`."""

from __future__ import annotations

import importlib.util
import pathlib
import resource
import sys
from typing import Any, Iterator

import bpy
import pytest
from test_live import folder, module, positions, until  # noqa: F401
from test_waiting import BOX, THROUGH, live, size

from conftest import PACKAGE


@pytest.fixture
def fresh(empty: Any) -> Iterator[Any]:
    """The module of the engine, which is restarted before and after the test."""
    engine = module("engine")
    preferences = bpy.context.preferences.addons[PACKAGE].preferences
    yield engine
    preferences.program, engine._is_full = "", False
    engine.restart()


def is_on_disk(engine: Any) -> bool:
    folder = engine.client().folder
    return bool(folder) and folder.parent == pathlib.Path(bpy.app.tempdir)


def limited(tmp_path: pathlib.Path, kilobytes: int) -> str:
    """A program with a limit on the size of its files in memory, as if there were no room for more."""
    found = importlib.util.find_spec("maquette")
    assert found and found.origin
    words = f"{sys.executable} -I {module('worker').__file__} {pathlib.Path(found.origin).parents[1]}"
    program = tmp_path / "limited"
    # A process that ignores the signal gets an error as for a full disk.
    limit = f'case "$*" in *--folder*) ;; *) trap "" XFSZ; ulimit -f {kilobytes};; esac'
    program.write_text(f'#!/bin/bash\n{limit}\nexec {words} "$@" --no-cache\n')
    program.chmod(0o755)
    return str(program)


def test_b9_with_little_memory_for_files_the_engines_folder_is_on_disk(fresh: Any, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh.restart()
    until(lambda: fresh.client().folder)
    assert not is_on_disk(fresh)
    monkeypatch.setattr(module("exchange"), "ROOM", 1 << 60)
    fresh.restart()
    owner = live(tmp_path, BOX)
    module("waiting").update()
    assert is_on_disk(fresh) and size(owner) == 10.0


def test_b9_a_result_without_room_keeps_the_last_mesh_and_comes_by_way_of_the_disk(fresh: Any, folder: pathlib.Path) -> None:  # noqa: F811
    bpy.context.preferences.addons[PACKAGE].preferences.program = limited(folder, 64)
    fresh.restart()
    box = live(folder, BOX)
    module("waiting").update()
    assert not is_on_disk(fresh) and size(box) == 10.0
    doll = module("live").add(str(folder / "doll.ron"), bpy.context)
    module("waiting").update()
    assert is_on_disk(fresh) and len(doll.data.vertices) > 1000 and len(box.data.vertices) == 8


def test_b9_without_room_on_disk_either_the_last_mesh_stays_and_it_is_said(
    fresh: Any, folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch  # noqa: F811
) -> None:
    monkeypatch.setattr(fresh, "go_to_disk", lambda: False)
    bpy.context.preferences.addons[PACKAGE].preferences.program = limited(folder, 64)
    fresh.restart()
    owner = live(folder, BOX)
    module("waiting").update()
    before = positions(owner).copy()
    owner.maquette.graph = str(folder / "doll.ron")
    with pytest.raises(RuntimeError, match="no room"):
        module("waiting").update()
    assert (positions(owner) == before).all()


def test_b9_an_input_without_room_goes_by_way_of_the_disk(fresh: Any, tmp_path: pathlib.Path) -> None:
    fresh.restart()
    through, box = live(tmp_path, THROUGH, "through.ron"), live(tmp_path, BOX)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=100, y_subdivisions=100)
    grid = bpy.context.object
    until(lambda: "it" in through.maquette.inputs and box.maquette.shown)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 14, limits[1]))
    try:
        through.maquette.inputs["it"].object = grid
        until(lambda: fresh._is_full)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    # The engine inherits the limits of this process.
    fresh.restart()
    module("waiting").update()
    assert is_on_disk(fresh) and len(through.data.vertices) == len(grid.data.vertices) and size(box) == 10.0
