"""Live objects: a graph, values for its parameters and objects at its inputs, and the mesh that comes of them.

What an object has of its graph is in its properties, and so in the file and in its undo steps; what goes on meanwhile is in `states`, and
can be lost at any time. `values` has its values and widgets, `evaluated` the objects at its inputs.
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

# What a mesh remembers of the value that it was made of: its hash.
SHOWN = "maquette_shown"

# Seconds after which a run makes way for later values.
PATIENCE = 0.15

# Seconds between two looks at files.
LOOK = 0.1

AXES = {"upright": math.pi / 2, "sensor": -math.pi / 2}


class MaquetteInput(bpy.types.PropertyGroup):
    """An object at an input of a graph."""

    object: bpy.props.PointerProperty(name="Object", type=bpy.types.Object)  # type: ignore[valid-type]


def _outputs(its: Any, _context: Any, text: str) -> list[str]:
    """What of the graph can be shown."""
    it = states.get(key(its.id_data))
    found = [*(one["name"] for one in it.loaded["outputs"]), *it.loaded["nodes"]] if it and it.loaded and it.loaded["ok"] else []
    return [name for name in dict.fromkeys(found) if text.lower() in name.lower()]


def _changed(_its: Any, _context: Any) -> None:
    """An object became live, or is no longer."""
    forget()


class MaquetteObject(bpy.types.PropertyGroup):
    """What an object has of its graph."""

    graph: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Graph", description="The file of the graph", subtype="FILE_PATH", options=engine.RELATIVE, update=_changed
    )
    folder: bpy.props.StringProperty(description="The folder that `//` at the beginning of the graph's path stands for")  # type: ignore[valid-type]
    beside: bpy.props.StringProperty(description="The graph's path from the folder of the file, when that was saved")  # type: ignore[valid-type]
    output: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Output", description="What of the graph is shown: an output or a node", search=_outputs, search_options={"SUGGESTION"}
    )
    values: bpy.props.StringProperty(description="JSON: values as RON by their parameters' names")  # type: ignore[valid-type]
    widgets: bpy.props.StringProperty(description="JSON: what the widgets were last given, by their parameters' names")  # type: ignore[valid-type]
    inputs: bpy.props.CollectionProperty(type=MaquetteInput)  # type: ignore[valid-type]
    shown: bpy.props.StringProperty(description="The hash of the value that the mesh shows")  # type: ignore[valid-type]
    held: bpy.props.StringProperty(description="Why the object follows its graph no more; empty if it does")  # type: ignore[valid-type]
    is_new: bpy.props.BoolProperty(description="Whether its origin goes into the middle of the first value")  # type: ignore[valid-type]
    lost: bpy.props.StringProperty(description="What objects at inputs have and the mesh has not, in lines")  # type: ignore[valid-type]
    axes: bpy.props.StringProperty(description="How the value that the mesh shows lies: a key of AXES")  # type: ignore[valid-type]


class State:
    """What goes on with an object."""

    def __init__(self) -> None:
        # What `load` said, and of what: a graph, and the folders that it may read.
        self.loaded: Answer | None = None
        self.read: Any = None
        self.controls: list[panel.Control] = []
        # The values that the widgets show.
        self.arranged: str | None = None
        # The values that an animation or a driver gives in the current frame, where the object itself does not have them: it is hidden, or the
        # frame is that of a render. None before they were read.
        self.frame: dict[str, str] | None = None
        self.stamps: dict[str, float | None] = {}
        self.loading = False
        # Why the graph could not be read.
        self.unread = ""
        # The run that is under way: its request, since when, and what it is of.
        self.run: int | None = None
        self.since = 0.0
        self.asked: Any = None
        self.cancelled = False
        # What is shown, or was found to have problems.
        self.answered: Any = None
        self.problems: list[dict[str, Any]] = []
        self.message = ""
        self.progress: tuple[str, float] | None = None
        # Values of objects at inputs, by name, which objects these are, those that are on their way, and those that are to be sent anew.
        self.inputs: dict[str, str] = {}
        self.sent: dict[str, int] = {}
        self.sending: set[str] = set()
        self.stale: set[str] = set()
        # What they were given of their objects.
        self.sources: dict[str, Source] = {}
        # Why objects cannot be given, by the inputs' names.
        self.unfit: dict[str, str] = {}
        self.runs = 0
        # The user has said that work by hand may be lost.
        self.may_lose = False
        # The mesh that has a mark which it loses if it is converted.
        self.marked: int | None = None
        # An undo or a redo has replaced the object since the last look.
        self.undone = False


states: dict[int, State] = {}
_looked = 0.0

# The live objects, linked ones too; None if they are to be searched for. And when all objects were last counted, and their number.
_live: list[bpy.types.Object] | None = None
_counted, _count = 0.0, 0

# Keys of live objects that are in no scene, and the index of the object that was checked last.
_unused: set[int] = set()
_turn = 0

# Seconds between two counts: Blender tells of most new objects, and to count thousands takes milliseconds.
COUNT = 1.0


def state(owner: bpy.types.Object) -> State:
    """What goes on with an object."""
    return states.setdefault(key(owner), State())


def objects() -> list[bpy.types.Object]:
    """All live objects but those of other files, which show what was computed there, and those that are in no scene."""
    return [it for it in _own() if key(it) not in _unused]


def _own() -> list[bpy.types.Object]:
    return [it for it in everything() if not it.library and not it.override_library]


def _look_at_scenes() -> None:
    """Checks the next live object in turn for being in a scene: Blender searches all objects of a scene for it."""
    global _turn
    owners = _own()
    if owners:
        _turn = (_turn + 1) % len(owners)
        (_unused.discard if _is_used(owners[_turn], owners) else _unused.add)(key(owners[_turn]))


def find_linked_again() -> None:
    """Checks the live objects that were in no scene again; usually there are none."""
    owners = _own() if _unused else []
    _unused.difference_update([key(it) for it in owners if key(it) in _unused and _is_used(it, owners)])


def _is_used(owner: bpy.types.Object, others: list[bpy.types.Object]) -> bool:
    """Returns True if an object is in a scene, at an input of another one, or in a collection that has instances."""
    if any(scene.objects.get(owner.name) == owner for scene in bpy.data.scenes):
        return True
    if any(its.object == owner for other in others if other != owner for its in other.maquette.inputs):
        return True
    instances = (it.instance_collection for it in bpy.data.objects if it.instance_type == "COLLECTION")
    return any(it and it.all_objects.get(owner.name) == owner for it in instances)


def everything() -> list[bpy.types.Object]:
    """All live objects, those of other files too. A scene may have thousands of others, at which a look does not look."""
    global _live, _counted, _count
    now = time.monotonic()
    if _live is not None and now - _counted > COUNT:
        _counted = now
        if _count != len(bpy.data.objects):
            _live = None
    if _live is not None:
        try:
            return [it for it in _live if it.maquette.graph]
        except ReferenceError:
            # One was deleted.
            pass
    _live, _counted, _count = [it for it in bpy.data.objects if it.maquette.graph], now, len(bpy.data.objects)
    return list(_live)


def forget() -> None:
    """Live objects are searched for anew."""
    global _live
    _live = None


def graph_path(owner: bpy.types.Object) -> str:
    """The graph's file."""
    return bpy.path.abspath(owner.maquette.graph, library=owner.library)


