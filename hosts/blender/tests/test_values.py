"""Tests that live objects show values exactly as the command line writes them, and tests of values that are not meshes."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import pathlib
import shutil
import subprocess
import sys
import types
from typing import Any

import bpy
import numpy as np
import pytest
from test_live import ROOT, SMOOTH, folder, module, positions, settled, until  # noqa: F401

BENT = """Graph(
    format: 1,
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "mesh": Triangulate(range: "scan.range"),
        "bent": Curvature(mesh: "mesh", method: Fit),
    },
    outputs: { "shown.ply": "bent" },
)
"""

TEXTURED = """Graph(
    format: 1,
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "mesh": Triangulate(range: "scan.range"),
        "model": Texture(mesh: "mesh", image: "scan.color"),
    },
    outputs: { "shown.ply": "model", "shown.glb": "model" },
)
"""

LABELLED = """Graph(
    format: 1,
    nodes: { "marked": ReadMesh(path: "marked.ply") },
    outputs: { "shown.ply": "marked" },
)
"""

# Numbers that single precision cannot hold: a label beyond 2^24, and the double 0.1.
MARKED = """ply
format ascii 1.0
comment attribute flag seen
comment attribute vector flow
element vertex 4
property float x
property float y
property float z
property uint label
property double heat
property uchar seen
property float flow_x
property float flow_y
property float flow_z
property uchar red
property uchar green
property uchar blue
element face 1
property list uchar int vertex_indices
end_header
0 0 0 16777217 0.1 1 1 0.5 0 200 100 1
10 0 0 2 -0.3 0 0 1 0 0 255 17
10 10 0 3 1e-30 1 0 0 1 254 3 128
0 10 0 4 12345.678 0 0.25 0 1 9 10 11
4 0 1 2 3
"""
KINDS = {"float": "<f4", "double": "<f8", "uchar": "u1", "uint": "<u4", "int": "<i4"}


def command_line(*words: object, may_fail: bool = False) -> str:
    """Runs the command line of the extension's engine and returns its output."""
    found = importlib.util.find_spec("maquette")
    assert found and found.origin
    worker = pathlib.Path(module("worker").__file__)
    whole = [sys.executable, "-I", worker, pathlib.Path(found.origin).parents[1], *words]
    done = subprocess.run([str(it) for it in whole], capture_output=True, text=True)
    assert may_fail or done.returncode == 0, done.stderr
    return done.stdout


