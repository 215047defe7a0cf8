"""Problems of graphs, and the errors and warnings that report them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

if TYPE_CHECKING:
    from ._run import Run


class Use(NamedTuple):
    """A use of a graph in another one, on the path to a problem."""

    name: str
    """The name of the node that uses the graph."""
    file: str
    """The file with this node."""
    line: int
    """The line of the node, from 1."""
    column: int
    """The column of the node, from 1, in characters."""


class Note(NamedTuple):
    """Another position that explains a problem, such as the other end of a link."""

    file: str
    """The graph file."""
    line: int
    """The first line, from 1."""
    column: int
    """The first column, from 1, in characters."""
    end_line: int
    """The last line."""
    end_column: int
    """The column after the last character."""
    message: str
    """The explanation."""


class TextEdit(NamedTuple):
    """A replacement of a range of text in a graph file."""

    line: int
    """The first line, from 1."""
    column: int
    """The first column, from 1, in characters."""
    end_line: int
    """The last line."""
    end_column: int
    """The column after the last character."""
    text: str
    """The new text."""


class Element(NamedTuple):
    """An element of a value that violates a requirement."""

    name: str
    """Its name, such as `edge 0-2`."""
    at: Tuple[float, float, float]
    """Its position, in mm."""


class Problem(NamedTuple):
    """A problem in a graph file: its position, a message, and help."""

    severity: str
    """`error`, or `warning` if the graph can still run."""
    code: str
    """The kind of problem, such as `G007`; the meaning of codes never changes."""
    file: str
    """The graph file."""
    line: int
    """The first line, from 1."""
    column: int
    """The first column, from 1, in characters."""
    end_line: int
    """The last line."""
    end_column: int
    """The column after the last character."""
    message: str
    """The message."""
    help: str
    """A hint how to solve the problem; may be empty."""
    uses: Tuple[Use, ...]
    """For a problem in a used graph: the uses that lead to it, the outermost first."""
    text: str
    """The whole problem as in a terminal, with the lines of the graph."""
    note: Optional[Note] = None
    """Another position that explains the problem, if there is one."""
    fix: Tuple[TextEdit, ...] = ()
    """The edits of the file that solve the problem, if there is a unique solution."""
    elements: Tuple[Element, ...] = ()
    """The first elements of a value that violate a requirement."""

    def __str__(self) -> str:
        """The whole problem as in a terminal, with the lines of the graph."""
        return self.text


def problem(entry: Dict[str, Any]) -> Problem:
    """Converts a problem of the engine."""
    uses = tuple(Use(**use) for use in entry.pop("uses", ()))
    note = entry.pop("note", None)
    fix = tuple(TextEdit(**edit) for edit in entry.pop("fix", ()))
    elements = tuple(Element(it["name"], (x, y, z)) for it in entry.pop("elements", ()) for x, y, z in [it["at"]])
    return Problem(uses=uses, note=Note(**note) if note else None, fix=fix, elements=elements, **entry)


def problems(entries: Sequence[Dict[str, Any]]) -> List[Problem]:
    """Converts problems of the engine."""
    return [problem(entry) for entry in entries]


class GraphWarning(UserWarning):
    """A warning about a graph, its inputs, its files or its cache; the graph can be run."""

    problem: Optional[Problem]
    """The problem, if it is in a graph; None for errors of the cache."""

    def __init__(self, text: str, problem: Optional[Problem] = None) -> None:
        super().__init__(text)
        self.problem = problem


class UnknownNodeWarning(GraphWarning):
    """A graph has a node whose type is in no pack; everything that does not depend on the node can be run."""


# The code of the problem that the type of a node is in no pack.
_UNKNOWN_NODE = "G003"


def warning_of(problem: Problem) -> GraphWarning:
    """Creates the warning of a problem, with one line of text."""
    kind = UnknownNodeWarning if problem.code == _UNKNOWN_NODE else GraphWarning
    text = f"{problem.file}:{problem.line}:{problem.column}: {problem.message}"
    return kind(f"{text} ({problem.help})" if problem.help else text, problem)


class Cancelled(Exception):
    """A run was stopped by `Graph.cancel` or `Running.cancel`."""


class GraphError(Exception):
    """A graph cannot be read, or a part of it failed.

    `problems` has the positions and reasons; `run` has the values that were found nevertheless, if the graph was run.
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
        # A run cannot be sent to another process.
        return GraphError, (self.problems,)
