"""Tests of problems, which have the same positions as on the command line."""

from __future__ import annotations

import json
import pathlib
import warnings

import pytest

import maquette
from conftest import SHARED

BAD = SHARED / "graphs/bad"


@pytest.mark.skipif(not BAD.exists(), reason=f"{BAD} is not here")
def test_every_bad_graph_has_its_problems_where_they_are_expected(program) -> None:  # type: ignore[no-untyped-def]
    expected = json.loads((BAD / "expected.json").read_text())
    files = sorted(BAD.glob("*.ron"))
    assert len(files) >= 15
    for file in files:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                found = maquette.load(file)._problems
                assert warned, f"{file.name} has a mistake"
            except maquette.GraphError as wrong:
                found = wrong.problems
        told = json.loads(program("check", str(file), "--json").stdout)["problems"]
        assert [(it.code, it.line, it.column, it.end_line, it.end_column, it.message, it.help) for it in found] == [
            tuple(it[key] for key in ("code", "line", "column", "end_line", "end_column", "message", "help")) for it in told
        ], file.name
        assert all(str(file) in it.text and it.code in it.text for it in found)
        wanted = expected.get(file.name, [])
        wanted = wanted if isinstance(wanted, list) else wanted.get("problems", [])
        for want in wanted:
            lines = want["line"] if isinstance(want["line"], list) else [want["line"]]
            low, high = want["column"]
            at = [it for it in found if it.line in lines and low <= it.column <= high]
            assert any(all(word in it.message + it.help for word in want["words"]) for it in at), (file.name, want, found)


def test_a_misspelled_name_brings_the_edit_that_puts_it_right(tmp_path: pathlib.Path) -> None:
    text = 'Graph(format: 1, nodes: { "a": PointNe(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]) }, outputs: { "a.json": "a" })'
    with pytest.raises(maquette.GraphError) as wrong, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        maquette.load(tmp_path / "it.ron", text=text).run()
    [problem] = wrong.value.problems
    [edit] = problem.fix
    assert edit.line == edit.end_line == 1
    assert text[edit.column - 1 : edit.end_column - 1] == "PointNe" and edit.text == "PointNet"


def test_what_is_not_as_it_is_wanted_is_named_with_its_place(tmp_path: pathlib.Path) -> None:
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "part.ron").write_text(
        'Graph(format: 1, inputs: { "mesh": Mesh(doc: "Closed.", wants: [Closed]) },'
        ' nodes: { "it": Transform(mesh: "mesh") }, outputs: { "mesh": "it" })'
    )
    graph = maquette.load(
        tmp_path / "it.ron",
        text='Graph(format: 1, use: { "Part": "part.ron" }, nodes: { "a": ReadMesh(path: "open.obj"), "b": Part(mesh: "a") },'
        ' outputs: { "b.ply": "b" })',
    )
    with pytest.raises(maquette.GraphError) as wrong:
        graph.run()
    [problem] = [it for it in wrong.value.problems if it.elements]
    assert sorted(element.name for element in problem.elements) == ["edge 0-1", "edge 0-2", "edge 1-2"]
    assert all(len(element.at) == 3 for element in problem.elements)


def test_a_mistake_in_a_used_graph_says_by_which_uses_it_is_reached(graphs: pathlib.Path) -> None:
    feature = graphs / "lib/feature.ron"
    feature.write_text(feature.read_text().replace("pick: Rank", "pick: Rang"))
    with pytest.raises(maquette.GraphError) as wrong:
        maquette.load(graphs / "face.ron")
    problem = wrong.value.problems[0]
    assert problem.file.endswith("feature.ron") and "Rang" in problem.text


FOREIGN = """Graph(
    format: 1,
    packs: { "hair": "0.3" },
    params: { "size": Number(default: 2.0, min: 1.0, max: 3.0, doc: "How large.") },
    nodes: {
        "ball": ReadMesh(path: "doll/coarse.obj"),
        "strands": HairStrands(on: "ball"),
        "combed": Transform(mesh: "strands", scale: (2, 2, 2)),
        "big": Transform(mesh: "ball", scale: (Param("size"), 1, 1)),
    },
    outputs: { "hair.obj": "combed", "big.ply": "big" },
)"""


def test_a_graph_with_an_unknown_node_gives_what_does_not_hang_on_it(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with pytest.warns(maquette.UnknownNodeWarning, match="`HairStrands` .*the pack `hair` 0.3"):
        graph = maquette.load(graphs / "foreign.ron", text=FOREIGN)
    assert [(it.code, it.severity) for it in graph.check() if it.code == "G003"] == [("G003", "warning")]
    assert isinstance(graph.run("big.ply")["big.ply"], maquette.Mesh)
    assert graph.run("big.ply", size=3)["big"] != graph.run("big.ply")["big"]
    with pytest.raises(maquette.GraphError, match="the pack `hair` 0.3") as wrong:
        graph.run()
    assert [(it.code, it.severity) for it in wrong.value.problems] == [("G003", "error")]
    run = graph.run(strict=False)
    assert "big.ply" in run and "hair.obj" not in run
    assert [file.name for file in run.write(tmp_path / "out")] == ["big.ply"]
