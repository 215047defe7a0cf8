"""What others changed in the file of a graph while a tree shows it. Nothing of Blender is here.

An undo of Blender brings back an older tree with the text that it had. Changes of others are not steps of the user: they are merged into
that text before it is written (`put` in docs/serve.md). So a tree keeps, beside its text, the number of changes of others that it has.
"""

from __future__ import annotations

from typing import Mapping, NamedTuple

# The number of changes that are remembered. An undo to a step before them is refused.
MAX_CHANGES = 1000


class Change(NamedTuple):
    """A change that somebody else made: the text before and after it, and the positions of the nodes that it moved."""

    before: str
    after: str
    spots: Mapping[str, tuple[float, float]]


class History:
    """The changes of others to one file, and its last known text."""

    def __init__(self) -> None:
        # None before the file was read.
        self.text: str | None = None
        self._first = 0
        self._changes: list[Change] = []

    @property
    def count(self) -> int:
        """The number of changes that the text has."""
        return self._first + len(self._changes)

    def begin(self, text: str, count: int) -> None:
        """Begins with a text that has this number of changes already."""
        self.text, self._first, self._changes = text, count, []

    def learn(self, before: str, text: str) -> None:
        """The file had the text `before`, and has `text` now. If `before` is not what was known, somebody else wrote it."""
        if self.text is not None and self.text != before:
            self._add(Change(self.text, before, {}))
        self.text = text

    def moved(self, spots: Mapping[str, tuple[float, float]]) -> None:
        """Somebody else moved nodes to these positions."""
        assert self.text is not None
        self._add(Change(self.text, self.text, spots))

    def since(self, count: int) -> list[Change] | None:
        """The changes that a text with `count` changes lacks; None if they are not known any more."""
        place = count - self._first
        return self._changes[place:] if 0 <= place <= len(self._changes) else None

    def _add(self, change: Change) -> None:
        self._changes.append(change)
        if len(self._changes) > MAX_CHANGES:
            del self._changes[0]
            self._first += 1
