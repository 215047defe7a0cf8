"""Tests of `render.py`: the object fills the picture, in its colors."""

from __future__ import annotations

import ctypes.util
import pathlib
from typing import Any

import bpy
import numpy as np
import pytest
from render import render
from test_screen import pixels

# Workbench draws with OpenGL; without a screen it needs EGL (Debian's libegl1 libgl1-mesa-dri).
EGL = pytest.mark.skipif(ctypes.util.find_library("EGL") is None, reason="not here: EGL")


@pytest.fixture
def ball(empty: Any) -> bpy.types.Object:
    """A red ball far from the origin, in a scene with its own camera."""
    bpy.ops.object.camera_add()
    bpy.ops.mesh.primitive_uv_sphere_add(radius=7, location=(100, 50, 20))
    ball = bpy.context.object
    red = bpy.data.materials.new("red")
    red.diffuse_color = (0.8, 0.0, 0.0, 1)
    if bpy.app.version < (5, 0):
        red.use_nodes = True
    red.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = red.diffuse_color
    ball.data.materials.append(red)
    return ball


@pytest.mark.parametrize("engine", ["CYCLES", pytest.param("BLENDER_WORKBENCH", marks=EGL)])
def test_a_rendering_is_filled_by_the_object(ball: bpy.types.Object, tmp_path: pathlib.Path, engine: str) -> None:
    kinds = ("scenes", "objects", "cameras", "lights", "worlds", "collections")
    before = {it: set(getattr(bpy.data, it).keys()) for it in kinds}
    render(ball, tmp_path / "ball.png", engine, size=(160, 120), samples=4, pitch=40)
    shown = pixels(tmp_path / "ball.png")
    assert shown.shape == (120, 160, 4)
    red = (shown[..., 0] > 0.3) & (shown[..., 1] < 0.6 * shown[..., 0])
    assert red[60, 80] and not red[[0, 0, -1, -1], [0, -1, 0, -1]].any()
    rows, columns = np.nonzero(red)
    # A ball fills less than its bounding box.
    assert 60 < np.ptp(rows) < 119 and abs(np.ptp(rows) - np.ptp(columns)) < 8, (np.ptp(rows), np.ptp(columns))
    assert {it: set(getattr(bpy.data, it).keys()) for it in kinds} == before
