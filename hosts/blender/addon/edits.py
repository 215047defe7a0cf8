"""A graph as nodes with sockets, and the edits of its text that make it what the nodes show. Nothing of Blender is here.

The text stays the truth: nodes are made of the engine's `outline`, a user changes them, and what differs becomes edits of the text, which the
engine makes or refuses (docs/serve.md).
"""

from __future__ import annotations

import dataclasses
from typing import Any, Iterable, Iterator

# Where a link comes from: node and output.
Source = tuple[str, str]


@dataclasses.dataclass
class Node:
    """A node as it is shown."""

    # Its name in the text; empty if it is not there yet.
    name: str
    kind: str
    # What it is called now: another name than that in the text is a wish.
    title: str
    # The links of each port in their order; those of ports within lists and choices have the way there as their name.
    links: dict[str, list[Source]] = dataclasses.field(default_factory=dict)
    # The fields that hold no link alone, as RON.
    fields: dict[str, str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass
class Shown:
    """A graph as it is shown."""

    nodes: list[Node]
    # What each output of the graph gives.
    outputs: dict[str, Source | None]

    def named(self, name: str) -> Node:
        """The node of this name in the text."""
        return next(it for it in self.nodes if it.name == name)


def shown(outline: dict[str, Any]) -> Shown:
    """What an outline is shown as."""
    nodes = []
    for told in outline["nodes"]:
        node = Node(told["name"], told["type"], told["name"])
        for port, links in _ports(told).items():
            node.links[port] = [(it["node"], it["output"]) for it in links]
        node.fields = {name: text for name, text in told["fields"] if name not in node.links}
        nodes.append(node)
    outputs = {it["name"]: _source(it["link"]) for it in outline["outputs"]}
    return Shown(nodes, outputs)


def _source(link: dict[str, Any] | None) -> Source | None:
    return (link["node"], link["output"]) if link else None


def _ports(told: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """The links of a node by the ports that hold them: `images.0` and `images.1` are of `images`."""
    ports: dict[str, list[dict[str, Any]]] = {it: [] for it in told["ports"] if told["type"] != "ForEach"}
    for link in told["links"]:
        way, _, last = link["port"].rpartition(".")
        ports.setdefault(way if way and last.isdecimal() else link["port"], []).append(link)
    return ports


def difference(outline: dict[str, Any], now: Shown) -> tuple[list[dict[str, Any]], list[Node]]:
    """The edits that make the text what is shown, and the new nodes that wait for links which they must have: they are not in the text yet."""
    known = {it["name"]: it for it in outline["nodes"]}
    there = {it.name for it in now.nodes}
    gone = known.keys() - there
    edits: list[dict[str, Any]] = [{"remove": {"name": it, "and_links": True}} for it in known if it in gone]
    names = _Names(outline, now)
    waiting = []
    for node in now.nodes:
        if node.name:
            continue
        if lacking(node):
            waiting.append(node)
            continue
        texts = {port: [names.link(it) for it in links] for port, links in node.links.items()}
        if any(None in links for links in texts.values()):
            # It hangs on another one that waits.
            waiting.append(node)
            continue
        links = [(port, _value(links)) for port, links in texts.items()]
        edits.append({"add": {"name": names.of(node), "node": node.kind, "fields": [*links, *node.fields.items()]}})
    for node in now.nodes:
        if node.name in known:
            edits += _node_edits(known[node.name], node, gone, names)
    for told in outline["outputs"]:
        name, was = told["name"], _source(told["link"])
        if name not in now.outputs:
            if not was or was[0] not in gone:
                edits.append({"output": {"name": name, "to": None}})
        elif now.outputs[name] != was and (to := now.outputs[name]) and (link := names.link(to)):
            edits.append({"output": {"name": name, "to": link}})
    given = {it["name"] for it in outline["outputs"]}
    for name, to in now.outputs.items():
        if name not in given and to and (link := names.link(to)):
            edits.append({"output": {"name": name, "to": link}})
    # Names come last: all that is above says the old ones.
    edits += [{"rename": {"from": f"nodes.{it.name}", "to": it.title}} for it in now.nodes if it.name in known and it.title != it.name]
    return edits, waiting


def lacking(node: Node) -> str:
    """What a new node needs before it can stand in the text, in words; empty if nothing."""
    ports = (f"link {port}" for port, links in node.links.items() if not links)
    fields = (f"say {field}" for field, text in node.fields.items() if not text)
    return next(ports, "") or next(fields, "")


def is_same(one: Shown, other: Shown) -> bool:
    """Whether both show the same, in whatever order nodes lie on each other."""

    def sorted_nodes(it: Shown) -> list[Node]:
        return sorted(it.nodes, key=lambda node: (node.name, node.kind, str(node)))

    return one.outputs == other.outputs and sorted_nodes(one) == sorted_nodes(other)


def without(now: Shown, refused: list[Node]) -> tuple[Shown, list[Node]]:
    """What is shown without the new nodes that were refused as they are, and these."""
    known = [node for node in now.nodes if not node.name and node in refused]
    return Shown([node for node in now.nodes if not any(node is it for it in known)], now.outputs), known


def _value(links: Iterable[str | None]) -> str:
    texts = [f'"{it}"' for it in links]
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"


class _Names:
    """How links name what they come from."""

    def __init__(self, outline: dict[str, Any], now: Shown) -> None:
        self.first = {it["name"]: (it["outputs"][0]["name"] if it["outputs"] else "") for it in outline["nodes"]}
        self.taken = {it["name"] for section in ("nodes", "inputs", "params") for it in outline[section]}
        self.inputs = {it["name"] for it in outline["inputs"]}
        self.new: dict[int, str] = {}

    def of(self, node: Node) -> str:
        """A name for a new node: its wish, or its type, with a number if that is taken."""
        wish = node.title or "".join(f"-{it.lower()}" if it.isupper() else it for it in node.kind).strip("-")
        name, number = wish, 2
        while name in self.taken:
            name, number = f"{wish}-{number}", number + 1
        self.taken.add(name)
        return name

    def link(self, source: Source) -> str | None:
        """What a link to it says; None if it is not in the text."""
        node, output = source
        if node in self.inputs:
            return node
        if node not in self.first:
            return None
        return node if output in ("", self.first[node]) else f"{node}.{output}"


def _node_edits(told: dict[str, Any], node: Node, gone: Iterable[str], names: _Names) -> Iterator[dict[str, Any]]:
    for field, text in told["fields"]:
        if field in node.fields and node.fields[field] != text:
            yield {"set": {"target": f"{node.name}.{field}", "value": node.fields[field]}}
    written = {field for field, _ in told["fields"]}
    for field, text in node.fields.items():
        if field not in written:
            yield {"set": {"target": f"{node.name}.{field}", "value": text}}
    for port, links in _ports(told).items():
        was = [(it["node"], it["output"]) for it in links if it["node"] not in gone]
        # A link alone at a port that takes many may have no brackets around it.
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
        # At a port that takes many, a link without a number is one more.
        numbered = f"{port}.{place}" if place < len(was) and (is_list or len(now) > 1) else port
        yield {"link": {"port": numbered, "to": link}}
    for place in reversed(range(len(now), len(was))):
        yield {"unlink": {"port": f"{port}.{place}"}}