def add(path: str, context: bpy.types.Context) -> bpy.types.Object:
    """A new live object of a graph."""
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
    """Puts a new object to the cursor, and its origin into its middle once it has one."""
    owner.location = context.scene.cursor.location
    owner.maquette.is_new = True


def reload(owner: bpy.types.Object) -> None:
    """Reads the graph anew."""
    states.pop(key(owner), None)


def start_over(owner: bpy.types.Object) -> None:
    """Reads the graph anew and shows what it gives, whatever was done to the mesh."""
    reload(owner)
    owner.maquette.held, state(owner).may_lose = "", True
    if owner.data:
        owner.data.pop(SHOWN, None)
        # What belongs together, and where it is, is the graph's matter again.
        owner.data.pop(by_hand.SUMS, None)


def restarted() -> None:
    """There is a new engine, which knows nothing; what users have touched meanwhile is not lost."""
    for it in states.values():
        it.loaded, it.loading, it.run, it.answered, it.inputs, it.message = None, False, None, None, {}, ""
        it.sending.clear()


def cancel(owner: bpy.types.Object) -> None:
    """Stops the run."""
    _cancel(state(owner))


def _cancel(it: State) -> None:
    if it.run is not None and not it.cancelled:
        it.cancelled = True
        engine.client().ask("cancel", None, None, run=it.run)


