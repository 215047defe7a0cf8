"""The add-on's preferences: which engine computes."""

from __future__ import annotations

import importlib.metadata

import bpy


class MaquettePreferences(bpy.types.AddonPreferences):
    """What is the same in all files of a user."""

    bl_idname = __package__

    def draw(self, _context: bpy.types.Context) -> None:
        """Says which engine the extension has."""
        self.layout.label(text=engine())


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
