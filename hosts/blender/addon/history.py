"""External changes of a graph file while a tree shows it: those not made by this tree. Does not use Blender.

An undo in Blender restores an older tree with its text. External changes are not undo steps of the user: they are merged into that text
before it is written (`put` in docs/serve.md). So a tree stores, beside its text, the number of external changes that the text contains.
"""

from __future__ import annotations

from typing import Mapping, NamedTuple

# The maximum number of remembered changes. An undo to an older step is refused.
MAX_CHANGES = 1000


class Change(NamedTuple):
    """An external change: the text before and after it, and the positions of the nodes that it moved."""

    before: str
    after: str
    spots: Mapping[str, tuple[float, float]]


class History:
    """The external changes of one file, and its last known text."""

    def __init__(self) -> None:
        # None until the file is read.
        self.text: str | None = None
        self._first = 0
        self._changes: list[Change] = []

    @property
    def count(self) -> int:
        """The number of external changes that the text contains."""
        return self._first + len(self._changes)

    def begin(self, text: str, count: int) -> None:
        """Starts with a text that contains this number of changes already."""
        self.text, self._first, self._changes = text, count, []

    def update(self, before: str, text: str) -> None:
        """Records that the file had the text `before` and has `text` now. If `before` is not the known text, it is an external change."""
        if self.text is not None and self.text != before:
            self._add(Change(self.text, before, {}))
        self.text = text

    def add_moves(self, spots: Mapping[str, tuple[float, float]]) -> None:
        """Adds an external change that moved nodes to these positions."""
        assert self.text is not None
        self._add(Change(self.text, self.text, spots))

    def changes_since(self, count: int) -> list[Change] | None:
        """The changes that a text with `count` changes lacks; None if they are no longer remembered."""
        place = count - self._first
        return self._changes[place:] if 0 <= place <= len(self._changes) else None

    def _add(self, change: Change) -> None:
        self._changes.append(change)
        if len(self._changes) > MAX_CHANGES:
            del self._changes[0]
            self._first += 1
