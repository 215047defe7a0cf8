"""Builds graphs in Python: converts nodes, links and parameters to the text of a graph file."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any, Dict, List, Tuple, Union

from . import _graph, _params

if TYPE_CHECKING:
    from ._graph import Graph
    from ._run import Path


class Call:
    """A named value of a graph file, with or without fields or items: `ron.Box(size=(1, 2, 3))`, `ron.At(0, 0)`, `ron.Loop`."""

    def __init__(self, name: str, items: Tuple[Any, ...] = (), fields: Union[Dict[str, Any], None] = None) -> None:
        self._name, self._items, self._fields = name, items, fields

    def __call__(self, *items: Any, **fields: Any) -> Call:
        """The value with these items or fields; a field whose name is a Python keyword has a trailing underscore."""
        if items and fields:
            raise TypeError(f"{self._name} takes values in order or by name, not both")
        return Call(self._name, items, {name.rstrip("_"): field for name, field in fields.items()})

    def __repr__(self) -> str:
        """The text in a graph file."""
        if self._fields is None:
            return self._name
        items = [_text(item) for item in self._items]
        return f"{self._name}({', '.join([*items, *_fields(self._fields)])})"


class _Words:
    """Names of graph files as attributes: node types, choices and kinds of parameters."""

    def __getattr__(self, name: str) -> Call:
        """The value with this name."""
        if not re.fullmatch("[A-Z][A-Za-z0-9]*", name):
            raise AttributeError(f"words of graph files begin with a capital letter, as Box; found {name}")
        return Call(name)


ron = _Words()
"""Values of graph files by name: `ron.Subdivide(mesh=cage, scheme=ron.Loop, levels=2)`."""


class Link:
    """A link to the first output of a node, to a named output, `scan["range"]`, or to an input of the graph."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getitem__(self, output: str) -> Link:
        """A link to the output with this name."""
        return Link(f"{self._name}.{output}")

    def __repr__(self) -> str:
        """The text in a graph file."""
        return _quote(self._name)


class GraphBuilder:
    """Builds the text of a graph: parameters, inputs, nodes and outputs, in any order.

        build = maquette.GraphBuilder(doc="A smooth box.")
        levels = build.param("levels", ron.Integer(default=1, min=0, max=4, doc="How often faces are divided."))
        box = build.node("box", ron.Primitive(shape=ron.Box(size=(10, 20, 30))))
        build.output("skin.ply", build.node("skin", ron.Subdivide(mesh=box, scheme=ron.DooSabin, levels=levels)))
        run = build.load().run(levels=2)
    """

    def __init__(self, doc: str = "") -> None:
        self._doc = doc
        self._parts: Dict[str, Dict[str, str]] = {"inputs": {}, "params": {}, "nodes": {}, "outputs": {}}

    def param(self, name: str, kind: Call) -> Call:
        """Declares a parameter, `ron.Number(default=12.0, min=0.0, max=40.0, unit="mm", doc="..")`; returns a reference to its value."""
        self._put("params", name, kind)
        return Call("Param", (name,), {})

    def input(self, name: str, kind: str, doc: str = "") -> Link:
        """Declares an input of a value type, such as `Mesh`."""
        self._put("inputs", name, Call(kind, (), {"doc": doc}))
        return Link(name)

    def node(self, name: str, node: Call) -> Link:
        """Adds a node; `maquette.nodes()` lists the types."""
        self._put("nodes", name, node)
        return Link(name)

    def output(self, name: str, of: Union[Link, str]) -> None:
        """Declares an output: a file, or a value of a graph with inputs."""
        self._put("outputs", name, of)

    def _put(self, part: str, name: str, given: Any) -> None:
        if name in self._parts[part]:
            raise ValueError(f"there is already `{name}` among the {part}")
        self._parts[part][name] = _text(given)

    @property
    def text(self) -> str:
        """The text of the graph file."""
        lines = ["Graph(", "    format: 1,"]
        if self._doc:
            lines.append(f"    doc: {_quote(self._doc)},")
        for part, entries in self._parts.items():
            if entries or part in ("nodes", "outputs"):
                inner = "".join(f"        {_quote(name)}: {text},\n" for name, text in entries.items())
                lines.append(f"    {part}: {{\n{inner}    }}," if entries else f"    {part}: {{}},")
        return "\n".join([*lines, ")", ""])

    def load(self, path: Path = "graph.ron", **options: Any) -> Graph:
        """Checks the graph, with the options of `maquette.load`. Nothing is written; paths in the graph are relative to `path`."""
        return _graph.load(path, text=self.text, **options)


def _fields(fields: Dict[str, Any]) -> List[str]:
    return [f"{name}: {_text(field)}" for name, field in fields.items()]


def _quote(text: str) -> str:
    """Formats a string for a graph file."""
    _params.check_text("text", text)
    return json.dumps(text, ensure_ascii=False)


def _text(given: Any) -> str:
    """Formats a value for a graph file."""
    if hasattr(given, "tolist"):
        given = given.tolist()
    if given is None:
        return "None"
    if isinstance(given, bool):
        return "true" if given else "false"
    if isinstance(given, (Call, Link)):
        return repr(given)
    if isinstance(given, (int, float)):
        if given != given or given in (float("inf"), float("-inf")):
            raise ValueError(f"a graph file holds finite numbers, found {given}")
        return repr(given)
    if isinstance(given, str):
        return _quote(given)
    if isinstance(given, tuple):
        return f"({', '.join(map(_text, given))})"
    if isinstance(given, list):
        return f"[{', '.join(map(_text, given))}]"
    if isinstance(given, dict):
        return "{" + ", ".join(f"{_text(name)}: {_text(item)}" for name, item in given.items()) + "}"
    raise TypeError(f"a graph file holds no {type(given).__name__}; expected a number, text, list, dict, link or word of `ron`")
