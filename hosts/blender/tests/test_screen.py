"""The harness for pictures: it draws what a script shows, and tells when a script fails."""

from __future__ import annotations

import importlib.util
import os
import pathlib
import shutil
import sys
from typing import Any

import bpy
import numpy as np
import pytest
import screen

pytestmark = pytest.mark.skipif(bool(screen.missing()), reason=f"not here: {', '.join(screen.missing())}")

SCRIPT = """
import bpy

class ScratchTree(bpy.types.NodeTree):
    bl_icon = "NODETREE"
    bl_label = "Scratch"

class ScratchNode(bpy.types.Node):
    bl_label = "Scratch"

def shots(window):
    for it in (ScratchTree, ScratchNode):
        bpy.utils.register_class(it)
    tree = bpy.data.node_groups.new("scratch", "ScratchTree")
    yield from window.tree(tree)
    yield "empty"
    node = tree.nodes.new("ScratchNode")
    node.width, node.use_custom_color, node.color, node.select = 300, True, (1, 0, 0), False
    yield from window.tree(tree)
    yield "node"
"""

DRAG = """
import bpy

class ScratchTree(bpy.types.NodeTree):
    bl_label, bl_icon = "Scratch", "NODETREE"

class ScratchNode(bpy.types.Node):
    bl_label = "Scratch"

    def init(self, _context):
        self.inputs.new("NodeSocketFloat", "in").hide_value = True
        self.outputs.new("NodeSocketFloat", "out")

def shots(window):
    for it in (ScratchTree, ScratchNode):
        bpy.utils.register_class(it)
    tree = bpy.data.node_groups.new("scratch", "ScratchTree")
    first, second = (tree.nodes.new("ScratchNode") for _ in range(2))
    second.location = (300, 0)
    yield from window.tree(tree)
    bpy.ops.ed.undo_push(message="Nodes")
    # Sockets stand in rows below the title, outputs first.
    yield from window.drag((140, -34), (300, -56))
    assert [(it.from_node.name, it.to_node.name) for it in tree.links] == [(first.name, second.name)]
    yield "linked"
    yield from window.key("ctrl+z")
    # Blender reads node trees anew: what is held of the old one is gone.
    assert len(bpy.data.node_groups["scratch"].links) == 0
"""


GRAPH = """Graph(
    format: 1,
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "whole": FillRange(range: "scan.range"),
        "grid": Triangulate(range: "whole"),
    },
    outputs: { "grid.ply": "grid", "whole.pcd": "whole" },
)
"""

HAND = """
import os, pathlib
import bpy

PATH = pathlib.Path(os.environ["GRAPH"])

def shots(window):
    from addon import mirror, tree as code
    tree = code.new(str(PATH), "hand")

    def until(is_so):
        for _ in range(100):
            yield 0.1
            if is_so():
                return
        raise AssertionError((PATH.read_text(), [(it.name, getattr(it, "maquette_problem", "")) for it in bpy.data.node_groups["hand"].nodes]))

    def corner(name):
        node = mirror.boxes(bpy.data.node_groups["hand"])[name]
        return node, mirror._corner(node)

    def output(name, number):
        # Outputs stand below the title, a row each.
        node, (x, y) = corner(name)
        return x + node.width, y - 34 - 22 * number

    def port(name):
        # The first one of a node with one output and no fields, below the space for these.
        return corner(name)[1][0], corner(name)[1][1] - 66

    yield from until(lambda: len(tree.nodes) == 4)
    yield from window.tree(tree)
    bpy.ops.ed.undo_push(message="Nodes")
    first = PATH.read_text()
    yield from window.drag(output("scan", 1), port("grid"))
    linked = first.replace('Triangulate(range: "whole")', 'Triangulate(range: "scan.range")')
    yield from until(lambda: PATH.read_text() == linked)
    yield "linked"
    yield from window.key("ctrl+z")
    yield from until(lambda: PATH.read_text() == first)
    yield from window.key("ctrl+shift+z")
    yield from until(lambda: PATH.read_text() == linked)
    # What is wrong is taken back, and the node says why.
    yield from window.drag(output("scan", 0), port("whole"))
    yield from until(lambda: "wants a RangeImage" in corner("whole")[0].maquette_problem)
    assert PATH.read_text() == linked
    yield "refused"
    # A node that is moved stays there, and is moved for everybody.
    _, (x, y) = corner("grid")
    yield from window.drag((x + 95, y - 10), (x + 95, y + 120))
    kept = PATH.with_suffix(".layout.ron")
    yield from until(kept.exists)
    assert corner("grid")[1][1] > y + 60 and PATH.read_text() == linked
    yield "moved"
"""


def pixels(path: pathlib.Path) -> np.ndarray:
    """Rows of RGBA, from 0 to 1."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)


def test_a_picture_shows_the_node_tree(tmp_path: pathlib.Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    taken = screen.take(script, tmp_path / "pictures", (900, 600))
    assert list(taken) == ["empty", "node"]
    red = {}
    for name, path in taken.items():
        shown = pixels(path)
        assert shown.shape == (600, 900, 4)
        red[name] = int(((shown[..., 0] > 0.5) & (shown[..., 1] < 0.2) & (shown[..., 2] < 0.2)).sum())
    assert red["empty"] == 0 and red["node"] > 1000, red


def test_the_mouse_links_nodes_and_a_key_undoes_it(tmp_path: pathlib.Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(DRAG)
    assert list(screen.take(script, tmp_path / "pictures", (900, 600))) == ["linked"]


def test_the_mouse_edits_a_graph_file(addon: Any, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = pathlib.Path(__file__).resolve().parents[3]
    shutil.copytree(root / "graphs/doll", tmp_path / "doll")
    (tmp_path / "hand.ron").write_text(GRAPH)
    if not os.environ.get("MAQUETTE"):
        # That window's Blender is older, and has another Python: the engine runs in this one.
        found = importlib.util.find_spec("maquette")
        assert found and found.origin
        worker, program = root / "hosts/blender/addon/worker.py", tmp_path / "maquette"
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I "{worker}" "{pathlib.Path(found.origin).parents[1]}" "$@"\n')
        program.chmod(0o755)
        monkeypatch.setenv("MAQUETTE", str(program))
    monkeypatch.setenv("GRAPH", str(tmp_path / "hand.ron"))
    script = tmp_path / "script.py"
    script.write_text(HAND)
    assert list(screen.take(script, tmp_path / "pictures", (1400, 700))) == ["linked", "moved", "refused"]


def test_a_script_that_fails_is_told(tmp_path: pathlib.Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("def shots(window):\n    yield None\n    raise ValueError('no such node')\n")
    with pytest.raises(RuntimeError, match="no such node"):
        screen.take(script, tmp_path / "pictures")
