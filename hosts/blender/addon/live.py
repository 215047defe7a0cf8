"""Live objects: objects whose mesh is the result of a graph with values for its parameters and objects at its inputs.

Everything persistent is in properties of the object, and so in the Blender file and in undo steps. The current activity is in `states`,
which can be lost at any time. The module `values` handles parameter values and widgets, `inputs` and `evaluated` the objects at inputs.
"""

from __future__ import annotations

import math
import pathlib
import time
from typing import Any

import bpy
from bpy.app.handlers import persistent
from mathutils import Matrix

from . import apply, by_hand, engine, evaluated, exchange, inputs, looks, panel, returned, space, values
from .client import Answer
from .engine import key
from .records import Source
from .values import WIDGET

# Custom property of a mesh with the hash of the value that it shows.
SHOWN_HASH = "maquette_shown"

# Seconds after which a run is cancelled if the values have changed meanwhile.
RUN_TIMEOUT = 0.15

# Seconds between two checks of files.
CHECK_INTERVAL = 0.1

AXES = {"upright": math.pi / 2, "sensor": -math.pi / 2}


class MaquetteInput(bpy.types.PropertyGroup):
    """An object at an input of a graph."""

    object: bpy.props.PointerProperty(name="Object", type=bpy.types.Object)  # type: ignore[valid-type]


def _outputs(its: Any, _context: Any, text: str) -> list[str]:
    """The names of outputs and nodes that can be shown."""
    it = states.get(key(its.id_data))
    found = [*(one["name"] for one in it.loaded["outputs"]), *it.loaded["nodes"]] if it and it.loaded and it.loaded["ok"] else []
    return [name for name in dict.fromkeys(found) if text.lower() in name.lower()]


def _on_graph_change(_its: Any, _context: Any) -> None:
    """Called when an object becomes live or stops being live."""
    invalidate()


class MaquetteObject(bpy.types.PropertyGroup):
    """The properties of a live object."""

    graph: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Graph", description="The file of the graph", subtype="FILE_PATH", options=engine.RELATIVE, update=_on_graph_change
    )
    folder: bpy.props.StringProperty(description="The folder that `//` at the start of the graph's path refers to")  # type: ignore[valid-type]
    beside: bpy.props.StringProperty(description="The graph's path relative to the Blender file when that was last saved")  # type: ignore[valid-type]
    output: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Output", description="The output or node of the graph that is shown", search=_outputs, search_options={"SUGGESTION"}
    )
    values: bpy.props.StringProperty(description="JSON: the values as RON, by parameter")  # type: ignore[valid-type]
    widgets: bpy.props.StringProperty(description="JSON: the last values written to the widgets, by parameter")  # type: ignore[valid-type]
    inputs: bpy.props.CollectionProperty(type=MaquetteInput)  # type: ignore[valid-type]
    shown: bpy.props.StringProperty(description="The hash of the value that the mesh shows")  # type: ignore[valid-type]
    held: bpy.props.StringProperty(description="The reason why the object no longer follows its graph; empty if it does")  # type: ignore[valid-type]
    is_new: bpy.props.BoolProperty(description="True until the origin is moved to the center of the first value")  # type: ignore[valid-type]
    lost: bpy.props.StringProperty(description="What objects at inputs have and the mesh lacks, one line each")  # type: ignore[valid-type]
    axes: bpy.props.StringProperty(description="The axes of the value that the mesh shows: a key of AXES")  # type: ignore[valid-type]


