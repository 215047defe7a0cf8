"""Tests that graphs run as on the command line: each option gives the same files, problems and folders."""

from __future__ import annotations

import json
import pathlib
import shutil
import subprocess
import warnings
from typing import Any, Callable, Dict, List, Set, Tuple

import pytest

import maquette

Program = Callable[..., "subprocess.CompletedProcess[str]"]

pytestmark = pytest.mark.every_change

GRAPH = """Graph(
    format: 1,
    params: { "levels": Integer(default: 1, min: 0, max: 4, doc: "How often.") },
    nodes: {
        "box": ReadMesh(path: "box.obj"),
        "part": Part(mesh: "box"),
        "skin": Subdivide(mesh: "part.out", scheme: DooSabin, levels: Draft(final: Param("levels"), draft: 0)),
    },
    outputs: { "skin.ply": "skin", "sub/skin.glb": "skin", "box.stl": "box" },
)"""
PART = """Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "What is moved.") },
    nodes: { "moved": Transform(mesh: "mesh", translate: (1, 0, 0)) },
    outputs: { "out": "moved" },
)"""
BOX = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nv 0 0 9\nv 9 0 9\nv 9 9 9\nv 0 9 9\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"


@pytest.fixture
def folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    monkeypatch.chdir(tmp_path)
    uses = GRAPH.replace("    params:", '    use: { "Part": "part.ron" },\n    params:')
    for name, text in (("it.ron", uses), ("part.ron", PART), ("box.obj", BOX)):
        pathlib.Path(name).write_text(text)
    return tmp_path


def files(folder: pathlib.Path) -> Dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def in_python(message: str) -> str:
    """Translates options in a message of the command line to those of the module."""
    words = {"(--only)": "", " (--max-memory)": " by `load(max_memory=..)`", "at a time ,": "at a time, by `run(outputs)`,"}
    for option, word in words.items():
        message = message.replace(option, word)
    return message


def run_both(
    program: Program,
    words: List[str],
    run: Callable[[], maquette.Run],
    **write: Any,
) -> Tuple[Set[Tuple[str, str]], Dict[str, bytes]]:
    """Runs a graph by both; checks that problems and files agree, and returns them."""
    path = pathlib.Path(write.get("folder", "out"))
    shutil.rmtree(path, ignore_errors=True)
    done = program("run", "it.ron", "--json", *words)
    told = json.loads(done.stdout)
    theirs = {(problem["severity"], in_python(problem["message"])) for problem in told["problems"]}
    their_files = files(path) if path.exists() else {}
    shutil.rmtree(path, ignore_errors=True)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            found = run()
            problems, failed = found.problems, any(it.severity == "error" for it in found.problems)
        except maquette.GraphError as error:
            problems, failed, found = error.problems, True, error.run  # type: ignore[assignment]
        if found is not None:
            found.write(**write)
    # Data that files cannot hold is a warning of `write`.
    told_of = [it.message.problem for it in warned if isinstance(it.message, maquette.GraphWarning) and it.message.problem]
    mine = {(problem.severity, problem.message) for problem in [*problems, *told_of]}
    assert mine == theirs and failed == (done.returncode == 1), (done.stderr, mine, theirs)
    for severity, message in theirs:
        assert severity == "error" or any(message in str(it.message) for it in warned), (message, warned)
    assert (files(path) if path.exists() else {}) == their_files
    return mine, their_files


def load(**options: Any) -> maquette.Graph:
    return maquette.load("it.ron", **options)


def test_a_plain_run(folder: pathlib.Path, program: Program) -> None:
    _, written = run_both(program, [], lambda: load().run(strict=False))
    assert set(written) == {"it/skin.ply", "it/sub/skin.glb", "it/box.stl"}


@pytest.mark.parametrize("cache", [["--no-cache"], ["--cache", "mine"], []])
def test_caches(folder: pathlib.Path, program: Program, cache: List[str]) -> None:
    option: Any = {0: True, 1: None, 2: "mine"}[len(cache)]
    run_both(program, cache, lambda: load(cache=option).run())
    assert pathlib.Path("mine").exists() == (len(cache) == 2)


def test_parameters_fields_and_drafts(folder: pathlib.Path, program: Program) -> None:
    run_both(program, ["--set", "levels=2"], lambda: load().run(levels=2))
    run_both(program, ["--set", "skin.levels=0"], lambda: load().run(params={"skin.levels": 0}))
    _, written = run_both(program, ["--draft"], lambda: load().run(draft=True))
    assert {name.split("/")[0] for name in written} == {"it-draft"}
    run_both(program, ["--draft", "--out", "named"], lambda: load().run(draft=True), folder="named")


def test_some_outputs_other_folders_and_no_provenance(folder: pathlib.Path, program: Program) -> None:
    _, written = run_both(program, ["--only", "skin.ply"], lambda: load().run("skin.ply"))
    assert set(written) == {"it/skin.ply"}, "another output of the same node was not asked for"
    run_both(program, ["--out", "there"], lambda: load().run(), folder="there")
    told, untold = (run_both(program, words, lambda: load().run(), provenance=not words)[1] for words in ([], ["--no-provenance"]))
    assert told != untold


