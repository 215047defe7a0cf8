"""The user interface of live objects: the panel and the operators."""

from __future__ import annotations

import os
import pathlib
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from . import engine, live, panel, paths, values
from .client import Answer


def active_object(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, if it is live."""
    owner = context.object
    return owner if owner and owner.maquette.graph else None


class ForLiveObject:
    """An operator on the active live object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Returns true if the active object is live."""
        return active_object(context) is not None


class MAQUETTE_OT_add(bpy.types.Operator, ImportHelper):
    """Adds a live object, which shows the result of a maquette graph and follows its changes"""

    bl_idname = "maquette.add"
    bl_label = "Maquette Graph"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".ron"
    filter_glob: bpy.props.StringProperty(default="*.ron", options={"HIDDEN"})  # type: ignore[valid-type]
    # A dropped file must not become the default of the next call.
    filepath: bpy.props.StringProperty(name="File Path", subtype="FILE_PATH", options={"SKIP_SAVE", *engine.RELATIVE})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Opens the file dialog, unless a file was dropped."""
        return self.execute(context) if self.filepath else ImportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Adds the object."""
        # Absolute, since the engine may have another current folder.
        path = os.path.abspath(bpy.path.abspath(self.filepath))
        if not pathlib.Path(path).is_file():
            self.report({"ERROR"}, f"cannot find the file {path}")
            return {"CANCELLED"}
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        live.place(live.add(paths.from_dialog(path), context), context)
        return {"FINISHED"}


# Blender before 4.1 has no such class; some tests use it.
if hasattr(bpy.types, "FileHandler"):

    class MAQUETTE_FH_graph(bpy.types.FileHandler):
        """Handles graph files that are dropped into a 3D view or the outliner."""

        bl_idname = "MAQUETTE_FH_graph"
        bl_label = "Maquette Graph"
        bl_import_operator = "maquette.add"
        bl_file_extensions = ".ron"

        @classmethod
        def poll_drop(cls, context: bpy.types.Context) -> bool:
            """Returns true if files can be dropped into the editor."""
            return context.area is not None and context.area.type in ("VIEW_3D", "OUTLINER")


class MAQUETTE_OT_reload(ForLiveObject, bpy.types.Operator):
    """Reads the graph again and computes its result"""

    bl_idname = "maquette.reload"
    bl_label = "Reload"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Reads the graph."""
        live.start_over(active_object(context))
        return {"FINISHED"}


class MAQUETTE_OT_go_on(ForLiveObject, bpy.types.Operator):
    """Follows the graph again. Manual edits that cannot be kept are lost; undo restores them"""

    bl_idname = "maquette.go_on"
    bl_label = "Follow the Graph Again"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Follows the graph."""
        live.start_over(active_object(context))
        return {"FINISHED"}


class MAQUETTE_OT_cancel(ForLiveObject, bpy.types.Operator):
    """Cancels the computation for this object"""

    bl_idname = "maquette.cancel"
    bl_label = "Cancel"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Cancels the run."""
        live.cancel(active_object(context))
        return {"FINISHED"}


class MAQUETTE_OT_bake(ForLiveObject, bpy.types.Operator):
    """Copies the shown mesh to a new object that does not follow the graph"""

    bl_idname = "maquette.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Creates the object."""
        owner = active_object(context)
        baked = bpy.data.objects.new(f"{owner.name} baked", owner.data.copy())
        for name in [it for it in baked.data.keys() if it.startswith("maquette")]:
            del baked.data[name]
        baked.matrix_world = owner.matrix_world
        for collection in owner.users_collection:
            collection.objects.link(baked)
        return {"FINISHED"}


class MAQUETTE_OT_restart(bpy.types.Operator):
    """Stops the engine, if it runs, and starts it again"""

    bl_idname = "maquette.restart"
    bl_label = "Restart Engine"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Restarts the engine."""
        engine.restart()
        return {"FINISHED"}


class MAQUETTE_OT_reset(ForLiveObject, bpy.types.Operator):
    """Resets the parameter to the graph's own value"""

    bl_idname = "maquette.reset"
    bl_label = "Reset to the Graph's Value"
    bl_options = {"REGISTER", "UNDO"}
    name: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Forgets the value."""
        owner = active_object(context)
        values.reset(owner, self.name)
        live.reload(owner)
        return {"FINISHED"}


class MAQUETTE_OT_choose(ForLiveObject, bpy.types.Operator):
    """Sets the parameter to this choice"""

    bl_idname = "maquette.choose"
    bl_label = "Choose"
    bl_options = {"REGISTER", "UNDO"}
    name: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    word: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Sets the value."""
        active_object(context)[live.WIDGET + self.name] = self.word
        return {"FINISHED"}


class MAQUETTE_OT_write(ForLiveObject, bpy.types.Operator):
    """Writes the values into the graph's file, without other changes of the file"""

    bl_idname = "maquette.write"
    bl_label = "Write Values"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Writes the values."""
        owner = active_object(context)
        uid, loaded, own = live.key(owner), live.state(owner).loaded, values.stored(owner)
        known = {name: text for name, text in own.items() if loaded and loaded["ok"] and values.is_known(name, loaded)}
        edits = [{"set": {"target": name, "value": value}} for name, value in known.items()]

        def done(answer: Answer) -> None:
            found = live.find(uid)
            if found is None:
                return
            if answer.ok:
                values.store(found, {name: text for name, text in values.stored(found).items() if known.get(name) != text})
                # The written values are the graph's own values now.
                live.reload(found)
            else:
                live.state(found).message = answer.why

        if edits:
            engine.client().ask("edit", done, None, graph=live.graph_path(owner), roots=engine.roots(), edits=edits)
        return {"FINISHED"}


class MAQUETTE_OT_open_line(bpy.types.Operator):
    """Opens the position in the text editor"""

    bl_idname = "maquette.open_line"
    bl_label = "Open"
    file: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    line: bpy.props.IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    column: bpy.props.IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Opens the position."""
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
    """The panel of a live object."""

    bl_label = "Maquette"

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the controls of the graph, its inputs and output, and problems."""
        owner = active_object(context)
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        it = live.states.get(live.key(owner))
        row = layout.row(align=True)
        row.prop(owner.maquette, "graph", text="Graph")
        row.operator("maquette.reload", text="", icon="FILE_REFRESH")
        hindrance = "" if it is None else live.hindrance(owner)
        if owner.library or owner.override_library:
            hindrance = "the object belongs to another file and shows the result that was computed there"
        if hindrance:
            layout.label(text=hindrance[0].upper() + hindrance[1:], icon="INFO")
        if owner.maquette.held:
            layout.operator("maquette.go_on", icon="PLAY")
        if it is None or it.loaded is None:
            return _state(layout, it, owner.maquette.lost)
        if it.loaded.get("doc"):
            layout.label(text=it.loaded["doc"])
        known = values.stored(owner)
        for control in it.controls:
            _control(layout, owner, control, control.name in known)
        if it.loaded["ok"]:
            _unknown_values(layout, it, known)
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


# Two separate classes with a common base, since Blender cannot register a class derived from a registered one.
class MAQUETTE_PT_object(GraphPanel, bpy.types.Panel):
    """The panel in the object's properties."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"


class MAQUETTE_PT_view(GraphPanel, bpy.types.Panel):
    """The panel in the sidebar of the 3D view."""

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


def _unknown_values(layout: Any, it: live.State, known: dict[str, str]) -> None:
    """Draws values of parameters that the graph no longer has; the user can remove them."""
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
        if engine.end_reason():
            box.operator("maquette.restart")
    problems(layout, it.problems)


def problems(layout: Any, found: list[dict[str, Any]]) -> None:
    """Draws the first eight problems with their positions, and a button that opens each."""
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
