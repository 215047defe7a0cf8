"""Bakes an animated live object into an Alembic file, which needs neither the graph nor the extension."""

from __future__ import annotations

import pathlib

import bpy

from . import waiting
from .ui import ForLiveObject, active_object


class MAQUETTE_OT_bake_frames(ForLiveObject, bpy.types.Operator):
    """Bakes each frame of the scene into a file, and adds an object that plays the file without the graph"""

    bl_idname = "maquette.bake_frames"
    bl_label = "Bake Frames"
    bl_options = {"REGISTER", "UNDO"}
    filepath: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="File", description="The file of the frames; if empty, NAME.abc in the folder of the Blender file", subtype="FILE_PATH"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Exports all frames, waiting for the result of each, and imports the file."""
        owner, scene, layer = active_object(context), context.scene, context.view_layer
        if not self.filepath and not bpy.data.filepath:
            self.report({"ERROR"}, "the Blender file is not saved yet: save it, or choose a file for the frames")
            return {"CANCELLED"}
        path = bpy.path.abspath(self.filepath or f"//{bpy.path.clean_name(owner.name)}.abc")
        if not owner.visible_get():
            self.report({"ERROR"}, f"{owner.name} is hidden: show it first")
            return {"CANCELLED"}
        frame, selected = scene.frame_current, [it for it in layer.objects if it.select_get()]
        for it in selected:
            it.select_set(False)
        owner.select_set(True)
        # The exporter writes meshes without modifiers only once; this modifier does nothing.
        mark = owner.modifiers.new("maquette frames", "SMOOTH")
        mark.show_viewport = mark.show_render = False
        try:
            pathlib.Path(path).parent.mkdir(parents=True, exist_ok=True)
            with waiting.each_frame():
                bpy.ops.wm.alembic_export(filepath=path, start=scene.frame_start, end=scene.frame_end, selected=True, as_background_job=False)
            known = set(bpy.data.objects)
            bpy.ops.wm.alembic_import(filepath=path, set_frame_range=False, always_add_cache_reader=True, as_background_job=False)
        except (OSError, RuntimeError) as error:
            self.report({"ERROR"}, str(error).strip())
            return {"CANCELLED"}
        finally:
            owner.modifiers.remove(mark)
            scene.frame_set(frame)
        made = next((it for it in bpy.data.objects if it not in known and it.type == "MESH"), None)
        if made is None:
            self.report({"ERROR"}, f"nothing was written to {path}")
            return {"CANCELLED"}
        made.name = f"{owner.name} frames"
        made.data.materials.clear()
        for material in owner.data.materials:
            made.data.materials.append(material)
        return {"FINISHED"}


def register() -> None:
    """Registers the operator."""
    bpy.utils.register_class(MAQUETTE_OT_bake_frames)


def unregister() -> None:
    """Unregisters the operator."""
    bpy.utils.unregister_class(MAQUETTE_OT_bake_frames)