def vertices(path: pathlib.Path) -> Any:
    """The vertices of a binary PLY."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    assert ["format", "binary_little_endian", "1.0"] in lines
    first = next(place for place, line in enumerate(lines) if line[:2] == ["element", "vertex"])
    last = next(place for place, line in enumerate(lines) if line[:1] == ["element"] and place > first)
    kind = np.dtype([(line[2], KINDS[line[1]]) for line in lines[first + 1 : last] if line[0] == "property"])
    return np.frombuffer(body, kind, int(lines[first][2]))


def attribute(owner: bpy.types.Object, name: str) -> Any:
    """The numbers of an attribute, one row for each element."""
    slots = {"FLOAT": ("value", np.float32, 1), "INT": ("value", np.int32, 1), "FLOAT_VECTOR": ("vector", np.float32, 3)}
    found = owner.data.attributes[name]
    slot, kind, width = slots[found.data_type]
    numbers = np.empty(len(found.data) * width, kind)
    found.data.foreach_get(slot, numbers)
    return numbers.reshape(-1, width)


def same(shown: Any, written: Any) -> bool:
    """Returns true if numbers are equal to the last bit."""
    return bool(shown.dtype == written.dtype and shown.shape == written.shape and (shown.view(np.uint32) == written.view(np.uint32)).all())


def both(folder: pathlib.Path, text: str) -> tuple[bpy.types.Object, Any]:
    """A live object of a graph, and the vertices that the command line writes for it."""
    graph = folder / "graph.ron"
    graph.write_text(text)
    owner = module("live").add(str(graph), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))
    command_line("run", graph, "--out", folder / "out", "--no-cache")
    return owner, vertices(folder / "out/shown.ply")


def columns(written: Any, *names: str) -> Any:
    """Some properties of vertices as columns."""
    return np.ascontiguousarray(np.stack([written[it] for it in names], 1))


# Files have y up. A scan looks along z, and the live object is rotated instead.
UPRIGHT = np.array([1, -1, -1], np.float32)


def test_8_curvature_is_the_command_lines_bit_by_bit(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    owner, written = both(folder, BENT)
    for name in ("gaussian", "mean", "k1", "k2"):
        shown = attribute(owner, name)
        assert shown.any() and same(shown, columns(written, name)), name
    for name in ("direction1", "direction2"):
        shown = attribute(owner, name)
        assert shown.any() and (shown * UPRIGHT == columns(written, *(f"{name}_{it}" for it in "xyz"))).all(), name
    for name in ("extraordinary", "unknown"):
        assert (attribute(owner, name) == columns(written, name)).all(), name
    assert (positions(owner) * UPRIGHT == columns(written, *"xyz")).all()


def test_8_labels_numbers_flags_and_vectors_are_the_command_lines_bit_by_bit(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    (folder / "marked.ply").write_text(MARKED)
    owner, written = both(folder, LABELLED)
    assert attribute(owner, "label").ravel().tolist() == written["label"].tolist() == [16777217, 2, 3, 4]
    assert attribute(owner, "seen").ravel().tolist() == written["seen"].tolist() == [1, 0, 1, 0]
    assert same(attribute(owner, "heat"), columns(written, "heat")) and written["heat"][0] == np.float32(0.1)
    assert same(attribute(owner, "flow"), columns(written, "flow_x", "flow_y", "flow_z"))
    assert same(positions(owner), columns(written, *"xyz"))
    colors = owner.data.attributes["color"]
    assert (colors.data_type, colors.domain) == ("BYTE_COLOR", "POINT")
    shown = [[round(255 * its) for its in one.color_srgb] for one in colors.data]
    assert shown == [[*map(int, row), 255] for row in columns(written, "red", "green", "blue")] and shown[0] == [200, 100, 1, 255]


def pixels(image: bpy.types.Image) -> Any:
    """All levels of a picture."""
    found = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(found)
    return found


def test_8_texture_and_its_coordinates_are_those_of_the_files(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    owner, written = both(folder, TEXTURED)
    corners = np.empty(len(owner.data.loops), np.int32)
    owner.data.attributes[".corner_vert"].data.foreach_get("value", corners)
    shown = np.empty(2 * len(corners), np.float32)
    owner.data.uv_layers["UVMap"].uv.foreach_get("vector", shown)
    assert same(shown.reshape(-1, 2), columns(written, "s", "t")[corners]) and shown.any()

    whole = (folder / "out/shown.glb").read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    told = json.loads(whole[20 : 20 + length])
    view = told["bufferViews"][told["images"][0]["bufferView"]]
    start = 28 + length + view.get("byteOffset", 0)
    (folder / "glb.png").write_bytes(whole[start : start + view["byteLength"]])
    (material,) = owner.data.materials
    texture = pixels(material.node_tree.nodes["Texture"].image)
    assert len(set(texture.tolist())) > 16
    for file in ("glb.png", "doll/color.png"):
        assert same(texture, pixels(bpy.data.images.load(str(folder / file)))), file
    # The material is removed with the texture, and restored with the user's changes.
    material.diffuse_color = (1, 0, 0, 1)
    for output, materials in (("mesh", []), ("model", [material])) * 2:
        owner.maquette.output = output
        until(lambda: settled(owner) and module("live").state(owner).asked[2] == output)
        assert list(owner.data.materials) == materials


def test_copies_and_what_is_baked_keep_their_texture_when_that_of_the_object_changes(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    live, graph = module("live"), folder / "graph.ron"
    graph.write_text(TEXTURED)
    owner = live.add(str(graph), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))

    def shown(it: bpy.types.Object) -> Any:
        (material,) = it.data.materials
        return pixels(material.node_tree.nodes["Texture"].image)

    first = shown(owner)
    assert bpy.ops.maquette.bake() == {"FINISHED"}
    baked = bpy.data.objects["graph baked"]
    assert bpy.ops.object.duplicate() == {"FINISHED"}
    copied = bpy.context.object
    assert copied != owner and copied.maquette.graph == owner.maquette.graph
    color = bpy.data.images.load(str(folder / "doll/color.png"))
    color.pixels.foreach_set(1 - first)
    (folder / "doll/other.png").write_bytes((folder / "doll/color.png").read_bytes())
    color.filepath_raw = str(folder / "doll/other.png")
    color.save()
    (folder / "other.ron").write_text(TEXTURED.replace("doll/color.png", "doll/other.png"))
    for turn in range(3):
        owner.maquette.graph = str(folder / ("graph.ron" if turn % 2 else "other.ron"))
        until(lambda: settled(owner) and settled(copied) and same(shown(owner), first) == bool(turn % 2))
        assert same(shown(copied), first) and same(shown(baked), first)
        # Unused images are removed.
        assert len(bpy.data.images) == (2 if turn % 2 else 3)
    # Changes of a material by the user survive a removal of the texture, and removed materials stay removed.
    owner.data.materials[0].diffuse_color = (1, 0, 0, 1)
    owner.maquette.output = "mesh"
    until(lambda: settled(owner) and not owner.data.materials)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(folder / "saved.blend"))
    owner = bpy.data.objects["graph"]
    owner.maquette.output = "shown.glb"
    until(lambda: settled(owner) and owner.data.materials)
    assert tuple(owner.data.materials[0].diffuse_color) == (1, 0, 0, 1) and not same(shown(owner), first)
    mine = owner.data.materials[0] = bpy.data.materials.new("mine")
    owner.maquette.graph = str(folder / "graph.ron")
    until(lambda: settled(owner) and owner.data["maquette_texture"] == bpy.data.objects["graph.001"].data["maquette_texture"])
    assert list(owner.data.materials) == [mine]


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
        "bent": Curvature(mesh: "mesh", method: Fit),
        "mug": ReadMesh(path: "doll/mug.obj"),
        "sharp": Crease(mesh: "mug", angle: 30.0),
        "points": ReadPoints(path: "doll/points.xyz"),
        "lines": Lattice(mesh: "mug"),
    },
    outputs: { "mesh.ply": "mesh", "surface.ply": "surface" },
)
"""



