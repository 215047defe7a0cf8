"""Renderings of an object by Cycles on the CPU, or by Workbench, which needs OpenGL, in software or hardware."""

from __future__ import annotations

import math
import pathlib

import bpy
from mathutils import Euler, Vector

# The field of view of the camera, and the fraction of it that the bounds of the object fill.
ANGLE = math.radians(30)
FILLED = 0.92


def render(
    thing: bpy.types.Object,
    path: pathlib.Path,
    engine: str = "CYCLES",
    size: tuple[int, int] = (800, 800),
    samples: int = 32,
    yaw: float = 30.0,
    pitch: float = 15.0,
) -> None:
    """Writes a PNG of `thing`, fitted into the picture; seen from the front, along y, if `yaw` and `pitch` are 0 degrees.

    Uses a separate scene, so that other objects are neither visible nor changed.
    """
    path.unlink(missing_ok=True)
    scene = bpy.data.scenes.new("picture")
    made: list[bpy.types.ID] = []
    try:
        scene.collection.objects.link(thing)
        scene.view_layers[0].update()
        corners = [thing.matrix_world @ Vector(it) for it in thing.bound_box]
        turned = Euler((math.radians(90 - pitch), 0, math.radians(yaw)))

        lens = bpy.data.cameras.new("picture")
        camera = bpy.data.objects.new("picture", lens)
        made.append(lens)
        camera.rotation_euler = turned
        scene.collection.objects.link(camera)
        scene.camera = camera
        scene.render.resolution_x, scene.render.resolution_y = size
        lens.angle = ANGLE * FILLED
        scene.view_layers[0].update()
        camera.location, _scale = camera.camera_fit_coords(scene.view_layers[0].depsgraph, [it for corner in corners for it in corner])
        lens.angle = ANGLE
        away = max((corner - camera.location).length for corner in corners)
        lens.clip_start, lens.clip_end = away / 1000, away * 2

        # One light from the upper left of the viewer, and light from the sky.
        light = bpy.data.lights.new("picture", "SUN")
        sun = bpy.data.objects.new("picture", light)
        made.append(light)
        light.energy, light.angle = 3.0, math.radians(10)
        sun.rotation_euler = (turned.to_matrix() @ Euler((math.radians(-35), math.radians(-35), 0)).to_matrix()).to_euler()
        scene.collection.objects.link(sun)
        world = bpy.data.worlds.new("picture")
        made.append(world)
        # Newer Blenders always use nodes.
        if bpy.app.version < (5, 0):
            world.use_nodes = True
        world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.8, 0.85, 0.9, 1)
        world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5
        scene.world = world

        settings = scene.render
        settings.engine = engine
        settings.resolution_percentage = 100
        settings.image_settings.file_format = "PNG"
        settings.filepath = str(path)
        # White in a texture is white in the picture.
        scene.view_settings.view_transform = "Standard"
        if engine == "CYCLES":
            scene.cycles.device = "CPU"
            scene.cycles.samples = samples
            scene.cycles.seed = 0
            scene.cycles.use_denoising = True
        elif engine == "BLENDER_WORKBENCH":
            scene.display.shading.color_type = "TEXTURE"
        bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        bpy.data.scenes.remove(scene)
        # Removing their data removes the objects of the camera and the light.
        bpy.data.batch_remove(made)
    if not path.exists():
        raise RuntimeError(f"{engine} wrote no {path}")
