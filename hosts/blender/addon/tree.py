"""Node trees that show and edit the text of a graph, which is authoritative.

A tree stores the text that it shows, so that undo steps contain it, too. Changes by the user are collected until the next tick, become
edits of the file (`edits.py`), and then the tree is updated to the file (`mirror.py`). Refused changes are reverted in the tree, with the
reason on the node. No reference to a node is kept between ticks, since an undo replaces all nodes.
"""

from __future__ import annotations

import pathlib
import time
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import edits, engine, live, mirror, nodes
from .client import Answer
from .history import History

# The outline of an unknown graph.
NOTHING: dict[str, Any] = {"nodes": [], "inputs": [], "params": [], "outputs": [], "types": [], "places": None}


class State:
    """The current activity of a tree."""

    def __init__(self) -> None:
        self.outline: dict[str, Any] | None = None
        # The fields of its nodes, by name.
        self.fields: dict[str, dict[str, str]] = {}
        # The properties of its nodes when they last agreed with the text.
        self.looked_at: dict[str, tuple[Any, ...]] = {}
        # The file, and the history of its text.
        self.path = ""
        self.history = History()
        # True if an undo or redo has replaced the tree since the last tick.
        self.undone = False
        # False while the tree lacks an external change of the text. Later changes by the user do not count.
        self.is_complete = True
        # The modification times of the graph, of used graphs, and of the layout.
        self.stamps: dict[str, float | None] = {}
        # The additional folders that the graph may read, at the time when it was read.
        self.roots: list[str] = []
        self.busy = False
        # Alternates between checks of fields and of positions.
        self.turn = False
        # True if the user has changed the tree while a request was pending; these changes are kept.
        self.keeps = False
        # The view after the last edit, until the text is read again.
        self.edited: edits.GraphView | None = None
        # New nodes that the engine has refused; they are sent again only after a change.
        self.refused: list[edits.Node] = []
        # The last saved positions of nodes, and those at the last check; a layout file exists; a layout file must be written.
        self.stood: dict[str, mirror.Spot] = {}
        self.seen: dict[str, mirror.Spot] = {}
        self.has_layout = self.wants_layout = False
        self.message = ""
        # The message of the last undo, which is shown until the next edit.
        self.notice = ""
        self.problems: list[dict[str, Any]] = []


states: dict[Any, State] = {}
changed: set[Any] = set()
_looked = 0.0
_asked = False


def key(tree: bpy.types.NodeTree) -> Any:
    """An identifier of a tree, also across undo."""
    return tree.session_uid if hasattr(tree, "session_uid") else tree.name_full


def trees() -> list[bpy.types.NodeTree]:
    """All node trees that show graphs."""
    return [it for it in bpy.data.node_groups if it.bl_idname == nodes.MaquetteTree.bl_idname and it.maquette_graph]


def tree_of_graph(path: str) -> bpy.types.NodeTree:
    """Finds the tree of a graph file; creates it if there is none."""
    real = _real(path)
    known = next((it for it in trees() if _real(it.maquette_graph) == real), None)
    return known or new(path, pathlib.Path(path).stem)


def _real(path: str) -> pathlib.Path:
    return pathlib.Path(bpy.path.abspath(path)).resolve()


def real_path(tree: bpy.types.NodeTree) -> pathlib.Path:
    """The path of a tree's graph."""
    return pathlib.Path(bpy.path.abspath(tree.maquette_graph, library=tree.library)).resolve()


def new(path: str, name: str) -> bpy.types.NodeTree:
    """Creates a tree for a graph file."""
    tree = bpy.data.node_groups.new(name, nodes.MaquetteTree.bl_idname)
    tree.use_fake_user = True
    tree.maquette_graph = path
    return tree


def view_of(tree: bpy.types.NodeTree) -> tuple[edits.GraphView, list[str]]:
    """The view that a tree shows, and the names of its nodes in Blender."""
    state = states.get(key(tree))
    return mirror.read_tree(tree, state.outline if state and state.outline else NOTHING)


