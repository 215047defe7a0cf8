"""A tree of nodes beside the graph that it shows: what it says is read from it, and it is made by difference what the graph says."""

from __future__ import annotations

from typing import Any, Iterable

import bpy

from . import edits, nodes

# What a frame that was made of a comment remembers.
FRAME = "maquette_comment"

# The units of node trees: a column of boxes, and a row of one.
COLUMN, ROW = 240.0, 22.0

# Nodes that moved by less, in units of the tree, stand where they stood.
STILL = 0.5

# Where a box stands, in columns and rows.
Spot = tuple[float, float]

# The boxes of all inputs and of all outputs in a list of spots: no node is called so.
INPUTS, OUTPUTS = "/inputs", "/outputs"


def all_inputs(node: bpy.types.Node) -> bool:
    """Whether it has the inputs of the graph."""
    return isinstance(node, nodes.MaquetteNodeInputs)


def all_outputs(node: bpy.types.Node) -> bool:
    """Whether it has the outputs of the graph."""
    return isinstance(node, nodes.MaquetteNodeOutputs)


def is_own(node: bpy.types.Node) -> bool:
    """Whether it is a node of the graph, or will be."""
    return isinstance(node, nodes.NodeBase) and not all_inputs(node) and not all_outputs(node)


def shown(tree: bpy.types.NodeTree, outline: dict[str, Any]) -> tuple[edits.Shown, list[str]]:
    """What a tree shows of a graph, and the names of its nodes in Blender."""
    fields = {it["name"]: dict(it["fields"]) for it in outline["nodes"]}
    written = {it.name: it.links for it in edits.shown(outline).nodes}
    there = {it["name"] for section in ("nodes", "inputs") for it in outline[section]}
    found, names = [], []
    outputs: dict[str, edits.Source | None] = {}
    for node in tree.nodes:
        if all_outputs(node):
            outputs = {it.maquette_port: next(iter(_sources(it)), None) for it in node.inputs}
        elif is_own(node):
            name = str(node.maquette_name)
            ports = {it.maquette_port: _sources(it) for it in node.inputs}
            for port, links in written.get(name, {}).items():
                # Blender shows what is linked twice once, and what leads nowhere not at all.
                if ports.get(port) == _once([it for it in links if it[0] in there]):
                    ports[port] = links
            own = nodes.fields(node, {it: text for it, text in fields.get(name, {}).items() if it not in ports})
            if not name:
                needed = {it["name"] for it in nodes.kinds.get(nodes.kind_of(node), {"inputs": ()})["inputs"] if not it["optional"]}
                ports = {port: links for port, links in ports.items() if links or port in needed}
                own = {it.name: "" for it in nodes.needed(node)} | own
            found.append(edits.Node(name, str(node.maquette_kind), nodes.title(node), ports, own))
            names.append(node.name)
    return edits.Shown(found, outputs), names


def adopt(tree: bpy.types.NodeTree, outline: dict[str, Any]) -> None:
    """Nodes that come from another tree are new here, whatever they were called there."""
    free = {it["name"] for it in outline["nodes"]}
    for node in tree.nodes:
        if is_own(node) and (name := node.maquette_name):
            if name not in free:
                node.maquette_name = ""
            free.discard(name)


def lacks_ends(tree: bpy.types.NodeTree, outline: dict[str, Any]) -> bool:
    """Whether somebody has deleted the node of all inputs, or of all outputs."""
    have = {node.bl_idname for node in tree.nodes}
    ends = ((nodes.MaquetteNodeInputs, "inputs"), (nodes.MaquetteNodeOutputs, "outputs"))
    return any(outline[section] and end.bl_idname not in have for end, section in ends)


def _source(link: bpy.types.NodeLink) -> edits.Source | None:
    """Where a link comes from, by way of whatever leads it there."""
    while link.from_node.type == "REROUTE":
        links = link.from_node.inputs[0].links
        if not links:
            return None
        link = links[0]
    node, port = link.from_node, getattr(link.from_socket, "maquette_port", "")
    return (port, "") if all_inputs(node) else (str(getattr(node, "maquette_name", "")), port)


def _sources(it: bpy.types.NodeSocket) -> list[edits.Source]:
    links = sorted(it.links, key=lambda link: getattr(link, "multi_input_sort_id", 0))
    return [source for link in links if (source := _source(link))]


def _once(links: list[edits.Source]) -> list[edits.Source]:
    return list(dict.fromkeys(links))


