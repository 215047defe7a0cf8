"""Node trees whose truth is the text of a graph.

A tree keeps the text that it shows, so that undo steps have it too. What a user changes is collected until the next look, becomes edits of the
file (`edits.py`), and the tree is made by difference what the file then says. What is refused is taken back in the tree, with the reason on the
node. No node is held over a look: after an undo all of them are others.
"""

from __future__ import annotations

import hashlib
import time
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import edits, engine, live, panel
from .client import Answer

# Custom properties of fields begin with this.
FIELD = "field "

# What a frame that was made of a comment remembers.
FRAME = "maquette_comment"

# The units of node trees: a column of boxes, and a row of one.
COLUMN, ROW = 240.0, 22.0

# Blender cuts names of nodes to so many bytes.
LONGEST = 63


class State:
    """What goes on with a tree."""

    def __init__(self) -> None:
        self.outline: dict[str, Any] | None = None
        # What stands in the file, as far as is known.
        self.text = ""
        self.stamp: float | None = None
        self.busy = False
        # What the tree shows beyond its text is kept: an undo brought both back.
        self.keeps = False
        self.message = ""
        self.problems: list[dict[str, Any]] = []


states: dict[Any, State] = {}
changed: set[Any] = set()
_undone = False
_looked = 0.0
# The classes that were made of the catalog, by their names.
_made: dict[str, type] = {}
_catalog: dict[str, dict[str, Any]] = {}
_asked = False


def key(tree: bpy.types.NodeTree) -> Any:
    """What a tree is known by, undo included."""
    return tree.session_uid if hasattr(tree, "session_uid") else tree.name_full


class MaquetteTree(bpy.types.NodeTree):
    """A graph of maquette, as its file has it"""

    bl_idname = "MaquetteTree"
    bl_label = "Maquette Graph"
    bl_icon = "NODETREE"

    maquette_graph: bpy.props.StringProperty(name="Graph", description="The file of the graph", subtype="FILE_PATH")  # type: ignore[valid-type]
    maquette_text: bpy.props.StringProperty(description="The text that is shown")  # type: ignore[valid-type]

    def update(self) -> None:
        """Something may have been changed: it is looked at with the next look."""
        changed.add(key(self))


class SocketBase:
    """A port or an output."""

    maquette_port: bpy.props.StringProperty()  # type: ignore[valid-type]

    def draw(self, _context: Any, layout: Any, _node: Any, text: str) -> None:
        """Its name."""
        layout.label(text=text)

    def draw_color(self, _context: Any, _node: Any) -> tuple[float, float, float, float]:
        """That of its type."""
        return color(self.bl_label)

    @classmethod
    def draw_color_simple(cls) -> tuple[float, float, float, float]:
        """That of its type."""
        return color(cls.bl_label)


def color(kind: str) -> tuple[float, float, float, float]:
    """A color for a type of values, everywhere the same."""
    import colorsys

    hue = hashlib.md5(kind.encode(), usedforsecurity=False).digest()[0] / 256
    return (*colorsys.hsv_to_rgb(hue, 0.55 if kind else 0.0, 0.8), 1.0)


class NodeBase:
    """A node of a graph."""

    bl_width_default = 190
    # Its name in the text; empty while it is not there.
    maquette_name: bpy.props.StringProperty()  # type: ignore[valid-type]
    maquette_kind: bpy.props.StringProperty()  # type: ignore[valid-type]
    maquette_problem: bpy.props.StringProperty()  # type: ignore[valid-type]

    @classmethod
    def poll(cls, tree: bpy.types.NodeTree) -> bool:
        """Whether it belongs into a tree."""
        return tree.bl_idname == MaquetteTree.bl_idname

    def init(self, _context: Any) -> None:
        """A new node has the ports of its type."""
        kind = getattr(self, "maquette_type", "")
        told = _catalog.get(kind)
        if told:
            self.maquette_kind = kind
            for port in told["inputs"]:
                socket(self.inputs, port["types"], port["name"], port["name"], port["many"])
            for output in told["outputs"]:
                socket(self.outputs, output["types"], output["name"], output["name"])
            for name in told["parameters"].get("required", ()):
                self[FIELD + name] = ""

    def copy(self, _from: Any) -> None:
        """A copy is another node, which is not in the text yet."""
        self.maquette_name = ""

    def draw_buttons(self, _context: Any, layout: Any) -> None:
        """Its fields, and what is wrong with it."""
        if self.maquette_problem:
            column = layout.column()
            column.alert = True
            column.label(text=self.maquette_problem, icon="ERROR")
        for name in [it for it in self.keys() if it.startswith(FIELD)]:
            layout.prop(self, f'["{name}"]', text=name[len(FIELD) :])


