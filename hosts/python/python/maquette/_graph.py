"""Graphs, and what comes of running them."""

from __future__ import annotations

import atexit
import errno
import os
import stat
import warnings
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple, Type, TypeVar
from typing import Union, overload

from . import _maquette
from ._problems import Cancelled, GraphError, GraphWarning, Problem, UnknownNodeWarning, problems
from ._values import Value, value_of, wrap

if TYPE_CHECKING:
    from ._running import Running

Path = Union[str, "os.PathLike[str]"]
T = TypeVar("T")
V = TypeVar("V", bound=Value)

# The code of the problem that a node's type is one that no pack has.
_UNKNOWN_NODE = "G003"

# What went wrong with keeping and sharing results, as far as somebody was warned of it.
_TOLD: Set[str] = set()


@atexit.register
def _finish() -> None:
    """Waits for what is on its way to the disk, which the next process would compute again, and warns of what never got there."""
    for trouble in _maquette.finish_all():
        if trouble not in _TOLD:
            _TOLD.add(trouble)
            warnings.warn(trouble, GraphWarning, stacklevel=2)


class Param(NamedTuple):
    """A parameter that a graph declares."""

    name: str
    """Its name, as `Graph.run` takes it."""
    kind: str
    """`Number`, `Integer`, `Toggle`, `Color`, `Text`, `Choice` or `Vector`."""
    default: Any
    """Its value if none is given: float, int, bool, str or a list of numbers."""
    min: Optional[float]
    """The least number that it takes."""
    max: Optional[float]
    """The greatest number that it takes."""
    unit: Optional[str]
    """The unit of its number, such as `mm`."""
    choices: Tuple[str, ...]
    """What a `Choice` chooses from."""
    doc: str
    """What it does, in the words of the graph's author."""


class Port(NamedTuple):
    """An input of a graph that is a function of values."""

    name: str
    """Its name, as `inputs` of `Graph.run` takes it."""
    kind: str
    """The type of values that it takes, such as `Mesh`."""
    doc: str
    """What it is, in the words of the graph's author."""


class Output(NamedTuple):
    """Something that a graph gives."""

    name: str
    """Its name: a file, or a value of a graph with inputs."""
    kind: Optional[str]
    """The type of its value; None if it is that of what comes in."""


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


