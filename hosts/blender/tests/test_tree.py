"""Node trees in the real Blender, with the real engine: the text is the truth."""

from __future__ import annotations

import pathlib
import shutil
import time
from typing import Any, Callable

import bpy
import pytest
from test_live import ROOT, folder, module  # noqa: F401


def until(is_so: Callable[[], Any], seconds: float = 15) -> None:
    """Lets the add-on go on until something is so."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, [it for tree in module("tree").trees() if (it := why(tree))]
        module("engine").poll()
        time.sleep(0.002)


def why(tree: bpy.types.NodeTree) -> Any:
    """What a tree waits for."""
    code = module("tree")
    state = code.states.get(code.key(tree))
    if not state or not state.outline:
        return (tree.maquette_graph, "nothing is known")
    edits, _ = module("edits").difference(state.outline, code.shown(tree)[0])
    waits = {"busy": state.busy, "changed": code.key(tree) in code.changed, "text": state.text != tree.maquette_text}
    return (tree.maquette_graph, state.message, edits, waits) if edits or any(waits.values()) else None


def is_settled(tree: bpy.types.NodeTree, path: pathlib.Path) -> bool:
    """Whether the tree shows what stands in the file."""
    code, text = module("tree"), path.read_text()
    state = code.states.get(code.key(tree))
    if not state or not state.outline or state.busy or state.text != text or tree.maquette_text != text or code._undone:
        return False
    edits, _ = module("edits").difference(state.outline, code.shown(tree)[0])
    return state.stamp == path.stat().st_mtime_ns and not edits and code.key(tree) not in code.changed


@pytest.fixture
def path(folder: pathlib.Path) -> pathlib.Path:  # noqa: F811
    """The doll's graph."""
    return folder / "doll.ron"


@pytest.fixture
def tree(empty: Any, path: pathlib.Path) -> bpy.types.NodeTree:
    """Its tree."""
    made = module("tree").new(str(path), "doll")
    until(lambda: is_settled(made, path))
    return made


def named(tree: bpy.types.NodeTree, name: str) -> bpy.types.Node:
    """The node of this name in the text."""
    return next(it for it in tree.nodes if getattr(it, "maquette_name", "") == name)


def change(tree: bpy.types.NodeTree, path: pathlib.Path, old: str, new: str) -> None:
    """Waits until one place of the file has become another one, and nothing else."""
    text = path.read_text()
    assert text.count(old) == 1
    until(lambda: path.read_text() != text)
    assert path.read_text() == text.replace(old, new)
    until(lambda: is_settled(tree, path))


def test_5_each_graph_is_shown_and_no_byte_of_it_is_written(empty: Any, tmp_path: pathlib.Path) -> None:
    shutil.copytree(ROOT / "graphs", tmp_path / "graphs", ignore=shutil.ignore_patterns("goldens", "pictures", "*.png"))
    graphs = [it for it in sorted((tmp_path / "graphs").rglob("*.ron")) if "\nGraph(" in "\n" + it.read_text()]
    assert len(graphs) > 20
    texts = {it: it.read_bytes() for it in graphs}
    trees = {it: module("tree").new(str(it), it.stem) for it in graphs}
    for graph, tree in trees.items():
        until(lambda tree=tree, graph=graph: is_settled(tree, graph))
        state = module("tree").states[module("tree").key(tree)]
        now, _ = module("tree").shown(tree)
        wanted = module("edits").shown(state.outline)
        assert sorted(now.nodes, key=lambda it: it.name) == sorted(wanted.nodes, key=lambda it: it.name), graph
        assert now.outputs == wanted.outputs
    assert {it: it.read_bytes() for it in graphs} == texts


