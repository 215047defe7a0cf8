"""Tests of the harness for pictures, and tests with mouse and keys in a real window."""

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

ROOT = pathlib.Path(__file__).resolve().parents[3]

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


SLIDER = """
import array, os
import bpy
from mathutils import Euler

def shots(window):
    from addon import apply, live

    def older(mesh, told, folder):
        # What the add-on writes in Blender 4.2, this older one takes in other ways.
        def numbers(name, kind):
            column = next(it for it in told["columns"] if it["name"] == name)
            return array.array(kind, (folder / column["file"]).read_bytes())
        places, corners = numbers("position", "f"), numbers("corners", "I")
        mesh.clear_geometry()
        mesh.from_pydata(list(zip(*[iter(places)] * 3)), [], list(zip(*[iter(corners)] * told["sides"])))
        mesh.uv_layers.new().data.foreach_set("uv", numbers("uv", "f"))
        mesh[apply.FACES] = "older"

    def doll():
        return bpy.data.objects["doll"]

    def settled():
        it = live.state(doll())
        return it.run is None and it.answered and it.answered[1] == doll().maquette.values

    def until(is_so):
        for _ in range(200):
            yield 0.1
            if is_so():
                return
        raise AssertionError((doll().maquette.values, doll().get("maquette growth"), live.state(doll()).message))

    def depth():
        # The nose grows towards who looks at it.
        return -min(vertex.co.z for vertex in doll().data.vertices)

    apply.apply = older
    for it in list(bpy.data.objects):
        bpy.data.objects.remove(it)
    live.add(os.environ["GRAPH"], bpy.context)
    yield from until(lambda: doll().maquette.shown and settled())
    space = window.show("VIEW_3D")
    space.show_region_ui, space.shading.color_type = True, "TEXTURE"
    yield None
    space.region_3d.view_rotation, space.region_3d.view_perspective = Euler((1.3, 0, 0.9)).to_quaternion(), "ORTHO"
    with window.override():
        bpy.ops.view3d.view_selected(use_all_regions=False)
    # The tab of the add-on, the fourth one.
    yield from window.click(1187, 254)
    bpy.ops.ed.undo_push(message="Doll")
    yield "before"
    first, values = depth(), []
    for pause in window.pull((1090, 180), (1140, 180), 12):
        yield pause
        values.append((round(depth(), 3), doll().maquette.values))
    yield from until(settled)
    # The mesh follows while the mouse is down, and at last has the value where it was left.
    assert len({it for it, _ in values[:-1]}) >= 3 and len({it for _, it in values[:-1]}) >= 3, values
    grown = doll()["maquette growth"]
    assert 20 < grown < 36 and depth() > first + 5, (grown, first, depth())
    yield "after"
    yield from window.key("ctrl+z")
    yield from until(lambda: settled() and abs(depth() - first) < 1e-3)
    assert doll()["maquette growth"] == 12 and "growth" not in doll().maquette.values
    yield from window.key("ctrl+shift+z")
    yield from until(lambda: settled() and depth() > first + 5)
    assert doll()["maquette growth"] == grown
"""


def pixels(path: pathlib.Path) -> np.ndarray:
    """The RGBA pixels of a picture, by rows, from 0 to 1."""
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


@pytest.fixture
def engine(addon: Any, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine for the window, whose Blender is older and has another Python."""
    if os.environ.get("MAQUETTE"):
        return
    found = importlib.util.find_spec("maquette")
    assert found and found.origin
    worker, program = ROOT / "hosts/blender/addon/worker.py", tmp_path / "maquette"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I "{worker}" "{pathlib.Path(found.origin).parents[1]}" "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("MAQUETTE", str(program))


@pytest.mark.usefixtures("engine")
def test_the_mouse_edits_a_graph_file(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "graphs/doll", tmp_path / "doll")
    (tmp_path / "hand.ron").write_text(GRAPH)
    monkeypatch.setenv("GRAPH", str(tmp_path / "hand.ron"))
    script = tmp_path / "script.py"
    script.write_text(HAND)
    assert list(screen.take(script, tmp_path / "pictures", (1400, 700))) == ["linked", "moved", "refused"]


@pytest.mark.usefixtures("engine")
def test_the_mouse_drags_a_slider_and_the_mesh_follows(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "graphs/doll", tmp_path / "doll")
    shutil.copy(ROOT / "graphs/doll.ron", tmp_path)
    monkeypatch.setenv("GRAPH", str(tmp_path / "doll.ron"))
    script = tmp_path / "script.py"
    script.write_text(SLIDER)
    kept = ROOT / "target/blender/pictures/slider"
    taken = screen.take(script, kept, (1200, 800))
    assert list(taken) == ["after", "before"]
    # The nose is longer.
    red = {}
    for name, path in taken.items():
        shown = pixels(path)
        red[name] = (shown[..., 0] > 0.4) & (shown[..., 1] < 0.25) & (shown[..., 2] < 0.25)
    assert red["before"].sum() > 1000 and red["after"].sum() > 1.5 * red["before"].sum(), {name: it.sum() for name, it in red.items()}


def test_a_script_that_fails_is_told(tmp_path: pathlib.Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("def shots(window):\n    yield None\n    raise ValueError('no such node')\n")
    with pytest.raises(RuntimeError, match="no such node"):
        screen.take(script, tmp_path / "pictures")
