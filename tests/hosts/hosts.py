"""Runs graphs by each host: the command line, `maquette serve`, the client of the Blender add-on, and the Python module.

A run is asked for by options in no host's words, which `table.py` lists. Each host has a function that takes the folder of a project and
options, and returns an `Outcome`.
"""

from __future__ import annotations

import importlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import time
import warnings
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

from outcome import DONE, FAILED, STOPPED, USAGE, Outcome, events, files, nodes, problems, troubles

COMMAND_LINE, PYTHON, SERVE, ADDON = "the command line", "Python", "maquette serve", "the add-on"

ADDON_FOLDER = pathlib.Path(__file__).resolve().parents[2] / "hosts/blender/addon"

# Options of a session, as the words of the command line and as `load` has them.
SESSION = ("cache", "cache_remote", "verify_cache", "memory", "max_memory", "threads")

# What a run may take at most, in seconds; on a busy machine.
PATIENCE = 120

Host = Callable[[pathlib.Path, Mapping[str, Any]], Outcome]


class Value:
    """A value of a parameter: for Python, and as text of RON for all others."""

    def __init__(self, python: Any, text: Optional[str] = None) -> None:
        self.python, self.text = python, json.dumps(python) if text is None else text


def session_words(options: Mapping[str, Any]) -> List[str]:
    """The options of a session in the words of the command line."""
    words = []
    for name in SESSION:
        if name in options and options[name] is None:
            words.append("--no-cache")
        elif name in options:
            words += [f"--{name.replace('_', '-')}={options[name]}"]
    return words


def out_folder(project: pathlib.Path, options: Mapping[str, Any]) -> pathlib.Path:
    """Where the outputs are written."""
    name = pathlib.Path(options.get("graph", "it.ron")).stem
    return project.joinpath(options.get("out", f"out/{name}-draft" if options.get("draft") else f"out/{name}"))


def end_of(found: Sequence[Mapping[str, Any]]) -> str:
    """Whether something failed."""
    return FAILED if any(it["severity"] == "error" for it in found) else DONE


def environment(project: pathlib.Path) -> Dict[str, str]:
    """The environment of a process that has the project's own cache."""
    return {**os.environ, "MAQUETTE_CACHE": str(project.parent / "cache")}


def command_line(command: Sequence[str]) -> Host:
    """`maquette run`, of a program or of the module."""

    def run(project: pathlib.Path, options: Mapping[str, Any]) -> Outcome:
        listens = options.get("progress") or options.get("cancel")
        words = ["run", options.get("graph", "it.ron"), "--events" if listens else "--json", *session_words(options)]
        for name, value in options.get("set", {}).items():
            words += ["--set", f"{name}={value.text}"]
        for name, path in {**options.get("input_files", {}), **options.get("input_values", {})}.items():
            words += ["--input", f"{name}={path}"]
        for name in options.get("outputs", ()):
            words += ["--only", name]
        for path in options.get("roots", ()):
            words += ["--root", path]
        words += ["--draft"] * options.get("draft", False) + ["--locked"] * options.get("locked", False)
        words += ["--no-pins"] * (not options.get("pins", True)) + ["--no-provenance"] * (not options.get("provenance", True))
        words += ["--out", options["out"]] if "out" in options else []
        for name in options.keys() - KNOWN:
            words.append(f"--{name.replace('_', '-')}" + ("" if options[name] is True else f"={options[name]}"))
        process = subprocess.Popen(
            [*command, *words], cwd=project, env=environment(project), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
        )
        told: List[Dict[str, Any]] = []
        if listens:
            assert process.stdout
            for line in process.stdout:
                told.append(json.loads(line))
                if options.get("cancel") and told[-1]["event"] == "started":
                    process.send_signal(signal.SIGINT)
        out, said = process.communicate(timeout=PATIENCE)
        end = {0: DONE, 1: FAILED, 2: USAGE, 130: STOPPED}[process.returncode]
        if end in (USAGE, STOPPED):
            return Outcome(end, said=said)
        if listens:
            last = told[-1]
            found = [it for event in told if event["event"] == "problems" for it in event["problems"]]
        else:
            last = json.loads(out) if out.startswith("{") else {"nodes": [], "problems": []}
            found = last["problems"]
        return Outcome(
            end,
            problems(found, project),
            troubles([line[len("warning: ") :] for line in said.splitlines() if line.startswith("warning: ")], project),
            nodes(last["nodes"]),
            files=files(out_folder(project, options)),
            events=events(told) if listens else None,
            said=said,
        )

    return run


