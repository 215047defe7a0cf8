"""Runs graphs by each host: the command line, `maquette serve`, the client of the Blender add-on, and the Python module.

Options of a run have the same names for all hosts; `table.py` lists them. Each host has a function that takes the folder of a project and
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

# The options of a session, by their names on the command line and in `load`.
SESSION = ("cache", "cache_remote", "verify_cache", "memory", "max_memory", "threads")

# The maximum time of a run in seconds, on a busy machine.
TIMEOUT = 120

Host = Callable[[pathlib.Path, Mapping[str, Any]], Outcome]


class Value:
    """A value of a parameter: for Python, and as RON for all other hosts."""

    def __init__(self, python: Any, text: Optional[str] = None) -> None:
        self.python, self.text = python, json.dumps(python) if text is None else text


def session_arguments(options: Mapping[str, Any]) -> List[str]:
    """The options of a session as arguments of the command line."""
    words = []
    for name in SESSION:
        if name in options and options[name] is None:
            words.append("--no-cache")
        elif name in options:
            words += [f"--{name.replace('_', '-')}={options[name]}"]
    return words


def out_folder(project: pathlib.Path, options: Mapping[str, Any]) -> pathlib.Path:
    """The folder of the outputs."""
    name = pathlib.Path(options.get("graph", "it.ron")).stem
    return project.joinpath(options.get("out", f"out/{name}-draft" if options.get("draft") else f"out/{name}"))


def verdict_of(found: Sequence[Mapping[str, Any]]) -> str:
    """The verdict of a run with these problems."""
    return FAILED if any(it["severity"] == "error" for it in found) else DONE


def environment(project: pathlib.Path) -> Dict[str, str]:
    """The environment of a process that uses the cache of the project."""
    return {**os.environ, "MAQUETTE_CACHE": str(project.parent / "cache")}


def command_line(command: Sequence[str]) -> Host:
    """The host `maquette run`, of the program or of the Python module."""

    def run(project: pathlib.Path, options: Mapping[str, Any]) -> Outcome:
        listens = options.get("progress") or options.get("cancel")
        words = ["run", options.get("graph", "it.ron"), "--events" if listens else "--json", *session_arguments(options)]
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
        received: List[Dict[str, Any]] = []
        if listens:
            assert process.stdout
            for line in process.stdout:
                received.append(json.loads(line))
                if options.get("cancel") and received[-1]["event"] == "started":
                    process.send_signal(signal.SIGINT)
        out, said = process.communicate(timeout=TIMEOUT)
        end = {0: DONE, 1: FAILED, 2: USAGE, 130: STOPPED}[process.returncode]
        if end in (USAGE, STOPPED):
            return Outcome(end, said=said)
        if listens:
            last = received[-1]
            found = [it for event in received if event["event"] == "problems" for it in event["problems"]]
        else:
            last = json.loads(out) if out.startswith("{") else {"nodes": [], "problems": []}
            found = last["problems"]
        return Outcome(
            end,
            problems(found, project),
            troubles([line[len("warning: ") :] for line in said.splitlines() if line.startswith("warning: ")], project),
            nodes(last["nodes"]),
            files=files(out_folder(project, options)),
            events=events(received) if listens else None,
            said=said,
        )

    return run


KNOWN = {*SESSION, "graph", "set", "input_files", "input_values", "outputs", "roots", "draft", "locked", "pins", "provenance", "out", "progress", "cancel"}
"""The options that have a special treatment above; all others are passed as they are."""


class Server:
    """A process of `maquette serve --stdio`, with one request at a time."""

    def __init__(self, command: Sequence[str], project: pathlib.Path) -> None:
        self._words = open(project.parent / "words", "w+", encoding="utf-8")
        self._process = subprocess.Popen(
            command, cwd=project, env=environment(project), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._words, encoding="utf-8"
        )
        self._asked, self.project = 0, project
        ready = self._read_event()
        self.folder = pathlib.Path(ready["folder"]) if ready else None

    def _read_event(self) -> Dict[str, Any]:
        assert self._process.stdout
        line = self._process.stdout.readline()
        return dict(json.loads(line)) if line else {}

    def ask(self, do: str, on_event: Callable[[int, Dict[str, Any]], object], fields: Mapping[str, Any]) -> Dict[str, Any]:
        """Sends a request and returns its answer; calls `on_event` with the id and each event before it."""
        self._asked += 1
        asked = self._asked
        self.send({"id": asked, "do": do, **fields})
        while True:
            event = self._read_event()
            if not event or event.get("id") == asked:
                return event
            on_event(asked, event)

    def cancel(self, run: int) -> None:
        """Cancels a run, and does not wait for the answer."""
        self.send({"id": "cancel", "do": "cancel", "run": run})

    def send(self, request: Mapping[str, Any]) -> None:
        """Sends a request."""
        assert self._process.stdin
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()

    def stop(self) -> Tuple[int, str]:
        """Ends the server; returns its exit code and its error output."""
        self._process.communicate(timeout=TIMEOUT)
        self._words.seek(0)
        with self._words:
            return self._process.returncode, self._words.read()


class AddonClient:
    """A process of `maquette serve --stdio`, used through the client of the Blender add-on, which never blocks."""

    def __init__(self, command: Sequence[str], project: pathlib.Path, make: Any = None) -> None:
        if make is None:
            sys.path.insert(0, str(ADDON_FOLDER))
            make = importlib.import_module("client").Client
        self.project = project
        with working_in(project):
            self._client = make(list(command))
        self._until(lambda: self._client.folder or self._client.ended)
        self.folder = self._client.folder

    def _until(self, is_so: Callable[[], object]) -> None:
        end = time.monotonic() + TIMEOUT
        while not is_so():
            assert time.monotonic() < end, "no answer"
            self._client.poll()
            time.sleep(0.001)

    def ask(self, do: str, on_event: Callable[[int, Dict[str, Any]], object], fields: Mapping[str, Any]) -> Dict[str, Any]:
        """Sends a request and returns its answer; calls `on_event` with the id and each event before it."""
        answers: List[Any] = []
        self._client.ask(do, answers.append, lambda event: on_event(event["run"], event), **fields)
        self._until(lambda: answers)
        return dict(answers[0].event)

    def cancel(self, run: int) -> None:
        """Cancels a run, and does not wait for the answer."""
        self._client.ask("cancel", None, None, run=run)

    def stop(self) -> Tuple[int, str]:
        """Ends the server; returns its exit code and its error output."""
        process = self._client._process
        assert process and process.stdin
        process.stdin.close()
        code = process.wait(TIMEOUT)
        self._client._words.seek(0)
        words = self._client._words.read().decode()
        self._client.stop()
        return code, words


def serve_host(command: Sequence[str], kind: Any = Server) -> Host:
    """The host `maquette serve`, with a client."""

    def run(project: pathlib.Path, options: Mapping[str, Any]) -> Outcome:
        server = kind([*command, "serve", "--stdio", *session_arguments(options)], project)
        received: List[Dict[str, Any]] = []

        def on_event(asked: int, event: Dict[str, Any]) -> None:
            received.append(event)
            if options.get("cancel") and event.get("event") == "started":
                server.cancel(asked)

        answer: Dict[str, Any] = {}
        hashes: Dict[str, str] = {}
        if server.folder:
            answer = server.ask("run", on_event, run_fields(server, options))
            hashes = {name: hash_of(server.folder, value) for name, value in answer.get("values", {}).items()}
        code, said = server.stop()
        if code or answer.get("event") == "refused" and not answer["problems"]:
            return Outcome(USAGE, said=said + answer.get("why", ""))
        assert not code, said
        if answer.get("cancelled"):
            return Outcome(STOPPED)
        warned_of = [it["message"] for it in answer["problems"] if it["code"] == "G017" and is_cache_warning(it["message"])]
        found = [it for it in answer["problems"] if it["message"] not in warned_of]
        warned_of += [line[len("warning: ") :] for line in said.splitlines() if line.startswith("warning: ")]
        return Outcome(
            verdict_of(found),
            problems(found, project),
            troubles(warned_of, project),
            nodes(answer.get("nodes", ())),
            hashes=hashes,
            events=events(received) if options.get("progress") else None,
        )

    return run


def is_cache_warning(message: str) -> bool:
    """Returns true if a warning is about the cache or the server of results; hosts have these among the problems."""
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
        fields["inputs"] = {name: send_value(server, name, path) for name, path in fields.pop("input_values").items()}
    return fields


def send_value(server: Any, name: str, path: str) -> str:
    """Writes the columns of a value into the folder, creates a value of them, and returns its hash."""
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


def hash_of(folder: pathlib.Path, answer: Mapping[str, Any]) -> str:
    """Creates a value from the columns of an answer, checks that its hash is that of the answer, and returns it."""
    import maquette
    import numpy as np

    parts = {}
    for column in answer["columns"]:
        kind = {"f64": "<f8", "f32": "<f4", "u32": "<u4", "u8": "u1"}[column["type"]]
        array = np.frombuffer((folder / column["file"]).read_bytes(), kind)
        assert array.size == column["count"] * column["width"]
        array = array.reshape(-1, column["width"]) if column["width"] > 1 else array
        if column["on"] == "pixel":
            array = array.reshape(-1, answer["row"], column["width"])
        parts[column["name"]] = maquette.Part(column["name"], column["on"], column["meaning"], array)
    value = maquette.Value.from_parts(answer["type"], parts, answer["facts"])
    assert value.hash == answer["hash"], answer
    return str(value.hash)


def module(project: pathlib.Path, options: Mapping[str, Any]) -> Outcome:
    """The host Python module, in this process."""
    import maquette

    loads = {name: options[name] for name in (*SESSION, "roots", "pins", "locked") if name in options}
    runs = {name: value for name, value in options.items() if name not in (*loads, "graph", "set", "out", "provenance", "progress", "cancel")}
    if "set" in options:
        runs["params"] = {name: value.python for name, value in options["set"].items()}
    if "input_files" in options:
        runs["inputs"] = runs.pop("input_files")
    if "input_values" in options:
        runs["inputs"] = {name: maquette.read(project / path) for name, path in runs.pop("input_values").items()}
    received: List[Dict[str, Any]] = []
    graph: Optional[maquette.Graph] = None

    def on_event(progress: maquette.Progress) -> None:
        # Nodes that are not evaluated have no name.
        if progress.state != "progress" and progress.node:
            received.append({"event": "finished", "node": progress.node, "state": progress.state})
        if options.get("cancel") and progress.state == "started":
            assert graph
            graph.cancel()

    if options.get("progress") or options.get("cancel"):
        runs["progress"] = on_event
    with working_in(project), warnings.catch_warnings(record=True) as warned:
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
    warned_of = [it.message for it in warned if isinstance(it.message, maquette.GraphWarning)]
    failed = [*failed, *(it.problem for it in warned_of if it.problem)]
    found = [dict(it._asdict()) for it in dict.fromkeys(failed)]
    # An error of a run may have been a warning of `load`, where it is not known yet that the node is needed.
    errors = [{**it, "severity": "", "text": ""} for it in found if it["severity"] == "error"]
    found = [it for it in found if it["severity"] == "error" or {**it, "severity": "", "text": ""} not in errors]
    unsaid = [it for it in checked if it["severity"] == "warning" and not any(it["message"] in str(one) for one in warned_of)]
    assert run is None or not unsaid, unsaid
    return Outcome(
        verdict_of(found),
        problems(found, project),
        troubles([str(it) for it in warned_of if not it.problem], project),
        nodes([node._asdict() for node in run.trace]) if run is not None else {},
        hashes,
        written,
        events(received) if options.get("progress") else None,
        problems(found, project) - problems(checked, project),
    )


class working_in:
    """A context in which the current folder is that of a project and the cache is that of the project."""

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