class MaquetteNodeOther(NodeBase, bpy.types.Node):
    """A node that the catalog has not: a graph that is used, a `ForEach`, a `Switch`, or one of an unknown type."""

    bl_idname = "MaquetteNodeOther"
    bl_label = "Maquette Node"


class MaquetteNodeInputs(NodeBase, bpy.types.Node):
    """All inputs of a graph."""

    bl_idname = "MaquetteNodeInputs"
    bl_label = "Inputs"


class MaquetteNodeOutputs(NodeBase, bpy.types.Node):
    """All outputs of a graph."""

    bl_idname = "MaquetteNodeOutputs"
    bl_label = "Outputs"


class MaquetteSocket(SocketBase, bpy.types.NodeSocket):
    """A port of which no single type is known."""

    bl_idname = "MaquetteSocket"
    bl_label = ""


def socket(sockets: Any, types: list[str], name: str, port: str, many: bool = False) -> Any:
    """A new socket of a node."""
    idname = f"MaquetteSocket{types[0]}" if len(types) == 1 else MaquetteSocket.bl_idname
    idname = idname if idname in _made else MaquetteSocket.bl_idname
    if many and bpy.app.version >= (4, 0):
        made = sockets.new(idname, name, use_multi_input=True)
    else:
        made = sockets.new(idname, name)
        if many:
            made.link_limit = 0
    made.maquette_port = port
    return made


def classes(nodes: list[dict[str, Any]]) -> None:
    """Registers a class for each type of nodes and of values that the engine has."""
    _catalog.update({it["name"]: it for it in nodes})
    types = {kind for it in nodes for port in [*it["inputs"], *it["outputs"]] for kind in port["types"]}
    wanted: list[tuple[str, tuple[type, ...], dict[str, Any]]] = []
    for kind in sorted(types):
        wanted.append((f"MaquetteSocket{kind}", (SocketBase, bpy.types.NodeSocket), {"bl_label": kind}))
    for it in nodes:
        own = {"bl_label": it["name"], "maquette_type": it["name"], "__doc__": it["doc"] or it["name"]}
        wanted.append((f"MaquetteNode{it['name']}", (NodeBase, bpy.types.Node), own))
    for name, bases, fields in wanted:
        if name not in _made:
            made = type(name, bases, {"bl_idname": name, "__module__": __name__, **fields})
            bpy.utils.register_class(made)
            _made[name] = made


def packs() -> list[str]:
    """The packs of nodes that the engine has, in its order."""
    return list(dict.fromkeys(it["pack"] for it in _catalog.values()))


def of_pack(pack: str) -> list[dict[str, Any]]:
    """The nodes of a pack."""
    return [it for it in _catalog.values() if it["pack"] == pack]


def trees() -> list[bpy.types.NodeTree]:
    """All trees of graphs."""
    return [it for it in bpy.data.node_groups if it.bl_idname == MaquetteTree.bl_idname and it.maquette_graph]


def new(path: str, name: str) -> bpy.types.NodeTree:
    """A tree of the graph in a file."""
    tree = bpy.data.node_groups.new(name, MaquetteTree.bl_idname)
    tree.use_fake_user = True
    tree.maquette_graph = path
    return tree


