"""Paths of graphs that begin with `//`, the folder of the Blender file: they are kept right as Blender keeps those of images.

Blender knows nothing of paths in an add-on's properties. So what has a path remembers the folder that its `//` stands for: if the file is saved
elsewhere, or the object comes from another file, the path is made anew from that. A file that was moved has the folder in which it is opened.
"""

from __future__ import annotations

import os
import pathlib
from typing import Any, Iterator

import bpy
from bpy.app.handlers import persistent

from . import engine, live, nodes

# What stands before paths from the folder of the Blender file.
HERE = "//"


class _Path:
    """A path in a property, with what is remembered beside it."""

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
        """The path from this folder on."""
        return os.path.normpath(os.path.join(folder, self.text[len(HERE) :])) if self.text.startswith(HERE) else self.text


def _all() -> Iterator[_Path]:
    for owner in [*live.everything(), *bpy.data.node_groups]:
        if isinstance(owner, bpy.types.Object) or owner.bl_idname == nodes.MaquetteTree.bl_idname and owner.maquette_graph:
            yield _Path(owner)


def _folder_of(path: str) -> str:
    return os.path.dirname(os.path.abspath(path)) if path else ""


def _here() -> str:
    return _folder_of(bpy.data.filepath)


def relative(path: str, folder: str) -> str:
    """A path from a folder on; as it is if there is no such way, as on another drive."""
    if not folder or path.startswith(HERE):
        return path
    try:
        return HERE + pathlib.PurePath(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path


def chosen(path: str) -> str:
    """A path that a user chose in a dialog, as the preferences say."""
    return relative(path, _here()) if bpy.context.preferences.filepaths.use_relative_paths else path


def _source(owner: bpy.types.ID) -> str:
    """The folder of the file that something was appended from, if Blender remembers that; else empty."""
    known = getattr(owner, "library_weak_reference", None) or getattr(getattr(owner, "data", None), "library_weak_reference", None)
    return _folder_of(bpy.path.abspath(known.filepath)) if known else ""


def settle() -> None:
    """Makes the paths right of what came from another file, or was saved in another folder."""
    here = _here()
    for it in _all():
        library = it.owner.library
        if library:
            it.folder = _folder_of(bpy.path.abspath(library.filepath))
        elif it.folder != here:
            # The file that it came from may have been moved since it was saved.
            known = [folder for folder in (it.folder, _source(it.owner)) if folder]
            _move(it, next((folder for folder in known if os.path.exists(it.absolute(folder))), it.folder), here)


def _move(it: _Path, was: str, here: str) -> None:
    """Makes a path from one folder the same from another one."""
    if it.text.startswith(HERE) and was and was != here:
        path = it.absolute(was)
        it.text = relative(path, here) if here else path
    it.folder = here


@persistent
def _saving(path: str, *_given: Any) -> None:
    """The file will be there: paths go from its folder, and the way to each graph is remembered, in case all of it moves."""
    here, was = _folder_of(path) if path else _here(), _here()
    settle()
    makes_relative = not bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths
    for it in _all():
        if it.owner.library or not here:
            continue
        _move(it, was, here)
        if makes_relative:
            it.text = relative(it.text, here)
        it.beside = "" if it.text.startswith(HERE) else relative(it.text, here)


@persistent
def _saved(*_given: Any) -> None:
    # A copy was saved elsewhere: this is still the file that it was.
    settle()


@persistent
def _opened(*_given: Any) -> None:
    """A file that was moved has moved with its folder; a graph that is gone may be where it was beside the file."""
    here = _here()
    for it in _all():
        if it.owner.library:
            continue
        it.folder = here
        beside = bpy.path.abspath(it.beside)
        if here and it.beside and not os.path.exists(it.text) and os.path.exists(beside):
            it.text = it.beside
    settle()


@persistent
def _imported(context: Any, *_given: Any) -> None:
    """Objects and trees were appended or linked: only now it is known from where."""
    for item in context.import_items:
        owner = item.id
        source = next((it.filepath for it in getattr(item, "source_libraries", ())), "") or getattr(item.source_library, "filepath", "")
        is_ours = isinstance(owner, bpy.types.Object) and owner.maquette.graph
        if source and (is_ours or getattr(owner, "bl_idname", "") == nodes.MaquetteTree.bl_idname):
            it = _Path(owner)
            it.folder = _folder_of(bpy.path.abspath(source))
            if not owner.library:
                _move(it, it.folder, _here())


class MAQUETTE_OT_make_paths(bpy.types.Operator):
    """Makes the paths of all graphs relative to the Blender file, or absolute"""

    bl_idname = "maquette.make_paths"
    bl_label = "Make Graph Paths"
    bl_options = {"UNDO"}
    is_relative: bpy.props.BoolProperty(name="Relative", default=True)  # type: ignore[valid-type]

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Changes the paths of this file's objects and trees."""
        here = _here()
        if self.is_relative and not here:
            self.report({"ERROR"}, "save the file first: paths are relative to its folder")
            return {"CANCELLED"}
        settle()
        for it in _all():
            if not it.owner.library:
                it.text = relative(it.text, here) if self.is_relative else it.absolute(here)
        return {"FINISHED"}


def _menu(self: Any, _context: bpy.types.Context) -> None:
    """Entries of File > External Data, whose own operators do not change paths of add-ons."""
    self.layout.separator()
    for word in ("Relative", "Absolute"):
        self.layout.operator(MAQUETTE_OT_make_paths.bl_idname, text=f"Make Graph Paths {word}").is_relative = word == "Relative"


HANDLERS = {"save_pre": _saving, "save_post": _saved, "save_post_fail": _saved, "load_post": _opened, "blend_import_post": _imported}


def register() -> None:
    """Begins to look after paths."""
    bpy.utils.register_class(MAQUETTE_OT_make_paths)
    bpy.types.TOPBAR_MT_file_external_data.append(_menu)
    for name, handler in HANDLERS.items():
        if hasattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).append(handler)
    # Before what reads them.
    engine.ticks.insert(0, settle)


def unregister() -> None:
    """Looks after them no more."""
    bpy.types.TOPBAR_MT_file_external_data.remove(_menu)
    bpy.utils.unregister_class(MAQUETTE_OT_make_paths)
    engine.ticks.remove(settle)
    for name, handler in HANDLERS.items():
        if hasattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
