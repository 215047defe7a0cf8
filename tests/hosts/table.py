"""The options of a run, one row each, with the expected outcome. Every row is run by every host.

`LACKS` has the options that a host does not have, with the reason: such a row is tried there, too, and must be refused with the option's
name.
"""

from __future__ import annotations

import pathlib
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List, Mapping, Sequence, Tuple

from hosts import ADDON, COMMAND_LINE, PYTHON, SERVE, Value
from outcome import DONE, FAILED, STOPPED, USAGE

Run = Callable[..., object]


def leave_unchanged(_project: pathlib.Path, _run: Run) -> None:
    """Leaves the project unchanged."""


@dataclass(frozen=True)
class Row:
    """An option, or a combination of options."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    end: str = DONE
    codes: Sequence[str] = ()
    """Codes of problems that must be reported."""
    before: Callable[[pathlib.Path, Run], object] = leave_unchanged
    """Prepares the project; is called with the folder and a function that runs the command line."""
    state: str = ""
    """A state that at least one node must have."""
    ends: Mapping[str, str] = field(default_factory=dict)
    """The verdicts of hosts that differ from `end`."""
    other_words: Mapping[str, str] = field(default_factory=dict)
    """The hosts that have another message, and why."""


def edit_file(name: str, old: str, new: str) -> Callable[[pathlib.Path, Run], object]:
    """Returns a step that replaces a text in a file."""

    def edit(project: pathlib.Path, _run: Run) -> None:
        path = project / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return edit


def run_commands(*commands: str) -> Callable[[pathlib.Path, Run], object]:
    """Returns a step that runs commands."""

    def run_all(_project: pathlib.Path, run: Run) -> None:
        for command in commands:
            run(*command.split())

    return run_all


def in_order(*steps: Callable[[pathlib.Path, Run], object]) -> Callable[[pathlib.Path, Run], object]:
    """Returns a step that performs several steps in order."""

    def do(project: pathlib.Path, run: Run) -> None:
        for step in steps:
            step(project, run)

    return do


def foreign_folder(project: pathlib.Path, _run: Run) -> None:
    """Creates a folder with files that is not a cache."""
    (project / "mine").mkdir()
    (project / "mine/letter.txt").write_text("dear")


def a_file(project: pathlib.Path, _run: Run) -> None:
    """Creates a file where a folder is expected."""
    (project / "mine").write_text("dear")


PINNED = in_order(run_commands("pin it.ron skin"))
STALE = in_order(PINNED, edit_file("it.ron", '"levels": Integer(default: 1', '"levels": Integer(default: 2'))
UNLOCKED = in_order(run_commands("lock it.ron"), edit_file("part.ron", "(1, 0, 0)", "(2, 0, 0)"))
WARM = run_commands("run it.ron --out warm")


def parameters(**values: Any) -> Dict[str, Any]:
    """Options with values of parameters, by name."""
    return {"set": {name: value if isinstance(value, Value) else Value(value) for name, value in values.items()}}


def field_of(name: str, value: Any, text: str) -> Dict[str, Any]:
    """Options with a value of a field, or of a parameter whose name is not a Python identifier."""
    return {"set": {name: Value(value, text)}}


ROWS = [
    Row("nothing", state="computed"),
    # Values of parameters.
    Row("an integer", parameters(levels=2)),
    Row("a number", parameters(move=0.1)),
    Row("a number that is an integer", parameters(move=7)),
    Row("a number with a unit", field_of("move", "1.5cm", "1.5cm"), FAILED),
    Row("a vector", parameters(turn=Value((10, 20.5, -30), "(10, 20.5, -30)"))),
    Row("a toggle", parameters(invert=Value(True, "true"))),
    Row("a color", parameters(paint="#ffffff")),
    Row("a choice", parameters(scheme=Value("CatmullClark", "CatmullClark"))),
    Row("a text", parameters(file="open.obj")),
    Row("a name with a hyphen", field_of("eye-step", 3, "3")),
    Row("two values", parameters(levels=0, move=3)),
    Row("a field", field_of("skin.levels", 0, "0")),
    Row("a number below its range", parameters(levels=-1), FAILED, ["G010"]),
    Row("a number above its range", parameters(move=91), FAILED, ["G010"]),
    Row("a number for an integer", parameters(levels=1.5), FAILED),
    Row("a text for a number", parameters(move="much"), FAILED),
    Row("a text for a toggle", parameters(invert="maybe"), FAILED),
    Row("an unknown color", parameters(paint="reddish"), FAILED),
    Row("an unknown choice", parameters(scheme=Value("Loop", "Loop")), FAILED),
    Row("a short vector", parameters(turn=Value((1, 2), "(1, 2)")), FAILED),
    Row("an unknown parameter", parameters(level=2), FAILED),
    Row("an unknown field", field_of("skin.level", 2, "2"), FAILED),
    Row("an unknown node", field_of("skim.levels", 2, "2"), FAILED),
    Row("a missing file", parameters(file="boks.obj"), FAILED, ["G013"]),
    # Reading of the graph.
    Row("a draft", {"draft": True}),
    Row("a draft with a value", {"draft": True, **parameters(levels=3, move=2)}),
    Row("a folder that may be read", {"graph": "outside.ron", "roots": ["../outside"]}),
    Row("a folder that may not be read", {"graph": "outside.ron"}, FAILED, ["G014"]),
    Row("a pin", {}, before=PINNED),
    Row("a stale pin", {}, codes=["G033"], before=STALE),
    Row("no pins", {"pins": False}, before=STALE),
    Row("a stale pin and a draft", {"draft": True}, before=STALE),
    Row("a lock", {"locked": True}, before=run_commands("lock it.ron")),
    Row("no lock", {"locked": True}, FAILED),
    Row("a lock that does not fit", {"locked": True}, FAILED, before=UNLOCKED),
    Row("a lock that nobody asks for", {}, before=UNLOCKED),
    Row("a missing graph", {"graph": "none.ron"}, FAILED, other_words={PYTHON: "as `open` has it, FileNotFoundError"}),
    Row("a graph with mistakes", {}, FAILED, before=edit_file("it.ron", "ReadMesh", "ReedMesh")),
    Row("a graph with a syntax error", {}, FAILED, before=edit_file("it.ron", "nodes: {", "nodes: {{")),
    Row("a graph with a warning", {}, before=edit_file("it.ron", '"idle": Primitive', '"idel": Primitive')),
    Row("a mistake in a used graph", {}, FAILED, before=edit_file("part.ron", "Transform", "Transfrom")),
    # Inputs.
    Row("an input", {"graph": "part.ron", "input_values": {"mesh": "box.obj"}}),
    Row("a file at an input", {"graph": "part.ron", "input_files": {"mesh": "box.obj"}}),
    Row("no value at an input", {"graph": "part.ron"}, FAILED, ["G016"]),
    Row("another type at an input", {"graph": "part.ron", "input_values": {"mesh": "dots.png"}}, FAILED, other_words={COMMAND_LINE: "a file that has no mesh"}),
    Row("another type of file at an input", {"graph": "part.ron", "input_files": {"mesh": "dots.png"}}, FAILED),
    Row("a missing file at an input", {"graph": "part.ron", "input_files": {"mesh": "boks.obj"}}, FAILED),
    Row("a value at an unknown input", {"graph": "part.ron", "input_values": {"mash": "box.obj"}}, FAILED),
    Row("a file at an unknown input", {"graph": "part.ron", "input_files": {"mash": "box.obj"}}, FAILED),
    # Caches and limits.
    Row("a cache of its own", {"cache": "mine"}),
    Row("no cache", {"cache": None}),
    Row("a cache that is warm", {}, before=WARM, state="cached"),
    Row("a warm cache that is left alone", {"cache": None}, before=WARM, state="computed"),
    Row("a folder that is no cache", {"cache": "mine"}, USAGE, before=foreign_folder),
    Row("a file in the place of the cache", {"cache": "mine"}, before=a_file),
    Row("a server that is not there", {"cache_remote": "http://127.0.0.1:9/results"}),
    Row("a server that is none", {"cache_remote": "gopher://host"}, USAGE),
    Row("a cold cache is verified", {"verify_cache": 100}),
    Row("a warm cache is verified", {"verify_cache": 100}, before=WARM, state="computed"),
    Row("a part of a cache is verified", {"verify_cache": 0.5}),
    Row("less than nothing is verified", {"verify_cache": -1}, USAGE),
    Row("more than all is verified", {"verify_cache": 101}, USAGE),
    Row("memory for results", {"memory": "500MB"}),
    Row("memory that is none", {"memory": "much"}, USAGE),
    Row("memory for a run", {"max_memory": "4GB"}),
    Row("too little memory for a run", {"max_memory": "1kB", "threads": 1}, FAILED),
    Row("memory for a run that is none", {"max_memory": "much"}, USAGE),
    Row("one thread", {"threads": 1}),
    Row("three threads", {"threads": 3}),
    Row("fewer threads than none", {"threads": -1}, USAGE),
    # Requested results.
    Row("an output", {"outputs": ["red.png"]}),
    Row("some outputs", {"outputs": ["sub/skin.glb", "skin.ply"]}),
    # A request to a server may name a node, so an unknown name is a problem of the graph, not wrong usage.
    Row("an unknown output", {"outputs": ["blue.png"]}, USAGE, ends={SERVE: FAILED, ADDON: FAILED}),
    Row("a node", {"outputs": [], "nodes": ["idle"]}),
    Row("progress", {"progress": True}),
    Row("a cancelled run", {"graph": "slow.ron", "cancel": True, "cache": None}, STOPPED),
    Row("a timeout", {"timeout": 60}),
    Row("a forecast", {"dry_run": True}),
    Row("a report", {"report": "it.html"}),
    Row("times and sizes", {"profile": True}),
    # Written files.
    Row("a folder", {"out": "there/it"}),
    Row("a folder of a draft", {"out": "there", "draft": True}),
    Row("a file in the place of the folder", {"out": "mine"}, FAILED, before=a_file),
    Row("no provenance", {"provenance": False}),
    # Failures.
    Row("a failing node and an expectation", {"graph": "wrong.ron"}, FAILED, ["G016", "G020"], state="failed"),
    Row("a failing node beside others", {"graph": "wrong.ron", "outputs": ["box.ply"]}),
]

_HOST_HAS_VALUES = "a host gets values and writes files itself"
LACKS: Dict[Tuple[str, str], str] = {
    (COMMAND_LINE, "nodes"): "it writes outputs; `maquette inspect` shows nodes",
    (COMMAND_LINE, "timeout"): "the system has a command: `timeout 60 maquette run it.ron`",
    (PYTHON, "dry_run"): "`Graph.why` explains each node",
    (PYTHON, "profile"): "`Run.trace` has times and sizes",
    **{(host, "timeout"): "a host can measure the time itself and use `cancel`" for host in (SERVE, ADDON)},
    **{(host, "out"): _HOST_HAS_VALUES for host in (SERVE, ADDON)},
    **{(host, "provenance"): _HOST_HAS_VALUES for host in (SERVE, ADDON)},
    **{(host, "input_files"): "a host reads files itself and passes columns of values" for host in (SERVE, ADDON)},
    **{(host, "dry_run"): "the request `why` explains each node" for host in (SERVE, ADDON)},
    **{(host, "profile"): "the answer has times and sizes in `nodes`" for host in (SERVE, ADDON)},
    **{(host, "report"): "`maquette batch` and `maquette test` write reports of many runs" for host in (COMMAND_LINE, PYTHON, SERVE, ADDON)},
}
