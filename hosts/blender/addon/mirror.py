"""Converts between Blender's node trees and views of graphs: reads a tree, and updates a tree to an outline by its differences."""

from __future__ import annotations

from typing import Any, Iterable

import bpy

from . import edits, nodes

# Custom property of a frame with the comment that it was made of.
FRAME = "maquette_comment"

# The width of a column and the height of a row of the layout, in units of Blender's node trees.
COLUMN, ROW = 240.0, 22.0

# Smaller moves, in units of the tree, are ignored.
MIN_MOVE = 0.5

# The position of a box, in columns and rows.
Spot = tuple[float, float]

# The names of the boxes of all inputs and all outputs in spots; no node can have these names.
INPUTS, OUTPUTS = "/inputs", "/outputs"


def is_inputs_node(node: bpy.types.Node) -> bool:
    """Returns true for the node with all inputs of the graph."""
    return isinstance(node, nodes.MaquetteNodeInputs)


def is_outputs_node(node: bpy.types.Node) -> bool:
    """Returns true for the node with all outputs of the graph."""
    return isinstance(node, nodes.MaquetteNodeOutputs)


def is_own(node: bpy.types.Node) -> bool:
    """Returns true if the node is a node of the graph, or a new one that is not in the text yet."""
    return isinstance(node, nodes.NodeBase) and not is_inputs_node(node) and not is_outputs_node(node)


def read_tree(tree: bpy.types.NodeTree, outline: dict[str, Any]) -> tuple[edits.GraphView, list[str]]:
    """Returns the view of a graph that a tree shows, and the names of its nodes in Blender."""
    fields = {it["name"]: dict(it["fields"]) for it in outline["nodes"]}
    written = {it.name: it.links for it in edits.view_of(outline).nodes}
    there = {it["name"] for section in ("nodes", "inputs") for it in outline[section]}
    found, names = [], []
    outputs: dict[str, edits.Source | None] = {}
    for node in tree.nodes:
        if is_outputs_node(node):
            outputs = {it.maquette_port: next(iter(_sources(it)), None) for it in node.inputs}
        elif is_own(node):
            name = str(node.maquette_name)
            ports = {it.maquette_port: _sources(it) for it in node.inputs}
            for port, links in written.get(name, {}).items():
                # Blender merges double links and does not show links to missing nodes: take the written ones if they look the same.
                if ports.get(port) == _unique([it for it in links if it[0] in there]):
                    ports[port] = links
            own = nodes.fields(node, {it: text for it, text in fields.get(name, {}).items() if it not in ports})
            if not name:
                needed = {it["name"] for it in nodes.kinds.get(nodes.kind_of(node), {"inputs": ()})["inputs"] if not it["optional"]}
                ports = {port: links for port, links in ports.items() if links or port in needed}
                own = {it.name: "" for it in nodes.needed(node)} | own
            found.append(edits.Node(name, str(node.maquette_kind), nodes.title(node), ports, own))
            names.append(node.name)
    return edits.GraphView(found, outputs), names


def adopt(tree: bpy.types.NodeTree, outline: dict[str, Any]) -> None:
    """Treats nodes that were pasted from another tree as new ones."""
    free = {it["name"] for it in outline["nodes"]}
    for node in tree.nodes:
        if is_own(node) and (name := node.maquette_name):
            if name not in free:
                node.maquette_name = ""
            free.discard(name)


def lacks_ends(tree: bpy.types.NodeTree, outline: dict[str, Any]) -> bool:
    """Returns true if the user has deleted the node of all inputs or of all outputs."""
    have = {node.bl_idname for node in tree.nodes}
    ends = ((nodes.MaquetteNodeInputs, "inputs"), (nodes.MaquetteNodeOutputs, "outputs"))
    return any(outline[section] and end.bl_idname not in have for end, section in ends)


def _source(link: bpy.types.NodeLink) -> edits.Source | None:
    """The source of a link, through reroute nodes."""
    while link.from_node.type == "REROUTE":
        links = link.from_node.inputs[0].links
        if not links:
            return None
        link = links[0]
    node, port = link.from_node, getattr(link.from_socket, "maquette_port", "")
    return (port, "") if is_inputs_node(node) else (str(getattr(node, "maquette_name", "")), port)


def _sources(it: bpy.types.NodeSocket) -> list[edits.Source]:
    links = sorted(it.links, key=lambda link: getattr(link, "multi_input_sort_id", 0))
    return [source for link in links if (source := _source(link))]


def _unique(links: list[edits.Source]) -> list[edits.Source]:
    return list(dict.fromkeys(links))


def rebuild(tree: bpy.types.NodeTree, outline: dict[str, Any], kept: dict[str, Spot]) -> None:
    """Updates a tree to an outline. `kept` has the positions of nodes that are new or were moved externally."""
    known = {it["name"]: it for it in outline["nodes"]}
    used = {it["name"]: it["pack"] for it in outline["types"]}
    have = {node.maquette_name: node for node in tree.nodes if is_own(node) and node.maquette_name}
    for name, node in list(have.items()):
        if name not in known:
            tree.nodes.remove(node)
            del have[name]
    graph = edits.view_of(outline)
    for entry, place, node in zip(outline["nodes"], outline["places"]["nodes"], graph.nodes):
        name, kind = entry["name"], entry["type"]
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
        if made.label != nodes.truncate(name):
            made.label = nodes.truncate(name)
        _arrange(made, entry, node)
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