def rebuild(tree: bpy.types.NodeTree, outline: dict[str, Any], kept: dict[str, Spot]) -> None:
    """Makes a tree by difference what the outline says; `kept` has the spots of nodes that are new or have been moved by others."""
    known = {it["name"]: it for it in outline["nodes"]}
    used = {it["name"]: it["pack"] for it in outline["types"]}
    have = {node.maquette_name: node for node in tree.nodes if is_own(node) and node.maquette_name}
    for name, node in list(have.items()):
        if name not in known:
            tree.nodes.remove(node)
            del have[name]
    graph = edits.shown(outline)
    for told, place, node in zip(outline["nodes"], outline["places"]["nodes"], graph.nodes):
        name, kind = told["name"], told["type"]
        made = have.get(name)
        if made is not None and made.maquette_kind != kind:
            place = spot(made)
            tree.nodes.remove(made)
            made = None
        if made is None:
            made = have[name] = tree.nodes.new(nodes.class_of(kind))
            made.maquette_name, made.maquette_kind, made.select = name, kind, False
            put(made, kept.get(name, place))
        if made.maquette_graph != used.get(kind, ""):
            made.maquette_graph = used.get(kind, "")
        if made.label != nodes.cut(name):
            made.label = nodes.cut(name)
        _arrange(made, told, node)
    ends = {}
    for base, section, name in (
        (nodes.MaquetteNodeInputs, "inputs", INPUTS),
        (nodes.MaquetteNodeOutputs, "outputs", OUTPUTS),
    ):
        made = next((it for it in tree.nodes if it.bl_idname == base.bl_idname), None)
        if made is None and outline[section]:
            made = tree.nodes.new(base.bl_idname)
            made.select = False
            put(made, kept.get(name, outline["places"][section]))
        if made is not None:
            sockets = made.outputs if section == "inputs" else made.inputs
            _sockets(sockets, [(it["name"], [it["type"]] if section == "inputs" else [], False) for it in outline[section]])
        ends[section] = made
    inputs = ends["inputs"].outputs if ends["inputs"] is not None else ()
    sources = {(it.maquette_port, ""): it for it in inputs}
    sources |= {(name, it.maquette_port): it for name, node in have.items() for it in node.outputs}
    for node in graph.nodes:
        for it in have[node.name].inputs:
            _link(tree, sources, it, node.links.get(it.maquette_port, []))
    if ends["outputs"] is not None:
        for it in ends["outputs"].inputs:
            source = graph.outputs.get(it.maquette_port)
            _link(tree, sources, it, [source] if source else [])
    _frame(tree, outline, have)


def _arrange(made: bpy.types.Node, told: dict[str, Any], node: edits.Node) -> None:
    """Gives a node its sockets and fields."""
    kind = nodes.kinds.get(nodes.kind_of(made))
    ports = {it["name"]: it for it in kind["inputs"]} if kind else {}
    inputs = [(port, ports.get(port, {}).get("types", []), ports.get(port, {}).get("many", len(links) > 1)) for port, links in node.links.items()]
    _sockets(made.inputs, inputs)
    _sockets(made.outputs, [(it["name"], [it["type"]] if it["type"] else [], False) for it in told["outputs"]])
    nodes.put_fields(made, node.fields)
    if made.maquette_problem:
        made.maquette_problem = ""


def _sockets(sockets: Any, wanted: list[tuple[str, list[str], bool]]) -> None:
    """Makes sockets those that are wanted, in order; those that are right keep their links."""
    right = [(port, nodes.socket_class(types)) for port, types, _ in wanted]
    if [(it.maquette_port, it.bl_idname) for it in sockets] == right:
        return
    for it in [it for it in sockets if (it.maquette_port, it.bl_idname) not in right]:
        sockets.remove(it)
    for place, (port, types, many) in enumerate(wanted):
        at = next((index for index, it in enumerate(sockets) if it.maquette_port == port), None)
        if at is None:
            nodes.socket(sockets, types, port or "value", port, many)
            at = len(sockets) - 1
        if at != place:
            sockets.move(at, place)


def _link(tree: bpy.types.NodeTree, sources: dict[edits.Source, Any], to: bpy.types.NodeSocket, wanted: list[edits.Source]) -> None:
    """Makes the links of a port those that are wanted, anew if one of them differs: only so is their order kept."""
    if _sources(to) == _once(wanted):
        return
    for link in list(to.links):
        tree.links.remove(link)
    for source in wanted:
        if source in sources:
            tree.links.new(sources[source], to)


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
            frame[FRAME], frame.label, frame.label_size = title, nodes.cut(title), 16
        is_ours = node.parent is not None and FRAME in node.parent.keys()
        if title and node.parent != frames[title]:
            node.parent = frames[title]
        elif not title and is_ours:
            node.parent = None


def _corner(node: bpy.types.Node | None) -> tuple[float, float]:
    """Where a frame stands in the tree: nodes in it stand relative to it."""
    x = y = 0.0
    while node is not None:
        right, up = node.location
        x, y, node = x + right, y + up, node.parent
    return x, y


def spot(node: bpy.types.Node) -> Spot:
    """Where a node stands."""
    x, y = _corner(node)
    return (x / COLUMN, -y / ROW)


def put(node: bpy.types.Node, place: Iterable[float]) -> None:
    """Puts a node to a place."""
    (column, row), (x, y) = place, _corner(node.parent)
    node.location = (column * COLUMN - x, -row * ROW - y)


def boxes(tree: bpy.types.NodeTree) -> dict[str, bpy.types.Node]:
    """The nodes of the graph by their names in the text, and those of its ends."""
    found = {}
    for node in tree.nodes:
        if all_inputs(node) or all_outputs(node):
            found[INPUTS if all_inputs(node) else OUTPUTS] = node
        elif is_own(node) and (name := node.maquette_name):
            found[name] = node
    return found


def spots(tree: bpy.types.NodeTree) -> dict[str, Spot]:
    """Where all boxes stand."""
    return {name: spot(node) for name, node in boxes(tree).items()}


def have_moved(were: dict[str, Spot], now: dict[str, Spot]) -> bool:
    """Whether one that was known stands elsewhere."""
    return any(
        abs(place[0] - was[0]) * COLUMN > STILL or abs(place[1] - was[1]) * ROW > STILL
        for name, place in now.items()
        if (was := were.get(name)) is not None
    )


def of_layout(layout: dict[str, Any] | None) -> dict[str, Spot]:
    """The spots that a layout has."""
    if not layout:
        return {}
    ends = {INPUTS: layout["inputs"], OUTPUTS: layout["outputs"]}
    return {name: tuple(place) for name, place in {**layout["nodes"], **ends}.items() if place}


def layout(places: dict[str, Spot]) -> dict[str, Any]:
    """The layout that has these spots."""
    return {"inputs": places.get(INPUTS), "nodes": {name: it for name, it in places.items() if name[0] != "/"}, "outputs": places.get(OUTPUTS)}