KNOWN = {*SESSION, "graph", "set", "input_files", "input_values", "outputs", "roots", "draft", "locked", "pins", "provenance", "out", "progress", "cancel"}
"""The options that the command line has, but for those of `LACKS`."""


class Server:
    """`maquette serve --stdio`, and requests to it, one after the other."""

    def __init__(self, command: Sequence[str], project: pathlib.Path) -> None:
        self._words = open(project.parent / "words", "w+", encoding="utf-8")
        self._process = subprocess.Popen(
            command, cwd=project, env=environment(project), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._words, encoding="utf-8"
        )
        self._asked, self.project = 0, project
        ready = self._hear()
        self.folder = pathlib.Path(ready["folder"]) if ready else None

    def _hear(self) -> Dict[str, Any]:
        assert self._process.stdout
        line = self._process.stdout.readline()
        return dict(json.loads(line)) if line else {}

    def ask(self, do: str, told: Callable[[int, Dict[str, Any]], object], fields: Mapping[str, Any]) -> Dict[str, Any]:
        """The answer to a request; events before it are told with its id."""
        self._asked += 1
        asked = self._asked
        self.tell({"id": asked, "do": do, **fields})
        while True:
            event = self._hear()
            if not event or event.get("id") == asked:
                return event
            told(asked, event)

    def cancel(self, run: int) -> None:
        """Cancels a run, and does not wait for the answer."""
        self.tell({"id": "cancel", "do": "cancel", "run": run})

    def tell(self, request: Mapping[str, Any]) -> None:
        """Sends a request."""
        assert self._process.stdin
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()

    def stop(self) -> Tuple[int, str]:
        """Ends the server; its exit code, and what it said."""
        self._process.communicate(timeout=PATIENCE)
        self._words.seek(0)
        with self._words:
            return self._process.returncode, self._words.read()