def _arrange(made: bpy.types.Node, entry: dict[str, Any], node: edits.Node) -> None:
    """Updates the sockets and fields of a node."""
    kind = nodes.kinds.get(nodes.kind_of(made))
    ports = {it["name"]: it for it in kind["inputs"]} if kind else {}
    inputs = [(port, ports.get(port, {}).get("types", []), ports.get(port, {}).get("many", len(links) > 1)) for port, links in node.links.items()]
    _sockets(made.inputs, inputs)
    _sockets(made.outputs, [(it["name"], [it["type"]] if it["type"] else [], False) for it in entry["outputs"]])
    nodes.put_fields(made, node.fields)
    if made.maquette_problem:
        made.maquette_problem = ""


def _sockets(sockets: Any, wanted: list[tuple[str, list[str], bool]]) -> None:
    """Updates a list of sockets; sockets that are unchanged keep their links."""
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
    """Updates the links of a port. If one differs, all are created again, since that is the only way to set their order."""
    if _sources(to) == _unique(wanted):
        return
    for link in list(to.links):
        tree.links.remove(link)
    for source in wanted:
        if source in sources:
            tree.links.new(sources[source], to)


def _frame(tree: bpy.types.NodeTree, outline: dict[str, Any], have: dict[str, Any]) -> None:
    """Puts the nodes of each paragraph whose first node has a comment into a frame with this comment."""
    titles: dict[int, str] = {}
    for entry in outline["nodes"]:
        titles.setdefault(entry["paragraph"], entry["comment"].replace("\n", " "))
    frames = {it[FRAME]: it for it in tree.nodes if it.type == "FRAME" and FRAME in it.keys()}
    for title, frame in list(frames.items()):
        if title not in titles.values():
            tree.nodes.remove(frame)
            del frames[title]
    for entry in outline["nodes"]:
        title = titles[entry["paragraph"]]
        node = have[entry["name"]]
        if title and title not in frames:
            frame = frames[title] = tree.nodes.new("NodeFrame")
            frame[FRAME], frame.label, frame.label_size = title, nodes.truncate(title), 16
        is_ours = node.parent is not None and FRAME in node.parent.keys()
        if title and node.parent != frames[title]:
            node.parent = frames[title]
        elif not title and is_ours:
            node.parent = None


def _corner(node: bpy.types.Node | None) -> tuple[float, float]:
    """The position of a node or frame in the tree; Blender stores it relative to the parent frame."""
    x = y = 0.0
    while node is not None:
        right, up = node.location
        x, y, node = x + right, y + up, node.parent
    return x, y


def spot(node: bpy.types.Node) -> Spot:
    """The position of a node, in columns and rows."""
    x, y = _corner(node)
    return (x / COLUMN, -y / ROW)


def put(node: bpy.types.Node, place: Iterable[float]) -> None:
    """Moves a node to a position."""
    (column, row), (x, y) = place, _corner(node.parent)
    node.location = (column * COLUMN - x, -row * ROW - y)


def boxes(tree: bpy.types.NodeTree) -> dict[str, bpy.types.Node]:
    """The nodes of the graph by their names in the text, and the nodes of all inputs and all outputs."""
    found = {}
    for node in tree.nodes:
        if is_inputs_node(node) or is_outputs_node(node):
            found[INPUTS if is_inputs_node(node) else OUTPUTS] = node
        elif is_own(node) and (name := node.maquette_name):
            found[name] = node
    return found


def spots(tree: bpy.types.NodeTree) -> dict[str, Spot]:
    """The positions of all boxes."""
    return {name: spot(node) for name, node in boxes(tree).items()}


def have_moved(were: dict[str, Spot], now: dict[str, Spot]) -> bool:
    """Returns true if a known box has moved."""
    return any(
        abs(place[0] - was[0]) * COLUMN > MIN_MOVE or abs(place[1] - was[1]) * ROW > MIN_MOVE
        for name, place in now.items()
        if (was := were.get(name)) is not None
    )


def layout_spots(layout: dict[str, Any] | None) -> dict[str, Spot]:
    """Converts a layout of the engine to positions by name."""
    if not layout:
        return {}
    ends = {INPUTS: layout["inputs"], OUTPUTS: layout["outputs"]}
    return {name: tuple(place) for name, place in {**layout["nodes"], **ends}.items() if place}


def layout(places: dict[str, Spot]) -> dict[str, Any]:
    """Converts positions by name to a layout of the engine."""
    return {"inputs": places.get(INPUTS), "nodes": {name: it for name, it in places.items() if name[0] != "/"}, "outputs": places.get(OUTPUTS)}
