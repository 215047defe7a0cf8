"""What is wrong with a graph, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

if TYPE_CHECKING:
    from ._run import Run


class Use(NamedTuple):
    """One use of a graph in another one, on the way to a problem."""

    name: str
    """The name of the node that uses it."""
    file: str
    """The file that uses it."""
    line: int
    """The line there, from 1."""
    column: int
    """The column there, from 1, in characters."""


class Note(NamedTuple):
    """Another place that explains a problem, such as the other end of a link."""

    file: str
    """The graph file."""
    line: int
    """The line where it begins, from 1."""
    column: int
    """The column where it begins, from 1, in characters."""
    end_line: int
    """The line where it ends."""
    end_column: int
    """The column behind its end."""
    message: str
    """What is there."""


class TextEdit(NamedTuple):
    """A text in the place of what stands in a graph file."""

    line: int
    """The line where it begins, from 1."""
    column: int
    """The column where it begins, from 1, in characters."""
    end_line: int
    """The line where it ends."""
    end_column: int
    """The column behind its end."""
    text: str
    """What stands there then."""


class Element(NamedTuple):
    """An element of a value that is to blame."""

    name: str
    """What it is, as `edge 0-2`."""
    at: Tuple[float, float, float]
    """A place of it, in mm."""


class Problem(NamedTuple):
    """Something wrong at a place of a graph file: where, what, and what to do."""

    severity: str
    """`error`, or `warning` if the graph runs all the same."""
    code: str
    """What kind of problem it is, as `G007`; codes keep their meaning."""
    file: str
    """The graph file."""
    line: int
    """The line where it begins, from 1."""
    column: int
    """The column where it begins, from 1, in characters."""
    end_line: int
    """The line where it ends."""
    end_column: int
    """The column behind its end."""
    message: str
    """What is wrong."""
    help: str
    """What to do; may be empty."""
    uses: Tuple[Use, ...]
    """For a problem in a graph that is used: the uses that lead there, from the outermost on."""
    text: str
    """The whole as a terminal shows it, with the lines of the graph."""
    note: Optional[Note] = None
    """Another place that explains it, if there is one."""
    fix: Tuple[TextEdit, ...] = ()
    """The edits of the file that make it go away, if there is one answer."""
    elements: Tuple[Element, ...] = ()
    """The first elements of a value that are not as they are wanted."""

    def __str__(self) -> str:
        """The whole as a terminal shows it, with the lines of the graph."""
        return self.text


def problem(told: Dict[str, Any]) -> Problem:
    """A problem as the engine tells it."""
    uses = tuple(Use(**use) for use in told.pop("uses", ()))
    note = told.pop("note", None)
    fix = tuple(TextEdit(**edit) for edit in told.pop("fix", ()))
    elements = tuple(Element(it["name"], (x, y, z)) for it in told.pop("elements", ()) for x, y, z in [it["at"]])
    return Problem(uses=uses, note=Note(**note) if note else None, fix=fix, elements=elements, **told)


def problems(told: Sequence[Dict[str, Any]]) -> List[Problem]:
    """Problems as the engine tells them."""
    return [problem(one) for one in told]


class GraphWarning(UserWarning):
    """Something about a graph, its inputs, its files or its cache is to be doubted, though it can be run."""

    problem: Optional[Problem]
    """What it is and where, if it lies in a graph; None for troubles of the cache."""

    def __init__(self, text: str, problem: Optional[Problem] = None) -> None:
        super().__init__(text)
        self.problem = problem


class UnknownNodeWarning(GraphWarning):
    """A graph has a node of a type that no pack has: what does not hang on it can be run."""


# The code of the problem that a node's type is one that no pack has.
_UNKNOWN_NODE = "G003"


def warning_of(problem: Problem) -> GraphWarning:
    """The warning that says a problem in one line."""
    kind = UnknownNodeWarning if problem.code == _UNKNOWN_NODE else GraphWarning
    text = f"{problem.file}:{problem.line}:{problem.column}: {problem.message}"
    return kind(f"{text} ({problem.help})" if problem.help else text, problem)


class Cancelled(Exception):
    """A run was stopped by `Graph.cancel` or `Running.cancel`."""


class GraphError(Exception):
    """A graph cannot be read, or something of it failed.

    `problems` says where and why, one by one; `run`, where something was run, what was found all the same.
    """

    problems: List[Problem]
    run: Optional[Run]

    def __init__(self, problems: Sequence[Problem], run: Optional[Run] = None) -> None:
        self.problems = list(problems)
        self.run = run
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(["", *(problem.text for problem in self.problems)])

    def __reduce__(self) -> Tuple[Any, ...]:
        # A run stays in its process.
        return GraphError, (self.problems,)
