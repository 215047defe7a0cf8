"""Keeps paths of graphs valid that begin with `//`, the folder of the Blender file, as Blender does for images.

Blender does not adapt paths in properties of add-ons. So each owner of a path stores the folder that `//` refers to: if the file is saved
elsewhere, or the object comes from another file, the path is adapted from that folder. A file that was moved has the folder in which it is
opened.
"""

from __future__ import annotations

import os
import pathlib
from typing import Any, Iterator

import bpy
from bpy.app.handlers import persistent

from . import engine, live, nodes

# The prefix of paths relative to the folder of the Blender file.
HERE = "//"


class _Path:
    """The properties of an object or a tree with the path of its graph."""

    def __init__(self, owner: bpy.types.ID) -> None:
        self.owner = owner
        self._its, self._prefix = (owner.maquette, "") if isinstance(owner, bpy.types.Object) else (owner, "maquette_")

    @property
    def text(self) -> str:
        return str(getattr(self._its, f"{self._prefix}graph"))

    @text.setter
    def text(self, text: str) -> None:
        setattr(self._its, f"{self._prefix}graph", text)

    @property
    def folder(self) -> str:
        return str(getattr(self._its, f"{self._prefix}folder"))

    @folder.setter
    def folder(self, folder: str) -> None:
        if self.folder != folder:
            setattr(self._its, f"{self._prefix}folder", folder)

    @property
    def beside(self) -> str:
        return str(getattr(self._its, f"{self._prefix}beside"))

    @beside.setter
    def beside(self, text: str) -> None:
        if self.beside != text:
            setattr(self._its, f"{self._prefix}beside", text)

    def absolute(self, folder: str) -> str:
        """The absolute path, if `//` refers to this folder."""
        return os.path.normpath(os.path.join(folder, self.text[len(HERE) :])) if self.text.startswith(HERE) else self.text


def _all_paths() -> Iterator[_Path]:
    for owner in [*live.all_objects(), *bpy.data.node_groups]:
        if isinstance(owner, bpy.types.Object) or owner.bl_idname == nodes.MaquetteTree.bl_idname and owner.maquette_graph:
            yield _Path(owner)


def _folder_of(path: str) -> str:
    return os.path.dirname(os.path.abspath(path)) if path else ""


def _blend_folder() -> str:
    return _folder_of(bpy.data.filepath)


def relative(path: str, folder: str) -> str:
    """Makes a path relative to a folder; returns it unchanged if that is impossible, as on another drive."""
    if not folder or path.startswith(HERE):
        return path
    try:
        return HERE + pathlib.PurePath(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path


def from_dialog(path: str) -> str:
    """A path that the user has chosen in a dialog, relative if the preferences say so."""
    return relative(path, _blend_folder()) if bpy.context.preferences.filepaths.use_relative_paths else path


def _source(owner: bpy.types.ID) -> str:
    """The folder of the file from which data was appended, if Blender has stored it; else empty."""
    known = getattr(owner, "library_weak_reference", None) or getattr(getattr(owner, "data", None), "library_weak_reference", None)
    return _folder_of(bpy.path.abspath(known.filepath)) if known else ""


def settle() -> None:
    """Adapts the paths of owners that come from another file or were saved in another folder."""
    here = _blend_folder()
    for it in _all_paths():
        library = it.owner.library
        if library:
            it.folder = _folder_of(bpy.path.abspath(library.filepath))
        elif it.folder != here:
            # The other file may have been moved since it was saved.
            known = [folder for folder in (it.folder, _source(it.owner)) if folder]
            _move(it, next((folder for folder in known if os.path.exists(it.absolute(folder))), it.folder), here)


def _move(it: _Path, was: str, here: str) -> None:
    """Adapts a path to a change of the Blender file's folder."""
    if it.text.startswith(HERE) and was and was != here:
        path = it.absolute(was)
        it.text = relative(path, here) if here else path
    it.folder = here


@persistent
def _before_save(path: str, *_given: Any) -> None:
    """Adapts paths to the folder of the saved file, and stores relative paths, in case the file is moved together with its graphs."""
    here, was = _folder_of(path) if path else _blend_folder(), _blend_folder()
    settle()
    makes_relative = not bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths
    for it in _all_paths():
        if it.owner.library or not here:
            continue
        _move(it, was, here)
        if makes_relative:
            it.text = relative(it.text, here)
        it.beside = "" if it.text.startswith(HERE) else relative(it.text, here)


@persistent
def _after_save(*_given: Any) -> None:
    # After Save Copy the open file is still the old one.
    settle()


@persistent
def _after_load(*_given: Any) -> None:
    """Adapts paths after a file was moved: a missing graph may be in the same position relative to the file."""
    here = _blend_folder()
    for it in _all_paths():
        if it.owner.library:
            continue
        it.folder = here
        beside = bpy.path.abspath(it.beside)
        if here and it.beside and not os.path.exists(it.text) and os.path.exists(beside):
            it.text = it.beside
    settle()


@persistent
def _after_import(context: Any, *_given: Any) -> None:
    """Adapts the paths of appended and linked objects and trees; only here their source file is known."""
    for item in context.import_items:
        owner = item.id
        source = next((it.filepath for it in getattr(item, "source_libraries", ())), "") or getattr(item.source_library, "filepath", "")
        is_ours = isinstance(owner, bpy.types.Object) and owner.maquette.graph
        if source and (is_ours or getattr(owner, "bl_idname", "") == nodes.MaquetteTree.bl_idname):
            it = _Path(owner)
            it.folder = _folder_of(bpy.path.abspath(source))
            if not owner.library:
                _move(it, it.folder, _blend_folder())


class MAQUETTE_OT_make_paths(bpy.types.Operator):
    """Makes the paths of all graphs relative to the Blender file, or absolute"""

    bl_idname = "maquette.make_paths"
    bl_label = "Make Graph Paths"
    bl_options = {"UNDO"}
    is_relative: bpy.props.BoolProperty(name="Relative", default=True)  # type: ignore[valid-type]

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Changes the paths of the objects and trees of this file."""
        here = _blend_folder()
        if self.is_relative and not here:
            self.report({"ERROR"}, "save the file first: paths are relative to its folder")
            return {"CANCELLED"}
        settle()
        for it in _all_paths():
            if not it.owner.library:
                it.text = relative(it.text, here) if self.is_relative else it.absolute(here)
        return {"FINISHED"}


def _menu(self: Any, _context: bpy.types.Context) -> None:
    """Draws entries in File > External Data, since its own operators do not change paths of add-ons."""
    self.layout.separator()
    for word in ("Relative", "Absolute"):
        self.layout.operator(MAQUETTE_OT_make_paths.bl_idname, text=f"Make Graph Paths {word}").is_relative = word == "Relative"


HANDLERS = {"save_pre": _before_save, "save_post": _after_save, "save_post_fail": _after_save, "load_post": _after_load, "blend_import_post": _after_import}


def register() -> None:
    """Registers the operator and the handlers."""
    bpy.utils.register_class(MAQUETTE_OT_make_paths)
    bpy.types.TOPBAR_MT_file_external_data.append(_menu)
    for name, handler in HANDLERS.items():
        if hasattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).append(handler)
    # Before the ticks that read paths.
    engine.ticks.insert(0, settle)


def unregister() -> None:
    """Unregisters the operator and the handlers."""
    bpy.types.TOPBAR_MT_file_external_data.remove(_menu)
    bpy.utils.unregister_class(MAQUETTE_OT_make_paths)
    engine.ticks.remove(settle)
    for name, handler in HANDLERS.items():
        if hasattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