class State:
    """The current activity of a live object."""

    def __init__(self) -> None:
        # The answer of `load`, and its arguments: the graph, and the folders that it may read.
        self.loaded: Answer | None = None
        self.read: Any = None
        self.controls: list[panel.Control] = []
        # The values for which the widgets were made.
        self.arranged: str | None = None
        # The values of animation and drivers in the current frame that the object itself does not have, because it is hidden or the frame
        # is that of a render. None until they are read.
        self.frame: dict[str, str] | None = None
        self.stamps: dict[str, float | None] = {}
        self.loading = False
        # The reason why the graph could not be read.
        self.unread = ""
        # The current run: the id of its request, its start time, and its target.
        self.run: int | None = None
        self.since = 0.0
        self.asked: Any = None
        self.cancelled = False
        # The target of the last finished run.
        self.answered: Any = None
        self.problems: list[dict[str, Any]] = []
        self.message = ""
        self.progress: tuple[str, float] | None = None
        # The values of objects at inputs, by name; the keys of these objects; the inputs whose request is pending; those to be sent again.
        self.inputs: dict[str, str] = {}
        self.sent: dict[str, int] = {}
        self.sending: set[str] = set()
        self.stale: set[str] = set()
        # The data of the objects that was passed, and that is restored later.
        self.sources: dict[str, Source] = {}
        # The reasons why objects cannot be passed, by input.
        self.unfit: dict[str, str] = {}
        self.runs = 0
        # True if the user has agreed to lose manual edits.
        self.may_lose = False
        # The key of the mesh with a mark that it loses if it is converted.
        self.marked: int | None = None
        # True if an undo or redo has replaced the object since the last tick.
        self.undone = False


states: dict[int, State] = {}
_looked = 0.0

# The live objects, including linked ones; None if they must be searched. The time when all objects were last counted, and their number.
_live: list[bpy.types.Object] | None = None
_counted, _count = 0.0, 0

# Keys of live objects that are in no scene, and the index of the object that was checked last.
_unused: set[int] = set()
_turn = 0

# Seconds between two counts of all objects. Blender notifies about most new objects, and counting thousands takes milliseconds.
COUNT_INTERVAL = 1.0


def state(owner: bpy.types.Object) -> State:
    """Returns the state of an object."""
    return states.setdefault(key(owner), State())


def objects() -> list[bpy.types.Object]:
    """All live objects, except those of other files, which show what was computed there, and those that are in no scene."""
    return [it for it in _own_objects() if key(it) not in _unused]


def _own_objects() -> list[bpy.types.Object]:
    return [it for it in all_objects() if not it.library and not it.override_library]


def _look_at_scenes() -> None:
    """Checks if the next live object in turn is in a scene; only one at a time, since Blender searches all objects of a scene for it."""
    global _turn
    owners = _own_objects()
    if owners:
        _turn = (_turn + 1) % len(owners)
        (_unused.discard if _is_used(owners[_turn], owners) else _unused.add)(key(owners[_turn]))


def find_linked_again() -> None:
    """Checks the live objects that were in no scene again; usually there are none."""
    owners = _own_objects() if _unused else []
    _unused.difference_update([key(it) for it in owners if key(it) in _unused and _is_used(it, owners)])


def _is_used(owner: bpy.types.Object, others: list[bpy.types.Object]) -> bool:
    """Returns True if an object is in a scene, at an input of another one, or in a collection that has instances."""
    if any(scene.objects.get(owner.name) == owner for scene in bpy.data.scenes):
        return True
    if any(its.object == owner for other in others if other != owner for its in other.maquette.inputs):
        return True
    instances = (it.instance_collection for it in bpy.data.objects if it.instance_type == "COLLECTION")
    return any(it and it.all_objects.get(owner.name) == owner for it in instances)


def all_objects() -> list[bpy.types.Object]:
    """All live objects, including those of other files. They are cached, since a scene may have thousands of other objects."""
    global _live, _counted, _count
    now = time.monotonic()
    if _live is not None and now - _counted > COUNT_INTERVAL:
        _counted = now
        if _count != len(bpy.data.objects):
            _live = None
    if _live is not None:
        try:
            return [it for it in _live if it.maquette.graph]
        except ReferenceError:
            # An object was deleted.
            pass
    _live, _counted, _count = [it for it in bpy.data.objects if it.maquette.graph], now, len(bpy.data.objects)
    return list(_live)


def invalidate() -> None:
    """Invalidates the cache of live objects."""
    global _live
    _live = None


def graph_path(owner: bpy.types.Object) -> str:
    """The path of the graph's file."""
    return bpy.path.abspath(owner.maquette.graph, library=owner.library)


def add(path: str, context: bpy.types.Context) -> bpy.types.Object:
    """Creates a live object of a graph, and selects it."""
    name = pathlib.Path(path).stem
    owner = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    owner.maquette.graph = path
    owner.scale = (space.scale(context.scene),) * 3
    context.collection.objects.link(owner)
    for other in context.selected_objects:
        other.select_set(False)
    owner.select_set(True)
    context.view_layer.objects.active = owner
    return owner


