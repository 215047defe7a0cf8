"""The user interface of node trees: operators that open trees and add nodes, and the panel with problems."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy

from . import live, nodes, tree
from .ui import ForLiveObject, active_object, problems


class MAQUETTE_OT_open_tree(ForLiveObject, bpy.types.Operator):
    """Shows the graph of this object as nodes, in a node editor if there is one"""

    bl_idname = "maquette.open_tree"
    bl_label = "Edit as Nodes"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Finds or creates the tree, and shows it."""
        shown = tree.tree_of_graph(active_object(context).maquette.graph)
        areas = [it for it in context.screen.areas if it.type == "NODE_EDITOR"] if context.screen else []
        for area in areas[:1]:
            area.ui_type = nodes.MaquetteTree.bl_idname
            area.spaces.active.node_tree = shown
        if not areas:
            self.report({"INFO"}, f"open an editor of the type Maquette Graph and choose the tree {shown.name}")
        return {"FINISHED"}


class InTree:
    """An operator for a node editor that shows a tree."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Returns true if the editor shows a tree."""
        return tree_of(context) is not None


class MAQUETTE_OT_open_used(InTree, bpy.types.Operator):
    """Opens the graph that this node uses"""

    bl_idname = "maquette.open_used"
    bl_label = "Open"
    graph: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Shows the tree of the used graph in the editor."""
        context.space_data.path.append(tree.tree_of_graph(self.graph))
        return {"FINISHED"}


class MAQUETTE_OT_close_used(InTree, bpy.types.Operator):
    """Goes back to the graph from which this one was opened"""

    bl_idname = "maquette.close_used"
    bl_label = "Back"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Shows the previous tree."""
        if len(context.space_data.path) > 1:
            context.space_data.path.pop()
        return {"FINISHED"}


class MAQUETTE_OT_add_used(InTree, bpy.types.Operator):
    """Adds a node that uses this graph"""

    bl_idname = "maquette.add_used"
    bl_label = "Add"
    bl_options = {"REGISTER", "UNDO"}
    graph: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Adds the node at the cursor of the editor."""
        it = tree_of(context)
        for other in it.nodes:
            other.select = False
        made = it.nodes.new(nodes.MaquetteNodeOther.bl_idname)
        nodes.init_node(made, nodes.kinds[self.graph], self.graph)
        made.location, it.nodes.active = context.space_data.cursor_location, made
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Adds the node at the pointer, and lets the user move it."""
        context.space_data.cursor_location_from_region(event.mouse_region_x, event.mouse_region_y)
        self.execute(context)
        return bpy.ops.node.translate_attach_remove_on_cancel("INVOKE_DEFAULT")


class MAQUETTE_OT_show_node(InTree, bpy.types.Operator):
    """Shows the result of this node on the live objects of this graph"""

    bl_idname = "maquette.show_node"
    bl_label = "Show on Live Objects"
    bl_options = {"REGISTER", "UNDO"}
    node: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Sets the output of the live objects."""
        path = tree.real_path(tree_of(context))
        found = [it for it in live.objects() if pathlib.Path(live.graph_path(it)).resolve() == path]
        for owner in found:
            owner.maquette.output = self.node
        if not found:
            self.report({"ERROR"}, "no live object shows this graph: add one with Add > Mesh > Maquette Graph")
            return {"CANCELLED"}
        return {"FINISHED"}


class MAQUETTE_PT_tree(bpy.types.Panel):
    """The graph of a tree."""

    bl_label = "Graph"
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Maquette"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Returns true if the editor shows a tree."""
        return tree_of(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the file and the problems of the graph."""
        it = tree_of(context)
        if len(context.space_data.path) > 1:
            self.layout.operator("maquette.close_used", text=f"Back to {context.space_data.path[-2].node_tree.name}", icon="BACK")
        self.layout.prop(it, "maquette_graph", text="")
        state = tree.states.get(tree.key(it))
        if state is None:
            return
        if state.message:
            box = self.layout.box()
            box.alert = True
            box.label(text=state.message, icon="ERROR")
        problems(self.layout, state.problems)


def tree_of(context: bpy.types.Context) -> bpy.types.NodeTree | None:
    """The tree that a node editor shows."""
    it = getattr(context.space_data, "edit_tree", None)
    return it if it is not None and it.bl_idname == nodes.MaquetteTree.bl_idname else None


def _menu(self: Any, context: bpy.types.Context) -> None:
    if tree_of(context) is None:
        return
    state = tree.states.get(tree.key(tree_of(context)))
    used = state.outline["types"] if state and state.outline else ()
    if used:
        self.layout.label(text="Used Graphs")
    for it in used:
        self.layout.operator("maquette.add_used", text=it["name"]).graph = it["pack"]
    for pack in nodes.packs():
        self.layout.menu(nodes.menu_of(pack))


CLASSES = (MAQUETTE_OT_open_tree, MAQUETTE_OT_open_used, MAQUETTE_OT_close_used, MAQUETTE_OT_add_used, MAQUETTE_OT_show_node, MAQUETTE_PT_tree)


def register() -> None:
    """Registers panels, operators and the entries of the Add menu."""
    for it in CLASSES:
        bpy.utils.register_class(it)
    bpy.types.NODE_MT_add.append(_menu)


def unregister() -> None:
    """Unregisters them."""
    bpy.types.NODE_MT_add.remove(_menu)
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