# The parts of each mesh: vertices, edges and faces.
SHOWN = {
    "mesh": "vef",
    "bent": "vef",
    "surface": "vef",
    "nose": "ve",
    "sharp": "vef",
    "points": "v",
    "scan.range": "v",
    "lines": "ve",
    "net": "ve",
    "normal": "ve",
}
UNSEEN = {
    "scan.color": "Image",
    "red": "Mask",
    "spots": "Labels",
    "knots": "KnotVector",
}


def test_every_kind_of_value_is_shown_or_it_is_said_why_not(empty: Any, folder: pathlib.Path) -> None:  # noqa: F811
    (folder / "others.ron").write_text(OTHERS)
    live = module("live")
    owner = live.add(str(folder / "others.ron"), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))
    it = live.state(owner)
    seen: dict[str, Any] = {}

    def show(value: str) -> None:
        """Shows a value, and checks that the result does not depend on the previous value."""
        owner.maquette.output = value
        until(lambda: settled(owner) and it.asked[2] == value)
        mesh = owner.data
        assert not mesh.validate(verbose=True) and not it.problems
        parts = {"v": len(mesh.vertices), "e": len(mesh.edges), "f": len(mesh.polygons)}
        names = sorted((it.name, it.domain, it.data_type) for it in mesh.attributes if not it.is_internal)
        turned = [round(number, 3) for row in owner.matrix_world for number in row]
        now = (parts, names, turned if value in SHOWN else None, it.message)
        assert seen.setdefault(value, now) == now
        if value in SHOWN:
            assert "".join(part for part in parts if parts[part]) == SHOWN[value] and not it.message, (value, now)
        else:
            assert not any(parts.values()), (value, now)
            assert f"{value} has the type {UNSEEN[value]}" in it.message, it.message

    every = [*SHOWN, *UNSEEN]
    for value in [*every, *reversed(every), *every[::2], *every[1::2]]:
        show(value)
    assert "k1" in str(seen["bent"]) and "k1" not in str(seen["mesh"])
    # Range images and drawings have other axes.
    assert seen["mesh"][2] != seen["sharp"][2]