def tick() -> None:
    """Goes on with all live objects."""
    global _looked
    looks = time.monotonic() - _looked > LOOK
    if looks:
        _looked = time.monotonic()
        _look_at_scenes()
    owners = objects()
    for uid in states.keys() - {key(it) for it in owners}:
        # Nobody waits for the run of an object that was deleted, and those of others would wait behind it.
        _cancel(states[uid])
    for owner in owners:
        it = state(owner)
        values.take(owner, it.controls)
        _marked(owner, it)
        if engine.ended():
            it.message, it.run, it.loading = engine.ended() or "", None, False
            continue
        have_changed = looks and any(stamp(path) != known for path, known in it.stamps.items())
        if have_changed or it.read != _source(owner):
            it.loaded = None
        if it.loaded is None:
            _load(owner, it)
            continue
        if it.undone or it.arranged != owner.maquette.values:
            # The step may have been taken before the graph was read: then the object lacks its widgets, inputs and output.
            it.undone = False
            if it.loaded["ok"]:
                _arrange(owner, it)
        if it.frame is None:
            it.frame = {}
            if owner.animation_data and it.loaded["ok"]:
                widgets = [WIDGET + control.name for control in it.controls if isinstance(values.plain(owner.get(WIDGET + control.name)), (float, int, list))]
                with evaluated.of(owner, widgets) as its:
                    it.frame = values.evaluated(owner, its, it.controls)
        _run(owner, it)


def wanted(owner: bpy.types.Object) -> tuple[Any, ...]:
    """All that says what an object shows."""
    its, it = owner.maquette, state(owner)
    return (graph_path(owner), its.values, its.output, tuple(sorted(it.inputs.items())), tuple(sorted((it.frame or {}).items())))


def is_answered(owner: bpy.types.Object) -> bool:
    """Returns true if what was last answered is what the object is to show now."""
    return state(owner).answered == (*wanted(owner), key(owner.data) if owner.data else None)


def look_now() -> None:
    """The next tick looks at files."""
    global _looked
    _looked = 0.0


def hindrance(owner: bpy.types.Object) -> str:
    """Why nothing can be shown; empty if it can."""
    if owner.type != "MESH":
        return f"{owner.name} is no mesh"
    if owner.maquette.held:
        return f"it is a mesh of your own now and follows its graph no more: {owner.maquette.held}"
    if owner.mode != "OBJECT" or owner.data.is_editmode:
        return "it goes on when you are back in Object Mode"
    if len(owner.data.vertices) and apply.FACES not in owner.data.keys():
        return f"{owner.data.name} is a mesh of your own, and stays as it is"
    return ""


def _marked(owner: bpy.types.Object, it: State) -> None:
    """Sees whether the mesh was converted, or a modifier of it applied."""
    mesh = owner.data if owner.type == "MESH" and owner.mode == "OBJECT" else None
    if mesh is None or not mesh.get(by_hand.SUMS) or mesh.library or mesh.is_editmode or owner.maquette.held:
        it.marked = None
    elif by_hand.is_marked(mesh):
        it.marked = key(mesh)
    elif it.marked == key(mesh):
        owner.maquette.held, it.marked = by_hand.CONVERTED, None
        it.message = hindrance(owner)
    else:
        # Files of some Blenders do not keep the mark.
        by_hand.mark(mesh)
        it.marked = key(mesh)


def _source(owner: bpy.types.Object) -> Any:
    """What an object's graph is read from."""
    return (graph_path(owner), engine.roots())


def stamp(path: str) -> float | None:
    """When a file was written; None if there is none."""
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
        owner = found(uid)
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


def found(uid: int) -> bpy.types.Object | None:
    """The object again: what was held over an undo may be gone."""
    return next((owner for owner in everything() if key(owner) == uid), None)


