"""Tests that values of live objects are neither lost nor stuck."""

from __future__ import annotations

import pathlib
from typing import Any

import bpy
import pytest
from test_live import module, until
from test_waiting import BOX, live, size


@pytest.fixture
def box(empty: Any, tmp_path: pathlib.Path) -> bpy.types.Object:
    """A live box, computed."""
    owner = live(tmp_path, BOX)
    module("waiting").update()
    return owner


def test_b6_a_value_that_is_set_before_the_graph_was_read_is_kept(box: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    new = live(tmp_path, BOX)
    new["maquette size"], new.location = 20.0, (1, 2, 3)
    module("waiting").update()
    assert size(new) == 20.0 and new.maquette.values == '{"size": "20.0"}' and tuple(new.location) == (1, 2, 3)
    assert [round(it, 6) for it in new.scale] == [0.001] * 3
    # On a copy, and on a linked duplicate.
    for data in (new.data.copy(), new.data):
        other = new.copy()
        other.data = data
        bpy.context.collection.objects.link(other)
        other["maquette size"] = 33.0
        module("waiting").update()
        assert (size(other), size(new)) == (33.0, 20.0)
    # In a file that was just opened.
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    own = bpy.data.objects["box"]
    own["maquette size"] = 44.0
    module("waiting").update()
    assert size(own) == 44.0
    # Values that were not set follow the graph.
    bpy.ops.wm.save_mainfile()
    (tmp_path / "box.ron").write_text(BOX.replace("default: 10.0", "default: 15.0"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    fresh = live(tmp_path, BOX.replace("default: 10.0", "default: 15.0"))
    module("waiting").update()
    assert size(fresh) == 15.0 and size(bpy.data.objects["box"]) == 44.0


def test_b6_an_untouched_value_of_an_opened_file_follows_the_graph(box: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    (tmp_path / "box.ron").write_text(BOX.replace("default: 10.0", "default: 15.0"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    module("waiting").update()
    box = bpy.data.objects["box"]
    assert (size(box), box["maquette size"], box.maquette.values) == (15.0, 15.0, "")


def test_b6_the_value_of_a_parameter_that_is_gone_stops_nothing_and_can_be_dropped(box: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    values = module("values")
    box["maquette size"] = 20.0
    module("waiting").update()
    renamed = BOX.replace('"size": Number', '"length": Number').replace('Param("size")', 'Param("length")')
    (tmp_path / "box.ron").write_text(renamed)
    module("waiting").update()
    assert size(box) == 10.0 and "maquette size" not in box.keys()
    assert values.stored(box) == {"size": "20.0"} and not values.is_known("size", module("live").state(box).loaded)
    box["maquette length"] = 30.0
    module("waiting").update()
    assert size(box) == 30.0
    # Written values are those of the file.
    assert bpy.ops.maquette.write() == {"FINISHED"}
    until(lambda: "default: 30.0" in (tmp_path / "box.ron").read_text() and values.stored(box) == {"size": "20.0"})
    # If the parameter exists again, the stored value applies again.
    (tmp_path / "box.ron").write_text(BOX)
    module("waiting").update()
    assert size(box) == 20.0
    (tmp_path / "box.ron").write_text(renamed)
    module("waiting").update()
    assert bpy.ops.maquette.reset(name="size") == {"FINISHED"}
    module("waiting").update()
    assert box.maquette.values == "" and size(box) == 10.0
    # Another graph whose parameter of this name accepts other values.
    box["maquette length"] = 40.0
    module("waiting").update()
    words = renamed.replace('Number(default: 10.0, min: 1.0, max: 100.0,', "Choice(default: one, of: [one, two],")
    (tmp_path / "box.ron").write_text(words.replace('(Param("length"), Param("length"), Param("length"))', "(1.0, 1.0, 1.0)"))
    with pytest.raises(RuntimeError, match="length"):
        module("waiting").update()
    assert bpy.ops.maquette.reset(name="length") == {"FINISHED"}
    (tmp_path / "box.ron").write_text(renamed)
    module("waiting").update()
    assert size(box) == 10.0


def test_b10_a_value_that_is_the_graphs_own_again_follows_the_graph(box: bpy.types.Object, tmp_path: pathlib.Path) -> None:
    # Backspace resets a widget to the default of its property.
    assert box.id_properties_ui("maquette size").as_dict()["default"] == 10.0
    box["maquette size"] = 20.0
    module("waiting").update()
    box["maquette size"] = 10.0
    module("waiting").update()
    assert box.maquette.values == "" and size(box) == 10.0
    (tmp_path / "box.ron").write_text(BOX.replace("default: 10.0", "default: 15.0"))
    module("waiting").update()
    assert size(box) == 15.0 and box.id_properties_ui("maquette size").as_dict()["default"] == 15.0


WIDGETS = """Graph(
    format: 1,
    params: {
        "sides": Vector(default: (1, 2, 3), min: 0.5, max: 50.0, unit: "mm", doc: "How long its sides are."),
        "which": Choice(default: small, of: [small, large], doc: "Which one."),
        "hue": Color(default: "#c33923", doc: "A color."),
        "count": Integer(default: 3, min: 0, max: 9, doc: "A number."),
        "flag": Toggle(default: true, doc: "A flag."),
        "name": Text(default: "none", doc: "A text."),
    },
    nodes: {
        "small": Primitive(shape: Box(size: Param("sides"))),
        "large": Primitive(shape: Sphere(radius: 20.0, sides: 8)),
        "chosen": Switch(cases: { "small": "small", "large": "large" }, choose: Param("which")),
    },
    outputs: { "box.ply": "chosen" },
)
"""


def test_b10_vectors_have_fields_and_choices_can_be_keyed(empty: Any, tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, WIDGETS)
    try:
        module("waiting").update()
    except RuntimeError as error:
        pytest.fail(str(error))
    shown = {it.name: owner.id_properties_ui(f"maquette {it.name}").as_dict() for it in module("live").state(owner).controls}
    assert owner["maquette sides"].to_list() == [1.0, 2.0, 3.0] and shown["sides"]["subtype"] == "XYZ"
    assert (shown["sides"]["min"], shown["sides"]["max"]) == (0.5, 50.0)
    defaults = {name: its["default"] for name, its in shown.items()}
    assert defaults.pop("hue")[0] == pytest.approx(0xC3 / 255)
    assert defaults == {"sides": [1.0, 2.0, 3.0], "which": 0, "count": 3, "flag": True, "name": "none"}
    assert size(owner) == 1.0
    owner["maquette sides"][0] = 7.5
    module("waiting").update()
    assert size(owner) == 7.5 and module("values").stored(owner) == {"sides": "(7.5, 2.0, 3.0)"}
    # A choice is a menu, which can be animated.
    assert owner.path_resolve('["maquette which"]') == "small"
    for frame, place in ((1, 0), (2, 1)):
        owner["maquette which"] = place
        assert owner.keyframe_insert('["maquette which"]', frame=frame)
    for frame, wide in ((1, 7.5), (2, 40.0)):
        bpy.context.scene.frame_set(frame)
        assert size(owner) == pytest.approx(wide, rel=0.1)
    owner.animation_data_clear()
    # Scripts may write the word.
    owner["maquette which"] = "small"
    module("waiting").update()
    assert owner["maquette which"] == 0 and size(owner) == 7.5
    owner["maquette which"] = "no such word"
    module("waiting").update()
    assert size(owner) == 7.5
