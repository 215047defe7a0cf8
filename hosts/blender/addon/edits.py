"""A graph as nodes with sockets, and the edits of its text that a user's changes of the nodes require. Does not use Blender.

The text is authoritative: nodes are created from the engine's `outline`, a user changes them, and the differences become edits of the text,
which the engine applies or refuses (docs/serve.md).
"""

from __future__ import annotations

import dataclasses
from typing import Any, Iterable, Iterator

# The source of a link: node and output.
Source = tuple[str, str]


@dataclasses.dataclass
class Node:
    """A node as the editor shows it."""

    # Its name in the text; empty if it is not in the text yet.
    name: str
    kind: str
    # Its name in the editor; if it differs from `name`, the user wants to rename it.
    title: str
    # The links of each port, in order. The names of ports within lists and choices are paths.
    links: dict[str, list[Source]] = dataclasses.field(default_factory=dict)
    # The fields other than links, as RON.
    fields: dict[str, str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass
class GraphView:
    """A graph as the editor shows it."""

    nodes: list[Node]
    # The source of each output of the graph.
    outputs: dict[str, Source | None]

    def node(self, name: str) -> Node:
        """Returns the node with this name in the text."""
        return next(it for it in self.nodes if it.name == name)


def view_of(outline: dict[str, Any]) -> GraphView:
    """Returns the view of an outline."""
    nodes = []
    for entry in outline["nodes"]:
        node = Node(entry["name"], entry["type"], entry["name"])
        for port, links in _ports(entry).items():
            node.links[port] = [(it["node"], it["output"]) for it in links]
        node.fields = {name: text for name, text in entry["fields"] if name not in node.links}
        nodes.append(node)
    outputs = {it["name"]: _source(it["link"]) for it in outline["outputs"]}
    return GraphView(nodes, outputs)


def _source(link: dict[str, Any] | None) -> Source | None:
    return (link["node"], link["output"]) if link else None


def _ports(entry: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Groups the links of a node by port: `images.0` and `images.1` belong to `images`."""
    ports: dict[str, list[dict[str, Any]]] = {it: [] for it in entry["ports"] if entry["type"] != "ForEach"}
    for link in entry["links"]:
        way, _, last = link["port"].rpartition(".")
        ports.setdefault(way if way and last.isdecimal() else link["port"], []).append(link)
    return ports


def difference(outline: dict[str, Any], now: GraphView) -> tuple[list[dict[str, Any]], list[Node]]:
    """Returns the edits that bring the text to the view, and the new nodes that are not in the text yet, since they lack required links."""
    known = {it["name"]: it for it in outline["nodes"]}
    there = {it.name for it in now.nodes}
    gone = known.keys() - there
    edits: list[dict[str, Any]] = [{"remove": {"name": it, "and_links": True}} for it in known if it in gone]
    names = _Names(outline, now)
    waiting = []
    for node in now.nodes:
        if node.name:
            continue
        if missing_part(node):
            waiting.append(node)
            continue
        texts = {port: [names.link(it) for it in links] for port, links in node.links.items()}
        if any(None in links for links in texts.values()):
            # It depends on another node that is not in the text yet.
            waiting.append(node)
            continue
        links = [(port, _value(links)) for port, links in texts.items()]
        edits.append({"add": {"name": names.new_name(node), "node": node.kind, "fields": [*links, *node.fields.items()]}})
    for node in now.nodes:
        if node.name in known:
            edits += _node_edits(known[node.name], node, gone, names)
    for entry in outline["outputs"]:
        name, was = entry["name"], _source(entry["link"])
        if name not in now.outputs:
            if not was or was[0] not in gone:
                edits.append({"output": {"name": name, "to": None}})
        elif now.outputs[name] != was and (to := now.outputs[name]) and (link := names.link(to)):
            edits.append({"output": {"name": name, "to": link}})
    given = {it["name"] for it in outline["outputs"]}
    for name, to in now.outputs.items():
        if name not in given and to and (link := names.link(to)):
            edits.append({"output": {"name": name, "to": link}})
    # Renames come last: all other edits use the old names.
    edits += [{"rename": {"from": f"nodes.{it.name}", "to": it.title}} for it in now.nodes if it.name in known and it.title != it.name]
    return edits, waiting


def missing_part(node: Node) -> str:
    """Returns what the user must do before a new node can be written into the text; empty if nothing."""
    ports = (f"link {port}" for port, links in node.links.items() if not links)
    fields = (f"set {field}" for field, text in node.fields.items() if not text)
    return next(ports, "") or next(fields, "")


def is_same(one: GraphView, other: GraphView) -> bool:
    """Returns true if both views are equal, regardless of the order of nodes."""

    def sorted_nodes(it: GraphView) -> list[Node]:
        return sorted(it.nodes, key=lambda node: (node.name, node.kind, str(node)))

    return one.outputs == other.outputs and sorted_nodes(one) == sorted_nodes(other)


def without_refused(now: GraphView, refused: list[Node]) -> tuple[GraphView, list[Node]]:
    """Returns the view without the new nodes that the engine has refused and that are unchanged since, and these nodes."""
    known = [node for node in now.nodes if not node.name and node in refused]
    return GraphView([node for node in now.nodes if not any(node is it for it in known)], now.outputs), known


def _value(links: Iterable[str | None]) -> str:
    texts = [f'"{it}"' for it in links]
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"


class _Names:
    """The names of nodes and links in the text."""

    def __init__(self, outline: dict[str, Any], now: GraphView) -> None:
        self.first = {it["name"]: (it["outputs"][0]["name"] if it["outputs"] else "") for it in outline["nodes"]}
        self.taken = {it["name"] for section in ("nodes", "inputs", "params") for it in outline[section]}
        self.inputs = {it["name"] for it in outline["inputs"]}
        self.new: dict[int, str] = {}

    def new_name(self, node: Node) -> str:
        """Chooses the name of a new node: its title or its type, with a number if that is taken."""
        wish = node.title or "".join(f"-{it.lower()}" if it.isupper() else it for it in node.kind).strip("-")
        name, number = wish, 2
        while name in self.taken:
            name, number = f"{wish}-{number}", number + 1
        self.taken.add(name)
        return name

    def link(self, source: Source) -> str | None:
        """Returns the text of a link to a source; None if the source is not in the text."""
        node, output = source
        if node in self.inputs:
            return node
        if node not in self.first:
            return None
        return node if output in ("", self.first[node]) else f"{node}.{output}"


def _node_edits(entry: dict[str, Any], node: Node, gone: Iterable[str], names: _Names) -> Iterator[dict[str, Any]]:
    for field, text in entry["fields"]:
        if field in node.fields and node.fields[field] != text:
            yield {"set": {"target": f"{node.name}.{field}", "value": node.fields[field]}}
    written = {field for field, _ in entry["fields"]}
    for field, text in node.fields.items():
        if field not in written:
            yield {"set": {"target": f"{node.name}.{field}", "value": text}}
    for port, links in _ports(entry).items():
        was = [(it["node"], it["output"]) for it in links if it["node"] not in gone]
        # A single link of a port that takes many may be written without brackets.
        is_list = any(it["port"] != port for it in links)
        yield from _port_edits(f"{node.name}.{port}", was, node.links.get(port, []), is_list, names)


def _port_edits(port: str, was: list[Source], now: list[Source], is_list: bool, names: _Names) -> Iterator[dict[str, Any]]:
    if was == now:
        return
    if not now:
        yield {"unlink": {"port": port}}
        return
    for place, source in enumerate(now):
        link = names.link(source)
        if link is None or (place < len(was) and was[place] == source):
            continue
        # At a port that takes many, a link without a number is appended.
        numbered = f"{port}.{place}" if place < len(was) and (is_list or len(now) > 1) else port
        yield {"link": {"port": numbered, "to": link}}
    for place in reversed(range(len(now), len(was))):
        yield {"unlink": {"port": f"{port}.{place}"}}