def tick() -> None:
    """Advances all trees by one step."""
    global _looked, _asked
    found = trees()
    if not found or engine.end_reason():
        return
    if not nodes.kinds:
        if not _asked:
            _asked = True
            engine.client().ask("catalog", _on_catalog)
        return
    looks = time.monotonic() - _looked > live.CHECK_INTERVAL
    if looks:
        _looked = time.monotonic()
    for tree in found:
        state = states.setdefault(key(tree), State())
        if state.busy:
            continue
        undone, state.undone = state.undone, False
        if undone and not tree.maquette_text:
            # The undo step is older than the first reading of the graph.
            state.outline = None
        path = bpy.path.abspath(tree.maquette_graph, library=tree.library)
        if path != state.path:
            state.path, state.history = path, History()
            state.outline, state.edited, state.keeps = None, None, False
        is_read = state.outline is not None and path in state.stamps and state.roots == engine.roots()
        # After an edit, the outline has the old names until the file is read again.
        if state.outline is not None and state.edited is None and key(tree) in changed and tree.maquette_text == state.history.text:
            mirror.adopt(tree, state.outline)
        known = state.history
        is_known = (tree.maquette_text, tree.maquette_changes) == (known.text, known.count)
        if undone and known.text is not None and tree.maquette_text and not is_known:
            _undo(tree, state, path)
        elif not is_read or state.edited is not None or (looks and any(live.stamp(it) != was for it, was in state.stamps.items())):
            _read(tree, state, path)
        elif key(tree) in changed or (looks and state.turn and _is_touched(tree, state)):
            changed.discard(key(tree))
            _edit(tree, state, path)
        elif looks and not state.turn:
            _keep_layout(tree, state, path)
        # Only one check in each tick, so that none takes long.
        state.turn ^= looks


def _on_catalog(answer: Answer) -> None:
    global _asked
    _asked = False
    if answer.ok:
        nodes.register_classes(answer["nodes"])


def _find(uid: Any) -> bpy.types.NodeTree | None:
    return next((it for it in trees() if key(it) == uid), None)


def _ask(state: State, uid: Any, do: str, then: Any, **fields: Any) -> None:
    state.busy = True

    def done(answer: Answer) -> None:
        state.busy = False
        tree = _find(uid)
        if tree is not None and states.get(uid) is state:
            then(tree, answer)

    engine.client().ask(do, done, None, **fields)


def _layout(path: str) -> str:
    """The layout file of a graph, which has the positions of its nodes."""
    return str(pathlib.Path(path).with_suffix(".layout.ron"))


