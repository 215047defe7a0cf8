"""Loading and running of graphs."""

from __future__ import annotations

import atexit
import os
import warnings
from _thread import get_ident
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple, Union

from . import _maquette
from ._params import Named, Output, Param, Port, param_of, to_plain
from ._problems import Cancelled, GraphError, GraphWarning, Problem, problems, warning_of
from ._run import Path, Progress, Request, Run, progress_callbacks
from ._values import Value, value_of, wrap

if TYPE_CHECKING:
    from ._running import Running

# The maximum that `threads` accepts.
_MAX_THREADS = 65535

# The errors of caches and result servers that were reported as warnings already.
_REPORTED: Set[str] = set()


@atexit.register
def _finish() -> None:
    """Waits until pending results are on disk, so that the next process need not compute them again; warns of those that failed."""
    for trouble in _maquette.finish_all():
        if trouble not in _REPORTED:
            _REPORTED.add(trouble)
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
    """Reads and checks a graph file and the graphs that it uses; runs nothing.

    `text`: the content to use instead of that of the file; paths in it are relative to `path`. `roots`: folders outside of the project that
    the graph may read. `cache`: the folder in which results are kept between processes: True for that of the command line, False or None
    for no cache, or a path. `memory`: the maximum memory of results. `threads`: the number of threads, 0 for that of the machine's
    processors. `max_memory`: the maximum memory of results and running nodes together, such as "4GB"; a node that would need more fails
    before it starts; None for nine tenths of the memory that is available. `cache_remote`: the URL of a server through which machines share
    results; None for that of `MAQUETTE_CACHE_REMOTE`. `verify_cache`: the percentage of cached results that are computed again; a
    difference is an error. `pins`: use pinned results instead of their nodes. `locked`: require used graphs to agree with the lock file.
    All are the same as the options of the command line.

    Later changes of graph files do not affect the graph; files that its nodes read are checked in every run.

    Doubts about the graph, such as a stale pin, are a GraphWarning. A node whose type is in no pack is an UnknownNodeWarning, which names
    the pack that may be missing; everything that does not depend on the node can be run.

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
    """A checked graph, returned by `load`."""

    def __init__(
        self,
        path: Path,
        text: Optional[str],
        roots: Sequence[Path],
        session: _maquette.Session,
        pins: bool,
        locked: bool,
    ) -> None:
        # Absolute, since the graph is read again with other values, when the current folder may have changed.
        self._path = os.path.abspath(path)
        self._roots = [os.path.abspath(root) for root in roots]
        self._session, self._pins, self._locked = session, pins, locked
        # The texts of warnings that were given, and the tokens that stop running runs.
        self._warned: Set[str] = set()
        self._running: Set[_maquette.Cancel] = set()
        # The tokens of runs that `start` has created and that have not begun yet, by thread.
        self._started: Dict[int, _maquette.Cancel] = {}
        self._known: Optional[Dict[str, str]] = None
        if text is None:
            with open(self._path, "rb"):
                pass
        texts = {} if text is None else {self._path: text}
        self._graph, self._problems, used = self._check({}, texts)
        # Parameter values are put into these checked texts, even if the files change.
        self._texts = {file: _text(file) for file in used}
        self._texts[self._path] = self._graph.text

    def _check(
        self, params: Mapping[str, Any], texts: Dict[str, str], draft: bool = False
    ) -> Tuple[_maquette.Graph, List[Problem], List[str]]:
        """Loads the graph with these values. Raises GraphError if it has errors then."""
        values = self._values_as_ron(params)
        graph, told, used = _maquette.Graph.load(
            self._path, self._roots, values, texts, draft, self._pins, self._locked
        )
        if graph is None:
            raise GraphError(problems(told))
        return graph, problems(told), [os.fspath(path) for path in used]

    def _values_as_ron(self, values: Mapping[str, Any]) -> List[Tuple[str, str]]:
        """Converts values to RON, by the names in the graph: `up_step` is the parameter `up-step`."""
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
        """The names of parameters by their names in Python: unchanged, or with underscores instead of hyphens."""
        if self._known is None:
            names = list(self.params)
            self._known = {**{name.replace("-", "_"): name for name in names}, **{name: name for name in names}}
        return self._known

    def _merge_params(
        self, params: Optional[Mapping[str, Any]], named: Mapping[str, Any], arguments: Mapping[str, Any]
    ) -> Dict[str, Any]:
        """Merges the parameters of a dict and of keywords. Raises TypeError if a keyword may mean both a parameter and an argument of
        `run`; with a dict, even an empty one, it means the argument."""
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
        """Warns of problems and of errors of the cache, once of each."""
        for problem in found:
            self._warn_once(warning_of(problem), level + 1)
        for trouble in self._session.troubles():
            _REPORTED.add(trouble)
            self._warn_once(GraphWarning(trouble), level + 1)

    def _warn_once(self, warning: GraphWarning, level: int) -> None:
        if str(warning) not in self._warned:
            self._warned.add(str(warning))
            warnings.warn(warning, stacklevel=level)

    def _as_ron(self, name: str, value: Any) -> str:
        """Formats a value as RON: for a parameter by its type, for a field by the type of the value."""
        value = to_plain(name, value)
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
        """The absolute path of the graph file."""
        return self._path

    @property
    def doc(self) -> str:
        """The description of the graph by its author."""
        return self._graph.doc

    @property
    def text(self) -> str:
        """The text of the graph when it was loaded."""
        return self._graph.text

    @property
    def nodes(self) -> List[str]:
        """The names of the nodes, each after those that it depends on."""
        return self._graph.nodes

    @property
    def params(self) -> Mapping[str, Param]:
        """The parameters by name, with types, defaults, ranges and units."""
        inputs = set(self.inputs)
        fields = self._graph.schema().get("properties", {})
        return Named(
            "parameter",
            {name: param_of(name, field) for name, field in fields.items() if name not in inputs},
        )

    @property
    def inputs(self) -> Mapping[str, Port]:
        """The inputs by name, if the graph is a function of values."""
        return Named("input", {port[0]: Port(*port) for port in self._graph.inputs()})

    @property
    def outputs(self) -> Mapping[str, Output]:
        """The outputs by name, with the types of their values."""
        return Named("output", {output[0]: Output(*output) for output in self._graph.results()})

    def check(self) -> List[Problem]:
        """Returns the problems with which the graph can still run: warnings, and nodes that nothing needs."""
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
        """Evaluates outputs of the graph, by default all of them, and the given nodes (`node` or `node.output`).

        Further keywords are parameters: `run(growth=12)`, or `run(eye_step=3)` for a parameter `eye-step`. `params`: parameters as a dict,
        for any name: `run(params={"draft": True, "cage.levels": 2})`, where the second is a field of a node. `inputs`: values for the
        graph's inputs by name: a `Value`, the path of a file, or an argument of the class of the input's type, such as a mesh of trimesh or
        an array of points. `draft`: use the draft value of each `Draft(final: .., draft: ..)`; False by default. `progress`: a function
        that is called with `Progress`; True draws a bar. `timeout`: the maximum time in seconds. Ctrl-C stops the run, and so does
        `cancel`.

        Only nodes that depend on a change are computed. Raises GraphError if a node failed, an output depends on a node of an unknown type,
        or an expectation is not met; the error's `run` has the values that were found. With `strict=False`, returns the run, whose
        `problems` has the errors. Raises TimeoutError or Cancelled if the run was stopped.
        """
        call = _Call(outputs, nodes, inputs, progress, strict, draft, timeout)
        token = self._started.pop(get_ident(), None) or _maquette.Cancel()
        self._running.add(token)
        try:
            return self._evaluate(token, call, self._merge_params(params, named, call._asdict()))
        finally:
            self._running.discard(token)

    def start(self, /, *outputs: Any, **arguments: Any) -> Running:
        """Starts `run` with these arguments on another thread and returns a future: `run = graph.start(growth=12).result()`, or
        `run = await graph.start(growth=12)`. Its `cancel` stops the run."""
        from ._running import Running

        token = _maquette.Cancel()
        self._running.add(token)

        def run() -> Run:
            self._started[get_ident()] = token
            return self.run(*outputs, **arguments)

        return Running(run, token)

    def cancel(self) -> None:
        """Stops all runs of the graph on other threads; each raises Cancelled."""
        for token in list(self._running):
            token.cancel()

    def _evaluate(self, token: _maquette.Cancel, call: _Call, given: Mapping[str, Any]) -> Run:
        """Runs the graph with these parameters, unless the token stops it."""
        seconds = _seconds(call.timeout)
        asked = None if call.outputs is None else _names("outputs", call.outputs)
        wanted = [] if call.nodes is None else _names("nodes", call.nodes)
        for output in asked or ():
            self.outputs[output]
        is_draft = bool(call.draft)
        graph, checked = self._graph, self._problems
        if given or is_draft:
            graph, checked, _ = self._check(given, self._texts, is_draft)
        values, doubts, files = self._values({} if call.inputs is None else call.inputs)
        told, end = progress_callbacks(call.progress, len(self.nodes))
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
        run = Run(self, found, Request(asked, wanted, is_draft, [*checked, *doubts], files))
        # A warning of the graph may be an error of the run.
        self._warn([problem for problem in run.problems if problem.severity != "error"], 4)
        failed = [problem for problem in run.problems if problem.severity == "error"]
        if failed and (call.strict is None or call.strict):
            raise GraphError(failed, run)
        return run

    def _values(self, inputs: Mapping[str, Any]) -> Tuple[Dict[str, Value], List[Problem], List[str]]:
        """Converts the arguments for inputs to values; also returns warnings about files that were read, and the paths of all files."""
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
                # The engine reports an unknown input and suggests a similar name.
                files.append((name, ""))
        if files:
            read, told = self._session.read_inputs(self._graph, files)
            if read is None:
                raise GraphError(problems(told))
            values.update({name: wrap(value) for name, value in read.items()})
            doubts = problems(told)
        return values, doubts, [os.path.abspath(os.fspath(path)) for _, path in files]

    def why(self, node: str) -> str:
        """Explains why a node would run now or would not, compared with the last run of the graph."""
        told = self._session.why(self._graph, node)
        if told is None:
            raise KeyError(f"no node `{node}`; there are: {', '.join(self.nodes)}")
        return told.rstrip("\n")

    def edited(self, params: Optional[Mapping[str, Any]] = None, /, **named: Any) -> str:
        """Returns the text of the graph with new values of parameters, `edited(growth=20)`, or of fields, `edited({"cage.levels": 2})`.

        All other bytes are unchanged. Writes no file. Raises GraphError if the text would have an error.
        """
        put = self._values_as_ron(self._merge_params({} if params is None else params, named, {}))
        text, told = self._graph.edited(put, self._roots, self._texts)
        if text is None:
            raise GraphError(problems(told))
        return text

    def forget(self) -> None:
        """Drops all results in memory; results on disk are kept."""
        self._session.forget()

    @property
    def trouble(self) -> Optional[str]:
        """The first error in storing results on disk or sharing them; None if there was none."""
        return next(iter(self._session.troubles()), None)

    def to_svg(self) -> str:
        """Draws the graph as SVG: boxes for nodes and outputs, and links."""
        return self._graph.svg()

    def _repr_svg_(self) -> str:
        return self.to_svg()

    def __repr__(self) -> str:
        return f"<Graph {self._path}: {len(self.nodes)} nodes, outputs {', '.join(self.outputs)}>"


class _Call(NamedTuple):
    """The arguments of `Graph.run` without the parameters of the graph."""

    outputs: Union[str, Sequence[str], None]
    nodes: Union[str, Sequence[str], None]
    inputs: Optional[Mapping[str, Any]]
    progress: Union[Callable[[Progress], object], bool, None]
    strict: Optional[bool]
    draft: Optional[bool]
    timeout: Optional[float]


def _seconds(timeout: Optional[float]) -> Optional[float]:
    """Checks the timeout of a run. Raises ValueError if it is negative or NaN."""
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
    """Converts a name or a collection of names to a list. An iterator is refused, since it may be infinite."""
    if isinstance(names, str):
        return [names]
    if not isinstance(names, Collection):
        raise TypeError(f"`{argument}` is a {type(names).__name__}; expected a name or a list of names")
    return list(names)