def test_memory_and_threads(folder: pathlib.Path, program: Program) -> None:
    run_both(program, ["--threads", "1", "--memory", "0", "--max-memory", "1GB"], lambda: load(threads=1, memory=0, max_memory="1GB").run())
    problems, _ = run_both(program, ["--no-cache", "--max-memory", "1", "--set", "levels=4"], lambda: load(max_memory=1, cache=None).run(levels=4))
    assert problems is not None


def test_stale_pins_are_a_warning_and_may_be_left_out(folder: pathlib.Path, program: Program) -> None:
    assert program("pin", "it.ron", "skin").returncode == 0
    pathlib.Path("it.ron").write_text(pathlib.Path("it.ron").read_text().replace("default: 1", "default: 2"))
    stale, pinned = run_both(program, [], lambda: load().run())
    assert any(severity == "warning" and "pinned" in message for severity, message in stale)
    fresh, unpinned = run_both(program, ["--no-pins"], lambda: load(pins=False).run())
    assert not any("pinned" in message for _, message in fresh) and pinned["it/skin.ply"] != unpinned["it/skin.ply"]
    with pytest.warns(maquette.GraphWarning, match="pinned"):
        load()


def test_a_lock_that_does_not_fit_is_a_warning_or_an_error(folder: pathlib.Path, program: Program) -> None:
    with pytest.raises(maquette.GraphError, match="no lock file"):
        load(locked=True)
    assert program("lock", "it.ron").returncode == 0
    run_both(program, ["--locked"], lambda: load(locked=True).run())
    pathlib.Path("part.ron").write_text(PART.replace("(1, 0, 0)", "(2, 0, 0)"))
    changed, _ = run_both(program, [], lambda: load().run())
    assert changed, "no warning"
    with pytest.warns(maquette.GraphWarning, match="part.ron"):
        load()
    run_both(program, ["--locked"], lambda: load(locked=True).run())


def test_a_cache_is_verified(folder: pathlib.Path, program: Program) -> None:
    run_both(program, [], lambda: load().run())
    run_both(program, ["--verify-cache", "100"], lambda: load(verify_cache=100).run())
    # Cached results take no time, unless they are verified.
    seconds = [sum(node.seconds for node in load(verify_cache=share).run(levels=4).trace) for share in (0, 0, 100)]
    assert seconds[1] == 0 < seconds[2]
    for wrong in (-1, 101, float("nan")):
        with pytest.raises(ValueError, match="verify_cache"):
            load(verify_cache=wrong)


def test_a_server_that_cannot_be_reached_is_told_by_both(folder: pathlib.Path, program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    address = "http://127.0.0.1:9/results"
    done = program("run", "it.ron", "--cache-remote", address)
    assert done.returncode == 0 and "warning" in done.stderr and "127.0.0.1:9" in done.stderr, done.stderr
    with pytest.warns(maquette.GraphWarning, match="127.0.0.1:9"):
        graph = load(cache_remote=address, cache="other")
        graph.run()
    assert graph.trouble is not None and "127.0.0.1:9" in graph.trouble
    monkeypatch.setenv("MAQUETTE_CACHE_REMOTE", address)
    with pytest.warns(maquette.GraphWarning, match="127.0.0.1:9"):
        load(cache="third").run()


def test_files_of_inputs_are_not_replaced(folder: pathlib.Path, program: Program) -> None:
    pathlib.Path("it.ron").write_text(PART)
    graph = load(cache=None)
    graph.run(inputs={"mesh": "box.obj"}).write("there")
    (file,) = pathlib.Path("there").iterdir()
    before = file.read_bytes()
    with pytest.raises(maquette.GraphError, match="it is an input"):
        graph.run("out", inputs={"mesh": file}).write("there")
    assert program("run", "it.ron", "--input", f"mesh={file}", "--out", "there").returncode == 1
    assert file.read_bytes() == before


def test_messages_speak_of_python(folder: pathlib.Path) -> None:
    graph = load(cache=None)
    for wrong in ({"levels": 99}, {"skin.nothing": 1}, {"nothing": 1}, {"levels": "x"}):
        with pytest.raises(maquette.GraphError) as error:
            graph.run(params=wrong)
        assert "--set" not in str(error.value), error.value
    pathlib.Path("taken").write_text("mine")
    with pytest.raises(maquette.GraphError) as unwritten:
        graph.run().write("taken")
    assert "--out" not in str(unwritten.value) and "write(folder)" in str(unwritten.value)
    outside = 'Graph(format: 1, nodes: {"m": ReadMesh(path: "../../outside.obj")}, outputs: {"a/../../b.ply": "m"})'
    with pytest.raises(maquette.GraphError) as refused:
        maquette.load("it.ron", text=outside, cache=None)
    assert "--" not in str(refused.value).replace("-->", ""), str(refused.value)