def place(owner: bpy.types.Object, context: bpy.types.Context) -> None:
    """Moves a new object to the 3D cursor. Its origin moves to the center of its first value."""
    owner.location = context.scene.cursor.location
    owner.maquette.is_new = True


def reload(owner: bpy.types.Object) -> None:
    """Reads the graph again."""
    states.pop(key(owner), None)


def start_over(owner: bpy.types.Object) -> None:
    """Reads the graph again and shows its result, even if manual edits of the mesh are lost."""
    reload(owner)
    owner.maquette.held, state(owner).may_lose = "", True
    if owner.data:
        owner.data.pop(SHOWN_HASH, None)
        # Without checksums, manual edits of topology and positions are not detected.
        owner.data.pop(by_hand.SUMS, None)


def on_restart() -> None:
    """Resets all states for a new engine. Values that users have set meanwhile are kept."""
    for it in states.values():
        it.loaded, it.loading, it.run, it.answered, it.inputs, it.message = None, False, None, None, {}, ""
        it.sending.clear()


def cancel(owner: bpy.types.Object) -> None:
    """Cancels the run of an object."""
    _cancel(state(owner))


def _cancel(it: State) -> None:
    if it.run is not None and not it.cancelled:
        it.cancelled = True
        engine.client().ask("cancel", None, None, run=it.run)


def tick() -> None:
    """Advances all live objects by one step."""
    global _looked
    looks = time.monotonic() - _looked > CHECK_INTERVAL
    if looks:
        _looked = time.monotonic()
        _look_at_scenes()
    owners = objects()
    for uid in states.keys() - {key(it) for it in owners}:
        # The object was deleted; its run would delay those of others.
        _cancel(states[uid])
    for owner in owners:
        it = state(owner)
        values.take_touched(owner, it.controls)
        _check_mark(owner, it)
        if engine.end_reason():
            it.message, it.run, it.loading = engine.end_reason() or "", None, False
            continue
        have_changed = looks and any(stamp(path) != known for path, known in it.stamps.items())
        if have_changed or it.read != _source(owner):
            it.loaded = None
        if it.loaded is None:
            _load(owner, it)
            continue
        if it.undone or it.arranged != owner.maquette.values:
            # The undo step may be older than the first reading of the graph; then the object lacks its widgets, inputs and output.
            it.undone = False
            if it.loaded["ok"]:
                _arrange(owner, it)
        if it.frame is None:
            it.frame = {}
            if owner.animation_data and it.loaded["ok"]:
                widgets = [WIDGET + control.name for control in it.controls if isinstance(values.to_json(owner.get(WIDGET + control.name)), (float, int, list))]
                with evaluated.evaluate(owner, widgets) as its:
                    it.frame = values.animated_values(owner, its, it.controls)
        _run(owner, it)


def target(owner: bpy.types.Object) -> tuple[Any, ...]:
    """Everything that determines what an object shows."""
    its, it = owner.maquette, state(owner)
    return (graph_path(owner), its.values, its.output, tuple(sorted(it.inputs.items())), tuple(sorted((it.frame or {}).items())))


def is_answered(owner: bpy.types.Object) -> bool:
    """Returns true if the last answer is for the current target."""
    return state(owner).answered == (*target(owner), key(owner.data) if owner.data else None)


def look_now() -> None:
    """Makes the next tick check files."""
    global _looked
    _looked = 0.0


def hindrance(owner: bpy.types.Object) -> str:
    """The reason why results cannot be shown; empty if they can."""
    if owner.type != "MESH":
        return f"{owner.name} is not a mesh"
    if owner.maquette.held:
        return f"the mesh no longer follows its graph: {owner.maquette.held}"
    if owner.mode != "OBJECT" or owner.data.is_editmode:
        return "paused until you return to Object Mode"
    if len(owner.data.vertices) and apply.FACES not in owner.data.keys():
        return f"{owner.data.name} was not made by a graph and is not replaced"
    return ""


