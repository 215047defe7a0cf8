"""Objects as the dependency graph evaluates them, whatever is hidden.

What is hidden, disabled or in no scene is not evaluated, unless something visible refers to it. So a scene for the moment refers to it, as a
modifier of Geometry Nodes would: then its animation, drivers, constraints and modifiers are evaluated.
"""

from __future__ import annotations

import contextlib
from typing import Any, Iterable, Iterator

import bpy
from mathutils import Matrix

from . import space

# The graph of the frame at hand, while a render, an export or a script waits for it; else that of the window.
_frame: list[bpy.types.Depsgraph] = []

# The names of the objects that the render of this frame evaluates.
_rendered: set[str] = set()

# Evaluating a scene for the moment calls handlers, for which nothing has happened.
is_at_work = False


@contextlib.contextmanager
def frame(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Within this, objects are as they are in a frame that is rendered or exported: scenes themselves may have another one."""
    _frame.append(depsgraph)
    _rendered.clear()
    if depsgraph.mode == "RENDER":
        _rendered.update(it.original.name_full for it in depsgraph.objects)
    try:
        yield
    finally:
        _frame.pop()


def is_frame() -> bool:
    """Returns true while somebody waits for a frame."""
    return bool(_frame)


@contextlib.contextmanager
def graph(owner: bpy.types.Object, names: Iterable[str] = ()) -> Iterator[bpy.types.Depsgraph]:
    """A dependency graph that evaluates an object and its custom properties of these names."""
    depsgraph = _frame[-1] if _frame else bpy.context.evaluated_depsgraph_get()
    if is_seen(owner, depsgraph):
        yield depsgraph
        return
    with _referred(owner, depsgraph.scene, names) as own:
        yield own


@contextlib.contextmanager
def of(owner: bpy.types.Object, names: Iterable[str] = ()) -> Iterator[bpy.types.Object]:
    """The evaluated object, with its custom properties of these names; it must not be used afterwards."""
    with graph(owner, names) as depsgraph:
        yield owner.evaluated_get(depsgraph)


def instances(owner: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[bpy.types.DepsgraphObjectInstance]:
    """The instances that an object shows in a graph of `graph`."""
    for one in depsgraph.object_instances:
        # In the scene for the moment they belong to the object that refers to it.
        if one.is_instance and one.parent and (is_at_work or one.parent.original == owner):
            yield one


def place(owner: bpy.types.Object) -> Matrix:
    """Where an object lies in the world."""
    if not _frame:
        return space.world(owner)
    with of(owner) as its:
        return its.matrix_world.copy()


def is_seen(owner: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Returns true if the graph evaluates the object because it is visible."""
    # What something refers to is in the graph, too, but is not evaluated there.
    if not owner.evaluated_get(depsgraph).is_evaluated:
        return False
    return owner.name_full in _rendered if depsgraph.mode == "RENDER" else bool(owner.visible_get(view_layer=depsgraph.view_layer))


@contextlib.contextmanager
def _referred(owner: bpy.types.Object, scene: bpy.types.Scene, names: Iterable[str]) -> Iterator[bpy.types.Depsgraph]:
    """A dependency graph of a scene that refers to the object."""
    global is_at_work
    is_at_work = True
    made: list[Any] = []
    try:
        own = bpy.data.scenes.new("maquette")
        made.append((bpy.data.scenes, own))
        group = bpy.data.node_groups.new("maquette", "GeometryNodeTree")
        made.append((bpy.data.node_groups, group))
        group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        info, end = group.nodes.new("GeometryNodeObjectInfo"), group.nodes.new("NodeGroupOutput")
        info.inputs["Object"].default_value, info.transform_space = owner, "RELATIVE"
        group.links.new(info.outputs["Geometry"], end.inputs[0])
        mesh = bpy.data.meshes.new("maquette")
        made.append((bpy.data.meshes, mesh))
        reader = bpy.data.objects.new("maquette", mesh)
        made.append((bpy.data.objects, reader))
        reader.modifiers.new("maquette", "NODES").node_group = group
        for name in names:
            # Custom properties are evaluated for a driver that reads them.
            reader[name] = 0.0
            driver = reader.driver_add(f'["{name}"]').driver
            target = driver.variables.new().targets[0]
            target.id, target.data_path = owner, f'["{name}"]' + ("[0]" if hasattr(owner[name], "to_list") else "")
            driver.expression = "var"
        own.collection.objects.link(reader)
        # Without a change of the frame no animation would be evaluated.
        own.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        with bpy.context.temp_override(scene=own, view_layer=own.view_layers[0]):
            depsgraph = bpy.context.evaluated_depsgraph_get()
        yield depsgraph
    finally:
        for where, it in reversed(made):
            where.remove(it)
        is_at_work = False
