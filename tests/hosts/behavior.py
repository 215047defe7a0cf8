"""Runs a row of the table by all hosts and compares the outcomes. Used by `hosts/python/tests` and `hosts/blender/tests`."""

from __future__ import annotations

import pathlib
import subprocess
from typing import Dict, FrozenSet, List, Mapping, Sequence

import project
from hosts import ADDON, COMMAND_LINE, PYTHON, SERVE, Host, environment
from outcome import DONE, FAILED, USAGE, Outcome, Problem
from table import LACKS, Row

# Texts in messages of the command line, and the corresponding texts of the Python module.
IN_PYTHON = {
    "--set ": "",
    "(--cache chooses another folder)": "(`load(cache=..)` chooses another folder)",
    "or allow more (--max-memory)": "or allow more by `load(max_memory=..)`",
    "--out chooses": "`write(folder)` chooses",
}


def in_python(text: str) -> str:
    """Translates a message of the command line to that of the Python module."""
    for word, other in IN_PYTHON.items():
        text = text.replace(word, other)
    return text


def check(row: Row, hosts: Mapping[str, Host], command: Sequence[str], folder: pathlib.Path) -> None:
    """Runs a row by these hosts. `command` is the command line that prepares projects."""
    outcomes: Dict[str, Outcome] = {}
    for number, (name, host) in enumerate(hosts.items()):
        place = project.make(folder / str(number))

        def run(*words: str) -> None:
            subprocess.run([*command, *words], cwd=place, env=environment(place), check=True, capture_output=True)

        row.before(place, run)
        outcome = host(place, row.options)
        lacking = [option for option in row.options if (name, option) in LACKS]
        if lacking:
            check_refusal(name, lacking, outcome)
        else:
            check_end(row, name, outcome)
            outcomes[name] = outcome
    compare(row, outcomes)


def check_refusal(name: str, lacking: List[str], outcome: Outcome) -> None:
    """Checks that a host refuses an option that it does not have, with its name."""
    words = outcome.said + str(outcome.problems)
    assert outcome.end in (USAGE, FAILED), (name, outcome)
    for option in lacking:
        assert any(f"{quote}{word}" in words for quote in "`'" for word in (option, f"--{option.replace('_', '-')}")), (name, words)


def check_end(row: Row, name: str, outcome: Outcome) -> None:
    """Checks the verdict of a run."""
    assert outcome.end == row.ends.get(name, row.end), (name, outcome.said, sorted(outcome.problems))
    if name not in row.other_words and name not in row.ends:
        assert set(row.codes) <= outcome.codes, (name, sorted(outcome.problems))
    if row.end == FAILED:
        assert outcome.problems or name in row.other_words, name
    if row.state:
        assert row.state in [state for _, state, *_ in outcome.nodes.values()], (name, outcome.nodes)


def compare(row: Row, outcomes: Mapping[str, Outcome]) -> None:
    """Checks that all hosts report and return the same."""
    comparable = {name: it for name, it in outcomes.items() if name not in row.other_words and name not in row.ends}
    of_files = outcomes[PYTHON].of_files if PYTHON in outcomes else frozenset()
    wanted: Dict[str, FrozenSet[Problem]] = {}
    for name, it in comparable.items():
        mine = it.problems if name not in (SERVE, ADDON) else it.problems | of_files
        wanted[name] = frozenset((*rest, in_python(message), in_python(help)) for *rest, message, help in mine)  # type: ignore[misc]
    assert_same("problems", wanted)
    assert_same("troubles", {name: frozenset(map(in_python, it.troubles)) for name, it in comparable.items()})
    assert_same("nodes", {name: {node: tuple(map(in_python, what)) for node, what in it.nodes.items()} for name, it in comparable.items()})
    assert_same("files", {name: it.files for name, it in comparable.items() if it.files is not None})
    assert_same("hashes", {name: it.hashes for name, it in comparable.items() if it.hashes is not None})
    assert_same("events", {name: it.events for name, it in comparable.items() if it.events is not None})
    if row.end == DONE and COMMAND_LINE in outcomes and PYTHON in outcomes:
        assert outcomes[COMMAND_LINE].files and outcomes[PYTHON].files and outcomes[PYTHON].hashes


def assert_same(what: str, found: Mapping[str, object]) -> None:
    """Checks that all entries are equal."""
    names = list(found)
    for name in names[1:]:
        assert found[name] == found[names[0]], f"{what} of {name} and of {names[0]} differ"
