"""Display in notebooks and terminals: pictures and tables of values, and progress bars."""

from __future__ import annotations

import base64
import html
import importlib
import sys
from typing import TYPE_CHECKING, Any, Callable, List, Sequence, Tuple

if TYPE_CHECKING:
    from ._run import Progress, Run
    from ._value import Value

_Bar = Tuple[Callable[["Progress"], object], Callable[[], object]]

_MAX_ROWS = 24
"""The maximum number of rows of a table; more are omitted."""


def value_html(value: Value) -> str:
    """The HTML of a value: its picture, and a table of facts and columns."""
    png = value._picture()
    picture = ""
    if png is not None:
        data = base64.b64encode(png).decode()
        picture = f'<img src="data:image/png;base64,{data}" style="max-width: 480px; max-height: 360px" alt="{value.kind}">'
    facts = [(name, str(fact)) for name, fact in value.facts.items()]
    columns = [(name, f"{part.array.shape} {part.array.dtype}, {part.meaning}") for name, part in value.parts.items()]
    heading = f"<b>{html.escape(value.kind)}</b> <code>{value.hash[:12]}</code>"
    table = _table([*facts, *columns])
    return f'<div style="display: flex; gap: 1em; align-items: start">{picture}<div>{heading}{table}</div></div>'


def run_html(run: Run) -> str:
    """The HTML of a run: the states of nodes, and problems."""
    rows = [
        (node.name, node.state, f"{node.seconds * 1000:.0f} ms" if node.seconds else "", node.reason)
        for node in run.trace
    ]
    told = "".join(f"<pre>{html.escape(problem.text)}</pre>" for problem in run.problems)
    return f"<b>{html.escape(repr(run)[1:-1])}</b>{_table(rows)}{told}"


def named_html(what: str, things: Sequence[Any]) -> str:
    """The HTML of parameters, inputs or outputs, one in each row; columns that are empty for all are omitted."""
    if not things:
        return f"no {what}"
    fields = [it for it in things[0]._fields if any(getattr(thing, it) not in (None, "", ()) for thing in things)]

    def cell(thing: Any, field: str) -> str:
        said = getattr(thing, field)
        return "" if said in (None, ()) else str(said)

    return _table([tuple(fields), *(tuple(cell(thing, field) for field in fields) for thing in things)])


def _table(rows: Sequence[Tuple[str, ...]]) -> str:
    cells = ["".join(f'<td style="text-align: left">{html.escape(cell)}</td>' for cell in row) for row in rows[:_MAX_ROWS]]
    more = f"<tr><td>and {len(rows) - _MAX_ROWS} more</td></tr>" if len(rows) > _MAX_ROWS else ""
    return "<table>" + "".join(f"<tr>{row}</tr>" for row in cells) + more + "</table>"


def bar() -> _Bar:
    """Creates a progress bar in a notebook or a terminal: a callback for `Progress`, and a function to call at the end."""
    return _notebook_bar() if _is_notebook() else _terminal_bar()


def _is_notebook() -> bool:
    # In a notebook, IPython is imported already.
    ipython: Any = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")


def _fraction(progress: Progress) -> float:
    part = progress.share if progress.state == "progress" else 0.0
    return min((progress.done + part) / max(progress.total, 1), 1.0)


def _notebook_bar() -> _Bar:
    ipython: Any = importlib.import_module("IPython.display")
    last: List[Tuple[float, str]] = [(0.0, "")]

    def draw(share: float, words: str) -> Any:
        return ipython.HTML(f'<progress value="{share:.3f}" max="1"></progress> {html.escape(words)}')

    shown = ipython.display(draw(0.0, ""), display_id=True)

    def tell(progress: Progress) -> None:
        now = (round(_fraction(progress), 2), progress.node)
        if now != last[0]:
            last[0] = now
            shown.update(draw(now[0], progress.node))

    return tell, lambda: shown.update(draw(1.0, "done"))


def _terminal_bar() -> _Bar:
    is_terminal = sys.stderr.isatty()
    width = 24

    def tell(progress: Progress) -> None:
        if is_terminal:
            full = round(_fraction(progress) * width)
            sys.stderr.write(f"\r\x1b[K[{'=' * full}{' ' * (width - full)}] {progress.node}")
            sys.stderr.flush()

    def end() -> None:
        if is_terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    return tell, end