class _Named(Mapping[str, T]):
    """Things by their names, in order."""

    def __init__(self, what: str, things: Dict[str, T]) -> None:
        self._what, self._things = what, things

    def __getitem__(self, name: str) -> T:
        try:
            return self._things[name]
        except KeyError:
            known = ", ".join(self._things) or "none"
            raise KeyError(f"no {self._what} `{name}`; there are: {known}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._things)

    def __len__(self) -> int:
        return len(self._things)

    def __repr__(self) -> str:
        return "\n".join(repr(thing) for thing in self._things.values()) or f"no {self._what}"

    def _repr_html_(self) -> str:
        from ._show import named_html

        return named_html(self._what, list(self._things.values()))


def load(
    path: Path,
    *,
    text: Optional[str] = None,
    roots: Sequence[Path] = (),
    cache: Union[Path, bool, None] = True,
    memory: Union[str, int] = "2GB",
    threads: int = 0,
    max_memory: Union[str, int, None] = None,
    cache_remote: Optional[str] = None,
    verify_cache: float = 0.0,
    pins: bool = True,
    locked: bool = False,
) -> Graph:
    """Reads and checks a graph file and those that it uses; runs nothing.

    `text` stands in place of the file's content; paths in it are relative to `path` all the same. `roots`: folders outside of the project
    that the graph may read. `cache`: where results are kept from one process to the next: True for the command line's folder, False or None
    for nowhere, or a folder. `memory`: how much results may hold. `threads`: how many there are, 0 for as many as the machine has.
    `max_memory`: how much results and nodes under way may hold together, as "4GB": a node that would need more fails before it begins; None
    for nine tenths of what the machine has left. `cache_remote`: the URL of a server through which machines share results; None for that
    of `MAQUETTE_CACHE_REMOTE`. `verify_cache`: the percentage of known results that are computed all the same, where a difference is an
    error. `pins`: whether pinned results stand in for their nodes. `locked`: whether used graphs must be what the lock file says. All are as
    the options of the command line.

    The graph stays as it is now when files of graphs change; files that its nodes read are looked at in every run.

    What is to be doubted of the graph is a GraphWarning, as a stale pin. A node of a type that no pack has is an UnknownNodeWarning, which
    says what pack may be missing: all that does not depend on the node can be run.

    Raises GraphError with every problem of the file, OSError if it cannot be read.
    """
    if not 0 <= verify_cache <= 100:
        raise ValueError(f"verify_cache is {verify_cache}; expected a percentage from 0 to 100")
    most = None if max_memory is None else str(max_memory)
    if cache is True:
        folder: Optional[str] = None
    else:
        folder = "" if cache is None or cache is False else os.path.abspath(cache)
    session = _maquette.Session(folder, str(memory), threads, most, cache_remote, verify_cache / 100)
    graph = Graph(path, text, roots, session, pins, locked)
    graph._warn(graph._problems, 3)
    return graph


class Graph:
    """A graph that has been checked. Made by `load`."""

    def __init__(
        self,
        path: Path,
        text: Optional[str],
        roots: Sequence[Path],
        session: _maquette.Session,
        pins: bool,
        locked: bool,
    ) -> None:
        # It is read again, with other values, wherever the program has gone meanwhile.
        self._path = os.path.abspath(path)
        self._roots = [os.path.abspath(root) for root in roots]
        self._session, self._pins, self._locked = session, pins, locked
        # The texts of warnings that were given, and what stops the runs under way.
        self._warned: Set[str] = set()
        self._running: Set[_maquette.Cancel] = set()
        self._known: Optional[Dict[str, str]] = None
        if text is None:
            with open(self._path, "rb"):
                pass
        texts = {} if text is None else {self._path: text}
        self._graph, self._problems, used = self._checked({}, texts)
        # Other values are put into the texts that were checked, whatever has become of the files meanwhile.
        self._texts = {file: _text(file) for file in used}
        self._texts[self._path] = self._graph.text

    def _checked(
        self, params: Mapping[str, Any], texts: Dict[str, str], draft: bool = False
    ) -> Tuple[_maquette.Graph, List[Problem], List[str]]:
        """The graph with these values; raises GraphError if it has mistakes then."""
        values = self._put(params)
        graph, told, used = _maquette.Graph.load(
            self._path, self._roots, values, texts, draft, self._pins, self._locked
        )
        if graph is None:
            raise GraphError(problems(told))
        return graph, problems(told), [os.fspath(path) for path in used]

    def _put(self, values: Mapping[str, Any]) -> List[Tuple[str, str]]:
        """Values by the names that the graph has for them: as in a field of a graph, `up_step` is the parameter `up-step`."""
        named: Dict[str, Any] = {}
        for name, value in values.items():
            if not isinstance(name, str):
                raise TypeError(f"the name of a parameter is a {type(name).__name__}; expected a str")
            name = self._params_by_word.get(name, name)
            if name in named:
                raise TypeError(f"the parameter `{name}` is given twice")
            named[name] = value
        return [(name, self._as_ron(name, value)) for name, value in named.items()]

    @property
    def _params_by_word(self) -> Dict[str, str]:
        """The names of parameters by what stands for them in Python: they themselves, else with underscores for hyphens."""
        if self._known is None:
            names = list(self.params)
            self._known = {**{name.replace("-", "_"): name for name in names}, **{name: name for name in names}}
        return self._known

    def _given(
        self, params: Optional[Mapping[str, Any]], named: Mapping[str, Any], arguments: Mapping[str, Any]
    ) -> Dict[str, Any]:
        """All parameters: from a dict, and those that were given as keywords. Raises TypeError where a keyword that is also a parameter may
        mean both: with a dict, even an empty one, it means the argument of `run`."""
        if params is None:
            for name, value in arguments.items():
                if value is not None and name in self._params_by_word:
                    raise TypeError(
                        f"`{name}` is an argument of run and a parameter of this graph: give the parameter as "
                        f"params={{'{name}': ..}}; beside params, even an empty dict, `{name}` is the argument"
                    )
            return dict(named)
        if not isinstance(params, Mapping):
            raise TypeError(f"`params` is a {type(params).__name__}; expected a dict of parameters by name")
        known = self._params_by_word
        taken = {known.get(name, name) for name in params}
        for name in named:
            if known.get(name, name) in taken:
                raise TypeError(f"the parameter `{name}` is given twice, in params and as a keyword")
        return {**params, **named}

    def _warn(self, found: Sequence[Problem], level: int) -> None:
        """Warns of what is to be doubted and of troubles of the cache, of each once."""
        for problem in found:
            kind = UnknownNodeWarning if problem.code == _UNKNOWN_NODE else GraphWarning
            text = f"{problem.file}:{problem.line}:{problem.column}: {problem.message}"
            self._warn_once(f"{text} ({problem.help})" if problem.help else text, kind, level + 1)
        for trouble in self._session.troubles():
            _TOLD.add(trouble)
            self._warn_once(trouble, GraphWarning, level + 1)

    def _warn_once(self, text: str, kind: Type[Warning], level: int) -> None:
        if text not in self._warned:
            self._warned.add(text)
            warnings.warn(text, kind, stacklevel=level)

    def _as_ron(self, name: str, value: Any) -> str:
        """A value as graph files have it: of a parameter by its type, else as it is."""
        value = _plain(name, value)
        try:
            return self._graph.as_ron(name, value)
        except KeyError:
            pass
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, (tuple, list)):
            return "(" + ", ".join(self._as_ron("", item) for item in value) + ")"
        return str(value)

    @property
    def path(self) -> str:
        """The path of its file."""
        return self._path

    @property
    def doc(self) -> str:
        """What it is for, in its author's words."""
        return self._graph.doc

    @property
    def text(self) -> str:
        """Its text, as it was when it was loaded."""
        return self._graph.text

    @property
    def nodes(self) -> List[str]:
        """The names of its nodes, each after those that it hangs on."""
        return self._graph.nodes

    @property
    def params(self) -> Mapping[str, Param]:
        """Its parameters, by name, with types, defaults, ranges and units."""
        inputs = set(self.inputs)
        fields = self._graph.schema().get("properties", {})
        return _Named(
            "parameter",
            {name: _param(name, field) for name, field in fields.items() if name not in inputs},
        )

    @property
    def inputs(self) -> Mapping[str, Port]:
        """The values that it wants, by name, if it is a function of values."""
        return _Named("input", {port[0]: Port(*port) for port in self._graph.inputs()})

    @property
    def outputs(self) -> Mapping[str, Output]:
        """What it gives, by name, with the types of the values."""
        return _Named("output", {output[0]: Output(*output) for output in self._graph.results()})

    def check(self) -> List[Problem]:
        """What is to be doubted of the graph, though it runs: warnings, and nodes that nothing needs."""
        return self._problems + problems(self._graph.unused())

    def run(
        self,
        /,
        outputs: Union[str, Sequence[str], None] = None,
        *,
        nodes: Union[str, Sequence[str], None] = None,
        inputs: Optional[Mapping[str, Any]] = None,
        progress: Union[Callable[[Progress], object], bool, None] = None,
        strict: Optional[bool] = None,
        draft: Optional[bool] = None,
        timeout: Optional[float] = None,
        params: Optional[Mapping[str, Any]] = None,
        **named: Any,
    ) -> Run:
        """Evaluates outputs of the graph, all if none is named, and these nodes (`node` or `node.output`) beside them.

        Further keywords are parameters, `run(growth=12)`, `run(eye_step=3)` of a parameter `eye-step`. `params`: the same as a dict, for
        any name: `run(params={"draft": True, "cage.levels": 2})`, where the second is the field of a node. `inputs`: values by the names of
        the graph's inputs: a `Value`, the path of a file, or whatever the class of the input's type takes, as a mesh of trimesh or an array of
        points. `draft`: whether each `Draft(final: .., draft: ..)` stands for its draft; False if left out. `progress`: is called with
        `Progress`; True draws a bar. `timeout`: how many seconds it may take. Ctrl-C stops the run, and so does `cancel`.

        Only what depends on something changed is computed. Raises GraphError if something failed, depends on a node of an unknown type or does
        not hold, with what was found in its `run`; with `strict=False` the run is given all the same, and its `problems` tell. Raises
        TimeoutError or Cancelled if it was stopped.
        """
        return self._until_cancelled(
            _maquette.Cancel(),
            outputs,
            nodes=nodes,
            inputs=inputs,
            progress=progress,
            strict=strict,
            draft=draft,
            timeout=timeout,
            params=params,
            **named,
        )

    def start(self, /, *outputs: Any, **arguments: Any) -> Running:
        """Begins what `run` does with these arguments, on another thread, and gives a future: `run = graph.start(growth=12).result()`,
        `run = await graph.start(growth=12)`. Its `cancel` stops the run."""
        from ._running import Running

        token = _maquette.Cancel()
        self._running.add(token)
        return Running(lambda: self._until_cancelled(token, *outputs, **arguments), token)

    def cancel(self) -> None:
        """Stops the runs of the graph that are under way on other threads; each raises Cancelled."""
        for token in list(self._running):
            token.cancel()

    def _until_cancelled(self, token: _maquette.Cancel, /, *outputs: Any, **arguments: Any) -> Run:
        """What `run` does, until the token stops it."""
        self._running.add(token)
        try:
            return self._evaluate(token, *outputs, **arguments)
        finally:
            self._running.discard(token)

    def _evaluate(
        self,
        token: _maquette.Cancel,
        /,
        outputs: Union[str, Sequence[str], None] = None,
        *,
        nodes: Union[str, Sequence[str], None] = None,
        inputs: Optional[Mapping[str, Any]] = None,
        progress: Union[Callable[[Progress], object], bool, None] = None,
        strict: Optional[bool] = None,
        draft: Optional[bool] = None,
        timeout: Optional[float] = None,
        params: Optional[Mapping[str, Any]] = None,
        **named: Any,
    ) -> Run:
        arguments = {
            "outputs": outputs,
            "nodes": nodes,
            "inputs": inputs,
            "progress": progress,
            "strict": strict,
            "draft": draft,
            "timeout": timeout,
        }
        given = self._given(params, named, arguments)
        seconds = _seconds(timeout)
        asked = None if outputs is None else _names("outputs", outputs)
        wanted = [] if nodes is None else _names("nodes", nodes)
        for output in asked or ():
            self.outputs[output]
        is_draft = bool(draft)
        graph, checked = self._graph, self._problems
        if given or is_draft:
            graph, checked, _ = self._checked(given, self._texts, is_draft)
        values, doubts, files = self._values({} if inputs is None else inputs)
        told, end = _told(progress, len(self.nodes))
        try:
            found, wrong = self._session.run(
                graph,
                asked is None,
                [*(asked or ()), *wanted],
                {name: value._native for name, value in values.items()},
                told,
                token,
                seconds,
            )
        finally:
            end()
        if found is None and token.is_cancelled:
            raise Cancelled("the run was cancelled")
        if found is None:
            raise GraphError(problems(wrong))
        checked = [*checked, *doubts]
        self._warn(checked, 5)
        run = Run(self, found, _Asked(asked, wanted, is_draft, checked, files))
        failed = [problem for problem in run.problems if problem.severity == "error"]
        if failed and (strict is None or strict):
            raise GraphError(failed, run)
        return run

    def _values(self, inputs: Mapping[str, Any]) -> Tuple[Dict[str, Value], List[Problem], List[str]]:
        """The values for inputs, whatever they were given as; what is to be doubted of those that were read, and their files."""
        if not isinstance(inputs, Mapping):
            raise TypeError(f"`inputs` is a {type(inputs).__name__}; expected a dict of values by name")
        ports = self.inputs
        values: Dict[str, Value] = {}
        files: List[Tuple[str, Path]] = []
        doubts: List[Problem] = []
        for name, given in inputs.items():
            if isinstance(given, (str, os.PathLike)):
                files.append((name, given))
            else:
                values[name] = value_of(ports[name].kind, given)
        if files:
            read, told = self._session.read_inputs(self._graph, files)
            if read is None:
                raise GraphError(problems(told))
            values.update({name: wrap(value) for name, value in read.items()})
            doubts = problems(told)
        return values, doubts, [os.path.abspath(os.fspath(path)) for _, path in files]

    def why(self, node: str) -> str:
        """Why a node would run now, or why not, since the graph was run last."""
        told = self._session.why(self._graph, node)
        if told is None:
            raise KeyError(f"no node `{node}`; there are: {', '.join(self.nodes)}")
        return told.rstrip("\n")

    def edited(self, params: Optional[Mapping[str, Any]] = None, /, **named: Any) -> str:
        """The text of the graph with values put into it: of parameters, `edited(growth=20)`, or of fields, `edited({"cage.levels": 2})`.

        Every other byte stays. Nothing is written. Raises GraphError if the text would have a mistake then.
        """
        put = self._put(self._given({} if params is None else params, named, {}))
        text, told = self._graph.edited(put, self._roots, self._texts)
        if text is None:
            raise GraphError(problems(told))
        return text

    def forget(self) -> None:
        """Drops every result that is held in memory; what is on disk stays."""
        self._session.forget()

    @property
    def trouble(self) -> Optional[str]:
        """What went wrong with keeping results on disk or sharing them, the first of it; None if nothing did."""
        return next(iter(self._session.troubles()), None)

    def to_svg(self) -> str:
        """The picture of the graph: boxes for nodes and outputs, and links."""
        return self._graph.svg()

    def _repr_svg_(self) -> str:
        return self.to_svg()

    def __repr__(self) -> str:
        return f"<Graph {self._path}: {len(self.nodes)} nodes, outputs {', '.join(self.outputs)}>"


