"""The add-on's preferences: which engine computes."""

from __future__ import annotations

import importlib.metadata

import bpy


class MaquettePreferences(bpy.types.AddonPreferences):
    """What is the same in all files of a user."""

    bl_idname = __package__

    program: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Program",
        description="A program `maquette` of your own, with packs of your own; the extension's if it is empty",
        subtype="FILE_PATH",
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Says which engine computes."""
        self.layout.label(text=engine())
        self.layout.prop(self, "program")


def engine() -> str:
    """The engine of the extension's wheel, in words."""
    try:
        return f"Engine: maquette {importlib.metadata.version('maquette')}, in the extension"
    except importlib.metadata.PackageNotFoundError:
        return "Engine: none in the extension"


def register() -> None:
    """Registers the preferences."""
    bpy.utils.register_class(MaquettePreferences)


def unregister() -> None:
    """Unregisters them."""
    bpy.utils.unregister_class(MaquettePreferences)
