"""Tests of loading, running, editing and explaining graphs."""

from __future__ import annotations

import pathlib
import pickle
import random
import subprocess
import warnings
from typing import Callable

import numpy as np
import pytest

import maquette

SMOOTH = """Graph(
    format: 1,
    inputs: { "cage": Mesh(doc: "What is to become smooth.") },
    params: {
        "levels": Integer(default: 1, min: 0, max: 6, doc: "How often."),
        "scheme": Choice(default: Loop, of: [Loop, CatmullClark], doc: "By which rule."),
    },
    nodes: { "smooth": Subdivide(mesh: "cage", scheme: Param("scheme"), levels: Param("levels")) },
    outputs: { "smooth": "smooth" },
)"""

CORNERS = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_a_parameter_with_a_hyphen_is_a_python_word_with_an_underscore(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "smooth.ron"
    path.write_text(SMOOTH.replace('"levels"', '"step-count"'))
    graph = maquette.load(path, cache=None)
    cage = maquette.Mesh(CORNERS, FACES)
    faces = [len(graph.run(inputs={"cage": cage}, step_count=count)["smooth"].faces) for count in (1, 2)]
    assert faces == [16, 64]
    assert "default: 3" in graph.edited(step_count=3)


def test_parameters_say_what_they_take(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron")
    growth, levels = doll.params["growth"], doll.params["levels"]
    assert (growth.kind, growth.default, growth.min, growth.max, growth.unit) == ("Number", 12.0, 0.0, 40.0, "mm")
    assert (levels.kind, levels.default, levels.min, levels.max) == ("Integer", 1, 0.0, 4.0)
    assert doll.outputs["model.glb"].kind == "Mesh"
    smooth = maquette.load("smooth.ron", text=SMOOTH)
    assert smooth.params["scheme"].choices == ("Loop", "CatmullClark")
    assert list(smooth.inputs) == ["cage"] and list(smooth.outputs) == ["smooth"]
    with pytest.raises(KeyError, match="growth"):
        doll.params["grwth"]


@pytest.mark.parametrize("levels", [2, np.int64(2), np.float64(2.0), np.array(2)])
def test_a_parameter_is_a_number_of_python_or_numpy(levels: object) -> None:
    smooth = maquette.load("smooth.ron", text=SMOOTH, cache=None)
    run = smooth.run(inputs={"cage": maquette.Mesh(CORNERS, FACES)}, levels=levels)
    assert len(run["smooth"].faces) == 4 * 4**2  # type: ignore[attr-defined]


def test_choices_texts_colors_and_vectors_are_what_they_are_declared_to_be() -> None:
    cube = maquette.Mesh(
        np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T,
        [[0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5], [0, 2, 3, 1], [4, 5, 7, 6]],
    )
    smooth = maquette.load("smooth.ron", text=SMOOTH, cache=None)
    mesh = smooth.run(inputs={"cage": cube}, scheme="CatmullClark")["smooth"]
    assert isinstance(mesh, maquette.Mesh) and mesh.faces.shape == (24, 4)
    with pytest.raises(maquette.GraphError) as wrong:
        smooth.run(inputs={"cage": cube}, scheme="Catmull")
    assert "CatmullClark" in str(wrong.value)


@pytest.mark.parametrize(
    "params", [{"growth": 99.0}, {"growth": "long"}, {"grwth": 3.0}, {"levels": 1.5}, {"nose.pik": 1}]
)
def test_values_that_do_not_fit_are_problems_and_nothing_runs(
    graphs: pathlib.Path, params: dict[str, object]
) -> None:
    with pytest.raises(maquette.GraphError) as wrong:
        maquette.load(graphs / "doll.ron", cache=None).run(**params)  # type: ignore[arg-type]
    assert wrong.value.problems and wrong.value.run is None


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), {"a": 1}])
def test_what_no_parameter_is_is_an_error_of_python(graphs: pathlib.Path, value: object) -> None:
    with pytest.raises((TypeError, ValueError), match="growth"):
        maquette.load(graphs / "doll.ron", cache=None).run(growth=value)


def test_a_mesh_comes_from_arrays_a_file_or_whatever_has_vertices_and_faces(tmp_path: pathlib.Path) -> None:
    class Foreign:
        vertices, faces = CORNERS.tolist(), FACES

    mesh = maquette.Mesh(CORNERS, FACES)
    file = tmp_path / "cage.obj"
    mesh.save(file)
    smooth = maquette.load("smooth.ron", text=SMOOTH, cache=None)
    given = [mesh, Foreign(), str(file), file, {"vertices": CORNERS, "faces": FACES.tolist()}]
    hashes = {smooth.run(inputs={"cage": cage})["smooth"].hash for cage in given}
    assert len(hashes) == 1


