"""The add-on's preferences: which engine computes, and what graphs may read."""

from __future__ import annotations

import importlib.metadata

import bpy

from . import engine


class MaquetteRoot(bpy.types.PropertyGroup):
    """A folder that graphs may read."""

    path: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", description="Graphs may read this folder, wherever they are", subtype="DIR_PATH", options=engine.RELATIVE
    )


class MAQUETTE_OT_add_root(bpy.types.Operator):
    """Adds a folder that graphs may read, beside that of their project"""

    bl_idname = "maquette.add_root"
    bl_label = "Add Folder"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Adds one that is still to be named."""
        context.preferences.addons[__package__].preferences.roots.add()
        return {"FINISHED"}


class MAQUETTE_OT_remove_root(bpy.types.Operator):
    """Graphs of other folders may read this folder no more"""

    bl_idname = "maquette.remove_root"
    bl_label = "Remove Folder"
    place: bpy.props.IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Removes it."""
        context.preferences.addons[__package__].preferences.roots.remove(self.place)
        return {"FINISHED"}


class MaquettePreferences(bpy.types.AddonPreferences):
    """What is the same in all files of a user."""

    bl_idname = __package__

    program: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Program",
        description="A program `maquette` of your own, with packs of your own; the extension's if it is empty",
        subtype="FILE_PATH",
        options=engine.RELATIVE,
    )

    roots: bpy.props.CollectionProperty(type=MaquetteRoot)  # type: ignore[valid-type]

    def draw(self, _context: bpy.types.Context) -> None:
        """Says which engine computes, and what graphs may read."""
        self.layout.label(text=version())
        self.layout.prop(self, "program")
        self.layout.label(text="A graph reads its project's folder, and these:")
        for place, root in enumerate(self.roots):
            row = self.layout.row(align=True)
            row.prop(root, "path", text="")
            row.operator("maquette.remove_root", text="", icon="X").place = place
        self.layout.operator("maquette.add_root", icon="ADD")


def version() -> str:
    """The engine of the extension's wheel, in words."""
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
    """Unregisters them."""
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
