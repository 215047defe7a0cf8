"""Node trees whose truth is the text of a graph.

A tree keeps the text that it shows, so that undo steps have it too. What a user changes is collected until the next look, becomes edits of the
file (`edits.py`), and the tree is made by difference what the file then says (`mirror.py`). What is refused is taken back in the tree, with the
reason on the node. No node is held over a look: after an undo all of them are others.
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

# What is known of a graph of which nothing is known.
NOTHING: dict[str, Any] = {"nodes": [], "inputs": [], "params": [], "outputs": [], "types": [], "places": None}


class State:
    """What goes on with a tree."""

    def __init__(self) -> None:
        self.outline: dict[str, Any] | None = None
        # The fields of its nodes.
        self.fields: dict[str, dict[str, str]] = {}
        # What its nodes had when they were last found to be as the text has them.
        self.looked_at: dict[str, tuple[Any, ...]] = {}
        # The file, its text as far as is known, and what others changed in it.
        self.path = ""
        self.history = History()
        # An undo or a redo has replaced the tree since the last look.
        self.undone = False
        # True if the tree shows the whole text, apart from what the user changed since; false while it lacks a change of somebody else.
        self.is_complete = True
        # The files that say what is shown: the graph's, those that it uses, and the layout's.
        self.stamps: dict[str, float | None] = {}
        # The folders that it may read beside its project's, as they were when it was read.
        self.roots: list[str] = []
        self.busy = False
        # Whether the next look is at fields, or at places.
        self.turn = False
        # What the tree shows beyond its text is kept: the user was quicker than the engine.
        self.keeps = False
        # What was shown when the last edit was done, until the text is read again.
        self.edited: edits.Shown | None = None
        # New nodes as they were last refused: they are asked for again when they are others.
        self.refused: list[edits.Node] = []
        # Where nodes stood when all was well, and at the last look; whether it is kept beside the graph, and whether it is to be.
        self.stood: dict[str, mirror.Spot] = {}
        self.seen: dict[str, mirror.Spot] = {}
        self.has_layout = self.wants_layout = False
        self.message = ""
        # What the last undo has to report; it is shown until the next edit.
        self.notice = ""
        self.problems: list[dict[str, Any]] = []


states: dict[Any, State] = {}
changed: set[Any] = set()
_looked = 0.0
_asked = False


def key(tree: bpy.types.NodeTree) -> Any:
    """What a tree is known by, undo included."""
    return tree.session_uid if hasattr(tree, "session_uid") else tree.name_full


def trees() -> list[bpy.types.NodeTree]:
    """All trees of graphs."""
    return [it for it in bpy.data.node_groups if it.bl_idname == nodes.MaquetteTree.bl_idname and it.maquette_graph]


def of_graph(path: str) -> bpy.types.NodeTree:
    """The tree of the graph in a file; a new one if there is none."""
    real = _real(path)
    known = next((it for it in trees() if _real(it.maquette_graph) == real), None)
    return known or new(path, pathlib.Path(path).stem)


def _real(path: str) -> pathlib.Path:
    return pathlib.Path(bpy.path.abspath(path)).resolve()


def real_path(tree: bpy.types.NodeTree) -> pathlib.Path:
    """The file of a tree's graph."""
    return pathlib.Path(bpy.path.abspath(tree.maquette_graph, library=tree.library)).resolve()


def new(path: str, name: str) -> bpy.types.NodeTree:
    """A tree of the graph in a file."""
    tree = bpy.data.node_groups.new(name, nodes.MaquetteTree.bl_idname)
    tree.use_fake_user = True
    tree.maquette_graph = path
    return tree


def shown(tree: bpy.types.NodeTree) -> tuple[edits.Shown, list[str]]:
    """What a tree shows, and the names of its nodes in Blender."""
    state = states.get(key(tree))
    return mirror.shown(tree, state.outline if state and state.outline else NOTHING)


