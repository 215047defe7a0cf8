"""What comes of a run, and how far it is."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Callable, Dict, Iterator, List, NamedTuple, Optional, Tuple, Type, TypeVar, Union

from . import _maquette
from ._problems import GraphError, Problem, problems, warning_of
from ._value import Value, wrap

if TYPE_CHECKING:
    from ._graph import Graph

Path = Union[str, "os.PathLike[str]"]

V = TypeVar("V", bound=Value)


class Node(NamedTuple):
    """What happened to a node in a run, and why."""

    name: str
    """Its name in the graph."""
    node: str
    """Its type, such as `Threshold`."""
    state: str
    """`cached`, `equal` (not run, since its inputs came out the same), `computed`, `failed` or `skipped`."""
    reason: str
    """Why, in words."""
    seconds: float
    """How long it ran; 0 if it did not."""
    bytes: int
    """How much memory its results hold."""
    warnings: List[str]
    """Its doubts about the results."""
    unchanged: bool = False
    """Whether it ran and gave the same as last time."""


class WrittenFile(NamedTuple):
    """A file that `Run.write` wrote, or left alone because it was right."""

    name: str
    """The output."""
    path: str
    """Where it is."""
    bytes: int
    """Its size."""
    hash: str
    """The hash of its content."""


class Progress(NamedTuple):
    """How far a run is."""

    node: str
    """The node that something is told of; empty for nodes that need not be looked at."""
    state: str
    """`started`, `progress`, or what became of it: `computed`, `cached`, `equal`, `failed`, `skipped`."""
    share: float
    """How much of the node is done, 0 to 1."""
    done: int
    """How many nodes are done."""
    total: int
    """How many nodes the graph has; a run may need fewer."""


class Asked(NamedTuple):
    """What was asked of a run, and what was known before it."""

    outputs: Optional[List[str]]
    nodes: List[str]
    is_draft: bool
    checked: List[Problem]
    files: List[str]


class Run(Mapping[str, Value]):
    """What a run of a graph gave: `run["model.glb"]` is the value of an output, a node or an output of a node.

    It is a mapping of what was asked for and did not fail, outputs and then nodes: `for name, value in run.items()`. By name it has all else
    that was found on the way, too.
    """

    def __init__(self, graph: Graph, found: _maquette.Finished, asked: Asked) -> None:
        self._graph, self._found, self._asked = graph, found, asked

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def graph(self) -> Graph:
        """The graph that was run."""
        return self._graph

    def __getitem__(self, name: str) -> Value:
        """The value of an output, a node (its first output) or an output of a node. Raises KeyError if it was not asked for or failed."""
        found = self._found.value(name)
        if found is None:
            known = self._graph.nodes
            is_node = name.split(".")[0] in known
            hint = f'run(nodes=["{name}"]) asks for it, unless it failed' if is_node else "there is no such output or node"
            raise KeyError(f"no value `{name}`: {hint}")
        return wrap(found)

    def value(self, name: str, kind: Type[V]) -> V:
        """The same as a value of this class, `run.value("model.glb", maquette.Mesh)`, as checkers of types want it. Raises TypeError if it is
        of another one."""
        value = self[name]
        if not isinstance(value, kind):
            raise TypeError(f"`{name}` is a {value.kind}; expected a {kind.__name__}")
        return value

    def __contains__(self, name: object) -> bool:
        """Whether there is a value of this name."""
        return isinstance(name, str) and self._found.value(name) is not None

    def __iter__(self) -> Iterator[str]:
        """The names of what was asked for and did not fail."""
        outputs = self._graph.outputs if self._asked.outputs is None else self._asked.outputs
        return (name for name in dict.fromkeys([*outputs, *self._asked.nodes]) if name in self)

    def __len__(self) -> int:
        """The number of values that were asked for and did not fail."""
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        """True, even if nothing came of it."""
        return True

    @property
    def trace(self) -> List[Node]:
        """What happened to each node, and why, each after those that it hangs on."""
        return [Node(**node) for node in self._found.trace()]

    @property
    def problems(self) -> List[Problem]:
        """What is to be doubted of the graph, what failed, what nodes warn of, and what the graph expects that does not hold."""
        found = problems(self._found.problems())
        known = {problem._replace(severity="", text="") for problem in found}
        checked = [it for it in self._asked.checked if it._replace(severity="", text="") not in known]
        return checked + found

    def write(self, folder: Optional[Path] = None, *, provenance: bool = True) -> List[WrittenFile]:
        """Writes the outputs that were asked for to a folder, as `maquette run` does; a file that is right is left alone. If no folder is named,
        it is `out/GRAPH`, or `out/GRAPH-draft` after `run(draft=True)`. `provenance`: whether files tell of the graph, the parameters and the
        files that they were made of.

        What a file cannot tell of its value is a GraphWarning. Raises GraphError if a file cannot be written; what was there stays.
        """
        asked = self._asked
        if asked.outputs is not None and not asked.outputs:
            return []
        written, found = self._found.write(
            folder, self._graph.path, asked.is_draft, asked.outputs or [], provenance, asked.files
        )
        told = problems(found)
        if any(problem.severity == "error" for problem in told):
            raise GraphError(told, self)
        for problem in told:
            warnings.warn(warning_of(problem), stacklevel=2)
        return [WrittenFile(**file) for file in written]

    def __repr__(self) -> str:
        states: Dict[str, int] = {}
        for node in self.trace:
            states[node.state] = states.get(node.state, 0) + 1
        counts = ", ".join(f"{count} {state}" for state, count in states.items())
        return f"<Run of {self._graph.path}: {counts or 'no nodes'}>"

    def _repr_html_(self) -> str:
        from ._show import run_html

        return run_html(self)


def telling(
    progress: Union[Callable[[Progress], object], bool, None], total: int
) -> Tuple[Optional[Callable[[str, str, float], object]], Callable[[], object]]:
    """What is called as things happen, and at the end."""
    if not progress:
        return None, lambda: None
    end: Callable[[], object] = lambda: None
    if progress is True:
        from ._show import bar

        tell, end = bar()
    else:
        tell = progress
    done = 0

    def told(what: str, node: str, number: float) -> None:
        nonlocal done
        if what == "unchanged":
            done += int(number)
        elif what not in ("started", "progress"):
            done += 1
        share = {"started": 0.0, "progress": number}.get(what, 1.0)
        tell(Progress(node, what, share, done, max(total, done)))

    return told, end