class AddonClient:
    """The same by the client of the Blender add-on, which never waits."""

    def __init__(self, command: Sequence[str], project: pathlib.Path, make: Any = None) -> None:
        if make is None:
            sys.path.insert(0, str(ADDON_FOLDER))
            make = importlib.import_module("client").Client
        self.project = project
        with inside(project):
            self._client = make(list(command))
        self._until(lambda: self._client.folder or self._client.ended)
        self.folder = self._client.folder

    def _until(self, is_so: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE
        while not is_so():
            assert time.monotonic() < end, "no answer"
            self._client.poll()
            time.sleep(0.001)

    def ask(self, do: str, told: Callable[[int, Dict[str, Any]], object], fields: Mapping[str, Any]) -> Dict[str, Any]:
        """The answer to a request; events before it are told with its id."""
        answers: List[Any] = []
        self._client.ask(do, answers.append, lambda event: told(event["run"], event), **fields)
        self._until(lambda: answers)
        return dict(answers[0].event)

    def cancel(self, run: int) -> None:
        """Cancels a run, and does not wait for the answer."""
        self._client.ask("cancel", None, None, run=run)

    def stop(self) -> Tuple[int, str]:
        """Ends the server; its exit code, and what it said."""
        process = self._client._process
        assert process and process.stdin
        process.stdin.close()
        code = process.wait(PATIENCE)
        self._client._words.seek(0)
        words = self._client._words.read().decode()
        self._client.stop()
        return code, words


def served(command: Sequence[str], kind: Any = Server) -> Host:
    """`maquette serve`, asked by a client."""

    def run(project: pathlib.Path, options: Mapping[str, Any]) -> Outcome:
        server = kind([*command, "serve", "--stdio", *session_words(options)], project)
        told: List[Dict[str, Any]] = []

        def hear(asked: int, event: Dict[str, Any]) -> None:
            told.append(event)
            if options.get("cancel") and event.get("event") == "started":
                server.cancel(asked)

        answer: Dict[str, Any] = {}
        hashes: Dict[str, str] = {}
        if server.folder:
            answer = server.ask("run", hear, run_fields(server, options))
            hashes = {name: hash_of(server.folder, value) for name, value in answer.get("values", {}).items()}
        code, said = server.stop()
        if code or answer.get("event") == "refused" and not answer["problems"]:
            return Outcome(USAGE, said=said + answer.get("why", ""))
        assert not code, said
        if answer.get("cancelled"):
            return Outcome(STOPPED)
        told_of = [it["message"] for it in answer["problems"] if it["code"] == "G017" and is_trouble(it["message"])]
        found = [it for it in answer["problems"] if it["message"] not in told_of]
        told_of += [line[len("warning: ") :] for line in said.splitlines() if line.startswith("warning: ")]
        return Outcome(
            end_of(found),
            problems(found, project),
            troubles(told_of, project),
            nodes(answer.get("nodes", ())),
            hashes=hashes,
            events=events(told) if options.get("progress") else None,
        )

    return run


def is_trouble(message: str) -> bool:
    """Whether a warning is about the cache or the server of results; hosts have these among the problems."""
    return "results" in message


def run_fields(server: Any, options: Mapping[str, Any]) -> Dict[str, Any]:
    """The fields of the request `run`."""
    fields: Dict[str, Any] = {"graph": options.get("graph", "it.ron")}
    fields.update({name: value for name, value in options.items() if name not in (*SESSION, "graph", "progress", "cancel")})
    if "set" in options:
        fields["set"] = {name: value.text for name, value in options["set"].items()}
    if "outputs" in options:
        fields["want"] = [{"value": name} for name in [*fields.pop("outputs"), *fields.pop("nodes", ())]]
    if "input_values" in options:
        fields["inputs"] = {name: sent(server, name, path) for name, path in fields.pop("input_values").items()}
    return fields


def sent(server: Any, name: str, path: str) -> str:
    """Puts the columns of a value into the folder, and makes a value of them; its hash."""
    import maquette

    value = maquette.read(server.project / path)
    columns = []
    for number, part in enumerate(value.parts.values()):
        file = f"in-{name}-{number}"
        (server.folder / file).write_bytes(part.array.tobytes())
        kind = {"float64": "f64", "float32": "f32", "uint32": "u32", "uint8": "u8", "bool": "u8"}[part.array.dtype.name]
        width = part.array.shape[-1] if part.array.ndim > 1 else 1
        columns.append({"name": part.name, "on": part.on, "meaning": part.meaning, "width": width, "type": kind, "file": file})
    answer = server.ask("input", lambda *_: None, {"type": value.kind, "columns": columns, "facts": value.facts})
    assert answer["value"] == value.hash, answer
    return str(answer["value"])


def hash_of(folder: pathlib.Path, told: Mapping[str, Any]) -> str:
    """The hash of the value that is made of the columns of an answer, which is what the answer says."""
    import maquette
    import numpy as np

    parts = {}
    for column in told["columns"]:
        kind = {"f64": "<f8", "f32": "<f4", "u32": "<u4", "u8": "u1"}[column["type"]]
        array = np.frombuffer((folder / column["file"]).read_bytes(), kind)
        assert array.size == column["count"] * column["width"]
        array = array.reshape(-1, column["width"]) if column["width"] > 1 else array
        if column["on"] == "pixel":
            array = array.reshape(-1, told["row"], column["width"])
        parts[column["name"]] = maquette.Part(column["name"], column["on"], column["meaning"], array)
    value = maquette.Value.from_parts(told["type"], parts, told["facts"])
    assert value.hash == told["hash"], told
    return str(value.hash)


def module(project: pathlib.Path, options: Mapping[str, Any]) -> Outcome:
    """The Python module, in this process."""
    import maquette

    loads = {name: options[name] for name in (*SESSION, "roots", "pins", "locked") if name in options}
    runs = {name: value for name, value in options.items() if name not in (*loads, "graph", "set", "out", "provenance", "progress", "cancel")}
    if "set" in options:
        runs["params"] = {name: value.python for name, value in options["set"].items()}
    if "input_files" in options:
        runs["inputs"] = runs.pop("input_files")
    if "input_values" in options:
        runs["inputs"] = {name: maquette.read(project / path) for name, path in runs.pop("input_values").items()}
    told: List[Dict[str, Any]] = []
    graph: Optional[maquette.Graph] = None

    def hear(progress: maquette.Progress) -> None:
        # Nodes that need not be looked at have no name.
        if progress.state != "progress" and progress.node:
            told.append({"event": "finished", "node": progress.node, "state": progress.state})
        if options.get("cancel") and progress.state == "started":
            assert graph
            graph.cancel()

    if options.get("progress") or options.get("cancel"):
        runs["progress"] = hear
    with inside(project), warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            graph = maquette.load(options.get("graph", "it.ron"), **loads)
            run: Optional[maquette.Run] = graph.run(**runs)
            assert run
            failed = run.problems
        except maquette.GraphError as error:
            run, failed = error.run, [*error.problems, *(error.run.problems if error.run else ())]
        except maquette.Cancelled:
            return Outcome(STOPPED)
        except OSError as error:
            return Outcome(FAILED, said=f"{type(error).__name__}: {error}")
        except (ValueError, TypeError, KeyError) as error:
            return Outcome(USAGE, said=f"{type(error).__name__}: {error}")
        hashes: Dict[str, str] = {}
        written: Dict[str, bytes] = {}
        checked = [dict(it._asdict()) for it in dict.fromkeys(failed)]
        if run is not None:
            try:
                run.write(options.get("out"), provenance=options.get("provenance", True))
            except maquette.GraphError as error:
                failed = [*failed, *error.problems]
            hashes = {name: value.hash for name, value in run.items()}
        written = files(out_folder(project, options))
        del graph
    told_of = [it.message for it in warned if isinstance(it.message, maquette.GraphWarning)]
    failed = [*failed, *(it.problem for it in told_of if it.problem)]
    found = [dict(it._asdict()) for it in dict.fromkeys(failed)]
    # A graph that is loaded is not yet asked for what cannot be run, so that an error of a run may have been a warning of `load`.
    errors = [{**it, "severity": "", "text": ""} for it in found if it["severity"] == "error"]
    found = [it for it in found if it["severity"] == "error" or {**it, "severity": "", "text": ""} not in errors]
    unsaid = [it for it in checked if it["severity"] == "warning" and not any(it["message"] in str(one) for one in told_of)]
    assert run is None or not unsaid, unsaid
    return Outcome(
        end_of(found),
        problems(found, project),
        troubles([str(it) for it in told_of if not it.problem], project),
        nodes([node._asdict() for node in run.trace]) if run is not None else {},
        hashes,
        written,
        events(told) if options.get("progress") else None,
        problems(found, project) - problems(checked, project),
    )


class inside:
    """In this folder, with the cache of its project."""

    def __init__(self, project: pathlib.Path) -> None:
        self._project = project

    def __enter__(self) -> None:
        self._folder, self._cache = os.getcwd(), os.environ.get("MAQUETTE_CACHE")
        os.chdir(self._project)
        os.environ["MAQUETTE_CACHE"] = str(self._project.parent / "cache")

    def __exit__(self, *_: object) -> None:
        os.chdir(self._folder)
        if self._cache is None:
            del os.environ["MAQUETTE_CACHE"]
        else:
            os.environ["MAQUETTE_CACHE"] = self._cache
