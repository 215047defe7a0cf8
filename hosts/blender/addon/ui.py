"""What a user sees and does: the panel of a live object, and its operators."""

from __future__ import annotations

import os
import pathlib
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from . import engine, live, panel, paths, values
from .client import Answer


def active(context: bpy.types.Context) -> bpy.types.Object | None:
    """The live object that is worked on."""
    owner = context.object
    return owner if owner and owner.maquette.graph else None


class ForLiveObject:
    """An operator on the active live object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is one."""
        return active(context) is not None


class MAQUETTE_OT_add(bpy.types.Operator, ImportHelper):
    """Adds an object that shows a graph of maquette, and follows it"""

    bl_idname = "maquette.add"
    bl_label = "Maquette Graph"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".ron"
    filter_glob: bpy.props.StringProperty(default="*.ron", options={"HIDDEN"})  # type: ignore[valid-type]
    # What was dropped last is not what is added next.
    filepath: bpy.props.StringProperty(name="File Path", subtype="FILE_PATH", options={"SKIP_SAVE", *engine.RELATIVE})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Asks for the file, if none was dropped."""
        return self.execute(context) if self.filepath else ImportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Adds it."""
        # The engine may have another current folder.
        path = os.path.abspath(bpy.path.abspath(self.filepath))
        if not pathlib.Path(path).is_file():
            self.report({"ERROR"}, f"there is no file {path}")
            return {"CANCELLED"}
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        live.place(live.add(paths.chosen(path), context), context)
        return {"FINISHED"}


# Windows of Blenders before 4.1, in which pictures of tests are made, have no such class.
if hasattr(bpy.types, "FileHandler"):

    class MAQUETTE_FH_graph(bpy.types.FileHandler):
        """Graphs that are dropped into a 3D view or the outliner."""

        bl_idname = "MAQUETTE_FH_graph"
        bl_label = "Maquette Graph"
        bl_import_operator = "maquette.add"
        bl_file_extensions = ".ron"

        @classmethod
        def poll_drop(cls, context: bpy.types.Context) -> bool:
            """Whether they can be dropped there."""
            return context.area is not None and context.area.type in ("VIEW_3D", "OUTLINER")


class MAQUETTE_OT_reload(ForLiveObject, bpy.types.Operator):
    """Reads the graph anew"""

    bl_idname = "maquette.reload"
    bl_label = "Reload"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Reads it."""
        live.start_over(active(context))
        return {"FINISHED"}


class MAQUETTE_OT_go_on(ForLiveObject, bpy.types.Operator):
    """Follows the graph again. What was done by hand and cannot be kept is lost; undo brings it back"""

    bl_idname = "maquette.go_on"
    bl_label = "Follow the Graph Again"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Follows it."""
        live.start_over(active(context))
        return {"FINISHED"}


class MAQUETTE_OT_cancel(ForLiveObject, bpy.types.Operator):
    """Stops what is computed for this object"""

    bl_idname = "maquette.cancel"
    bl_label = "Cancel"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stops it."""
        live.cancel(active(context))
        return {"FINISHED"}


class MAQUETTE_OT_bake(ForLiveObject, bpy.types.Operator):
    """Makes a mesh object of its own of what is shown, which follows no graph"""

    bl_idname = "maquette.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Makes it."""
        owner = active(context)
        baked = bpy.data.objects.new(f"{owner.name} baked", owner.data.copy())
        for name in [it for it in baked.data.keys() if it.startswith("maquette")]:
            del baked.data[name]
        baked.matrix_world = owner.matrix_world
        for collection in owner.users_collection:
            collection.objects.link(baked)
        return {"FINISHED"}


class MAQUETTE_OT_restart(bpy.types.Operator):
    """Ends the engine, if there is one, and starts another"""

    bl_idname = "maquette.restart"
    bl_label = "Restart Engine"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Starts it."""
        engine.restart()
        return {"FINISHED"}


class MAQUETTE_OT_reset(ForLiveObject, bpy.types.Operator):
    """Follows the graph's own value again"""

    bl_idname = "maquette.reset"
    bl_label = "Reset to the Graph's Value"
    bl_options = {"REGISTER", "UNDO"}
    name: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Forgets the value."""
        owner = active(context)
        values.reset(owner, self.name)
        live.reload(owner)
        return {"FINISHED"}


class MAQUETTE_OT_choose(ForLiveObject, bpy.types.Operator):
    """Takes this one of several words"""

    bl_idname = "maquette.choose"
    bl_label = "Choose"
    bl_options = {"REGISTER", "UNDO"}
    name: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    word: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Takes it."""
        active(context)[live.WIDGET + self.name] = self.word
        return {"FINISHED"}


class MAQUETTE_OT_write(ForLiveObject, bpy.types.Operator):
    """Writes the values into the graph's file, and leaves every other byte of it alone"""

    bl_idname = "maquette.write"
    bl_label = "Write Values"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Writes them."""
        owner = active(context)
        uid, loaded, own = live.key(owner), live.state(owner).loaded, values.kept(owner)
        known = {name: text for name, text in own.items() if loaded and loaded["ok"] and values.is_known(name, loaded)}
        edits = [{"set": {"target": name, "value": value}} for name, value in known.items()]

        def done(answer: Answer) -> None:
            found = live.found(uid)
            if found is None:
                return
            if answer.ok:
                values.keep(found, {name: text for name, text in values.kept(found).items() if known.get(name) != text})
                # Its widgets show what are the graph's own values now.
                live.reload(found)
            else:
                live.state(found).message = answer.why

        if edits:
            engine.client().ask("edit", done, None, graph=live.graph_path(owner), roots=engine.roots(), edits=edits)
        return {"FINISHED"}


class MAQUETTE_OT_open_line(bpy.types.Operator):
    """Opens the place in the text editor"""

    bl_idname = "maquette.open_line"
    bl_label = "Open"
    file: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    line: bpy.props.IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    column: bpy.props.IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Opens it."""
        try:
            known = (it for it in bpy.data.texts if bpy.path.abspath(it.filepath) == self.file)
            text = next(known, None) or bpy.data.texts.load(self.file)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        text.cursor_set(max(0, self.line - 1), character=max(0, self.column - 1))
        areas = [it for it in context.screen.areas if it.type == "TEXT_EDITOR"] if context.screen else []
        if areas:
            areas[0].spaces.active.text = text
        return {"FINISHED"}