def _arrange(owner: bpy.types.Object, it: State) -> None:
    """Makes widgets for the controls, and places for the inputs."""
    # What was touched before there was a widget is not lost.
    values.take(owner, it.controls)
    values.put(owner, it.controls)
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
        it.message = it.unfit.get(lacking[0], "") if lacking[0] in given else f"pick an object for the input {lacking[0]}"
        return
    now = (*wanted(owner), key(owner.data) if owner.data else None)
    if it.run is not None:
        late = time.monotonic() - it.since > PATIENCE
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
        lambda answer: _answered(uid, it, answer),
        lambda event: _told(it, event),
        graph=now[0],
        roots=engine.roots(),
        set=_settings(owner, it),
        inputs=it.inputs,
        want=[{"value": owner.maquette.output, "as": "mesh"}],
        slot=str(uid),
    )


def _settings(owner: bpy.types.Object, it: State) -> dict[str, str]:
    """The values of parameters in the current frame."""
    return {name: text for name, text in values.kept(owner).items() if values.is_known(name, it.loaded)} | (it.frame or {})


def _told(it: State, event: dict[str, Any]) -> None:
    if event["event"] in ("started", "progress"):
        it.progress = (str(event.get("node", "")), float(event.get("share", 0)))


def _answered(uid: int, it: State, answer: Answer) -> None:
    it.run, it.progress = None, None
    if states.get(uid) is not it or answer.get("replaced"):
        return
    owner = found(uid)
    if owner is None:
        return
    if answer.get("cancelled") and owner not in objects():
        # Computed again if it comes back into a scene.
        it.answered = None
        return
    if answer.get("cancelled"):
        # By a later value, which comes with the next tick, or by the user.
        it.answered, it.message = it.asked, "behind: the run was cancelled, and the mesh does not show these values; press Reload to compute them"
        return
    it.answered = it.asked
    it.problems = answer.problems
    if not answer.ok:
        it.message = answer.why
        return
    told = answer["values"].get(owner.maquette.output)
    if not told:
        return
    _show(owner, it, told)


def _show(owner: bpy.types.Object, it: State, told: dict[str, Any]) -> None:
    """Shows a value, unless something is against it."""
    if hindrance(owner):
        it.answered = None
        return
    if told.get("why") and exchange.is_unwritten(told["why"], engine.client().folder):
        _no_room(it, told["why"])
        return
    is_shared = any(other != owner and other.data == owner.data and wanted(other) != wanted(owner) for other in objects())
    if is_shared or owner.data.library or owner.data.override_library:
        # A linked duplicate goes on to show what it shows, and so does the file that the mesh is from.
        owner.data = owner.data.copy()
        it.answered = (*it.answered[:-1], key(owner.data))
    if "columns" not in told:
        if not by_hand.take(owner).is_empty:
            owner.maquette.held = f"nothing of {owner.maquette.output} can be seen, and the mesh would be empty"
            it.message = hindrance(owner)
            return
        it.message = f"{owner.maquette.output} is of the type {told['type']}: {told.get('why', '')}"
        owner.data.clear_geometry()
        owner.data[SHOWN] = ""
        by_hand.remember(owner.data)
        return
    try:
        show(owner, told)
        it.message = hindrance(owner) if owner.maquette.held else owner.maquette.lost
    except OSError:
        # Its files made way for later ones: it is asked for again.
        it.answered = None


def _no_room(it: State, why: str) -> None:
    """The last mesh stays. Without room in memory the engine's data is on disk from then on."""
    if engine.go_to_disk():
        return
    it.message = f"there is no room for the result, and the mesh stays as it was: {why}; free space, and press Reload"


