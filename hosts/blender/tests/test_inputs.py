"""Tests that data of an object at an input is restored in the mesh of the graph's result."""

from __future__ import annotations

import pathlib
from typing import Any, Callable

import bpy
import numpy as np
import pytest
from test_live import module, settled, until

THROUGH = 'Graph(format: 1, inputs: { "it": Mesh(doc: "in") }, nodes: { "same": Transform(mesh: "it", translate: (1.0, 0.0, 0.0)) }, outputs: { "mesh": "same" })'


def given(folder: pathlib.Path, source: bpy.types.Object, text: str = THROUGH) -> bpy.types.Object:
    """Creates a live object of a graph with another object at its input."""
    (folder / "through.ron").write_text(text)
    owner = module("live").add(str(folder / "through.ron"), bpy.context)
    until(lambda: "it" in owner.maquette.inputs)
    owner.maquette.inputs["it"].object = source
    until(lambda: owner.maquette.shown and settled(owner))
    return owner


def shape() -> bpy.types.Object:
    """A square, a pentagon and a triangle."""
    mesh = bpy.data.meshes.new("source")
    source = bpy.data.objects.new("source", mesh)
    bpy.context.collection.objects.link(source)
    places = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0.3), (2.5, 1, 0), (1.7, 2, 0)]
    mesh.from_pydata(places, [], [(0, 1, 2, 3), (1, 4, 5, 6, 2), (3, 2, 6)])
    return source


def numbers(mesh: bpy.types.Mesh, name: str) -> Any:
    """Domain, type and values of an attribute; None if there is none."""
    found = mesh.attributes.get(name)
    if found is None:
        return None
    slot, kind, width = module("records").KINDS[found.data_type]
    if kind == "O":
        its = [it.value for it in found.data]
    else:
        its = np.empty(len(found.data) * width, kind)
        found.data.foreach_get(slot, its)
    return found.domain, found.data_type, list(its)


def by_ends(mesh: bpy.types.Mesh, name: str) -> dict[frozenset[int], Any]:
    """The values of edges by their vertices."""
    found = numbers(mesh, name)
    width = len(found[2]) // len(mesh.edges) if found else 0
    return {frozenset(it.vertices): tuple(found[2][width * at : width * (at + 1)]) for at, it in enumerate(mesh.edges)} if found else {}


DOMAINS = ("POINT", "EDGE", "FACE", "CORNER")
KINDS = ("FLOAT", "INT", "INT8", "BOOLEAN", "FLOAT_VECTOR", "FLOAT2", "FLOAT_COLOR", "BYTE_COLOR", "INT32_2D", "QUATERNION", "FLOAT4X4", "STRING")


def fill(attribute: bpy.types.Attribute, dice: Any, low: int = 0) -> None:
    """Gives each element a random value."""
    slot, kind, width = module("records").KINDS[attribute.data_type]
    count = len(attribute.data) * width
    if kind == "O":
        for at, it in enumerate(attribute.data):
            it.value = f"Wort {at % 3} ä".encode()
        return
    if kind == "f4":
        its = dice.random(count).astype("f4")
        if attribute.data_type == "BYTE_COLOR":
            its = np.rint(its * 255).astype("f4") / np.float32(255)
    else:
        its = dice.integers(0, 2, count).astype(kind) if kind == "?" else dice.integers(low, 100, count).astype(kind)
    attribute.data.foreach_set(slot, its)


@pytest.mark.parametrize("domain", DOMAINS)
def test_attributes_of_each_type_come_back_out_of_a_graph(empty: Any, tmp_path: pathlib.Path, domain: str) -> None:
    source, dice = shape(), np.random.default_rng(7)
    mesh = source.data
    for kind in KINDS:
        fill(mesh.attributes.new(f"my {kind}", kind, domain), dice)
        if kind.startswith("INT"):
            fill(mesh.attributes.new(f"signed {kind}", kind, domain), dice, -100)
    names = [it.name for it in mesh.attributes if it.name.startswith(("my ", "signed "))]
    assert len(names) == len(KINDS) + 3
    owner = given(tmp_path, source)
    for name in names:
        if domain == "EDGE":
            assert by_ends(owner.data, name) == by_ends(mesh, name), name
        else:
            assert numbers(owner.data, name) == numbers(mesh, name), name
    assert owner.maquette.lost == "" and not module("live").state(owner).message
    others = {it.name for it in owner.data.attributes if not it.is_internal} - set(names) - {"position", module("by_hand").MARK}
    assert others <= {"material_index", "sharp_edge", "sharp_face"}, others