class GraphPanel(ForLiveObject):
    """A live object's graph."""

    bl_label = "Maquette"

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the controls of its graph."""
        owner = active(context)
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        it = live.states.get(live.key(owner))
        row = layout.row(align=True)
        row.prop(owner.maquette, "graph", text="Graph")
        row.operator("maquette.reload", text="", icon="FILE_REFRESH")
        hindrance = "" if it is None else live.hindrance(owner)
        if owner.library or owner.override_library:
            hindrance = "it shows what was computed in its own file"
        if hindrance:
            layout.label(text=hindrance[0].upper() + hindrance[1:], icon="INFO")
        if owner.maquette.held:
            layout.operator("maquette.go_on", icon="PLAY")
        if it is None or it.loaded is None:
            return _state(layout, it, owner.maquette.lost)
        if it.loaded.get("doc"):
            layout.label(text=it.loaded["doc"])
        known = values.kept(owner)
        for control in it.controls:
            _control(layout, owner, control, control.name in known)
        if it.loaded["ok"]:
            _unknown(layout, it, known)
        wanted = {its["name"] for its in it.loaded["inputs"]} if it.loaded["ok"] else owner.maquette.inputs.keys()
        for given in owner.maquette.inputs:
            if given.name in wanted:
                layout.prop(given, "object", text=given.name)
        layout.prop(owner.maquette, "output")
        _state(layout, it, owner.maquette.lost)
        row = layout.row(align=True)
        row.operator("maquette.write", icon="FILE_TICK")
        row.operator("maquette.bake", icon="MESH_DATA")
        row.operator("maquette.bake_frames", icon="FILE_CACHE")
        layout.operator("maquette.open_tree", icon="NODETREE")


# Neither may have the other as its base: Blender knows a class by one registration.
class MAQUETTE_PT_object(GraphPanel, bpy.types.Panel):
    """Among the object's properties."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"


class MAQUETTE_PT_view(GraphPanel, bpy.types.Panel):
    """Beside the 3D view."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Maquette"


def _control(layout: Any, owner: bpy.types.Object, control: panel.Control, is_set: bool) -> None:
    name = live.WIDGET + control.name
    if name not in owner.keys():
        return
    row = layout.row(align=True)
    row.prop(owner, f'["{name}"]', text=control.title, slider=control.is_ranged)
    if is_set:
        row.operator("maquette.reset", text="", icon="LOOP_BACK").name = control.name


def _unknown(layout: Any, it: live.State, known: dict[str, str]) -> None:
    """Values of parameters that the graph has no more: they wait for such a parameter, or are dropped."""
    for name, text in known.items():
        if not values.is_known(name, it.loaded):
            row = layout.row(align=True)
            row.label(text=f"{name} = {text}: the graph has no such parameter", icon="ERROR")
            row.operator("maquette.reset", text="", icon="X").name = name


def _state(layout: Any, it: live.State | None, lost: str) -> None:
    if it is None:
        return
    if it.progress:
        row = layout.row()
        row.label(text=f"{it.progress[0]}: {it.progress[1]:.0%}", icon="TIME")
        row.operator("maquette.cancel", text="", icon="CANCEL")
    if it.message and it.message == lost:
        for line in lost.splitlines():
            layout.label(text=line, icon="INFO")
    elif it.message:
        box = layout.box()
        box.alert = True
        box.label(text=it.message, icon="ERROR")
        if engine.ended():
            box.operator("maquette.restart")
    problems(layout, it.problems)


def problems(layout: Any, found: list[dict[str, Any]]) -> None:
    """Problems with their places, and a button that opens each; the first ones, for nobody reads more."""
    for problem in found[:8]:
        row = layout.row()
        row.alert = problem.get("severity") == "error"
        row.label(text=f"{problem['code']} {problem['line']}:{problem['column']} {problem['message']}", icon="ERROR")
        place = row.operator("maquette.open_line", text="", icon="TEXT")
        place.file, place.line, place.column = problem["file"], problem["line"], problem["column"]


def _menu(self: Any, _context: bpy.types.Context) -> None:
    self.layout.operator("maquette.add", icon="NODETREE")


CLASSES = (
    MAQUETTE_OT_add,
    *([MAQUETTE_FH_graph] if hasattr(bpy.types, "FileHandler") else ()),
    MAQUETTE_OT_reload,
    MAQUETTE_OT_go_on,
    MAQUETTE_OT_cancel,
    MAQUETTE_OT_bake,
    MAQUETTE_OT_restart,
    MAQUETTE_OT_reset,
    MAQUETTE_OT_choose,
    MAQUETTE_OT_write,
    MAQUETTE_OT_open_line,
    MAQUETTE_PT_object,
    MAQUETTE_PT_view,
)


def register() -> None:
    """Registers panels, operators and the entry of the Add menu."""
    for it in CLASSES:
        bpy.utils.register_class(it)
    bpy.types.VIEW3D_MT_mesh_add.append(_menu)


def unregister() -> None:
    """Unregisters them."""
    bpy.types.VIEW3D_MT_mesh_add.remove(_menu)
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
