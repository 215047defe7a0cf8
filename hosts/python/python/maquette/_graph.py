"""Graphs, and how they are run."""

from __future__ import annotations

import atexit
import os
import warnings
from _thread import get_ident
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple, Union

from . import _maquette
from ._params import Named, Output, Param, Port, param_of, plain
from ._problems import Cancelled, GraphError, GraphWarning, Problem, problems, warning_of
from ._run import Asked, Path, Progress, Run, telling
from ._values import Value, value_of, wrap

if TYPE_CHECKING:
    from ._running import Running

# Far more than any machine has.
_MAX_THREADS = 65535

# What went wrong with keeping and sharing results, as far as somebody was warned of it.
_TOLD: Set[str] = set()


@atexit.register
def _finish() -> None:
    """Waits for what is on its way to the disk, which the next process would compute again, and warns of what never got there."""
    for trouble in _maquette.finish_all():
        if trouble not in _TOLD:
            _TOLD.add(trouble)
            warnings.warn(trouble, GraphWarning, stacklevel=2)


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
    if not 0 <= threads <= _MAX_THREADS:
        raise ValueError(f"threads is {threads}; expected a number from 0 to {_MAX_THREADS}")
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
        # What stops a run that `start` begins, by the thread that it is about to begin on.
        self._started: Dict[int, _maquette.Cancel] = {}
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
            self._warn_once(warning_of(problem), level + 1)
        for trouble in self._session.troubles():
            _TOLD.add(trouble)
            self._warn_once(GraphWarning(trouble), level + 1)

    def _warn_once(self, warning: GraphWarning, level: int) -> None:
        if str(warning) not in self._warned:
            self._warned.add(str(warning))
            warnings.warn(warning, stacklevel=level)

    def _as_ron(self, name: str, value: Any) -> str:
        """A value as graph files have it: of a parameter by its type, else as it is."""
        value = plain(name, value)
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
        return Named(
            "parameter",
            {name: param_of(name, field) for name, field in fields.items() if name not in inputs},
        )

    @property
    def inputs(self) -> Mapping[str, Port]:
        """The values that it wants, by name, if it is a function of values."""
        return Named("input", {port[0]: Port(*port) for port in self._graph.inputs()})

    @property
    def outputs(self) -> Mapping[str, Output]:
        """What it gives, by name, with the types of the values."""
        return Named("output", {output[0]: Output(*output) for output in self._graph.results()})

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
        call = _Call(outputs, nodes, inputs, progress, strict, draft, timeout)
        token = self._started.pop(get_ident(), None) or _maquette.Cancel()
        self._running.add(token)
        try:
            return self._evaluate(token, call, self._given(params, named, call._asdict()))
        finally:
            self._running.discard(token)

    def start(self, /, *outputs: Any, **arguments: Any) -> Running:
        """Begins what `run` does with these arguments, on another thread, and gives a future: `run = graph.start(growth=12).result()`,
        `run = await graph.start(growth=12)`. Its `cancel` stops the run."""
        from ._running import Running

        token = _maquette.Cancel()
        self._running.add(token)

        def run() -> Run:
            self._started[get_ident()] = token
            return self.run(*outputs, **arguments)

        return Running(run, token)

    def cancel(self) -> None:
        """Stops the runs of the graph that are under way on other threads; each raises Cancelled."""
        for token in list(self._running):
            token.cancel()

    def _evaluate(self, token: _maquette.Cancel, call: _Call, given: Mapping[str, Any]) -> Run:
        """Runs the graph with these parameters, until the token stops it."""
        seconds = _seconds(call.timeout)
        asked = None if call.outputs is None else _names("outputs", call.outputs)
        wanted = [] if call.nodes is None else _names("nodes", call.nodes)
        for output in asked or ():
            self.outputs[output]
        is_draft = bool(call.draft)
        graph, checked = self._graph, self._problems
        if given or is_draft:
            graph, checked, _ = self._checked(given, self._texts, is_draft)
        values, doubts, files = self._values({} if call.inputs is None else call.inputs)
        told, end = telling(call.progress, len(self.nodes))
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
        run = Run(self, found, Asked(asked, wanted, is_draft, [*checked, *doubts], files))
        # What was a doubt of the graph may be an error of the run.
        self._warn([problem for problem in run.problems if problem.severity != "error"], 4)
        failed = [problem for problem in run.problems if problem.severity == "error"]
        if failed and (call.strict is None or call.strict):
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
            elif name in ports:
                values[name] = value_of(ports[name].kind, given)
            else:
                # The engine says what an unknown input may have meant, whatever is given for it.
                files.append((name, ""))
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


class _Call(NamedTuple):
    """The arguments of `Graph.run` but for the parameters of the graph."""

    outputs: Union[str, Sequence[str], None]
    nodes: Union[str, Sequence[str], None]
    inputs: Optional[Mapping[str, Any]]
    progress: Union[Callable[[Progress], object], bool, None]
    strict: Optional[bool]
    draft: Optional[bool]
    timeout: Optional[float]


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


def _names(argument: str, names: Union[str, Sequence[str]]) -> List[str]:
    """A name or some names as a list. An iterator is refused, since it may have no end."""
    if isinstance(names, str):
        return [names]
    if not isinstance(names, Collection):
        raise TypeError(f"`{argument}` is a {type(names).__name__}; expected a name or a list of names")
    return list(names)