def tick() -> None:
    """Goes on with all trees."""
    global _looked, _asked
    found = trees()
    if not found or engine.ended():
        return
    if not nodes.kinds:
        if not _asked:
            _asked = True
            engine.client().ask("catalog", _cataloged)
        return
    looks = time.monotonic() - _looked > live.LOOK
    if looks:
        _looked = time.monotonic()
    for tree in found:
        state = states.setdefault(key(tree), State())
        if state.busy:
            continue
        undone, state.undone = state.undone, False
        if undone and not tree.maquette_text:
            # The step was taken before the graph was read for the first time.
            state.outline = None
        path = bpy.path.abspath(tree.maquette_graph, library=tree.library)
        if path != state.path:
            state.path, state.history = path, History()
            state.outline, state.edited, state.keeps = None, None, False
        is_read = state.outline is not None and path in state.stamps and state.roots == engine.roots()
        # Behind an edit the outline has the names before it, until the file is read again.
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
        # One thing at a time: no look takes long.
        state.turn ^= looks


def _cataloged(answer: Answer) -> None:
    global _asked
    _asked = False
    if answer.ok:
        nodes.classes(answer["nodes"])


def _found(uid: Any) -> bpy.types.NodeTree | None:
    return next((it for it in trees() if key(it) == uid), None)


def _ask(state: State, uid: Any, do: str, then: Any, **fields: Any) -> None:
    state.busy = True

    def done(answer: Answer) -> None:
        state.busy = False
        tree = _found(uid)
        if tree is not None and states.get(uid) is state:
            then(tree, answer)

    engine.client().ask(do, done, None, **fields)


def _layout(path: str) -> str:
    """The file beside a graph that says where its nodes stand."""
    return str(pathlib.Path(path).with_suffix(".layout.ron"))


