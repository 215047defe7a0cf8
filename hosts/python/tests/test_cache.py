"""Tests that the module, the command line and other processes share cached results."""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys

import maquette


def count_computed(graph: pathlib.Path) -> int:
    """The number of nodes that another process computes with the module."""
    text = "import sys, maquette; print(sum(node.state == 'computed' for node in maquette.load(sys.argv[1]).run().trace))"
    return int(subprocess.run([sys.executable, "-c", text, str(graph)], capture_output=True, text=True, check=True).stdout)


def count_computed_by_program(program, graph: pathlib.Path, out: pathlib.Path) -> int:  # type: ignore[no-untyped-def]
    """The number of nodes that the command line computes."""
    done = program("run", str(graph), "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    return sum(node["state"] == "computed" for node in json.loads(done.stdout)["nodes"])


def test_the_command_line_and_the_module_believe_each_other(graphs, tmp_path, program, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    doll = graphs / "doll.ron"
    monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / "one"))
    assert count_computed_by_program(program, doll, tmp_path / "a") == 15
    assert count_computed(doll) == 0
    monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / "two"))
    assert count_computed(doll) == 15
    assert count_computed_by_program(program, doll, tmp_path / "b") == 0
    done = subprocess.run([sys.executable, "-m", "maquette", "run", str(doll), "--out", str(tmp_path / "c"), "--json"], capture_output=True, text=True)
    assert all(node["state"] != "computed" for node in json.loads(done.stdout)["nodes"])
    run = maquette.load(doll).run()
    run.write(tmp_path / "d")
    assert program("run", str(doll), "--out", str(tmp_path / "e"), "--no-provenance").returncode == 0
    for name in run.graph.outputs:
        content = (tmp_path / "a" / name).read_bytes()
        assert content == (tmp_path / "b" / name).read_bytes() == (tmp_path / "c" / name).read_bytes()
        assert content == (tmp_path / "d" / name).read_bytes()
        # A saved value has no provenance.
        assert (tmp_path / "e" / name).read_bytes() == run[name].to_bytes(name.rsplit(".")[-1])


def test_a_cache_may_be_anywhere_or_nowhere(graphs: pathlib.Path, own_cache: pathlib.Path, tmp_path: pathlib.Path) -> None:
    doll = graphs / "doll.ron"
    maquette.load(doll, cache=False).run()
    assert not any(own_cache.iterdir())
    graph = maquette.load(doll, cache=tmp_path / "mine")
    graph.run()
    del graph
    assert (tmp_path / "mine").exists() and not any(own_cache.iterdir())
    assert all(node.state == "cached" for node in maquette.load(doll, cache=tmp_path / "mine").run().trace)


def test_somebodys_folder_is_no_cache(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/letter.txt").write_text("dear")
    try:
        maquette.load(graphs / "doll.ron", cache=tmp_path / "mine")
    except ValueError as error:
        assert "mine" in str(error)
    else:
        raise AssertionError("it was taken")
    assert os.listdir(tmp_path / "mine") == ["letter.txt"]
