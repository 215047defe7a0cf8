"""What a user sees of node trees: how they are opened, the nodes that can be added, and what is wrong."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy

from . import live, tree
from .ui import ForLiveObject, active, problems


class MAQUETTE_OT_open_tree(ForLiveObject, bpy.types.Operator):
    """Shows the graph of this object as nodes, in a node editor if there is one"""

    bl_idname = "maquette.open_tree"
    bl_label = "Edit as Nodes"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Makes the tree, if it is not there."""
        path = live.graph_path(active(context))
        known = (it for it in tree.trees() if bpy.path.abspath(it.maquette_graph) == path)
        shown = next(known, None) or tree.new(active(context).maquette.graph, pathlib.Path(path).stem)
        areas = [it for it in context.screen.areas if it.type == "NODE_EDITOR"] if context.screen else []
        for area in areas[:1]:
            area.ui_type = tree.MaquetteTree.bl_idname
            area.spaces.active.node_tree = shown
        if not areas:
            self.report({"INFO"}, f"{shown.name} is among the node trees of the editor Maquette Graph")
        return {"FINISHED"}


class MAQUETTE_PT_tree(bpy.types.Panel):
    """The graph of a tree."""

    bl_label = "Graph"
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Maquette"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether a tree is seen."""
        return shown(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draws its file and its problems."""
        it = shown(context)
        self.layout.prop(it, "maquette_graph", text="")
        state = tree.states.get(tree.key(it))
        if state is None:
            return
        if state.message:
            box = self.layout.box()
            box.alert = True
            box.label(text=state.message, icon="ERROR")
        problems(self.layout, state.problems)


def shown(context: bpy.types.Context) -> bpy.types.NodeTree | None:
    """The tree that a node editor shows."""
    it = getattr(context.space_data, "edit_tree", None)
    return it if it is not None and it.bl_idname == tree.MaquetteTree.bl_idname else None


def _menu(self: Any, context: bpy.types.Context) -> None:
    if shown(context) is None:
        return
    for pack in tree.packs():
        self.layout.label(text=pack.capitalize())
        for it in tree.of_pack(pack):
            made = self.layout.operator("node.add_node", text=it["name"])
            made.type, made.use_transform = f"MaquetteNode{it['name']}", True


CLASSES = (MAQUETTE_OT_open_tree, MAQUETTE_PT_tree)


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
