"""Tests of positions of live objects: units, the cursor, origins, and transforms that users apply to the mesh."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from test_by_hand import small  # noqa: F401
from test_inputs import THROUGH, shape
from test_live import doll, folder, module, positions, settled, until  # noqa: F401


def world(owner: bpy.types.Object) -> Any:
    """The positions of vertices in the world."""
    bpy.context.view_layer.update()
    return positions(owner) @ np.array(owner.matrix_world.to_3x3()).T + np.array(owner.matrix_world.translation)


def add_object(path: pathlib.Path) -> bpy.types.Object:
    """Adds a live object by the operator."""
    assert bpy.ops.maquette.add(filepath=str(path)) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    until(lambda: owner.maquette.shown and settled(owner))
    bpy.context.view_layer.update()
    return owner


@pytest.mark.parametrize("system, scale", [("METRIC", 1.0), ("METRIC", 0.001), ("IMPERIAL", 0.3048), ("NONE", 1.0), ("NONE", 0.01)])
def test_a_millimeter_is_one_in_the_scenes_units(empty: Any, folder: pathlib.Path, system: str, scale: float) -> None:  # noqa: F811
    units = bpy.context.scene.unit_settings
    units.system, units.scale_length = system, scale
    owner = add_object(folder / "doll.ron")
    width = float(np.ptp(positions(owner)[:, 0]))
    meters = owner.dimensions[0] * (scale if system != "NONE" else 1.0)
    assert meters * 1000 == pytest.approx(width, rel=1e-5) and width > 50


def test_a_new_object_is_at_the_cursor_with_its_origin_in_its_middle(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    bpy.context.scene.cursor.location = (1, 2, 3)
    owner = add_object(folder / "doll.ron")

    def middle() -> Any:
        return (world(owner).min(0) + world(owner).max(0)) / 2

    assert np.abs(middle() - [1, 2, 3]).max() < 1e-5 and tuple(owner.location) == (1, 2, 3)
    first = world(owner)
    owner["maquette growth"] = 30.0
    until(lambda: owner.maquette.values and settled(owner))
    # Only the nose moves.
    assert (np.abs(world(owner) - first).max(1) > 1e-6).mean() < 0.5 and tuple(owner.location) == (1, 2, 3)
    # A range image has other axes and keeps its position.
    owner.maquette.output = "whole"
    until(lambda: settled(owner))
    assert np.abs(middle() - [1, 2, 3]).max() < 0.1


def test_what_is_made_of_an_object_lies_there_and_has_its_origin_there(empty: Any, tmp_path: pathlib.Path) -> None:
    (tmp_path / "through.ron").write_text(THROUGH)
    bpy.context.scene.cursor.location = (1, 2, 3)
    source = shape()
    source.location = (5, 0, 0)
    assert bpy.ops.maquette.add(filepath=str(tmp_path / "through.ron")) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    until(lambda: "it" in owner.maquette.inputs)
    owner.maquette.inputs["it"].object = source
    until(lambda: owner.maquette.shown and settled(owner))
    for x in (5, 7):
        source.location.x = x
        bpy.context.view_layer.update()
        until(lambda: settled(owner) and abs(world(owner).min(0)[0] - x - 0.001) < 1e-4)
        assert np.abs(world(owner) - world(source) - [0.001, 0, 0]).max() < 1e-4
    assert abs(owner.location.x - 6.25) < 0.01


def apply_all(owner: bpy.types.Object) -> None:
    owner.rotation_euler.y += 0.4
    owner.scale.x *= 2
    bpy.context.view_layer.update()
    assert bpy.ops.object.transform_apply(location=True, rotation=True, scale=True) == {"FINISHED"}


def apply_scale(owner: bpy.types.Object) -> None:
    assert bpy.ops.object.transform_apply(location=False, rotation=False, scale=True) == {"FINISHED"}


def set_origin(owner: bpy.types.Object) -> None:
    bpy.context.scene.cursor.location = (0.5, 0, 0)
    assert bpy.ops.object.origin_set(type="ORIGIN_CURSOR") == {"FINISHED"}


def turn_in_edit_mode(owner: bpy.types.Object) -> None:
    owner.data.transform(Matrix.Rotation(0.7, 4, "Z"))
    owner.data.update()


@pytest.mark.parametrize("does", [apply_all, apply_scale, set_origin, turn_in_edit_mode])
def test_what_was_applied_to_the_mesh_stays_when_values_change(small: bpy.types.Object, does: Any) -> None:  # noqa: F811
    values = {}

    def show(tall: float) -> None:
        small["maquette tall"] = tall
        until(lambda: str(tall) in small.maquette.values and settled(small))

    show(2.0)
    values[2.0] = world(small)
    show(1.5)
    values[1.5] = world(small)
    mesh = positions(small).copy()
    does(small)
    bpy.context.view_layer.update()
    after = world(small)
    assert (positions(small) != mesh).any()
    # The change in the world: none, except for a rotation in Edit Mode or a scale before it is applied.
    flat = np.column_stack([values[1.5], np.ones(len(after))])
    way, *_ = np.linalg.lstsq(flat, after, rcond=None)
    for tall in (2.0, 1.5):
        kept = small.matrix_world.copy()
        show(tall)
        wanted = np.column_stack([values[tall], np.ones(len(after))]) @ way
        assert not small.maquette.held and np.abs(world(small) - wanted).max() < 2e-5, tall
        assert small.matrix_world == kept