def test_an_input_of_another_type_is_a_problem_and_no_panic() -> None:
    smooth = maquette.load("smooth.ron", text=SMOOTH, cache=None)
    with pytest.raises(maquette.GraphError) as wrong:
        smooth.run(inputs={"cage": maquette.Points(CORNERS)})
    assert [problem.code for problem in wrong.value.problems] == ["G012"]
    with pytest.raises(maquette.GraphError):
        smooth.run()
    with pytest.raises(maquette.GraphError, match="its inputs: cage"):
        smooth.run(inputs={"mesh": CORNERS})
    with pytest.raises(TypeError, match="vertices and faces"):
        smooth.run(inputs={"cage": CORNERS})
    with pytest.raises(maquette.GraphError, match="nowhere.obj"):
        smooth.run(inputs={"cage": "nowhere.obj"})


def test_nodes_and_outputs_are_asked_for_by_name(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron")
    run = doll.run("nose-mask.png", nodes=["nose", "scan.color"])
    assert {"nose-mask.png", "nose", "scan.color"} == {
        name for name in ("nose-mask.png", "nose", "scan.color", "skin", "model.glb") if name in run
    }
    with pytest.raises(KeyError, match="skin"):
        run["skin"]
    with pytest.raises(KeyError, match="model.glb"):
        doll.run("modl.glb")
    with pytest.raises(maquette.GraphError):
        doll.run([], nodes="noze")


def test_what_fails_tells_and_what_was_found_is_there(graphs: pathlib.Path) -> None:
    text = (graphs / "doll.ron").read_text().replace('pick: Largest', 'pick: At(0, 0)')
    doll = maquette.load(graphs / "doll.ron", text=text, cache=None)
    with pytest.raises(maquette.GraphError) as failed:
        doll.run()
    problem = failed.value.problems[0]
    assert problem.code == "G016" and problem.line > 0 and problem.text in str(failed.value)
    assert failed.value.run is not None and "red" in failed.value.run and "skin" not in failed.value.run
    run = doll.run(strict=False)
    assert [it.message for it in run.problems] == [it.message for it in failed.value.problems]
    assert pickle.loads(pickle.dumps(failed.value)).problems == failed.value.problems


def test_the_reason_of_a_node_is_told(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron", cache=None)
    assert "not computed before" in doll.why("red")
    doll.run()
    assert "does not run" in doll.why("red")
    run = doll.run(growth=20)
    assert {node.name: node.reason for node in run.trace}["raised"].startswith("parameter `distance` 12")
    with pytest.raises(KeyError, match="red"):
        doll.why("rad")


def test_an_edit_leaves_every_other_byte(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron")
    text = doll.edited(growth=20.0, **{"skin.scheme": "CatmullClark", "red.select.distance": 25})
    before = (graphs / "doll.ron").read_text()
    changed = [(a, b) for a, b in zip(before.split("\n"), text.split("\n")) if a != b]
    assert len(changed) == 3 and len(before.split("\n")) == len(text.split("\n"))
    assert "default: 20" in changed[0][1] and "distance: 25" in changed[1][1] and "CatmullClark" in changed[2][1]
    assert (graphs / "doll.ron").read_text() == before
    with pytest.raises(maquette.GraphError):
        doll.edited(growth=99)


def test_a_graph_stays_as_it_was_loaded(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron", cache=None)
    before = doll.run(growth=5)["model.ply"].hash
    path = graphs / "doll.ron"
    path.write_text(path.read_text().replace("scheme: Loop", "scheme: CatmullClark"))
    assert doll.run(growth=6)["model.ply"].hash != before
    assert doll.run(growth=5)["model.ply"].hash == before
    assert maquette.load(path, cache=None).run(growth=5)["model.ply"].hash != before


def test_the_program_may_go_elsewhere(graphs: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(graphs)
    doll = maquette.load("doll.ron", cache="kept")
    monkeypatch.chdir(tmp_path)
    assert len(doll.run(growth=3).write("out")) == 5 and not (tmp_path / "kept").exists()
    assert doll.edited(growth=4) != doll.text


def test_files_that_nodes_read_are_looked_at_in_every_run(graphs: pathlib.Path) -> None:
    nodes = 'nodes: { "cage": ReadMesh(path: "cage.obj") }, outputs: { "cage.ply": "cage" }'
    maquette.Mesh(CORNERS, FACES).save(graphs / "cage.obj")
    graph = maquette.load(graphs / "it.ron", text=f"Graph(format: 1, {nodes})")
    first = graph.run()["cage"].hash
    maquette.Mesh(2 * CORNERS, FACES).save(graphs / "cage.obj")
    assert graph.run()["cage"].hash != first


def test_progress_is_told_and_an_error_in_it_stops_the_run(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron", cache=None)
    told: list[maquette.Progress] = []
    doll.run(progress=told.append)
    assert {it.node for it in told if it.state == "computed"} == set(doll.nodes)
    assert all(0.0 <= it.share <= 1.0 and it.done <= it.total for it in told)
    assert told[-1].done == told[-1].total

    def stop(progress: maquette.Progress) -> None:
        raise LookupError("enough")

    doll.forget()
    with pytest.raises(LookupError, match="enough"):
        doll.run(progress=stop, growth=3)
    assert doll.run(growth=3)["model.ply"].hash == maquette.load(graphs / "doll.ron", cache=None).run(growth=3)["model.ply"].hash


def test_outputs_are_written_as_the_command_line_writes_them(graphs, tmp_path, program) -> None:  # type: ignore[no-untyped-def]
    run = maquette.load(graphs / "doll.ron").run()
    files = run.write(tmp_path / "out")
    assert {file.name for file in files} == set(run.graph.outputs)
    assert program("run", str(graphs / "doll.ron"), "--out", str(tmp_path / "theirs")).returncode == 0
    assert (tmp_path / "out/model.glb").read_bytes() == (tmp_path / "theirs/model.glb").read_bytes()
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(maquette.GraphError):
        run.write(tmp_path / "taken")
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.every_change
def test_a_draft_is_written_to_the_folder_of_drafts_as_by_the_command_line(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, program: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    monkeypatch.chdir(tmp_path)
    pathlib.Path("it.ron").write_text(
        """Graph(
            format: 1,
            nodes: {
                "box": Primitive(shape: Box(size: (10, 20, 30))),
                "skin": Subdivide(mesh: "box", scheme: DooSabin, levels: Draft(final: 3, draft: 1)),
            },
            outputs: { "skin.ply": "skin" },
        )"""
    )
    graph = maquette.load("it.ron", cache=None)

    def written() -> dict[str, bytes]:
        return {str(path): path.read_bytes() for path in sorted(pathlib.Path("out").rglob("*.ply"))}

    graph.run().write()
    final = written()
    assert list(final) == ["out/it/skin.ply"]
    graph.run(draft=True).write()
    both = written()
    assert set(both) == {"out/it/skin.ply", "out/it-draft/skin.ply"} and both["out/it/skin.ply"] == final["out/it/skin.ply"]
    for words in (["--draft"], []):
        assert program("run", "it.ron", *words).returncode == 0
    assert written() == both
    graph.run(draft=True).write("named")
    assert pathlib.Path("named/skin.ply").read_bytes() == both["out/it-draft/skin.ply"]


def test_random_sequences_give_what_an_evaluation_without_memory_gives(graphs: pathlib.Path) -> None:
    chance = random.Random(20070115)
    folder = graphs.parent / "kept"
    graph = maquette.load(graphs / "doll.ron", cache=folder, memory="20MB")
    for _ in range(25):
        what = chance.randrange(5)
        if what == 0:
            graph.forget()
        elif what == 1:
            graph = maquette.load(graphs / "doll.ron", cache=folder, memory=chance.choice(["0", "20MB", "2GB"]))
        params = {"growth": chance.choice([0.0, 3.0, 12.0, 40.0]), "levels": chance.choice([0, 1])}
        wanted = chance.sample(["nose", "surface", "blended", "skin", "model"], 2)
        run = graph.run([], nodes=wanted, **params)
        fresh = maquette.load(graphs / "doll.ron", cache=None).run([], nodes=wanted, **params)
        assert [run[name].hash for name in wanted] == [fresh[name].hash for name in wanted], (params, wanted)


def test_a_graph_that_cannot_be_read_is_an_error(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError):
        maquette.load(tmp_path / "nothing.ron")
    (tmp_path / "broken.ron").write_text("Graph(")
    with pytest.raises(maquette.GraphError) as broken:
        maquette.load(tmp_path / "broken.ron")
    assert broken.value.problems[0].code == "G001"
    with pytest.raises(ValueError, match="memory|size"):
        maquette.load(tmp_path / "it.ron", text="Graph(format: 1, nodes: {}, outputs: {})", memory="lots")


def test_the_reference_is_there_as_data() -> None:
    nodes = maquette.nodes()
    assert "Threshold" in nodes and nodes["Ffd"]["parameters"]["properties"]
    assert "glb" in maquette.value_types()["Mesh"]["written"]


def test_doubts_of_a_reader_are_warnings(tmp_path: pathlib.Path) -> None:
    (tmp_path / "it.mtl").write_text("newmtl a\nmap_Kd gone.png\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    (tmp_path / "it.obj").write_text(f"mtllib it.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\n")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert len(maquette.read(tmp_path / "it.obj").faces) == 1  # type: ignore[attr-defined]
    assert any("gone.png" in str(it.message) for it in told)
    with pytest.raises(ValueError, match="broken.obj"):
        (tmp_path / "broken.obj").write_text("v a b c\n")
        maquette.read(tmp_path / "broken.obj")


def test_a_graph_with_an_empty_section_of_inputs_gives_its_outputs() -> None:
    text = 'Graph(format: 1, inputs: {}, nodes: {"b": Primitive(shape: Box(size: (1, 1, 1)))}, outputs: {"o": "b"})'
    graph = maquette.load("a.ron", text=text, cache=None)
    assert list(graph.outputs) == ["o"]
    for run in (graph.run(), graph.run(inputs={}), graph.run("o")):
        assert len(run["o"].vertices) == 8
