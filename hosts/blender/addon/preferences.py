"""The preferences of the add-on: the engine, and the folders that graphs may read."""

from __future__ import annotations

import importlib.metadata

import bpy

from . import engine


class MaquetteRoot(bpy.types.PropertyGroup):
    """A folder that graphs may read."""

    path: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", description="A folder that all graphs may read", subtype="DIR_PATH", options=engine.RELATIVE
    )


class MAQUETTE_OT_add_root(bpy.types.Operator):
    """Adds a folder that graphs may read, in addition to that of their project"""

    bl_idname = "maquette.add_root"
    bl_label = "Add Folder"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Adds an empty entry."""
        context.preferences.addons[__package__].preferences.roots.add()
        return {"FINISHED"}


class MAQUETTE_OT_remove_root(bpy.types.Operator):
    """Removes this folder from those that all graphs may read"""

    bl_idname = "maquette.remove_root"
    bl_label = "Remove Folder"
    place: bpy.props.IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Removes the entry."""
        context.preferences.addons[__package__].preferences.roots.remove(self.place)
        return {"FINISHED"}


class MaquettePreferences(bpy.types.AddonPreferences):
    """The preferences, which apply to all Blender files of a user."""

    bl_idname = __package__

    program: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Program",
        description="Another program `maquette`, for example one with your own packs; if empty, the extension's own",
        subtype="FILE_PATH",
        options=engine.RELATIVE,
    )

    roots: bpy.props.CollectionProperty(type=MaquetteRoot)  # type: ignore[valid-type]

    def draw(self, _context: bpy.types.Context) -> None:
        """Draws the preferences."""
        self.layout.label(text=version())
        self.layout.prop(self, "program")
        self.layout.label(text="Graphs may read the folder of their project, and these:")
        for place, root in enumerate(self.roots):
            row = self.layout.row(align=True)
            row.prop(root, "path", text="")
            row.operator("maquette.remove_root", text="", icon="X").place = place
        self.layout.operator("maquette.add_root", icon="ADD")


def version() -> str:
    """The version of the engine in the extension, for the user."""
    try:
        return f"Engine: maquette {importlib.metadata.version('maquette')}, in the extension"
    except importlib.metadata.PackageNotFoundError:
        return "Engine: none in the extension"


CLASSES = (MaquetteRoot, MAQUETTE_OT_add_root, MAQUETTE_OT_remove_root, MaquettePreferences)


def register() -> None:
    """Registers the preferences."""
    for it in CLASSES:
        bpy.utils.register_class(it)


def unregister() -> None:
    """Unregisters the preferences."""
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