def _read(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Shows what stands in the file."""
    stamps, state.roots = {it: live.stamp(it) for it in {path, _layout(path), *state.stamps}}, engine.roots()

    def then(tree: bpy.types.NodeTree, answer: Answer) -> None:
        were, state.stamps = state.stamps, stamps
        state.message = answer.why or state.notice
        if state.undone:
            # The tree is another one now: it is compared with the file first.
            state.stamps = {path: None}
            return
        edited, state.edited = state.edited, None
        if not answer.ok:
            state.outline = state.outline or NOTHING
            return
        if edited is not None:
            state.keeps |= not edits.is_same(edited, shown(tree)[0])
            if state.keeps and not (state.is_complete and answer["text"] == state.history.text):
                # The tree lacks a change of somebody else: compared with the file, it would take that back.
                state.keeps = False
                state.notice = "somebody else changed the file at the same moment; your last change was not written, make it again"
        elif state.outline is not None and not state.keeps and edits.difference(state.outline, _wished(tree, state))[0]:
            # What the user has changed meanwhile goes into the file first; then this is asked for again.
            state.stamps = {path: None}
            _edit(tree, state, path)
            return
        state.problems = answer.problems
        outline = answer["outline"]
        if outline is None:
            # Nothing can be shown of such a text; what is shown stays.
            state.message = answer.problems[0]["message"] if answer.problems else ""
            return
        used = [it["pack"] for it in outline["types"]]
        state.stamps = {it: stamps.get(it, live.stamp(it)) for it in (path, _layout(path), *used)}
        nodes.learn(outline["types"], "pack")
        kept = mirror.of_layout(answer.get("layout"))
        state.has_layout = bool(kept)
        state.message = answer.get("layout_why", "") or state.notice
        is_first, is_new = state.history.text is None, not tree.maquette_text
        if is_first:
            # What was written to the file since the tree was saved is a change of others.
            state.history.begin(tree.maquette_text or answer["text"], tree.maquette_changes)
        state.history.learn(answer["text"], answer["text"])
        _know(state, outline)
        _has_text(tree, state)
        if state.keeps:
            state.keeps = False
            changed.add(key(tree))
            return
        state.wants_layout |= mirror.have_moved(state.stood, mirror.spots(tree))
        _rebuild(tree, state, kept)
        if were.get(_layout(path)) != stamps[_layout(path)]:
            moved = _place(tree, kept)
            if moved and not is_first:
                state.history.moved(moved)
                _has_text(tree, state)
        state.stood, state.is_complete = mirror.spots(tree), True
        if is_first and is_new:
            _push("Graph Shown")

    _ask(state, key(tree), "outline", then, graph=path, roots=state.roots)


def _rebuild(tree: bpy.types.NodeTree, state: State, kept: dict[str, mirror.Spot]) -> None:
    mirror.rebuild(tree, state.outline or NOTHING, kept)
    changed.discard(key(tree))


def _know(state: State, outline: dict[str, Any]) -> None:
    """From now on the tree is compared with this outline."""
    state.outline, state.looked_at = outline, {}
    state.fields = {it.name: it.fields for it in edits.shown(outline).nodes}


def _place(tree: bpy.types.NodeTree, spots: dict[str, mirror.Spot]) -> dict[str, mirror.Spot]:
    """Moves nodes to these positions; returns the positions of those that were elsewhere."""
    moved = {}
    for name, node in mirror.boxes(tree).items():
        if name in spots and mirror.have_moved({name: spots[name]}, {name: mirror.spot(node)}):
            mirror.put(node, spots[name])
            moved[name] = spots[name]
    return moved


def _has_text(tree: bpy.types.NodeTree, state: State) -> None:
    """The text of the tree is that of the file."""
    tree.maquette_text, tree.maquette_changes = state.history.text, state.history.count


def _push(message: str) -> None:
    """Takes an undo step. Without one for the tree as it is first shown, the first undo would leave an empty tree, or none."""
    try:
        bpy.ops.ed.undo_push(message=message)
    except RuntimeError:
        # No window, no undo.
        pass


def _undo(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """After an undo or a redo the file gets the text that the tree has again, with all that others changed since.

    If that is impossible, the file is left as it is, and the tree shows it.
    """
    uid, text, was = key(tree), tree.maquette_text, state.history.text
    later = state.history.since(tree.maquette_changes)
    state.notice = ""

    def refuse(why: str) -> None:
        state.notice = state.message = f"not undone: {why}"
        state.outline = state.edited = None
        state.keeps = False

    if later is None:
        refuse("the step is older than what is known of the file; the file is left as it is")
        return

    def outlined(_tree: bpy.types.NodeTree, answer: Answer) -> None:
        # A second undo while this one is at work replaces it.
        if state.undone:
            return
        outline = answer.get("outline")
        if outline is None:
            refuse(answer.why or "the text of that step cannot be read; the file is left as it is")
            return
        theirs = [(it.before, it.after) for it in later if it.before != it.after]
        _ask(state, uid, "put", lambda tree, answer: put(tree, answer, outline), graph=path, was=was, text=text, theirs=theirs)

    def put(tree: bpy.types.NodeTree, answer: Answer, outline: dict[str, Any]) -> None:
        state.stamps = {path: None}
        if answer.ok:
            state.history.learn(answer["before"], answer["text"])
        if state.undone:
            return
        for change in later:
            _place(tree, change.spots)
        if not answer.ok:
            refuse(answer.why)
            return
        if answer["text"] not in (answer["before"], text):
            state.notice = "undone, and what others changed in the file was kept"
        # The tree shows the text of its step, and maybe what the user did in that step: this is written next, and then the file is read.
        _know(state, outline)
        _has_text(tree, state)
        state.edited, state.keeps, state.is_complete = None, False, answer["text"] == text

    _ask(state, uid, "outline", outlined, graph=path, roots=engine.roots(), text=text)


def _wished(tree: bpy.types.NodeTree, state: State) -> edits.Shown:
    """What a tree shows, without what was refused already."""
    return edits.without(shown(tree)[0], state.refused)[0]


def _edit(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Makes the file what the tree shows; or the tree what the file says."""
    assert state.outline is not None
    if mirror.lacks_ends(tree, state.outline):
        # An output goes when its link does.
        state.message = "the nodes of all inputs and of all outputs stay, and nothing was deleted"
        _rebuild(tree, state, {})
        return
    everything, places = shown(tree)
    names = {id(node): name for node, name in zip(everything.nodes, places)}
    now, state.refused = edits.without(everything, state.refused)
    changes, waiting = edits.difference(state.outline, now)
    new = [node for node in now.nodes if not node.name and not any(node is it for it in waiting)]
    for node in waiting:
        _say(tree.nodes[names[id(node)]], f"{edits.lacking(node) or 'a link'}: it is not in the graph yet")
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
        state.history.learn(answer["before"], answer["text"])
        if state.undone:
            # The tree is another one now: the file is made what that one shows.
            return
        state.keeps |= not edits.is_same(everything, shown(tree)[0])
        given = [it["add"]["name"] for it in changes if "add" in it]
        for node, name in zip(new, given):
            made = tree.nodes.get(names[id(node)])
            if made:
                made.maquette_name = name
                _say(made, "")
        for node in tree.nodes:
            own = getattr(node, "maquette_name", "")
            if own in renamed:
                node.maquette_name = renamed[own]
        _has_text(tree, state)
        state.edited = shown(tree)[0]
        # Where a new node stands is the user's wish; and a name that is another one is another one there, too.
        state.wants_layout |= bool(given) or (bool(renamed) and state.has_layout)

    _ask(state, key(tree), "edit", then, graph=path, roots=engine.roots(), edits=changes)


def _say(node: bpy.types.Node, problem: str) -> None:
    if node.maquette_problem != problem:
        node.maquette_problem = problem


def _refuse(tree: bpy.types.NodeTree, state: State, words: str, changes: list[dict[str, Any]], new: list[str]) -> None:
    """Takes back what the engine refuses, and says why on the nodes."""
    named = set()
    for change in changes:
        for fields in change.values():
            said = fields.get("port") or fields.get("target") or fields.get("name") or fields.get("from", "")
            named.add(said.removeprefix("nodes.").split(".")[0])
    _rebuild(tree, state, {})
    for node in tree.nodes:
        if node.name in new or (mirror.is_own(node) and node.maquette_name and node.maquette_name in named):
            _say(node, words)


def _is_touched(tree: bpy.types.NodeTree, state: State) -> bool:
    """Whether a field or a name was changed, of which nothing tells."""
    for node in tree.nodes:
        if not mirror.is_own(node):
            continue
        name = node.maquette_name
        if not name:
            return True
        # One call of Blender for all that a node has: there may be hundreds of nodes.
        now = (node.label, *(list(it) if hasattr(it, "to_list") else it for it in node.values()))
        if state.looked_at.get(name) == now:
            continue
        known = state.fields.get(name)
        if known is not None and (nodes.title(node) != name or nodes.fields(node, known) != known):
            return True
        state.looked_at[name] = now
    return False


def _keep_layout(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Keeps where the user has put nodes, once they have come to rest."""
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


def _hear(tree: bpy.types.NodeTree) -> None:
    changed.add(key(tree))


@persistent
def _after_undo(*_given: Any) -> None:
    for tree in trees():
        states.setdefault(key(tree), State()).undone = True
        changed.add(key(tree))


@persistent
def _opened(*_given: Any) -> None:
    states.clear()
    changed.clear()


HANDLERS = {"undo_post": _after_undo, "redo_post": _after_undo, "load_post": _opened}


def register() -> None:
    """Begins to look after trees."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    nodes.heard.append(_hear)
    engine.ticks.append(tick)


def unregister() -> None:
    """Looks after them no more."""
    global _asked
    engine.ticks.remove(tick)
    nodes.heard.remove(_hear)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    states.clear()
    changed.clear()
    _asked = False