def test_uv_maps_colors_groups_sharp_edges_seams_and_normals_come_back(empty: Any, tmp_path: pathlib.Path) -> None:
    source, dice = shape(), np.random.default_rng(8)
    mesh = source.data
    for name in ("First", "Second"):
        fill(mesh.attributes.new(name, "FLOAT2", "CORNER"), dice)
    mesh.uv_layers["Second"].active_render = True
    fill(mesh.color_attributes.new("Paint", "BYTE_COLOR", "CORNER"), dice)
    fill(mesh.color_attributes.new("Fine", "FLOAT_COLOR", "POINT"), dice)
    for render in (0, 1):
        mesh.color_attributes.render_color_index = render
        for name, members, weight in (("Pin", [0, 1, 2], 0.5), ("Other", [5], 1.0)):
            (source.vertex_groups.get(name) or source.vertex_groups.new(name=name)).add(members, weight, "REPLACE")
        mesh.polygons.foreach_set("use_smooth", [True, False, True])
        for edge, name in ((3, "use_edge_sharp"), (1, "use_seam"), (2, "use_seam")):
            setattr(mesh.edges[edge], name, True)
        mesh.attributes.new("bevel_weight_edge", "FLOAT", "EDGE").data[2].value = 0.25
        mesh.normals_split_custom_set([(0.6, 0, 0.8)] * len(mesh.loops))
        mesh.update()
        owner = given(tmp_path, source)
        result = owner.data
        for name in ("First", "Second", "Paint", "Fine", "sharp_face"):
            assert numbers(result, name) == numbers(mesh, name), name
        assert sorted(it.name for it in result.color_attributes) == ["Fine", "Paint"]
        weights = [{owner.vertex_groups[one.group].name: one.weight for one in it.groups} for it in result.vertices]
        assert weights == [{"Pin": 0.5}] * 3 + [{}] * 2 + [{"Other": 1.0}, {}]
        for name in ("bevel_weight_edge", "sharp_edge"):
            assert by_ends(result, name) == by_ends(mesh, name), name
        seams = [{frozenset(it.vertices) for it in its.edges if it.use_seam} for its in (mesh, result)]
        assert seams[0] == seams[1] and len(seams[0]) == 2
        bpy.context.view_layer.update()
        normals = np.array([(owner.matrix_world.to_3x3() @ it.vector).normalized() for it in result.corner_normals])
        assert result.has_custom_normals and np.abs(normals - [0.6, 0, 0.8]).max() < 1e-3
        assert not owner.maquette.lost and not result.validate(verbose=True)
        bpy.data.objects.remove(owner)
        mesh.attributes.remove(mesh.attributes["bevel_weight_edge"])


def test_normals_turn_with_an_object_that_is_turned_scaled_or_mirrored(empty: Any, tmp_path: pathlib.Path) -> None:
    source = shape()
    source.data.normals_split_custom_set([(0.6, 0, 0.8)] * len(source.data.loops))
    fill(source.data.attributes.new("UVMap", "FLOAT2", "CORNER"), np.random.default_rng(9))
    owner = given(tmp_path, source)
    for scale, turn in (((1, 1, 1), 0.0), ((2, 1, 1), 0.5), ((-1, 1, 1), 0.3)):
        source.scale, source.rotation_euler = scale, (turn, 0.2, 0)
        bpy.context.view_layer.update()
        until(lambda: settled(owner))
        bpy.context.view_layer.update()

        def seen(it: bpy.types.Object) -> set[tuple[float, ...]]:
            """Positions, normals and texture coordinates of corners in the world."""
            found = set()
            turned = it.matrix_world.to_3x3().inverted().transposed()
            for loop, normal, uv in zip(it.data.loops, it.data.corner_normals, it.data.uv_layers[0].uv):
                place = it.matrix_world @ it.data.vertices[loop.vertex_index].co
                found.add((*(round(one, 2) for one in (*place, *(turned @ normal.vector).normalized())), *(round(one, 3) for one in uv.vector)))
            return found

        assert {(round(x - 0.001, 2), *rest) for x, *rest in seen(owner)} == seen(source)


