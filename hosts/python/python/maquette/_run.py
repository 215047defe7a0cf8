"""Results and progress of runs."""

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
    """The state of a node in a run, and the reason."""

    name: str
    """Its name in the graph."""
    node: str
    """Its type, such as `Threshold`."""
    state: str
    """`cached`, `equal` (not run, since its inputs are unchanged), `computed`, `failed` or `skipped`."""
    reason: str
    """The reason of the state, as text."""
    seconds: float
    """The time that it ran; 0 if it did not run."""
    bytes: int
    """The memory of its results."""
    warnings: List[str]
    """The warnings about its results."""
    unchanged: bool = False
    """True if it ran and its results equal those of the last run."""


class WrittenFile(NamedTuple):
    """A file that `Run.write` has written, or left unchanged because it was up to date."""

    name: str
    """The name of the output."""
    path: str
    """The path."""
    bytes: int
    """The size."""
    hash: str
    """The hash of the content."""


class Progress(NamedTuple):
    """The progress of a run."""

    node: str
    """The node; empty for nodes that need no evaluation."""
    state: str
    """`started`, `progress`, or a final state: `computed`, `cached`, `equal`, `failed`, `skipped`."""
    share: float
    """The fraction of the node that is done, 0 to 1."""
    done: int
    """The number of nodes that are done."""
    total: int
    """The number of nodes of the graph; a run may need fewer."""


class Request(NamedTuple):
    """The requested results of a run, and the problems that were known before it."""

    outputs: Optional[List[str]]
    nodes: List[str]
    is_draft: bool
    checked: List[Problem]
    files: List[str]


class Run(Mapping[str, Value]):
    """The results of a run of a graph: `run["model.glb"]` is the value of an output, a node or an output of a node.

    A run is a mapping of the requested outputs and nodes that did not fail, in this order: `for name, value in run.items()`. Values of
    other nodes that were evaluated are also accessible by name.
    """

    def __init__(self, graph: Graph, found: _maquette.Finished, asked: Request) -> None:
        self._graph, self._found, self._asked = graph, found, asked

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def graph(self) -> Graph:
        """The graph that was run."""
        return self._graph

    def __getitem__(self, name: str) -> Value:
        """The value of an output, a node (its first output) or an output of a node. Raises KeyError if it was not evaluated or failed."""
        found = self._found.value(name)
        if found is None:
            known = self._graph.nodes
            is_node = name.split(".")[0] in known
            hint = f'run(nodes=["{name}"]) asks for it, unless it failed' if is_node else "there is no such output or node"
            raise KeyError(f"no value `{name}`: {hint}")
        return wrap(found)

    def value(self, name: str, kind: Type[V]) -> V:
        """Returns the value of a name, checked to be of this class, for type checkers: `run.value("model.glb", maquette.Mesh)`. Raises
        TypeError if it is of another class."""
        value = self[name]
        if not isinstance(value, kind):
            raise TypeError(f"`{name}` is a {value.kind}; expected a {kind.__name__}")
        return value

    def __contains__(self, name: object) -> bool:
        """True if there is a value with this name."""
        return isinstance(name, str) and self._found.value(name) is not None

    def __iter__(self) -> Iterator[str]:
        """The names of the requested values that did not fail."""
        outputs = self._graph.outputs if self._asked.outputs is None else self._asked.outputs
        return (name for name in dict.fromkeys([*outputs, *self._asked.nodes]) if name in self)

    def __len__(self) -> int:
        """The number of requested values that did not fail."""
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        """True, even if the run has no values."""
        return True

    @property
    def trace(self) -> List[Node]:
        """The state of each node with the reason; each node comes after those that it depends on."""
        return [Node(**node) for node in self._found.trace()]

    @property
    def problems(self) -> List[Problem]:
        """Warnings of the graph, failures and warnings of nodes, and expectations of the graph that are not met."""
        found = problems(self._found.problems())
        known = {problem._replace(severity="", text="") for problem in found}
        checked = [it for it in self._asked.checked if it._replace(severity="", text="") not in known]
        return checked + found

    def write(self, folder: Optional[Path] = None, *, provenance: bool = True) -> List[WrittenFile]:
        """Writes the requested outputs into a folder, as `maquette run` does; a file that is up to date is not written again. The default
        folder is `out/GRAPH`, or `out/GRAPH-draft` after `run(draft=True)`. `provenance`: store in each file the graph, the parameters and
        the files that it was made of.

        Warns with GraphWarning of data that a file cannot hold. Raises GraphError if a file cannot be written; an existing file is kept
        then.
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


def progress_callbacks(
    progress: Union[Callable[[Progress], object], bool, None], total: int
) -> Tuple[Optional[Callable[[str, str, float], object]], Callable[[], object]]:
    """Returns the callback of the engine for events of nodes, and a function to call at the end."""
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