def test_5_one_edit_in_the_tree_is_one_change_of_the_file(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    tree.links.new(named(tree, "scan").outputs["range"], named(tree, "blended").inputs["range"])
    change(tree, path, 'Blend(range: "whole"', 'Blend(range: "scan.range"')
    named(tree, "skin").label = "fine-skin"
    until(lambda: '"fine-skin": Subdivide' in path.read_text() and is_settled(tree, path))
    assert '"model": Texture(mesh: "fine-skin"' in path.read_text()
    node = named(tree, "red")
    node["field select"] = 'Near(color: "#c33923", distance: 25.0)'
    change(tree, path, "distance: 30.0", "distance: 25.0")
    output = next(it for it in tree.nodes if it.bl_idname == "MaquetteNodeOutputs")
    tree.links.new(named(tree, "grid").outputs["mesh"], next(it for it in output.inputs if it.maquette_port == "model.ply"))
    change(tree, path, '"model.ply": "model"', '"model.ply": "grid"')


def test_5_a_node_is_added_when_it_has_what_it_needs_and_removed(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    text = path.read_text()
    node = tree.nodes.new("MaquetteNodeSubdivide")
    node["field scheme"] = "Loop"
    name = node.name
    until(lambda: "link mesh" in tree.nodes[name].maquette_problem)
    assert path.read_text() == text
    tree.links.new(named(tree, "grid").outputs["mesh"], tree.nodes[name].inputs["mesh"])
    until(lambda: '"subdivide": Subdivide(mesh: "grid", scheme: Loop)' in path.read_text() and is_settled(tree, path))
    assert tree.nodes[name].maquette_name == "subdivide"
    tree.nodes.remove(named(tree, "subdivide"))
    until(lambda: path.read_text() == text and is_settled(tree, path))


def test_5_an_edit_of_the_file_is_seen(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    text = path.read_text()
    path.write_text(text.replace('"spots"', '"patches"'))
    until(lambda: is_settled(tree, path))
    assert "patches" in {it.label for it in tree.nodes} and "spots" not in {it.label for it in tree.nodes}
    # A text of which nothing can be said leaves what is shown.
    count = len(tree.nodes)
    path.write_text(text[:200])
    until(lambda: module("tree").states[module("tree").key(tree)].problems)
    assert len(tree.nodes) >= count - 1
    path.write_text(text)
    until(lambda: is_settled(tree, path))


def test_5_a_link_that_leads_nowhere_stays_as_it_is_while_others_change(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    path.write_text(path.read_text().replace('Subdivide(mesh: "grid"', 'Subdivide(mesh: "gird"'))
    until(lambda: is_settled(tree, path))
    assert module("tree").states[module("tree").key(tree)].problems
    named(tree, "spots")["field connectivity"] = "Four"
    change(tree, path, "connectivity: Eight", "connectivity: Four")
    tree.links.new(named(tree, "grid").outputs["mesh"], named(tree, "skin").inputs["mesh"])
    change(tree, path, '"gird"', '"grid"')


def test_5_comments_before_paragraphs_are_frames(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    def frames() -> dict[str, set[str]]:
        """The nodes in each frame."""
        found: dict[str, set[str]] = {}
        for it in tree.nodes:
            if it.parent:
                found.setdefault(it.parent.label, set()).add(it.maquette_name)
        return found

    assert frames()["Where is the nose?"] == {"red", "spots", "nose"}
    places = {it.maquette_name: tuple(it.location) for it in tree.nodes if hasattr(it, "maquette_name")}
    text = path.read_text()
    path.write_text(text.replace("// Where is the nose?", "// Look for red."))
    until(lambda: is_settled(tree, path))
    assert frames()["Look for red."] == {"red", "spots", "nose"} and "Where is the nose?" not in frames()
    assert places == {it.maquette_name: tuple(it.location) for it in tree.nodes if hasattr(it, "maquette_name")}


def test_11_a_wrong_link_is_refused_in_the_checkers_words_on_the_node(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    text = path.read_text()
    for source, output, node, port, words in (
        ("scan", "color", "spots", "mask", "wants a Mask"),
        ("red", "mask", "grid", "range", "wants a RangeImage"),
        ("model", "mesh", "skin", "mesh", "circle"),
    ):
        tree.links.new(named(tree, source).outputs[output], named(tree, node).inputs[port])
        until(lambda: words in named(tree, node).maquette_problem, 10)
        until(lambda: is_settled(tree, path))
        assert path.read_text() == text
    tree.nodes.remove(named(tree, "scan"))
    until(lambda: is_settled(tree, path) and any(getattr(it, "maquette_name", "") == "scan" for it in tree.nodes))
    assert "needs it" in module("tree").states[module("tree").key(tree)].message or path.read_text() == text


def test_6_fifty_steps_back_and_forth_leave_the_tree_as_the_text(tree: bpy.types.NodeTree, path: pathlib.Path) -> None:
    bpy.context.preferences.edit.undo_steps = 100
    bpy.ops.ed.undo_push(message="begin")
    texts = [path.read_text()]
    for step in range(50):
        it = bpy.data.node_groups["doll"]
        if step % 2:
            source = ("whole", "range") if step % 4 == 1 else ("scan", "range")
            it.links.new(named(it, source[0]).outputs[source[1]], named(it, "grid").inputs["range"])
        else:
            named(it, "skin" if step == 0 else f"skin-{step - 2}").label = f"skin-{step}"
        # As Blender does behind an operator of the user, before the add-on has looked.
        bpy.ops.ed.undo_push(message=f"step {step}")
        until(lambda: path.read_text() != texts[-1] and is_settled(bpy.data.node_groups["doll"], path))
        texts.append(path.read_text())
    for known, walk in ((reversed(texts[:-1]), bpy.ops.ed.undo), (iter(texts[1:]), bpy.ops.ed.redo)):
        for text in known:
            assert walk() == {"FINISHED"}
            until(lambda: path.read_text() == text and is_settled(bpy.data.node_groups["doll"], path))