class _Asked(NamedTuple):
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

    def __init__(self, graph: Graph, found: _maquette.Finished, asked: _Asked) -> None:
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

        What a file cannot tell of its value is a warning. Raises GraphError if a file cannot be written; what was there stays.
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
            warnings.warn(problem.message, stacklevel=2)
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


@overload
def read(path: Path, kind: Optional[str] = None) -> Value: ...
@overload
def read(path: Path, kind: Type[V]) -> V: ...
def read(path: Path, kind: Union[str, Type[Value], None] = None) -> Value:
    """The value in a file, by its ending: a `Mesh` from .glb, .obj, .ply, .stl .., a `RangeImage` from .pcd, a picture from .png ..

    `kind` says which type it is to be, by name or class, `read("a.ply", maquette.Points)`. What is doubtful of the file is a warning. Raises
    FileNotFoundError and its like if the file cannot be read, ValueError that says what is wrong with it and where.
    """
    path = os.fspath(path)
    _check_readable(path)
    name = kind.KIND if isinstance(kind, type) and issubclass(kind, Value) else kind
    value, doubts = _maquette.read(path, name)
    for doubt in doubts:
        warnings.warn(f"{path}: {doubt}", stacklevel=2)
    return wrap(value)


def _check_readable(path: str) -> None:
    """Raises what `open` raises of a file that cannot be read."""
    wrong = 0
    if stat.S_ISDIR(os.stat(path).st_mode):
        wrong = errno.EISDIR
    elif not os.access(path, os.R_OK):
        wrong = errno.EACCES
    if wrong:
        raise OSError(wrong, os.strerror(wrong), path)


