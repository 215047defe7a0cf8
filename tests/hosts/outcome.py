"""What a run came to, in the same words for all hosts."""

from __future__ import annotations

import pathlib
from dataclasses import dataclass, field
from typing import Any, Dict, FrozenSet, Iterable, List, Mapping, Optional, Tuple

DONE, FAILED, USAGE, STOPPED = "done", "failed", "usage", "stopped"
"""A run that went well, one whose graph has an error, one that was asked for wrongly, and one that was cancelled."""

Problem = Tuple[str, str, str, int, int, str, str]
"""Severity, code, file, line, column, message and help."""


@dataclass(frozen=True)
class Outcome:
    """What a run came to."""

    end: str
    problems: FrozenSet[Problem] = frozenset()
    troubles: FrozenSet[str] = frozenset()
    """Warnings about the cache and the server of results."""
    nodes: Mapping[str, Tuple[str, ...]] = field(default_factory=dict)
    """Of each node its type, its state, the reason and its warnings."""
    hashes: Optional[Mapping[str, str]] = None
    """The hashes of the values of outputs; None if the host writes files instead."""
    files: Optional[Mapping[str, bytes]] = None
    """All files of the folder of outputs; None if the host gives values instead."""
    events: Optional[FrozenSet[Tuple[str, str]]] = None
    """The nodes that ended, if somebody listened."""
    of_files: FrozenSet[Problem] = frozenset()
    """Those of its problems that are about the files of outputs."""
    said: str = ""
    """Why it was asked for wrongly."""

    @property
    def codes(self) -> FrozenSet[str]:
        """The codes of its problems."""
        return frozenset(code for _, code, *_ in self.problems)


def without_folder(text: str, project: pathlib.Path) -> str:
    """A text in which the folder of the project is not named: hosts name files as they were given."""
    return text.replace(f"{project}/", "").replace(str(project), "@")


def troubles(told: Iterable[str], project: pathlib.Path) -> FrozenSet[str]:
    """Warnings about the cache and the server of results."""
    return frozenset(without_folder(text, project) for text in told)


def problems(told: Iterable[Mapping[str, Any]], project: pathlib.Path) -> FrozenSet[Problem]:
    """Problems as JSON has them, but for the folders of files, which hosts name as they were given."""

    def one(it: Mapping[str, Any]) -> Problem:
        message, help = (without_folder(str(it[name]), project) for name in ("message", "help"))
        return it["severity"], it["code"], pathlib.PurePath(it["file"]).name, it["line"], it["column"], message, help

    return frozenset(map(one, told))


def nodes(trace: Iterable[Mapping[str, Any]]) -> Dict[str, Tuple[str, ...]]:
    """What became of the nodes, but for times and sizes."""
    return {it["name"]: (it["node"], it["state"], it["reason"], *it["warnings"]) for it in trace}


def events(told: Iterable[Mapping[str, Any]]) -> FrozenSet[Tuple[str, str]]:
    """How each node ended that had something to do; hosts differ in whether they look at others."""
    ended = ((it["node"], it.get("state", "started")) for it in told if it.get("event") == "finished")
    return frozenset(it for it in ended if it[1] not in ("started", "cached", "equal"))


def files(folder: pathlib.Path) -> Dict[str, bytes]:
    """All files of a folder by their paths in it."""
    paths: List[pathlib.Path] = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
