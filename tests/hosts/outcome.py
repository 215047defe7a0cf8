"""The outcome of a run, in a form that is comparable between hosts."""

from __future__ import annotations

import pathlib
from dataclasses import dataclass, field
from typing import Any, Dict, FrozenSet, Iterable, List, Mapping, Optional, Tuple

DONE, FAILED, USAGE, STOPPED = "done", "failed", "usage", "stopped"
"""Verdicts: a run without errors, a graph with an error, wrong usage of the host, and a cancelled run."""

Problem = Tuple[str, str, str, int, int, str, str]
"""Severity, code, file, line, column, message and help."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run."""

    end: str
    problems: FrozenSet[Problem] = frozenset()
    troubles: FrozenSet[str] = frozenset()
    """Warnings about the cache and the server of results."""
    nodes: Mapping[str, Tuple[str, ...]] = field(default_factory=dict)
    """The type, state, reason and warnings of each node."""
    hashes: Optional[Mapping[str, str]] = None
    """The hashes of the values of outputs; None if the host writes files instead."""
    files: Optional[Mapping[str, bytes]] = None
    """All files of the folder of outputs; None if the host returns values instead."""
    events: Optional[FrozenSet[Tuple[str, str]]] = None
    """The nodes that ended; None if no progress was requested."""
    of_files: FrozenSet[Problem] = frozenset()
    """The problems about output files."""
    said: str = ""
    """The message in case of wrong usage."""

    @property
    def codes(self) -> FrozenSet[str]:
        """The codes of the problems."""
        return frozenset(code for _, code, *_ in self.problems)


def without_folder(text: str, project: pathlib.Path) -> str:
    """Removes the folder of the project from a text, since hosts print paths as they were passed."""
    return text.replace(f"{project}/", "").replace(str(project), "@")


def troubles(found: Iterable[str], project: pathlib.Path) -> FrozenSet[str]:
    """Warnings about the cache and the server of results."""
    return frozenset(without_folder(text, project) for text in found)


def problems(found: Iterable[Mapping[str, Any]], project: pathlib.Path) -> FrozenSet[Problem]:
    """Converts problems in JSON; without the folders of files, since hosts print paths as they were passed."""

    def problem_tuple(it: Mapping[str, Any]) -> Problem:
        message, help = (without_folder(str(it[name]), project) for name in ("message", "help"))
        return it["severity"], it["code"], pathlib.PurePath(it["file"]).name, it["line"], it["column"], message, help

    return frozenset(map(problem_tuple, found))


def nodes(trace: Iterable[Mapping[str, Any]]) -> Dict[str, Tuple[str, ...]]:
    """The states of nodes, without times and sizes."""
    return {it["name"]: (it["node"], it["state"], it["reason"], *it["warnings"]) for it in trace}


def events(found: Iterable[Mapping[str, Any]]) -> FrozenSet[Tuple[str, str]]:
    """The final states of the nodes that were run; hosts differ in the other nodes that they report."""
    ended = ((it["node"], it.get("state", "started")) for it in found if it.get("event") == "finished")
    return frozenset(it for it in ended if it[1] not in ("started", "cached", "equal"))


def files(folder: pathlib.Path) -> Dict[str, bytes]:
    """All files of a folder, by relative path."""
    paths: List[pathlib.Path] = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