def test_what_a_graph_cannot_be_given_or_drops_is_named(empty: Any, tmp_path: pathlib.Path) -> None:
    source = shape()
    mesh = source.data
    mesh.vertices.add(2)
    mesh.edges.add(1)
    mesh.edges[-1].vertices = (7, 8)
    mesh.edges[2].use_edge_sharp = mesh.edges[4].use_seam = True
    fill(mesh.attributes.new("number", "INT", "POINT"), np.random.default_rng(1))
    fill(mesh.attributes.new("pick", "INT", "FACE"), np.random.default_rng(1))
    owner = given(tmp_path, source)
    it = module("live").state(owner)
    assert owner.maquette.lost == it.message == "it: source is passed without 1 edge without a face"
    fine = THROUGH.replace('Transform(mesh: "it", translate: (1.0, 0.0, 0.0))', 'Subdivide(mesh: "it", scheme: CatmullClark, levels: 1)')
    (tmp_path / "through.ron").write_text(fine)
    until(lambda: len(owner.data.polygons) > 3 and settled(owner))
    assert "not in mesh: " in it.message and "sharp edges" in it.message and "seams" in it.message
    (tmp_path / "through.ron").write_text(THROUGH)
    until(lambda: len(owner.data.polygons) == 3 and settled(owner))
    assert "sharp" not in it.message and sum(its.use_edge_sharp for its in owner.data.edges) == 1
    owner.maquette.inputs["it"].object = None
    source.data.edges.foreach_set("use_seam", [False] * len(mesh.edges))