def _check_mark(owner: bpy.types.Object, it: State) -> None:
    """Detects whether the mesh was converted, or a modifier applied."""
    mesh = owner.data if owner.type == "MESH" and owner.mode == "OBJECT" else None
    if mesh is None or not mesh.get(by_hand.SUMS) or mesh.library or mesh.is_editmode or owner.maquette.held:
        it.marked = None
    elif by_hand.is_marked(mesh):
        it.marked = key(mesh)
    elif it.marked == key(mesh):
        owner.maquette.held, it.marked = by_hand.CONVERTED, None
        it.message = hindrance(owner)
    else:
        # Some versions of Blender do not save the mark in files.
        by_hand.mark(mesh)
        it.marked = key(mesh)


def _source(owner: bpy.types.Object) -> Any:
    """The arguments of `load` for an object."""
    return (graph_path(owner), engine.roots())


def stamp(path: str) -> float | None:
    """The modification time of a file; None if it does not exist."""
    try:
        return pathlib.Path(path).stat().st_mtime_ns
    except OSError:
        return None


def _load(owner: bpy.types.Object, it: State) -> None:
    if it.loading:
        return
    it.loading = True
    uid, it.read = key(owner), _source(owner)
    path, roots = it.read
    before = stamp(path)

    def done(answer: Answer) -> None:
        it.loading = False
        if states.get(uid) is not it:
            return
        owner = find(uid)
        if owner is None or not answer.ok:
            it.message = it.unread = answer.why
            return
        it.unread = ""
        it.loaded, it.message, it.problems, it.answered = answer, "", answer.problems, None
        it.stamps = {name: stamp(name) for name in [*answer.get("files", ()), *answer.get("graphs", ())]}
        it.stamps[path] = before
        if answer["ok"]:
            it.controls = panel.controls(answer["schema"])
            it.stale = {its["name"] for its in answer["inputs"]}
            _arrange(owner, it)

    engine.client().ask("load", done, None, graph=path, roots=roots)


def find(uid: int) -> bpy.types.Object | None:
    """Finds an object by its key; references to objects become invalid after an undo."""
    return next((owner for owner in all_objects() if key(owner) == uid), None)


def _arrange(owner: bpy.types.Object, it: State) -> None:
    """Creates the widgets of controls and the properties of inputs, and chooses an output."""
    # Values that were set before the widgets existed are kept.
    values.take_touched(owner, it.controls)
    values.make_widgets(owner, it.controls)
    it.arranged = owner.maquette.values
    wanted = [its["name"] for its in it.loaded["inputs"]] if it.loaded else []
    for name in wanted:
        if name not in owner.maquette.inputs:
            owner.maquette.inputs.add().name = name
    outputs = [its["name"] for its in it.loaded["outputs"]] if it.loaded else []
    is_known = owner.maquette.output in outputs or (it.loaded and owner.maquette.output.partition(".")[0] in it.loaded["nodes"])
    if outputs and not is_known:
        drawn = [its["name"] for its in it.loaded["outputs"] if its["type"] in ("Mesh", "Surface", "ControlNet", "Points")]
        owner.maquette.output = (drawn or outputs)[0]


def _run(owner: bpy.types.Object, it: State) -> None:
    if not it.loaded or not it.loaded["ok"]:
        return
    given = {its.name: its.object for its in owner.maquette.inputs if its.object}
    it.inputs = {name: value for name, value in it.inputs.items() if name in given}
    it.sent = {name: which for name, which in it.sent.items() if name in given}
    for its in it.loaded["inputs"]:
        name = its["name"]
        if name in given and (name in it.stale or it.sent.get(name) != key(given[name])):
            inputs.send(owner, it, name, its["type"], given[name])
    if it.loaded is None:
        # The engine was replaced.
        return
    lacking = [its["name"] for its in it.loaded["inputs"] if its["name"] not in it.inputs]
    if lacking:
        it.answered = None
        it.message = it.unfit.get(lacking[0], "") if lacking[0] in given else f"choose an object for the input {lacking[0]}"
        return
    now = (*target(owner), key(owner.data) if owner.data else None)
    if it.run is not None:
        late = time.monotonic() - it.since > RUN_TIMEOUT
        if now != it.asked and late:
            cancel(owner)
        return
    if now == it.answered:
        return
    if hindrance(owner):
        return
    uid = key(owner)
    it.asked, it.since, it.cancelled, it.message = now, time.monotonic(), False, ""
    it.runs += 1
    it.run = engine.client().ask(
        "run",
        lambda answer: _on_answer(uid, it, answer),
        lambda event: _on_event(it, event),
        graph=now[0],
        roots=engine.roots(),
        set=_settings(owner, it),
        inputs=it.inputs,
        want=[{"value": owner.maquette.output, "as": "mesh"}],
        slot=str(uid),
    )


