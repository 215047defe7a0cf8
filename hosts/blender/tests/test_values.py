"""What a live object shows of values beside what the command line writes of them, bit by bit; and of values that are no meshes."""

from __future__ import annotations

import importlib.util
import pathlib
import subprocess
import sys
from typing import Any

import bpy
import numpy as np
from test_live import ROOT, folder, module, positions, settled, until  # noqa: F401

BENT = """Graph(
    format: 1,
    params: { "strongest": Number(default: 0.1, min: 0.01, max: 2.0, unit: "1/mm", doc: "What is red.") },
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "mesh": Triangulate(range: "scan.range"),
        "bent": Curvature(mesh: "mesh", method: Fit, strongest: Param("strongest")),
    },
    outputs: { "bent.ply": "bent" },
)
"""
KINDS = {"float": "<f4", "double": "<f8", "uchar": "u1", "uint": "<u4", "int": "<i4"}


def command_line(*words: object) -> None:
    """What a user's terminal would do, by the program in the extension."""
    found = importlib.util.find_spec("maquette")
    assert found and found.origin
    worker = pathlib.Path(module("worker").__file__)
    whole = [sys.executable, "-I", worker, pathlib.Path(found.origin).parents[1], *words]
    done = subprocess.run([str(it) for it in whole], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def vertices(path: pathlib.Path) -> Any:
    """The vertices of a binary PLY."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    assert ["format", "binary_little_endian", "1.0"] in lines
    first = next(place for place, line in enumerate(lines) if line[:2] == ["element", "vertex"])
    last = next(place for place, line in enumerate(lines) if line[:1] == ["element"] and place > first)
    kind = np.dtype([(line[2], KINDS[line[1]]) for line in lines[first + 1 : last] if line[0] == "property"])
    return np.frombuffer(body, kind, int(lines[first][2]))


def test_8_attributes_are_the_command_lines_as_single_numbers(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    graph = folder / "bent.ron"
    graph.write_text(BENT)
    owner = module("live").add(str(graph), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))
    command_line("run", graph, "--out", folder / "out", "--no-cache")
    written = vertices(folder / "out/bent.ply")
    same = 0
    for name in ("gaussian", "mean", "k1", "k2", "extraordinary", "unknown"):
        attribute = owner.data.attributes.get(name)
        if attribute is None or name not in written.dtype.names:
            assert name not in written.dtype.names and attribute is None, name
            continue
        shown = np.empty(len(attribute.data), np.float32 if attribute.data_type == "FLOAT" else np.int32)
        attribute.data.foreach_get("value", shown)
        assert (shown == written[name].astype(shown.dtype)).all() and shown.any() or name in ("extraordinary", "unknown"), name
        same += 1
    assert same >= 4, (written.dtype.names, list(owner.data.attributes.keys()))
    # Files stand upright; a scan looks along z, and the object is turned instead.
    there = np.stack([written[it] for it in "xyz"], 1).astype(np.float32) * np.array([1, -1, -1], np.float32)
    assert (positions(owner) == there).all()


OTHERS = """Graph(
    format: 1,
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "red": Threshold(image: "scan.color", select: Near(color: "#c33923", distance: 30.0)),
        "spots": Label(mask: "red", connectivity: Eight),
        "nose": ExtractRegion(labels: "spots", range: "scan.range", pick: Largest),
        "normal": AverageNormal(region: "nose", range: "scan.range"),
        "net": ControlNet(region: "nose", range: "scan.range"),
        "knots": Knots(net: "net", along: U, order: 3),
        "across": Knots(net: "net", along: V, order: 3),
        "surface": Nurbs(net: "net", u: "knots", v: "across"),
        "mesh": Triangulate(range: "scan.range"),
    },
    outputs: { "mesh.ply": "mesh", "surface.ply": "surface" },
)
"""


def test_every_kind_of_value_is_shown_or_it_is_said_why_not(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    (folder / "others.ron").write_text(OTHERS)
    owner = module("live").add(str(folder / "others.ron"), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))
    it = module("live").state(owner)
    seen: dict[str, tuple[int, int, int, str]] = {}
    values = ("mesh", "scan.range", "net", "surface", "scan.color", "red", "spots", "nose", "normal", "knots", "mesh")
    for value in values:
        owner.maquette.output = value
        until(lambda: settled(owner) and it.asked[2] == value)
        mesh = owner.data
        assert not mesh.validate(verbose=True)
        now = (len(mesh.vertices), len(mesh.edges), len(mesh.polygons), it.message)
        assert seen.setdefault(value, now) == now
        assert not it.problems
    for value in ("mesh", "net", "nose", "surface"):
        assert seen[value][0] > 16 and not seen[value][3], (value, seen[value])
    for value in ("scan.color", "scan.range", "red", "spots", "knots"):
        assert "nothing of it lies in space" in seen[value][3], (value, seen[value])


def test_9_each_graphs_panel_says_what_the_module_says(empty: Any) -> None:
    import maquette

    compared = 0
    for graph in sorted((ROOT / "graphs").rglob("*.ron")):
        if "\nGraph(" not in "\n" + graph.read_text():
            continue
        try:
            declared = maquette.load(str(graph)).params
        except Exception:
            # A patch, or one with a mistake.
            continue
        owner = module("live").add(str(graph), bpy.context)
        it = module("live").state(owner)
        until(lambda: it.loaded)
        for control in it.controls:
            own, name = declared[control.name], f"maquette {control.name}"
            assert control.doc == (own.doc or ""), (graph, name)
            shown = owner.id_properties_ui(name).as_dict()
            assert shown["description"] == control.doc
            if control.kind in ("number", "integer"):
                assert owner[name] == own.default, (graph, name)
                assert own.min is None or shown["min"] == own.min
                assert own.max is None or shown["max"] == own.max
                compared += 1
        bpy.data.objects.remove(owner)
    assert compared > 30, compared