def _read(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Reads the file and updates the tree."""
    stamps, state.roots = {it: live.stamp(it) for it in {path, _layout(path), *state.stamps}}, engine.roots()

    def then(tree: bpy.types.NodeTree, answer: Answer) -> None:
        were, state.stamps = state.stamps, stamps
        state.message = answer.why or state.notice
        if state.undone:
            # An undo has replaced the tree: compare it with the file first.
            state.stamps = {path: None}
            return
        edited, state.edited = state.edited, None
        if not answer.ok:
            state.outline = state.outline or NOTHING
            return
        if edited is not None:
            state.keeps |= not edits.is_same(edited, view_of(tree)[0])
            if state.keeps and not (state.is_complete and answer["text"] == state.history.text):
                # The tree lacks an external change, which an edit from it would revert.
                state.keeps = False
                state.notice = "another program changed the file at the same time, so your last change was not written; make it again"
        elif state.outline is not None and not state.keeps and edits.difference(state.outline, _wanted_view(tree, state))[0]:
            # Write the user's changes first, then read the file again.
            state.stamps = {path: None}
            _edit(tree, state, path)
            return
        state.problems = answer.problems
        outline = answer["outline"]
        if outline is None:
            # The text cannot be parsed: keep the tree.
            state.message = answer.problems[0]["message"] if answer.problems else ""
            return
        used = [it["pack"] for it in outline["types"]]
        state.stamps = {it: stamps.get(it, live.stamp(it)) for it in (path, _layout(path), *used)}
        nodes.add_types(outline["types"], "pack")
        kept = mirror.layout_spots(answer.get("layout"))
        state.has_layout = bool(kept)
        state.message = answer.get("layout_why", "") or state.notice
        is_first, is_new = state.history.text is None, not tree.maquette_text
        if is_first:
            # Changes of the file since the tree was saved are external.
            state.history.begin(tree.maquette_text or answer["text"], tree.maquette_changes)
        state.history.update(answer["text"], answer["text"])
        _set_outline(state, outline)
        _sync_text(tree, state)
        if state.keeps:
            state.keeps = False
            changed.add(key(tree))
            return
        state.wants_layout |= mirror.have_moved(state.stood, mirror.spots(tree))
        _rebuild(tree, state, kept)
        if were.get(_layout(path)) != stamps[_layout(path)]:
            moved = _place(tree, kept)
            if moved and not is_first:
                state.history.add_moves(moved)
                _sync_text(tree, state)
        state.stood, state.is_complete = mirror.spots(tree), True
        if is_first and is_new:
            _push("Graph Shown")

    _ask(state, key(tree), "outline", then, graph=path, roots=state.roots)


def _rebuild(tree: bpy.types.NodeTree, state: State, kept: dict[str, mirror.Spot]) -> None:
    mirror.rebuild(tree, state.outline or NOTHING, kept)
    changed.discard(key(tree))


def _set_outline(state: State, outline: dict[str, Any]) -> None:
    """Sets the outline with which the tree is compared from now on."""
    state.outline, state.looked_at = outline, {}
    state.fields = {it.name: it.fields for it in edits.view_of(outline).nodes}


def _place(tree: bpy.types.NodeTree, spots: dict[str, mirror.Spot]) -> dict[str, mirror.Spot]:
    """Moves nodes to these positions; returns the positions of those that have moved."""
    moved = {}
    for name, node in mirror.boxes(tree).items():
        if name in spots and mirror.have_moved({name: spots[name]}, {name: mirror.spot(node)}):
            mirror.put(node, spots[name])
            moved[name] = spots[name]
    return moved


def _sync_text(tree: bpy.types.NodeTree, state: State) -> None:
    """Stores the known text of the file in the tree."""
    tree.maquette_text, tree.maquette_changes = state.history.text, state.history.count


def _push(message: str) -> None:
    """Pushes an undo step. Without one for the first display of the tree, the first undo would leave an empty tree, or none."""
    try:
        bpy.ops.ed.undo_push(message=message)
    except RuntimeError:
        # There is no undo without a window.
        pass


def _undo(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """After an undo or redo, writes the text of the tree into the file, merged with all later external changes.

    If that is impossible, the file is not changed, and the tree is updated to it.
    """
    uid, text, was = key(tree), tree.maquette_text, state.history.text
    later = state.history.changes_since(tree.maquette_changes)
    state.notice = ""

    def refuse(why: str) -> None:
        state.notice = state.message = f"not undone: {why}"
        state.outline = state.edited = None
        state.keeps = False

    if later is None:
        refuse("the step is older than the known history of the file; the file is unchanged")
        return

    def outlined(_tree: bpy.types.NodeTree, answer: Answer) -> None:
        # Another undo replaces this one.
        if state.undone:
            return
        outline = answer.get("outline")
        if outline is None:
            refuse(answer.why or "the text of that step cannot be read; the file is unchanged")
            return
        theirs = [(it.before, it.after) for it in later if it.before != it.after]
        _ask(state, uid, "put", lambda tree, answer: put(tree, answer, outline), graph=path, was=was, text=text, theirs=theirs)

    def put(tree: bpy.types.NodeTree, answer: Answer, outline: dict[str, Any]) -> None:
        state.stamps = {path: None}
        if answer.ok:
            state.history.update(answer["before"], answer["text"])
        if state.undone:
            return
        for change in later:
            _place(tree, change.spots)
        if not answer.ok:
            refuse(answer.why)
            return
        if answer["text"] not in (answer["before"], text):
            state.notice = "undone; external changes of the file were kept"
        # The tree shows the text of its step, and maybe changes by the user in that step, which are written next; then the file is read.
        _set_outline(state, outline)
        _sync_text(tree, state)
        state.edited, state.keeps, state.is_complete = None, False, answer["text"] == text

    _ask(state, uid, "outline", outlined, graph=path, roots=engine.roots(), text=text)


def _wanted_view(tree: bpy.types.NodeTree, state: State) -> edits.GraphView:
    """The view of a tree without refused new nodes."""
    return edits.without_refused(view_of(tree)[0], state.refused)[0]


def _edit(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Writes changes of the tree into the file; reverts them in the tree if they are refused."""
    assert state.outline is not None
    if mirror.lacks_ends(tree, state.outline):
        # Outputs are deleted by deleting their links.
        state.message = "the nodes Inputs and Outputs cannot be deleted"
        _rebuild(tree, state, {})
        return
    everything, places = view_of(tree)
    names = {id(node): name for node, name in zip(everything.nodes, places)}
    now, state.refused = edits.without_refused(everything, state.refused)
    changes, waiting = edits.difference(state.outline, now)
    new = [node for node in now.nodes if not node.name and not any(node is it for it in waiting)]
    for node in waiting:
        _set_problem(tree.nodes[names[id(node)]], f"not in the graph yet: {edits.missing_part(node) or 'link a node that is in the graph'}")
    if not changes:
        return
    renamed = {node.name: node.title for node in now.nodes if node.name and node.title != node.name}

    def then(tree: bpy.types.NodeTree, answer: Answer) -> None:
        if state.undone and not answer.ok:
            return
        if not answer.ok:
            words = answer.problems[0]["message"] if answer.problems else answer.why
            state.message = words
            if not state.is_complete:
                # The file is read next.
                state.notice = words
            state.refused = [*state.refused, *new]
            _refuse(tree, state, words, changes, [names[id(node)] for node in new])
            return
        state.message, state.notice, state.stamps[path] = "", "", None
        state.is_complete &= answer["before"] == state.history.text
        state.history.update(answer["before"], answer["text"])
        if state.undone:
            # An undo has replaced the tree: its text is written next.
            return
        state.keeps |= not edits.is_same(everything, view_of(tree)[0])
        given = [it["add"]["name"] for it in changes if "add" in it]
        for node, name in zip(new, given):
            made = tree.nodes.get(names[id(node)])
            if made:
                made.maquette_name = name
                _set_problem(made, "")
        for node in tree.nodes:
            own = getattr(node, "maquette_name", "")
            if own in renamed:
                node.maquette_name = renamed[own]
        _sync_text(tree, state)
        state.edited = view_of(tree)[0]
        # The layout must have the positions of new nodes, and the new names of renamed ones.
        state.wants_layout |= bool(given) or (bool(renamed) and state.has_layout)

    _ask(state, key(tree), "edit", then, graph=path, roots=engine.roots(), edits=changes)


def _set_problem(node: bpy.types.Node, problem: str) -> None:
    if node.maquette_problem != problem:
        node.maquette_problem = problem


def _refuse(tree: bpy.types.NodeTree, state: State, words: str, changes: list[dict[str, Any]], new: list[str]) -> None:
    """Reverts refused changes, and shows the reason on the nodes."""
    named = set()
    for change in changes:
        for fields in change.values():
            said = fields.get("port") or fields.get("target") or fields.get("name") or fields.get("from", "")
            named.add(said.removeprefix("nodes.").split(".")[0])
    _rebuild(tree, state, {})
    for node in tree.nodes:
        if node.name in new or (mirror.is_own(node) and node.maquette_name and node.maquette_name in named):
            _set_problem(node, words)


def _is_touched(tree: bpy.types.NodeTree, state: State) -> bool:
    """Returns true if a field or a name has changed; Blender does not notify about these changes."""
    for node in tree.nodes:
        if not mirror.is_own(node):
            continue
        name = node.maquette_name
        if not name:
            return True
        # Only one call of Blender for each node: there may be hundreds of nodes.
        now = (node.label, *(list(it) if hasattr(it, "to_list") else it for it in node.values()))
        if state.looked_at.get(name) == now:
            continue
        known = state.fields.get(name)
        if known is not None and (nodes.title(node) != name or nodes.fields(node, known) != known):
            return True
        state.looked_at[name] = now
    return False


def _keep_layout(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Writes the layout file after the user has moved nodes and they have stopped moving."""
    now = mirror.spots(tree)
    state.wants_layout |= mirror.have_moved(state.stood, now)
    is_at_rest = state.seen.keys() == now.keys() and not mirror.have_moved(state.seen, now)
    state.seen = now
    if not (state.wants_layout and is_at_rest):
        return
    state.wants_layout = False
    state.stood = now

    def then(_tree: bpy.types.NodeTree, answer: Answer) -> None:
        state.message = answer.why
        state.has_layout = state.has_layout or answer.ok
        state.stamps[_layout(path)] = live.stamp(_layout(path))

    _ask(state, key(tree), "layout", then, graph=path, layout=mirror.layout(now))


def _on_change(tree: bpy.types.NodeTree) -> None:
    changed.add(key(tree))


@persistent
def _on_undo(*_given: Any) -> None:
    for tree in trees():
        states.setdefault(key(tree), State()).undone = True
        changed.add(key(tree))


@persistent
def _on_load(*_given: Any) -> None:
    states.clear()
    changed.clear()


HANDLERS = {"undo_post": _on_undo, "redo_post": _on_undo, "load_post": _on_load}


def register() -> None:
    """Registers the handlers and the tick."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    nodes.listeners.append(_on_change)
    engine.ticks.append(tick)


def unregister() -> None:
    """Unregisters the handlers and the tick."""
    global _asked
    engine.ticks.remove(tick)
    nodes.listeners.remove(_on_change)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    states.clear()
    changed.clear()
    _asked = False
