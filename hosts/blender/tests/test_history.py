"""Tests of undo and redo in any order while a second editor writes the same file."""

from __future__ import annotations

import pathlib
import random
import time
from typing import Any

import bpy
import pytest
from test_live import folder  # noqa: F401
from test_live import module, until
from test_waiting import BOX, live
from test_tree import change_externally, is_settled, node_named, path, push, redo, tree, undo  # noqa: F401

# The fields that the user changes, with the text before each; and the texts that the other editor changes.
OWN = {"knots-u": ("order", "along: U, order: {}", (2, 3, 4)), "knots-v": ("order", "along: V, order: {}", (2, 3, 4))}
OTHERS = {
    "growth": ("Number(default: {}", ("12.0", "13.0", "14.5")),
    "levels": ("Integer(default: {}", ("1", "0", "2")),
    "red": ("distance: {}", ("30.0", "28.0", "26.0")),
}


def expected(text: str, own: dict[str, int], others: dict[str, str]) -> str:
    """The text of the file with these values."""
    for name, (_, place, values) in OWN.items():
        text = text.replace(place.format(values[1]), place.format(own[name]))
    for name, (place, values) in OTHERS.items():
        text = text.replace(place.format(values[0]), place.format(others[name]))
    return text


@pytest.mark.usefixtures("tree")
@pytest.mark.parametrize("seed", range(3))
def test_b1_undo_and_redo_in_any_order_take_back_ones_own_steps_and_no_others(path: pathlib.Path, seed: int) -> None:  # noqa: F811
    chance, first = random.Random(seed), path.read_text()
    steps: list[dict[str, int]] = [{name: values[1] for name, (_, _, values) in OWN.items()}]
    at, others = 0, {name: values[0] for name, (_, values) in OTHERS.items()}
    push("begin")
    done: dict[str, int] = {}
    while sum(done.values()) < 20 or len(done) < 4:
        does = chance.choice(["own", "theirs", "undo", "redo"])
        if does == "own":
            name = chance.choice(list(OWN))
            field, _, values = OWN[name]
            value = chance.choice([it for it in values if it != steps[at][name]])
            del steps[at + 1 :]
            steps.append({**steps[at], name: value})
            at += 1
            node_named(bpy.data.node_groups["doll"], name)[f"field {field}"] = value
            push(f"set {name}")
            until(lambda: path.read_text() == expected(first, steps[at], others) and is_settled(bpy.data.node_groups["doll"], path))
        elif does == "theirs":
            name = chance.choice(list(OTHERS))
            place, texts = OTHERS[name]
            new = chance.choice([it for it in texts if it != others[name]])
            change_externally(path, place.format(others[name]), place.format(new))
            others[name] = new
        elif does == "undo" and at > 0:
            at -= 1
            undo(path)
        elif does == "redo" and at + 1 < len(steps):
            at += 1
            redo(path)
        else:
            continue
        done[does] = done.get(does, 0) + 1
        until(lambda: is_settled(bpy.data.node_groups["doll"], path))
        assert path.read_text() == expected(first, steps[at], others), (does, done)
        shown = {name: node_named(bpy.data.node_groups["doll"], name)[f"field {field}"] for name, (field, _, _) in OWN.items()}
        assert shown == steps[at], (does, done)


def test_b8_a_look_costs_what_live_objects_cost_not_all_others(empty: Any, tmp_path: pathlib.Path) -> None:
    owner = live(tmp_path, BOX)
    module("waiting").update()

    def look() -> float:
        """The time of one tick in this thread."""
        times = []
        for _ in range(40):
            before = time.thread_time()
            module("live").tick()
            times.append(time.thread_time() - before)
        return sorted(times)[20]

    alone = look()
    for place in range(10_000):
        bpy.context.collection.objects.link(bpy.data.objects.new(f"other {place}", None))
    look()
    among = look()
    print(f"a look: {alone * 1e3:.2f} ms alone, {among * 1e3:.2f} ms among 10 000")
    assert among < alone + 0.001
    # New live objects among them are found: a copy, and one whose graph is set.
    other = owner.copy()
    other.data = owner.data.copy()
    bpy.context.collection.objects.link(other)
    made = bpy.data.objects.new("made", bpy.data.meshes.new("made"))
    bpy.context.collection.objects.link(made)
    module("live").tick()
    made.maquette.graph = owner.maquette.graph
    module("waiting").update()
    assert {owner, other, made} == set(module("live").objects()) and len(made.data.polygons) == 6
    bpy.data.objects.remove(other)
    bpy.data.objects.new("in its place", None)
    module("live").tick()
    assert {owner, made} == set(module("live").objects())