def test_an_attribute_that_moves_to_other_elements_is_not_lost(empty: Any, tmp_path: pathlib.Path) -> None:
    apply = module("apply")

    def triangle(*attributes: tuple[str, str, list[float]]) -> dict[str, Any]:
        """A triangle with attributes."""
        parts = [("position", "vertex", 3, "f32", [0, 0, 0, 1, 0, 0, 0, 1, 0]), ("corners", "corner", 1, "u32", [0, 1, 2])]
        parts += [("edges", "edge", 2, "u32", [0, 1, 1, 2, 2, 0]), ("edge of a corner", "corner", 1, "u32", [0, 1, 2])]
        parts += [(name, on, 1, "f32", numbers) for name, on, numbers in attributes]
        found = []
        for name, on, width, kind, numbers in parts:
            file = f"{name}-{on}-{len(numbers)}-{sum(numbers)}"
            np.array(numbers, "<f4" if kind == "f32" else "<u4").tofile(tmp_path / file)
            count = len(numbers) // width
            found.append({"name": name, "on": on, "meaning": "number", "width": width, "type": kind, "count": count, "file": file})
        return {"sides": 3, "columns": found}

    mesh = bpy.data.meshes.new("triangle")
    owner: Any = types.SimpleNamespace(data=mesh)
    for on, numbers in (("vertex", [1.0, 2.0, 3.0]), ("face", [4.0]), ("corner", [5.0, 6.0, 7.0]), ("vertex", [8.0, 9.0, 10.0])):
        apply.apply(mesh, triangle(("heat", on, numbers)), tmp_path)
        assert mesh.attributes["heat"].domain == apply.DOMAINS[on]
        assert attribute(owner, "heat").ravel().tolist() == numbers
    # Like creases: on some edges only.
    apply.apply(mesh, triangle(("some", "edge", [1.0, 2.0])), tmp_path)
    assert "some" not in mesh.attributes and "heat" not in mesh.attributes


def world(owner: bpy.types.Object) -> list[float]:
    """The bounds of an object in the world."""
    bpy.context.view_layer.update()
    places = positions(owner) @ np.array(owner.matrix_world.to_3x3()).T + np.array(owner.matrix_world.translation)
    return [round(float(it), 3) for it in np.concatenate([places.min(0), places.max(0)])]


def cube(size: float, height: float) -> bpy.types.Object:
    """A cube above the origin."""
    bpy.ops.mesh.primitive_cube_add(size=size, location=(0, 0, height))
    return bpy.context.object


@pytest.fixture
def smooth(empty: Any, tmp_path: pathlib.Path) -> bpy.types.Object:
    """A live object with a mesh input."""
    (tmp_path / "smooth.ron").write_text(SMOOTH)
    owner = module("live").add(str(tmp_path / "smooth.ron"), bpy.context)
    until(lambda: "cage" in owner.maquette.inputs)
    return owner


