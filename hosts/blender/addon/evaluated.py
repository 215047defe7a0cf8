"""Evaluated objects, also if they are hidden.

Blender does not evaluate objects that are hidden, disabled or in no scene, unless something visible refers to them. So a temporary scene
refers to such an object by a Geometry Nodes modifier; then its animation, drivers, constraints and modifiers are evaluated.
"""

from __future__ import annotations

import contextlib
from typing import Any, Iterable, Iterator

import bpy
from mathutils import Matrix

from . import space

# The dependency graph of the frame that a render, an export or a script waits for; empty outside, where that of the window is used.
_frame: list[bpy.types.Depsgraph] = []

# The names of the objects that a render of the current frame evaluates.
_rendered: set[str] = set()

# True during the evaluation of a temporary scene, which calls handlers that must do nothing then.
is_at_work = False


@contextlib.contextmanager
def use_frame(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """A context in which objects are evaluated for a rendered or exported frame, which may differ from the scene's current frame."""
    _frame.append(depsgraph)
    _rendered.clear()
    if depsgraph.mode == "RENDER":
        _rendered.update(it.original.name_full for it in depsgraph.objects)
    try:
        yield
    finally:
        _frame.pop()


def is_frame() -> bool:
    """Returns true within `use_frame`."""
    return bool(_frame)


@contextlib.contextmanager
def graph(owner: bpy.types.Object, names: Iterable[str] = ()) -> Iterator[bpy.types.Depsgraph]:
    """A context with a dependency graph that evaluates an object and its custom properties with these names."""
    depsgraph = _frame[-1] if _frame else bpy.context.evaluated_depsgraph_get()
    if is_seen(owner, depsgraph):
        yield depsgraph
        return
    with _referring_scene(owner, depsgraph.scene, names) as own:
        yield own


@contextlib.contextmanager
def evaluate(owner: bpy.types.Object, names: Iterable[str] = ()) -> Iterator[bpy.types.Object]:
    """A context with the evaluated object and its custom properties with these names; it must not be used after the context."""
    with graph(owner, names) as depsgraph:
        yield owner.evaluated_get(depsgraph)


def instances(owner: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[bpy.types.DepsgraphObjectInstance]:
    """The instances of an object in a dependency graph of `graph`."""
    for one in depsgraph.object_instances:
        # In the temporary scene, the parent of the instances is the object that refers to `owner`.
        if one.is_instance and one.parent and (is_at_work or one.parent.original == owner):
            yield one


def world_matrix(owner: bpy.types.Object) -> Matrix:
    """The matrix of an object in the world."""
    if not _frame:
        return space.world_matrix(owner)
    with evaluate(owner) as its:
        return its.matrix_world.copy()


def is_seen(owner: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Returns true if the dependency graph evaluates the object because it is visible."""
    # Objects that are only referred to are in the graph, too, but not evaluated.
    if not owner.evaluated_get(depsgraph).is_evaluated:
        return False
    return owner.name_full in _rendered if depsgraph.mode == "RENDER" else bool(owner.visible_get(view_layer=depsgraph.view_layer))


@contextlib.contextmanager
def _referring_scene(owner: bpy.types.Object, scene: bpy.types.Scene, names: Iterable[str]) -> Iterator[bpy.types.Depsgraph]:
    """A context with the dependency graph of a temporary scene that refers to the object."""
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
            # Custom properties are only evaluated if a driver reads them.
            reader[name] = 0.0
            driver = reader.driver_add(f'["{name}"]').driver
            target = driver.variables.new().targets[0]
            target.id, target.data_path = owner, f'["{name}"]' + ("[0]" if hasattr(owner[name], "to_list") else "")
            driver.expression = "var"
        own.collection.objects.link(reader)
        # Animation is only evaluated by a change of the frame.
        own.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        with bpy.context.temp_override(scene=own, view_layer=own.view_layers[0]):
            depsgraph = bpy.context.evaluated_depsgraph_get()
        yield depsgraph
    finally:
        for where, it in reversed(made):
            where.remove(it)
        is_at_work = False
