"""The harness for pictures: it draws what a script shows, and tells when a script fails."""

from __future__ import annotations

import pathlib

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


def test_a_script_that_fails_is_told(tmp_path: pathlib.Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("def shots(window):\n    yield None\n    raise ValueError('no such node')\n")
    with pytest.raises(RuntimeError, match="no such node"):
        screen.take(script, tmp_path / "pictures")