def test_what_comes_of_an_object_lies_where_the_object_is(smooth: bpy.types.Object) -> None:
    def lies_at(height: float, width: float) -> None:
        def is_so() -> bool:
            if not (smooth.maquette.shown and settled(smooth)):
                return False
            low, high = np.split(np.array(world(smooth)), 2)
            middle = (low + high) / 2 - [0, 0, height]
            return bool(np.abs(middle).max() < 0.01 and width * 0.8 < high[0] - low[0] < width)

        until(is_so, 5)

    smooth.maquette.inputs["cage"].object = cube(2, 3)
    lies_at(3, 2)
    smooth.location.x = 7
    bpy.context.view_layer.update()
    lies_at(3, 2)
    # Another object at the input, then none.
    smooth.maquette.inputs["cage"].object = cube(4, -5)
    lies_at(-5, 4)
    last = world(smooth)
    smooth.maquette.inputs["cage"].object = None
    until(lambda: "choose an object for the input cage" in module("live").state(smooth).message)
    assert world(smooth) == last
    # The first object again.
    smooth.maquette.inputs["cage"].object = bpy.context.object
    lies_at(-5, 4)
    assert not module("live").state(smooth).message


def test_what_is_mirrored_is_not_turned_inside_out(empty: Any, tmp_path: pathlib.Path) -> None:
    (tmp_path / "moved.ron").write_text(TAKES.format("Mesh"))
    owner, given = module("live").add(str(tmp_path / "moved.ron"), bpy.context), cube(2, 0)
    until(lambda: "it" in owner.maquette.inputs)
    owner.maquette.inputs["it"].object = given
    for scale in ((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (2, -3, 0.5)):
        given.scale = scale
        bpy.context.view_layer.update()
        until(lambda: owner.maquette.shown and settled(owner))
        assert world(owner)[3:] == [abs(it) for it in scale]
        # The signed volume: its sign depends on the orientation of faces.
        faces = [[owner.data.vertices[it].co for it in face.vertices] for face in owner.data.polygons]
        assert sum(corners[0].dot(corners[at].cross(corners[at + 1])) for corners in faces for at in (1, 2)) > 0


PAIR = """Graph(
    format: 1,
    inputs: { "low": Mesh(doc: "one"), "high": Mesh(doc: "another") },
    nodes: { "one": Transform(mesh: "low"), "another": Transform(mesh: "high") },
    outputs: { "low-one": "one", "high-one": "another" },
)
"""


def test_each_of_two_inputs_has_its_own_object(empty: Any, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pair.ron").write_text(PAIR)
    owner = module("live").add(str(tmp_path / "pair.ron"), bpy.context)
    until(lambda: "high" in owner.maquette.inputs)
    owner.maquette.inputs["low"].object, owner.maquette.inputs["high"].object = cube(2, -5), cube(4, 5)
    # The engine starts only when both are there.
    with monkeypatch.context() as slow:
        slow.setattr(module("engine").client(), "_send", lambda: None)
        module("live").tick()
    assert module("live").state(owner).sending == {"low", "high"}
    for value, bounds in (("low-one", [-1, -1, -6, 1, 1, -4]), ("high-one", [-2, -2, 3, 2, 2, 7])) * 2:
        owner.maquette.output = value
        until(lambda: owner.maquette.shown and settled(owner))
        assert world(owner) == bounds


def test_an_object_without_a_mesh_is_no_input_and_that_is_said(smooth: bpy.types.Object) -> None:
    it = module("live").state(smooth)
    for data in (None, bpy.data.cameras.new("Camera"), bpy.data.lights.new("Light", "SUN")):
        given = bpy.data.objects.new(data.name if data else "Empty", data)
        bpy.context.collection.objects.link(given)
        smooth.maquette.inputs["cage"].object = given
        until(lambda: it.message == f"cage: {given.name} has no mesh")
    smooth.maquette.inputs["cage"].object = cube(2, 0)
    until(lambda: smooth.maquette.shown and settled(smooth))
    assert not it.message and len(smooth.data.polygons) == 96


def test_an_object_is_not_made_of_itself_also_not_by_another_one(smooth: bpy.types.Object) -> None:
    live = module("live")
    smooth.maquette.inputs["cage"].object = smooth
    until(lambda: "cannot be an input of itself" in live.state(smooth).message)
    smooth.maquette.inputs["cage"].object = cube(2, 0)
    until(lambda: smooth.maquette.shown and settled(smooth))
    other = live.add(live.graph_path(smooth), bpy.context)
    until(lambda: "cage" in other.maquette.inputs)
    other.maquette.inputs["cage"].object = smooth
    until(lambda: other.maquette.shown and settled(other))
    smooth.maquette.inputs["cage"].object = other
    until(lambda: f"{other.name} depends on {smooth.name} itself" in live.state(smooth).message)
    assert (len(smooth.data.polygons), len(other.data.polygons)) == (96, 96 * 16)


TAKES = 'Graph(format: 1, inputs: {{ "it": {}(doc: "") }}, nodes: {{ "moved": Transform(mesh: "it") }}, outputs: {{ "moved": "moved" }})'


def test_vertices_are_given_as_points_and_what_cannot_be_given_is_said(empty: Any, tmp_path: pathlib.Path) -> None:
    live, given = module("live"), cube(2, 3)
    for kind in ("Points", "ControlNet", "RangeImage"):
        (tmp_path / f"{kind}.ron").write_text(TAKES.format(kind))
        owner = live.add(str(tmp_path / f"{kind}.ron"), bpy.context)
        until(lambda: "it" in owner.maquette.inputs)
        owner.maquette.inputs["it"].object = given
        if kind == "Points":
            until(lambda: owner.maquette.shown and settled(owner))
            assert (len(owner.data.vertices), len(owner.data.edges)) == (8, 0)
            assert world(owner) == [-1, -1, 2, 1, 1, 4]
        else:
            until(lambda: f"the input takes a value of type {kind}, but an object can only be passed as Mesh, Points or Curve" in live.state(owner).message)
            assert not owner.maquette.shown


ON = {"vertex": "POINT", "corner": "CORNER", "face": "FACE"}


def test_8_attributes_of_one_name_on_vertices_corners_and_faces_are_all_shown_bit_by_bit(
    empty: Any, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "moved.ron").write_text(TAKES.format("Mesh"))
    live, rows = module("live"), {"vertex": 8, "corner": 24, "face": 6}
    owner = live.add(str(tmp_path / "moved.ron"), bpy.context)
    until(lambda: "it" in owner.maquette.inputs)
    before = module("inputs").columns
    numbers = {
        (name, on): (np.arange(rows[on]) + 16777217).astype(np.uint32) if name == "label" else (np.arange(rows[on]) / np.float32(7)).astype(np.float32)
        for name in ("label", "heat", "position", "material_index", "edges", "long " * 20)
        for on in rows
        if (name, on) != ("position", "vertex")
    }

    def given(*words: Any) -> dict[str, Any]:
        """An object with attributes."""
        found = before(*words)
        for (name, on), its in numbers.items():
            file = f"{on}-{len(name)}-{name[0]}"
            its.tofile(module("engine").client().folder / file)
            kind, meaning = ("u32", "index") if its.dtype == np.uint32 else ("f32", "number")
            found["columns"].append({"name": name, "on": on, "meaning": meaning, "width": 1, "type": kind, "file": file})
        return found

    monkeypatch.setattr(module("inputs"), "columns", given)

    def shown(wanted: dict[tuple[str, str], str]) -> None:
        """Waits for the result and checks each attribute."""
        live.state(owner).stale.add("it")
        until(lambda: owner.maquette.shown and settled(owner))
        assert {it.name for it in owner.data.attributes if it.name.partition(".")[0] in ("label", "heat")} == {
            name for (known, _), name in wanted.items() if known in ("label", "heat")
        }
        for (name, on), its in numbers.items():
            found = owner.data.attributes[wanted[name, on]]
            assert found.domain == ON[on]
            assert same(attribute(owner, wanted[name, on]).view(np.uint32).ravel(), its.view(np.uint32)), (name, on)
        assert len(owner.data.vertices) == 8 and len(owner.data.edges) == 12 and not owner.data.validate(verbose=True)

    owner.maquette.inputs["it"].object = cube(2, 0)
    cut = ("long " * 20)[:48]
    wanted = {(name, on): name if on == "vertex" else f"{name}.{on}" for name in ("label", "heat", "edges") for on in rows}
    wanted |= {(name, on): f"{name}.{on}" for name in ("position", "material_index") for on in rows}
    wanted |= {("long " * 20, on): cut if on == "vertex" else f"{cut}.{on}" for on in rows}
    shown(wanted)
    # The first attribute keeps the name.
    for name in ("label", "heat"):
        del numbers[name, "vertex"], wanted[name, "vertex"]
        wanted[name, "corner"] = name
    shown(wanted)
    del numbers["heat", "corner"], numbers["heat", "face"], wanted["heat", "corner"], wanted["heat", "face"]
    numbers["label", "corner"] = numbers["label", "corner"][::-1].copy()
    shown(wanted)


def test_9_each_graphs_panel_says_what_the_module_and_the_command_line_say(empty: Any, tmp_path: pathlib.Path) -> None:
    import maquette

    live, panel = module("live"), module("panel")
    graphs = tmp_path / "graphs"
    shutil.copytree(ROOT / "graphs", graphs, ignore=shutil.ignore_patterns("goldens", "pictures", "*.test.ron", "*.lock.ron"))
    compared = 0
    for graph in sorted(graphs.rglob("*.ron")):
        if "\n    params: {" not in graph.read_text():
            continue
        declared = maquette.load(str(graph)).params
        # The command line describes used graphs.
        using = graph.with_name("using.ron")
        using.write_text(f'Graph(format: 1, use: {{ "It": "{graph.name}" }}, nodes: {{}}, outputs: {{}})')
        (printed,) = json.loads(command_line("nodes", using, "It", "--json", may_fail=True))["nodes"]
        owner = live.add(str(graph), bpy.context)
        it = live.state(owner)
        until(lambda: it.loaded)
        # The parameters of a used graph are fields, with underscores instead of hyphens.
        fields = [dataclasses.replace(control, name=control.name.replace("-", "_")) for control in it.controls]
        assert it.loaded["ok"] and fields == panel.controls(printed["parameters"]), graph
        assert [control.name for control in it.controls] == list(declared), graph
        for control in it.controls:
            own, name = declared[control.name], f"maquette {control.name}"
            said = (control.doc, control.unit, control.low, control.high, control.choices, control.default)
            assert said == (own.doc, own.unit or "", own.min, own.max, own.choices, own.default), (graph, name)
            shown = owner.id_properties_ui(name).as_dict()
            assert shown["description"] == own.doc
            if control.kind in ("number", "integer"):
                assert owner[name] == own.default, (graph, name)
                for bound, limit in (("min", own.min), ("max", own.max)):
                    assert limit is None or shown[bound] == shown[f"soft_{bound}"] == limit, (graph, name)
            elif control.kind != "color":
                held = module("values").to_json(owner[name])
                held = control.choices[held] if control.kind == "choice" else held
                assert held == panel.widget_value(control, None), (graph, name)
            compared += 1
        bpy.data.objects.remove(owner)
    assert compared > 40, compared


CREASED = """Graph(
    format: 1,
    inputs: { "cage": Mesh(doc: "") },
    nodes: { "moved": Transform(mesh: "cage", translate: (0.0, 0.0, 1.0)), "round": Subdivide(mesh: "cage", scheme: CatmullClark, levels: 2) },
    outputs: { "moved": "moved", "round": "round" },
)
"""


def test_creases_come_from_objects_and_go_to_them(empty: Any, tmp_path: pathlib.Path) -> None:
    (tmp_path / "creased.ron").write_text(CREASED)
    live, given = module("live"), cube(2, 0)
    owner = live.add(str(tmp_path / "creased.ron"), bpy.context)
    until(lambda: "cage" in owner.maquette.inputs)
    owner.maquette.inputs["cage"].object = given

    def shown(output: str) -> Any:
        owner.maquette.output = output
        until(lambda: owner.maquette.shown and settled(owner) and live.state(owner).asked[2] == output)
        return positions(owner)

    def creases(it: bpy.types.Object) -> dict[frozenset[tuple[float, ...]], float]:
        """The creases of edges, by the rounded positions of their ends in the world."""
        bpy.context.view_layer.update()
        found = it.data.attributes.get("crease_edge")
        places = [tuple(round(number, 2) for number in it.matrix_world @ vertex.co) for vertex in it.data.vertices]
        ends = [frozenset(places[end] for end in edge.vertices) for edge in it.data.edges]
        return {its: one.value for its, one in zip(ends, found.data) if one.value} if found else {}

    soft = shown("round")
    shown("moved")
    assert not creases(owner)
    sharp = given.data.attributes.new("crease_edge", "FLOAT", "EDGE")
    flat = [place for place, edge in enumerate(given.data.edges) if all(given.data.vertices[end].co.z == 1 for end in edge.vertices)]
    assert len(flat) == 4
    for place, crease in zip(flat, (1.0, 0.5, 0.25, 1.0)):
        sharp.data[place].value = crease
    given.data.update()
    bpy.context.view_layer.update()
    until(lambda: creases(owner))
    assert creases(owner) == pytest.approx(creases(given)) and len(creases(owner)) == 4
    # The cube of two meters, in millimetres.
    assert np.abs(shown("round") - soft).max() > 100


STROKE = """Graph(
    format: 1,
    inputs: { "path": Curve(doc: "") },
    nodes: { "moved": Transform(mesh: "path", translate: (0.0, 0.0, 1.0)) },
    outputs: { "moved": "moved" },
)
"""


def test_a_chain_of_edges_is_given_as_a_curve(empty: Any, tmp_path: pathlib.Path) -> None:
    (tmp_path / "stroke.ron").write_text(STROKE)
    live = module("live")
    owner = live.add(str(tmp_path / "stroke.ron"), bpy.context)
    until(lambda: "path" in owner.maquette.inputs)
    places = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 0.0, 0.0), (3.0, 1.0, 0.0)]

    def give(edges: list[tuple[int, int]]) -> None:
        mesh = bpy.data.meshes.new("chain")
        mesh.from_pydata(places, edges, [])
        given = bpy.data.objects.new("chain", mesh)
        bpy.context.collection.objects.link(given)
        owner.maquette.inputs["path"].object = given

    def lengths() -> list[float]:
        its = [vertex.co / 1000 for vertex in owner.data.vertices]
        return sorted(round((its[one] - its[other]).length, 3) for one, other in (edge.vertices for edge in owner.data.edges))

    give([(2, 0), (3, 1), (1, 2)])
    until(lambda: owner.maquette.shown and settled(owner))
    assert lengths() == [1, 1, 1.414]
    give([(2, 0), (3, 1), (1, 2), (0, 3)])
    until(lambda: len(owner.data.edges) == 4)
    assert lengths() == [1, 1, 1.414, 3.162]
    for edges in ([(0, 1), (1, 2), (1, 3)], [(0, 1), (2, 3)], [(0, 1), (1, 2)], []):
        give(edges)
        until(lambda: "is not a single chain of edges" in live.state(owner).message)
        owner.maquette.inputs["path"].object = None
        until(lambda: "choose an object" in live.state(owner).message)
    bpy.ops.curve.primitive_bezier_circle_add(radius=5)
    owner.maquette.inputs["path"].object = bpy.context.object
    until(lambda: len(owner.data.edges) == len(owner.data.vertices) > 12)