def nodes() -> Dict[str, Any]:
    """All node types by name: what `maquette nodes --json` prints of each: words, inputs, outputs and the JSON schema of its parameters."""
    return {node["name"]: node for node in _maquette.catalog()["nodes"]}


def value_types() -> Dict[str, Any]:
    """All types of values by name, with the endings of files that they are read from and written to."""
    return {kind["name"]: kind for kind in _maquette.catalog()["values"]}


def _seconds(timeout: Optional[float]) -> Optional[float]:
    """How long a run may take. Raises ValueError if it is no time."""
    if timeout is None:
        return None
    seconds = float(timeout)
    if not 0 <= seconds:
        raise ValueError(f"timeout is {timeout}; expected a number of seconds")
    return seconds


def _text(file: str) -> str:
    with open(file, encoding="utf-8", newline="") as opened:
        return opened.read()


def _plain(name: str, value: Any) -> Any:
    """A value of NumPy or Python as a bool, number, text or list. Raises TypeError or ValueError with the parameter's name."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (tuple, list)):
        try:
            return [_plain(name, item) for item in value]
        except RecursionError:
            raise ValueError(f"`{name}` is a list that is nested too deeply") from None
    if isinstance(value, str):
        _check_text(name, value)
        return value
    if isinstance(value, (bool, int)):
        return value
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"`{name}` is a {type(value).__name__}, which no parameter is") from None
    if number != number or number in (float("inf"), float("-inf")):
        raise ValueError(f"`{name}` is {number}")
    return number


def _names(argument: str, names: Union[str, Sequence[str]]) -> List[str]:
    """A name or some names as a list. An iterator is refused, since it may have no end."""
    if isinstance(names, str):
        return [names]
    if not isinstance(names, Collection):
        raise TypeError(f"`{argument}` is a {type(names).__name__}; expected a name or a list of names")
    return list(names)


def _check_text(name: str, text: str) -> None:
    """Raises ValueError if a text cannot be written to a file, as names of files that are not valid UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        reason = f"character {error.start} is a lone surrogate, as in names of files that are not valid UTF-8"
        raise ValueError(f"`{name}` is {ascii(text)}, which is not valid Unicode: {reason}") from None


def _param(name: str, field: Dict[str, Any]) -> Param:
    """A parameter as its JSON schema has it."""
    kinds = {"number": "Number", "integer": "Integer", "boolean": "Toggle", "array": "Vector"}
    kind = kinds.get(field.get("type", ""), "Text")
    if "enum" in field:
        kind = "Choice"
    elif field.get("format") == "color":
        kind = "Color"
    limits = field.get("items", {}) if kind == "Vector" else field
    return Param(
        name,
        kind,
        field.get("default"),
        limits.get("minimum"),
        limits.get("maximum"),
        field.get("unit"),
        tuple(field.get("enum", ())),
        field.get("description", ""),
    )


def _told(
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
