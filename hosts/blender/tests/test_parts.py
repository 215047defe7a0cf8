"""Tests of fields with parts, of the menu of nodes, and of other features of the node editor."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy
import pytest
from test_live import folder, module, until  # noqa: F401
from test_waiting import BOX, live


@pytest.fixture
def tree(empty: Any, folder: pathlib.Path) -> bpy.types.NodeTree:  # noqa: F811
    """The tree of the doll."""
    it = module("tree").tree_of_graph(str(folder / "doll.ron"))
    until(lambda: len(it.nodes) > 10 and not module("tree").states[module("tree").key(it)].busy)
    return it


def node_named(tree: bpy.types.NodeTree, name: str) -> bpy.types.Node:
    return next(it for it in tree.nodes if getattr(it, "maquette_name", "") == name)


def test_b10_the_parts_of_a_value_have_widgets_and_one_change_is_one_edit(tree: bpy.types.NodeTree, folder: pathlib.Path) -> None:  # noqa: F811
    path = folder / "doll.ron"
    text = path.read_text()
    assert 'Near(color: "#c33923", distance: 30.0)' in text
    node = node_named(tree, "red")
    assert node["part select distance"] == 30.0 and [round(it * 255) for it in node["part select color"]] == [0xC3, 0x39, 0x23]
    shape = node.id_properties_ui("part select distance").as_dict()
    assert (shape["min"], shape["max"], shape["default"]) == (0.0, 400.0, 15.0)
    assert node["part select lightness"] == 1.0
    node["part select distance"] = 12.5
    until(lambda: 'Near(color: "#c33923", distance: 12.5)' in path.read_text())
    assert path.read_text() == text.replace("distance: 30.0", "distance: 12.5", 1)
    until(lambda: module("tree").states[module("tree").key(tree)].outline and node_named(tree, "red")["field select"].endswith("12.5)"))
    node_named(tree, "red")["part select color"][1] = 0.5
    until(lambda: 'Near(color: "#c38023", distance: 12.5)' in path.read_text())
    # A part that is not written is written after a change.
    until(lambda: "#c38023" in node_named(tree, "red")["field select"])
    node_named(tree, "red")["part select lightness"] = 0.5
    until(lambda: 'Near(color: "#c38023", distance: 12.5, lightness: 0.5)' in path.read_text())
    # The widgets show a change of the file.
    path.write_text(path.read_text().replace("distance: 12.5", "distance: 9.0"))
    until(lambda: node_named(tree, "red")["part select distance"] == 9.0)
    # Another word has other parts; parts of the same name keep their values.
    assert node_named(tree, "red").maquette_choice_select == "Near"
    node_named(tree, "red").maquette_choice_select = "Sample"
    until(lambda: "Sample(at: (1, 1), distance: 9.0, lightness: 0.5)" in path.read_text())
    until(lambda: "part select at" in node_named(tree, "red").keys())
    assert "part select color" not in node_named(tree, "red").keys()
    # Edited text is parsed, too.
    node_named(tree, "red")["field select"] = "Otsu(channel: Saturation)"
    until(lambda: "select: Otsu(channel: Saturation)" in path.read_text())
    until(lambda: node_named(tree, "red").get("part select channel") == "Saturation")


def test_b10_vectors_of_nodes_have_fields(empty: Any, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "box.ron"
    path.write_text(BOX.replace('"box": Primitive', '"moved": Transform(mesh: "box", translate: (1.0, 2.0, 3.0)), "box": Primitive'))
    tree = module("tree").tree_of_graph(str(path))
    until(lambda: len(tree.nodes) > 2)
    node = node_named(tree, "moved")
    assert list(node["field translate"]) == [1.0, 2.0, 3.0] and list(node["field scale"]) == [1.0, 1.0, 1.0]
    assert node.id_properties_ui("field scale").as_dict()["default"] == [1.0, 1.0, 1.0]
    node["field translate"][2] = 7.25
    until(lambda: "translate: (1.0, 2.0, 7.25)" in path.read_text())
    # Fields that are not a vector of numbers are texts.
    assert node_named(tree, "box").get("part shape size") is None
    node_named(tree, "moved")["field scale"][0] = 2.0
    until(lambda: "scale: (2.0, 1.0, 1.0)" in path.read_text())


def test_b10_nodes_are_in_menus_by_pack_with_the_words_of_other_programs(tree: bpy.types.NodeTree) -> None:
    nodes = module("nodes")
    packs = nodes.packs()
    assert len(packs) > 5 and all(hasattr(bpy.types, nodes.menu_of(it)) for it in packs)
    entries = {it["name"]: nodes.entry(it) for pack in packs for it in nodes.nodes_of_pack(pack)}
    assert entries["Simplify"] == "Simplify (decimate, PolyReduce)" and len(entries) == len([it for pack in packs for it in nodes.nodes_of_pack(pack)])


def test_b10_a_node_is_shown_on_the_live_objects_of_its_graph(tree: bpy.types.NodeTree, folder: pathlib.Path) -> None:  # noqa: F811
    owner = module("live").add(str(folder / "doll.ron"), bpy.context)
    other = live(folder, BOX)
    ui = module("tree_ui")
    before = other.maquette.output
    context = type("Context", (), {"space_data": type("Space", (), {"edit_tree": tree})()})()
    operator = type("Operator", (), {"node": "raised", "report": lambda *_: None})()
    assert ui.MAQUETTE_OT_show_node.execute(operator, context) == {"FINISHED"}
    assert owner.maquette.output == "raised" and other.maquette.output == before


def test_b10_graphs_can_be_dropped(empty: Any, tmp_path: pathlib.Path) -> None:
    handler = bpy.types.MAQUETTE_FH_graph
    assert (handler.bl_import_operator, handler.bl_file_extensions) == ("maquette.add", ".ron")
    view = type("Context", (), {"area": type("Area", (), {"type": "VIEW_3D"})()})()
    text = type("Context", (), {"area": type("Area", (), {"type": "TEXT_EDITOR"})()})()
    assert module("ui").MAQUETTE_FH_graph.poll_drop(view) and not module("ui").MAQUETTE_FH_graph.poll_drop(text)
    (tmp_path / "box.ron").write_text(BOX)
    # As Blender calls the operator for a dropped file.
    assert bpy.ops.maquette.add("INVOKE_DEFAULT", filepath=str(tmp_path / "box.ron")) == {"FINISHED"}
    assert "box" in bpy.data.objects