def _settings(owner: bpy.types.Object, it: State) -> dict[str, str]:
    """The parameter values in the current frame."""
    return {name: text for name, text in values.stored(owner).items() if values.is_known(name, it.loaded)} | (it.frame or {})


def _on_event(it: State, event: dict[str, Any]) -> None:
    if event["event"] in ("started", "progress"):
        it.progress = (str(event.get("node", "")), float(event.get("share", 0)))


def _on_answer(uid: int, it: State, answer: Answer) -> None:
    it.run, it.progress = None, None
    if states.get(uid) is not it or answer.get("replaced"):
        return
    owner = find(uid)
    if owner is None:
        return
    if answer.get("cancelled") and owner not in objects():
        # It is computed again if it is linked into a scene.
        it.answered = None
        return
    if answer.get("cancelled"):
        # Cancelled for newer values, which the next tick requests, or by the user.
        it.answered, it.message = it.asked, "out of date: the run was cancelled, so the mesh does not show the current values; press Reload to compute them"
        return
    it.answered = it.asked
    it.problems = answer.problems
    if not answer.ok:
        it.message = answer.why
        return
    entry = answer["values"].get(owner.maquette.output)
    if not entry:
        return
    _show(owner, it, entry)


def _show(owner: bpy.types.Object, it: State, entry: dict[str, Any]) -> None:
    """Shows a value, or sets a message with the reason why it cannot."""
    if hindrance(owner):
        it.answered = None
        return
    if entry.get("why") and exchange.is_unwritten(entry["why"], engine.client().folder):
        _report_no_room(it, entry["why"])
        return
    is_shared = any(other != owner and other.data == owner.data and target(other) != target(owner) for other in objects())
    if is_shared or owner.data.library or owner.data.override_library:
        # Other users of the mesh, linked duplicates and other files, keep the old one.
        owner.data = owner.data.copy()
        it.answered = (*it.answered[:-1], key(owner.data))
    if "columns" not in entry:
        if not by_hand.collect(owner).is_empty:
            owner.maquette.held = f"{owner.maquette.output} cannot be shown as a mesh, and an empty mesh would lose manual edits"
            it.message = hindrance(owner)
            return
        it.message = f"{owner.maquette.output} has the type {entry['type']}: {entry.get('why', '')}"
        owner.data.clear_geometry()
        owner.data[SHOWN_HASH] = ""
        by_hand.remember(owner.data)
        return
    try:
        show(owner, entry)
        it.message = hindrance(owner) if owner.maquette.held else owner.maquette.lost
    except OSError:
        # Its files were replaced by newer ones: request the value again.
        it.answered = None


def _report_no_room(it: State, why: str) -> None:
    """Moves the engine's data from memory to disk; if it is there already, reports that there is no room. The last mesh is kept."""
    if engine.go_to_disk():
        return
    it.message = f"no room for the result, so the mesh is unchanged: {why}; free space, then press Reload"