def show(owner: bpy.types.Object, told: dict[str, Any]) -> None:
    """Puts a value into the object's mesh, if it is not there."""
    folder = engine.client().folder
    if folder is None:
        return
    mesh = owner.data
    turn = Matrix.Rotation(AXES[told["axes"]] - AXES.get(owner.maquette.axes, 0.0), 4, "X")
    if mesh.get(SHOWN) != told["hash"]:
        it = state(owner)
        sources = [it.sources[its.name] for its in owner.maquette.inputs if its.name in it.sources and its.object]
        told = {**told, "sources": sources}
        columns = apply.Columns(told, folder)
        space.turn(mesh, told["axes"], turn)
        if owner.maquette.is_new and columns.count("position"):
            space.center(owner, columns.named("position"), told["axes"], bool(sources))
            owner.maquette.is_new = False
        work, why = by_hand.ready(owner, columns, folder, it.may_lose)
        if why:
            owner.maquette.held = why
            return
        will_differ = apply.will_differ(mesh, columns)
        before = by_hand.places(mesh) if mesh.shape_keys and not will_differ else None
        if mesh.shape_keys and will_differ:
            owner.shape_key_clear()
        apply.apply(mesh, told, folder)
        if before is not None:
            by_hand.move_keys(mesh, before)
        if work:
            by_hand.put(owner, work)
        returned.groups(owner, columns, sources)
        looks.show(mesh, told, folder, [name for source in sources for name in source.materials])
        by_hand.remember(mesh)
        it.may_lose = False
        mesh[SHOWN] = told["hash"]
        owner.maquette.lost = inputs.lost(owner, it, told)
    if told["axes"] != owner.maquette.axes:
        # Not its matrix in the world: that is not evaluated yet where a script has placed the object a moment ago.
        owner.matrix_basis = owner.matrix_basis @ turn
        if not evaluated.is_frame():
            bpy.context.view_layer.update()
        owner.maquette.axes = told["axes"]
        _placed(owner)
    owner.maquette.shown = told["hash"]
    for other in objects():
        # Nothing tells of a hidden one.
        state(other).stale |= {its.name for its in other.maquette.inputs if its.object == owner and other != owner}


def _placed(owner: bpy.types.Object) -> None:
    """It lies elsewhere, and so do the objects at its inputs relative to it."""
    state(owner).stale |= {its.name for its in owner.maquette.inputs}


@persistent
def _moved(_scene: Any, depsgraph: bpy.types.Depsgraph) -> None:
    """Objects at inputs were changed, or live objects moved."""
    if evaluated.is_at_work:
        return
    found = depsgraph.updates if everything() or depsgraph.id_type_updated("OBJECT") else ()
    moved: set[str] = set()
    changed: set[str] = set()
    for update in found:
        if update.is_updated_transform or update.is_updated_geometry:
            original = update.id.original
            changed.add(original.name_full)
            if update.is_updated_transform:
                moved.add(original.name_full)
            if isinstance(original, bpy.types.Object) and original.maquette.graph and original not in everything():
                forget()
    if not changed:
        return
    for owner in objects():
        if owner.name_full in moved:
            _placed(owner)
        for its in owner.maquette.inputs:
            if its.object and its.object.name_full in changed:
                state(owner).stale.add(its.name)


def framed(depsgraph: bpy.types.Depsgraph) -> None:
    """There is another frame: what it says of objects at inputs and of values is asked for anew."""
    _moved(None, depsgraph)
    for owner in objects():
        it = state(owner)
        it.frame = None
        if evaluated.is_frame():
            # A render has its objects to itself: those of the scene may lie elsewhere.
            _placed(owner)
        it.stale |= {its.name for its in owner.maquette.inputs if its.object and not evaluated.is_seen(its.object, depsgraph)}


@persistent
def _undone(*_given: Any) -> None:
    """Meshes may be what they were: what is shown is asked for again."""
    forget()
    for it in states.values():
        it.answered, it.undone, it.marked = None, True, None


@persistent
def _opened(*_given: Any) -> None:
    forget()
    for it in states.values():
        _cancel(it)
    states.clear()


CLASSES = (MaquetteInput, MaquetteObject)
HANDLERS = {"depsgraph_update_post": _moved, "undo_post": _undone, "redo_post": _undone, "load_post": _opened}


def register() -> None:
    """Registers live objects."""
    for it in CLASSES:
        bpy.utils.register_class(it)
    bpy.types.Object.maquette = bpy.props.PointerProperty(type=MaquetteObject)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    engine.ticks.append(tick)
    engine.replaced.append(restarted)


def unregister() -> None:
    """Unregisters them; objects keep what they have."""
    engine.ticks.remove(tick)
    engine.replaced.remove(restarted)
    forget()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    states.clear()
    del bpy.types.Object.maquette
    for it in reversed(CLASSES):
        bpy.utils.unregister_class(it)