def tick() -> None:
    """Goes on with all trees."""
    global _undone, _looked, _asked
    known = trees()
    if not known or engine.ended():
        return
    if not _catalog:
        if not _asked:
            _asked = True
            engine.client().ask("catalog", _cataloged)
        return
    looks = time.monotonic() - _looked > live.LOOK
    if looks:
        _looked = time.monotonic()
    undone, _undone = _undone, False
    for tree in known:
        state = states.setdefault(key(tree), State())
        if state.busy:
            _undone = _undone or undone
            continue
        path = bpy.path.abspath(tree.maquette_graph)
        if undone and state.outline is not None and tree.maquette_text and tree.maquette_text != state.text:
            _put(tree, state, path)
        elif state.outline is None or (looks and live.stamp(path) != state.stamp):
            _read(tree, state, path)
        elif key(tree) in changed or _is_touched(tree, state):
            changed.discard(key(tree))
            _edit(tree, state, path)


def _cataloged(answer: Answer) -> None:
    global _asked
    _asked = False
    if answer.ok:
        classes(answer["nodes"])


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


def _read(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Shows what stands in the file."""
    stamp = live.stamp(path)

    def then(tree: bpy.types.NodeTree, answer: Answer) -> None:
        state.stamp = stamp
        state.message = answer.why
        if not answer.ok:
            state.outline = state.outline or {"nodes": [], "inputs": [], "params": [], "outputs": [], "types": [], "places": None}
            return
        state.problems = answer.problems
        if answer["outline"] is None:
            # Nothing can be shown of such a text; what is shown stays.
            state.message = answer.problems[0]["message"] if answer.problems else ""
            return
        is_foreign = bool(tree.maquette_text) and tree.maquette_text != answer["text"] and state.outline is not None
        state.outline, state.text = answer["outline"], answer["text"]
        tree.maquette_text = answer["text"]
        if state.keeps:
            state.keeps = False
            changed.add(key(tree))
            return
        rebuild(tree, state)
        if is_foreign:
            _push("Graph file changed")

    _ask(state, key(tree), "outline", then, graph=path)


def _push(message: str) -> None:
    """An undo step: without it the next undo of a user would take a change of the file along."""
    try:
        bpy.ops.ed.undo_push(message=message)
    except RuntimeError:
        # No window, no undo.
        pass


def _put(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """After an undo the file has to say what the tree says, if nobody else has changed it."""

    def then(_tree: bpy.types.NodeTree, answer: Answer) -> None:
        state.outline, state.keeps = None, answer.ok
        if not answer.ok:
            state.message = answer.why

    # What the file says now is read again, and with it what the tree shows beyond its text.
    _ask(state, key(tree), "put", then, graph=path, was=state.text, text=tree.maquette_text)


def _edit(tree: bpy.types.NodeTree, state: State, path: str) -> None:
    """Makes the file what the tree shows; or the tree what the file says."""
    assert state.outline is not None
    now, places = shown(tree)
    changes, waiting = edits.difference(state.outline, now)
    for node, name in zip(now.nodes, places):
        if not node.name:
            lacking = next((port for port, links in node.links.items() if not links), None)
            is_waiting = any(node is it for it in waiting)
            tree.nodes[name].maquette_problem = f"link {lacking}: it is not in the graph yet" if is_waiting and lacking else ""
    if not changes:
        return
    added = [name for node, name in zip(now.nodes, places) if not node.name and not any(node is it for it in waiting)]
    renamed = {node.name: node.title for node in now.nodes if node.name and node.title != node.name}

    def then(tree: bpy.types.NodeTree, answer: Answer) -> None:
        if not answer.ok:
            words = answer.problems[0]["message"] if answer.problems else answer.why
            state.message = words
            _refuse(tree, state, words, changes)
            return
        state.message, state.stamp = "", None
        names = [it["add"]["name"] for it in changes if "add" in it]
        for name, given in zip(added, names):
            if name in tree.nodes:
                tree.nodes[name].maquette_name = given
        for node in tree.nodes:
            own = getattr(node, "maquette_name", "")
            if own in renamed:
                node.maquette_name = renamed[own]
        state.text = tree.maquette_text = answer["text"]

    _ask(state, key(tree), "edit", then, graph=path, edits=changes)


def _refuse(tree: bpy.types.NodeTree, state: State, words: str, changes: list[dict[str, Any]]) -> None:
    """Takes back what the engine refuses, and says why on the nodes."""
    named = set()
    for change in changes:
        for fields in change.values():
            said = fields.get("port") or fields.get("target") or fields.get("name") or fields.get("from", "")
            named.add(said.removeprefix("nodes.").split(".")[0])
    rebuild(tree, state)
    for node in tree.nodes:
        if getattr(node, "maquette_name", "") in named:
            node.maquette_problem = words


def _is_touched(tree: bpy.types.NodeTree, state: State) -> bool:
    """Whether a field or a name was changed, of which nothing tells."""
    fields = {it["name"]: dict(it["fields"]) for it in state.outline["nodes"]} if state.outline else {}
    for node in tree.nodes:
        known = fields.get(getattr(node, "maquette_name", ""))
        if known is None:
            continue
        if title(node) != node.maquette_name or any(text != known.get(name) for name, text in _fields(node, known).items()):
            return True
    return False


def title(node: bpy.types.Node) -> str:
    """What a node is called now."""
    name = str(node.maquette_name)
    return name if node.label in ("", _cut(name)) else str(node.label)


def _cut(name: str) -> str:
    return name.encode()[:LONGEST].decode(errors="ignore")


def _fields(node: bpy.types.Node, known: dict[str, str]) -> dict[str, str]:
    """The fields of a node as RON; that of a number which nobody touched as it is written."""
    found = {}
    for name in [it for it in node.keys() if it.startswith(FIELD)]:
        field, value = name[len(FIELD) :], node[name]
        if isinstance(value, float):
            was = _number(known.get(field, ""))
            is_same = was is not None and panel.single(was) == panel.single(value)
            found[field] = known[field] if is_same else panel.number_text(value)
        elif str(value):
            found[field] = str(value)
    return found


def _number(text: str) -> float | None:
    """The number that a text is, if it is one with a point."""
    try:
        return float(text) if "." in text else None
    except ValueError:
        return None


def _source(link: bpy.types.NodeLink) -> edits.Source | None:
    """Where a link comes from, by way of whatever leads it there."""
    while link.from_node.type == "REROUTE":
        links = link.from_node.inputs[0].links
        if not links:
            return None
        link = links[0]
    node, port = link.from_node, getattr(link.from_socket, "maquette_port", "")
    if node.bl_idname == MaquetteNodeInputs.bl_idname:
        return (port, "")
    return (str(getattr(node, "maquette_name", "")), port)


def _sources(it: bpy.types.NodeSocket) -> list[edits.Source]:
    links = sorted(it.links, key=lambda link: getattr(link, "multi_input_sort_id", 0))
    return [source for link in links if (source := _source(link))]


def _once(links: list[edits.Source]) -> list[edits.Source]:
    return list(dict.fromkeys(links))


def shown(tree: bpy.types.NodeTree) -> tuple[edits.Shown, list[str]]:
    """What a tree shows, and the names of its nodes in Blender."""
    state = states.get(key(tree))
    known = {it["name"]: dict(it["fields"]) for it in state.outline["nodes"]} if state and state.outline else {}
    written = {it.name: it.links for it in edits.shown(state.outline).nodes} if state and state.outline else {}
    there = {it["name"] for section in ("nodes", "inputs") for it in state.outline[section]} if state and state.outline else set()
    nodes, names = [], []
    outputs: dict[str, edits.Source | None] = {}
    for node in tree.nodes:
        if node.bl_idname == MaquetteNodeOutputs.bl_idname:
            for it in node.inputs:
                outputs[it.maquette_port] = next(iter(_sources(it)), None)
        elif isinstance(node, NodeBase) and node.bl_idname != MaquetteNodeInputs.bl_idname:
            name = str(node.maquette_name)
            ports = {it.maquette_port: _sources(it) for it in node.inputs}
            for port, links in written.get(name, {}).items():
                # Blender shows what is linked twice once, and what leads nowhere not at all.
                if ports.get(port) == _once([it for it in links if it[0] in there]):
                    ports[port] = links
            if not name:
                needed = {it["name"] for it in _catalog.get(node.maquette_kind, {"inputs": ()})["inputs"] if not it["optional"]}
                ports = {port: links for port, links in ports.items() if links or port in needed}
            nodes.append(edits.Node(name, str(node.maquette_kind), title(node), ports, _fields(node, known.get(name, {}))))
            names.append(node.name)
    return edits.Shown(nodes, outputs), names


def rebuild(tree: bpy.types.NodeTree, state: State) -> None:
    """Makes a tree by difference what the outline says."""
    outline = state.outline
    assert outline is not None
    known = {it["name"]: it for it in outline["nodes"]}
    types = {it["name"]: it for it in outline["types"]} | _catalog
    have = {node.maquette_name: node for node in tree.nodes if isinstance(node, NodeBase) and node.maquette_name}
    for name, node in list(have.items()):
        if name not in known:
            tree.nodes.remove(node)
            del have[name]
    graph = edits.shown(outline)
    for told, place, node in zip(outline["nodes"], outline["places"]["nodes"], graph.nodes):
        made = have.get(told["name"])
        if made is not None and made.maquette_kind != told["type"]:
            at = tuple(made.location)
            tree.nodes.remove(made)
            made = None
            place = (at[0] / COLUMN, -at[1] / ROW)
        if made is None:
            idname = f"MaquetteNode{told['type']}"
            made = tree.nodes.new(idname if idname in _made else MaquetteNodeOther.bl_idname)
            made.maquette_name, made.maquette_kind = told["name"], told["type"]
            made.location = (place[0] * COLUMN, -place[1] * ROW)
            have[told["name"]] = made
        if made.label != _cut(told["name"]):
            made.label = _cut(told["name"])
        _arrange(made, told, node, types.get(told["type"]))
    fixed = {}
    for base, section, place in (
        (MaquetteNodeInputs, "inputs", outline["places"]["inputs"]),
        (MaquetteNodeOutputs, "outputs", outline["places"]["outputs"]),
    ):
        made = next((it for it in tree.nodes if it.bl_idname == base.bl_idname), None)
        if made is None and outline[section]:
            made = tree.nodes.new(base.bl_idname)
            made.location = (place[0] * COLUMN, -place[1] * ROW)
        if made is not None:
            sockets = made.outputs if section == "inputs" else made.inputs
            kinds = [[it["type"]] if section == "inputs" else [] for it in outline[section]]
            _sockets(sockets, [(it["name"], kind, False) for it, kind in zip(outline[section], kinds)])
        fixed[section] = made
    for node in graph.nodes:
        for it in have[node.name].inputs:
            _link(tree, have, fixed, it, node.links.get(it.maquette_port, []))
    if fixed["outputs"] is not None:
        for it in fixed["outputs"].inputs:
            source = graph.outputs.get(it.maquette_port)
            _link(tree, have, fixed, it, [source] if source else [])
    _frame(tree, outline, have)
    changed.discard(key(tree))


def _frame(tree: bpy.types.NodeTree, outline: dict[str, Any], have: dict[str, Any]) -> None:
    """Nodes of one paragraph whose first one has a comment stand in a frame that says it."""
    titles: dict[int, str] = {}
    for told in outline["nodes"]:
        titles.setdefault(told["paragraph"], told["comment"].replace("\n", " "))
    frames = {it[FRAME]: it for it in tree.nodes if it.type == "FRAME" and FRAME in it.keys()}
    for title, frame in list(frames.items()):
        if title not in titles.values():
            tree.nodes.remove(frame)
            del frames[title]
    for told in outline["nodes"]:
        title = titles[told["paragraph"]]
        node = have[told["name"]]
        if title and title not in frames:
            frame = frames[title] = tree.nodes.new("NodeFrame")
            frame[FRAME], frame.label, frame.label_size = title, _cut(title), 16
        is_ours = node.parent is not None and FRAME in node.parent.keys()
        if title and node.parent != frames[title]:
            node.parent = frames[title]
        elif not title and is_ours:
            node.parent = None


def _arrange(made: bpy.types.Node, told: dict[str, Any], node: edits.Node, kind: dict[str, Any] | None) -> None:
    """Gives a node its sockets and fields."""
    ports = {it["name"]: it for it in kind["inputs"]} if kind else {}
    inputs = [(port, ports.get(port, {}).get("types", []), ports.get(port, {}).get("many", len(links) > 1)) for port, links in node.links.items()]
    _sockets(made.inputs, inputs)
    _sockets(made.outputs, [(it["name"], [it["type"]] if it["type"] else [], False) for it in told["outputs"]])
    for name in [it for it in made.keys() if it.startswith(FIELD) and it[len(FIELD) :] not in node.fields]:
        del made[name]
    now = _fields(made, node.fields)
    for field, text in node.fields.items():
        number = _number(text)
        if now.get(field) != text:
            made[FIELD + field] = text if number is None else number
    if made.maquette_problem:
        made.maquette_problem = ""


def _sockets(sockets: Any, wanted: list[tuple[str, list[str], bool]]) -> None:
    """Makes sockets those that are wanted, in order; those that are right keep their links."""
    if [it.maquette_port for it in sockets] == [port for port, _, _ in wanted]:
        return
    for it in [it for it in sockets if it.maquette_port not in {port for port, _, _ in wanted}]:
        sockets.remove(it)
    for place, (port, types, many) in enumerate(wanted):
        at = next((index for index, it in enumerate(sockets) if it.maquette_port == port), None)
        if at is None:
            socket(sockets, types, port or "value", port, many)
            at = len(sockets) - 1
        if at != place:
            sockets.move(at, place)


def _link(tree: bpy.types.NodeTree, have: dict[str, Any], fixed: dict[str, Any], to: bpy.types.NodeSocket, wanted: list[edits.Source]) -> None:
    """Makes the links of a port those that are wanted, anew if one of them differs: only so is their order kept."""
    if _sources(to) == _once(wanted):
        return
    for link in list(to.links):
        tree.links.remove(link)
    for name, output in wanted:
        node = have.get(name)
        ports = node.outputs if node is not None else fixed["inputs"].outputs if fixed["inputs"] is not None else ()
        port = output if node is not None else name
        source = next((it for it in ports if it.maquette_port == port), None)
        if source is not None:
            tree.links.new(source, to)


@persistent
def _after_undo(*_given: Any) -> None:
    global _undone
    _undone = True
    changed.update(key(it) for it in trees())


@persistent
def _opened(*_given: Any) -> None:
    states.clear()
    changed.clear()


CLASSES = (MaquetteSocket, MaquetteTree, MaquetteNodeOther, MaquetteNodeInputs, MaquetteNodeOutputs)
HANDLERS = {"undo_post": _after_undo, "redo_post": _after_undo, "load_post": _opened}


def register() -> None:
    """Registers trees; the classes of nodes come with the catalog."""
    for it in CLASSES:
        bpy.utils.register_class(it)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    engine.ticks.append(tick)


def unregister() -> None:
    """Unregisters them; files keep what they have of them."""
    global _asked
    engine.ticks.remove(tick)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    for it in [*reversed(_made.values()), *reversed(CLASSES)]:
        bpy.utils.unregister_class(it)
    _made.clear()
    _catalog.clear()
    states.clear()
    changed.clear()
    _asked = False