def show(owner: bpy.types.Object, entry: dict[str, Any]) -> None:
    """Writes a value into the object's mesh, unless it is there already."""
    folder = engine.client().folder
    if folder is None:
        return
    mesh = owner.data
    turn = Matrix.Rotation(AXES[entry["axes"]] - AXES.get(owner.maquette.axes, 0.0), 4, "X")
    if mesh.get(SHOWN_HASH) != entry["hash"]:
        it = state(owner)
        sources = [it.sources[its.name] for its in owner.maquette.inputs if its.name in it.sources and its.object]
        entry = {**entry, "sources": sources}
        columns = apply.Columns(entry, folder)
        space.change_axes(mesh, entry["axes"], turn)
        if owner.maquette.is_new and columns.count("position"):
            space.center(owner, columns.numbers_of("position"), entry["axes"], bool(sources))
            owner.maquette.is_new = False
        work, why = by_hand.prepare(owner, columns, folder, it.may_lose)
        if why:
            owner.maquette.held = why
            return
        will_differ = apply.will_differ(mesh, columns)
        before = by_hand.positions(mesh) if mesh.shape_keys and not will_differ else None
        if mesh.shape_keys and will_differ:
            owner.shape_key_clear()
        apply.apply(mesh, entry, folder)
        if before is not None:
            by_hand.move_keys(mesh, before)
        if work:
            by_hand.restore(owner, work)
        returned.set_groups(owner, columns, sources)
        looks.show(mesh, entry, folder, [name for source in sources for name in source.materials])
        by_hand.remember(mesh)
        it.may_lose = False
        mesh[SHOWN_HASH] = entry["hash"]
        owner.maquette.lost = inputs.describe_losses(owner, it, entry)
    if entry["axes"] != owner.maquette.axes:
        # Not `matrix_world`, which is not evaluated yet if a script has just moved the object.
        owner.matrix_basis = owner.matrix_basis @ turn
        if not evaluated.is_frame():
            bpy.context.view_layer.update()
        owner.maquette.axes = entry["axes"]
        _mark_inputs_stale(owner)
    owner.maquette.shown = entry["hash"]
    for other in objects():
        # Blender does not notify about changes of hidden objects.
        state(other).stale |= {its.name for its in other.maquette.inputs if its.object == owner and other != owner}


def _mark_inputs_stale(owner: bpy.types.Object) -> None:
    """Marks all inputs to be sent again, since the object has moved relative to the objects at its inputs."""
    state(owner).stale |= {its.name for its in owner.maquette.inputs}


@persistent
def _on_update(_scene: Any, depsgraph: bpy.types.Depsgraph) -> None:
    """Marks inputs as stale whose objects have changed, or whose live object has moved."""
    if evaluated.is_at_work:
        return
    found = depsgraph.updates if all_objects() or depsgraph.id_type_updated("OBJECT") else ()
    moved: set[str] = set()
    changed: set[str] = set()
    for update in found:
        if update.is_updated_transform or update.is_updated_geometry:
            original = update.id.original
            changed.add(original.name_full)
            if update.is_updated_transform:
                moved.add(original.name_full)
            if isinstance(original, bpy.types.Object) and original.maquette.graph and original not in all_objects():
                invalidate()
    if not changed:
        return
    for owner in objects():
        if owner.name_full in moved:
            _mark_inputs_stale(owner)
        for its in owner.maquette.inputs:
            if its.object and its.object.name_full in changed:
                state(owner).stale.add(its.name)


def on_frame(depsgraph: bpy.types.Depsgraph) -> None:
    """Handles a change of the frame: values and hidden objects at inputs are read again."""
    _on_update(None, depsgraph)
    for owner in objects():
        it = state(owner)
        it.frame = None
        if evaluated.is_frame():
            # A render has its own copies of objects, whose positions may differ from those of the scene.
            _mark_inputs_stale(owner)
        it.stale |= {its.name for its in owner.maquette.inputs if its.object and not evaluated.is_seen(its.object, depsgraph)}


@persistent
def _on_undo(*_given: Any) -> None:
    """After an undo, meshes may be older ones: request all results again."""
    invalidate()
    for it in states.values():
        it.answered, it.undone, it.marked = None, True, None


@persistent
def _on_load(*_given: Any) -> None:
    invalidate()
    for it in states.values():
        _cancel(it)
    states.clear()


CLASSES = (MaquetteInput, MaquetteObject)
HANDLERS = {"depsgraph_update_post": _on_update, "undo_post": _on_undo, "redo_post": _on_undo, "load_post": _on_load}


def register() -> None:
    """Registers live objects."""
    for it in CLASSES:
        bpy.utils.register_class(it)
    bpy.types.Object.maquette = bpy.props.PointerProperty(type=MaquetteObject)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    engine.ticks.append(tick)
    engine.restart_listeners.append(on_restart)


def unregister() -> None:
    """Unregisters live objects; their meshes stay."""
    engine.ticks.remove(tick)
    engine.restart_listeners.remove(on_restart)
    invalidate()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    states.clear()
    del bpy.types.Object.maquette
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