def test_instances_are_given_with_all_that_they_have(empty: Any, tmp_path: pathlib.Path) -> None:
    scene = bpy.context.collection
    inner, outer = shape(), bpy.data.objects.new("outer", None)
    fill(inner.data.attributes.new("pick", "INT", "FACE"), np.random.default_rng(1))
    kept = bpy.data.collections.new("kept")
    kept.objects.link(inner)
    scene.objects.unlink(inner)
    for name in ("red", "green"):
        inner.data.materials.append(bpy.data.materials.new(name))
    inner.data.polygons[1].material_index = 1
    outer.instance_type, outer.instance_collection = "COLLECTION", kept
    outer.location.x = 5
    scene.objects.link(outer)
    bpy.context.view_layer.update()
    owner = given(tmp_path, outer)
    assert len(owner.data.polygons) == 3 and numbers(owner.data, "pick") == numbers(inner.data, "pick")
    bpy.context.view_layer.update()
    assert abs((owner.matrix_world @ owner.data.vertices[1].co).x - 6.001) < 1e-4

    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    tree = bpy.data.node_groups.new("instances", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    start, end, points, small = (
        tree.nodes.new(it) for it in ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeInstanceOnPoints", "GeometryNodeMeshCube")
    )
    tree.links.new(start.outputs[0], points.inputs["Points"])
    tree.links.new(small.outputs["Mesh"], points.inputs["Instance"])
    tree.links.new(points.outputs[0], end.inputs[0])
    cube.modifiers.new("instances", "NODES").node_group = tree
    owner.maquette.inputs["it"].object = cube
    until(lambda: len(owner.data.vertices) == 64 and settled(owner))
    assert len(owner.data.polygons) == 48


def test_materials_of_objects_come_back_themselves(empty: Any, tmp_path: pathlib.Path) -> None:
    source = shape()
    for name in ("red", "green"):
        source.data.materials.append(bpy.data.materials.new(name))
    source.data.materials.append(None)
    source.data.polygons.foreach_set("material_index", [1, 0, 2])
    owner = given(tmp_path, source)
    assert list(owner.data.materials) == list(source.data.materials)
    assert numbers(owner.data, "material_index") == numbers(source.data, "material_index")
    # The user has changed the first slot.
    mine = owner.data.materials[0] = bpy.data.materials.new("mine")
    source.location.x = 3
    bpy.context.view_layer.update()
    until(lambda: settled(owner) and owner.data.vertices[0].co.x > 2900)
    assert list(owner.data.materials) == [mine, bpy.data.materials["green"], None] and len(bpy.data.materials) == 3


TWO = """Graph(format: 1, nodes: { "it": ReadMesh(path: "two.obj") }, outputs: { "mesh.ply": "it" })"""


def test_faces_of_a_file_with_several_materials_show_their_own(empty: Any, tmp_path: pathlib.Path) -> None:
    (tmp_path / "two.obj").write_text(
        "mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "usemtl paper\nf 1/1 2/2 3/3\nusemtl wood\nf 1/1 3/3 4/4\n"
    )
    (tmp_path / "two.mtl").write_text("newmtl paper\nKd 1 1 1\nmap_Kd paper.png\nnewmtl wood\nKd 0.5 0.25 0.125\nmap_Kd wood.png\n")
    for name, color in (("paper", (1, 0, 0, 1)), ("wood", (0, 1, 0, 1))):
        image = bpy.data.images.new(name, 4, 4)
        image.pixels.foreach_set(np.tile(np.array(color, "f4"), 16))
        image.filepath_raw, image.file_format = str(tmp_path / f"{name}.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)
    (tmp_path / "two.ron").write_text(TWO)
    owner = module("live").add(str(tmp_path / "two.ron"), bpy.context)
    until(lambda: owner.maquette.shown and settled(owner))
    assert [it.name for it in owner.data.materials] == ["paper", "wood"]
    assert numbers(owner.data, "material_index")[2] == [0, 1]

    def green(material: bpy.types.Material) -> float:
        """The green channel of its picture in the middle."""
        return material.node_tree.nodes["Texture"].image.pixels[4 * 5 + 1]

    assert green(owner.data.materials[0]) == 0 and green(owner.data.materials[1]) > 0
    # Changes by the user are kept, and changes in the file are shown.
    wood = owner.data.materials[1]
    wood.roughness = 0.75
    (tmp_path / "two.mtl").write_text((tmp_path / "two.mtl").read_text().replace("Kd 0.5", "Kd 0.75"))
    (tmp_path / "two.obj").write_text((tmp_path / "two.obj").read_text() + "# again\n")
    until(lambda: wood.diffuse_color[0] > 0.6 and settled(owner))
    assert list(owner.data.materials)[1] == wood and wood.roughness == 0.75 and len(bpy.data.materials) == 2
    # A result without materials removes them.
    (tmp_path / "two.mtl").unlink()
    (tmp_path / "two.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    until(lambda: len(owner.data.polygons) == 1 and settled(owner) and not len(owner.data.materials))


def painted(name: str, color: tuple[float, ...], is_data: bool = False) -> bpy.types.Image:
    """A small picture of one color, without a file."""
    image = bpy.data.images.new(name, 4, 2, is_data=is_data)
    image.pixels.foreach_set(np.tile(np.array(color, "f4"), 8))
    return image


def wooden(folder: pathlib.Path) -> bpy.types.Material:
    """A material with pictures at all inputs: painted, in a file, and packed."""
    material = module("apply").material("wood")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(it for it in nodes if it.type == "BSDF_PRINCIPLED")
    packed = painted("packed", (0.8, 0.2, 0.6, 1), is_data=True)
    packed.pack()
    bumps = painted("bumps", (0.5, 0.5, 1, 1), is_data=True)
    bumps.filepath_raw, bumps.file_format = str(folder / "bumps.png"), "PNG"
    bumps.save()
    shown = nodes["Texture"]
    shown.image, shown.extension = painted("bark", (0.2, 0.4, 0.6, 0.5)), "MIRROR"
    links.new(shown.outputs["Alpha"], shader.inputs["Alpha"])
    split, rough = nodes.new("ShaderNodeSeparateColor"), nodes.new("ShaderNodeTexImage")
    rough.image = packed
    links.new(rough.outputs["Color"], split.inputs["Color"])
    links.new(split.outputs["Green"], shader.inputs["Roughness"])
    links.new(split.outputs["Blue"], shader.inputs["Metallic"])
    turned, bump, place = nodes.new("ShaderNodeNormalMap"), nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeUVMap")
    turned.inputs["Strength"].default_value, bump.image, place.uv_map = 0.5, bpy.data.images.load(str(folder / "bumps.png")), "Second"
    for start, end in ((place.outputs["UV"], bump.inputs["Vector"]), (bump.outputs["Color"], turned.inputs["Color"])):
        links.new(start, end)
    links.new(turned.outputs["Normal"], shader.inputs["Normal"])
    noise = nodes.new("ShaderNodeTexNoise")
    links.new(noise.outputs["Color"], shader.inputs["Emission Color"])
    return material


def test_pictures_of_materials_go_through_a_graph(empty: Any, tmp_path: pathlib.Path) -> None:
    source, dice = shape(), np.random.default_rng(11)
    for name in ("First", "Second"):
        fill(source.data.attributes.new(name, "FLOAT2", "CORNER"), dice)
    source.data.uv_layers["First"].active_render = True
    source.data.materials.append(wooden(tmp_path))
    owner = given(tmp_path, source)
    it = module("live").state(owner)
    assert it.message == "it: source is passed without the link of Emission Color of the material wood"
    assert list(owner.data.materials) == [bpy.data.materials["wood"]]
    mesh = bpy.data.meshes.new("other")

    def show() -> bpy.types.Material:
        """Shows the result on a new object and returns its material."""
        answers: list[Any] = []
        client, want = module("engine").client(), [{"value": "mesh", "as": "mesh"}]
        client.ask("run", answers.append, None, graph=str(tmp_path / "through.ron"), inputs=it.inputs, want=want, slot="other")
        until(lambda: answers)
        module("looks").show(mesh, answers[0]["values"]["mesh"], client.folder, [])
        (made,) = mesh.materials
        return made

    made = show()
    assert made.name == "wood.001"
    nodes = made.node_tree.nodes
    shader = next(its for its in nodes if its.type == "BSDF_PRINCIPLED")

    def middle(name: str) -> list[float]:
        image = nodes[name].image
        return [round(its, 2) for its in image.pixels[4:7]]

    assert middle("Texture") == [0.2, 0.4, 0.6] and nodes["Texture"].extension == "MIRROR"
    assert [round(its, 1) for its in middle("roughness")] == [0.8, 0.2, 0.6] and nodes["roughness"].image == nodes["metallic"].image
    assert shader.inputs["Roughness"].links[0].from_socket.name == "Green" and shader.inputs["Metallic"].links[0].from_socket.name == "Blue"
    assert shader.inputs["Normal"].links[0].from_node.inputs["Strength"].default_value == 0.5
    assert middle("normal") == [0.5, 0.5, 1] and nodes["normal uv"].uv_map == "Second"
    opacity = shader.inputs["Alpha"].links[0]
    assert opacity.from_socket.name == "Alpha" and round(opacity.from_node.image.pixels[3], 2) == 0.5
    assert nodes["normal"].image.colorspace_settings.name == "Non-Color" and not shader.inputs["Emission Color"].links
    # A changed picture is updated, and changes of the material by the user are kept.
    shader.inputs["IOR"].default_value = 2
    bpy.data.images["bark"].pixels.foreach_set(np.tile(np.array((1, 0, 0, 1), "f4"), 8))
    before = dict(it.inputs)
    source.data.update_tag()
    bpy.context.view_layer.update()
    until(lambda: settled(owner) and it.inputs != before)
    assert show() == made and middle("Texture") == [1, 0, 0] and shader.inputs["IOR"].default_value == 2
