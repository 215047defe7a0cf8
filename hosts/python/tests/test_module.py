"""Tests of conventions for Python modules: a version, a console script, licences, mappings, and types."""

from __future__ import annotations

import pathlib
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from importlib import metadata
from typing import Any, Dict, List

import pytest

import maquette

HERE = pathlib.Path(__file__).resolve().parents[1]


@pytest.mark.every_change
def test_the_module_says_its_version_and_has_a_script_and_licences() -> None:
    assert maquette.__version__ == metadata.version("maquette") and re.fullmatch(r"\d+\.\d+\.\d+", maquette.__version__)
    names = [str(file) for file in metadata.files("maquette") or ()]
    assert [name for name in names if name.endswith(("LICENSE-MIT", "LICENSE-APACHE"))]
    scripts = [it for it in metadata.distribution("maquette").entry_points if it.group == "console_scripts"]
    assert [it.name for it in scripts] == ["maquette"]
    program = pathlib.Path(sys.executable).parent / "maquette"
    done = subprocess.run([str(program), "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and maquette.__version__ in done.stdout
    with pytest.raises(AttributeError, match="lod"):
        maquette.lod  # type: ignore[attr-defined]
    assert set(maquette.__all__) <= set(dir(maquette))


@pytest.mark.every_change
def test_a_run_is_a_mapping_of_what_was_asked_for(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron")
    run = doll.run(levels=0)
    assert isinstance(run, Mapping) and list(run) == list(doll.outputs) and len(run) == len(doll.outputs)
    assert dict(run) == dict(run.items()) == {name: run[name] for name in doll.outputs}
    assert [value.kind for value in run.values()] == [output.kind for output in doll.outputs.values()]
    assert run.get("nothing") is None and run.get("model.ply") == run["model.ply"]
    assert "red" in run and "red" not in list(run) and 3 not in run
    some = doll.run("model.ply", nodes=["nose", "scan.color", "model.ply"], levels=0)
    assert list(some) == ["model.ply", "nose", "scan.color"]
    assert run == run and run != some and len({run, some}) == 2 and bool(doll.run([]))
    assert run.value("model.ply", maquette.Mesh) == run["model.ply"]
    with pytest.raises(TypeError, match="`model.ply` is a Mesh; expected a Points"):
        run.value("model.ply", maquette.Points)
    text = (graphs / "doll.ron").read_text().replace("pick: Largest", "pick: At(0, 0)")
    failed = maquette.load(graphs / "doll.ron", text=text, cache=None).run(strict=False)
    assert set(dict(failed)) < set(doll.outputs) and len(failed) == len(dict(failed))


def examples_of(path: pathlib.Path) -> str:
    """All Python code blocks of a document, joined."""
    blocks = re.findall(r"```python\n(.*?)```", path.read_text(), re.DOTALL)
    return "\n".join(blocks)


USER = '''
from __future__ import annotations
import asyncio
import numpy as np
import numpy.typing as npt
import maquette
from maquette import Graph, Mesh, Run, Value, ron


def tip(run: Run) -> npt.NDArray[np.float64]:
    return run.value("skin", Mesh).vertices


async def later(graph: Graph) -> Run:
    return await graph.start(growth=3)


graph = maquette.load("x.ron", pins=False, locked=True, verify_cache=3)
run = graph.run(growth=3, outputs=["a"], nodes=("b",), progress=lambda p: print(p.node), timeout=3.5, params={"draft": True})
for name, value in run.items():
    print(name.upper(), value.kind)
values: dict[str, Value] = dict(run)
mesh: Mesh = maquette.read("a.ply", Mesh).replace(np.zeros((3, 3)), heat=[1.0, 2.0, 3.0], uv=None)
height: float = mesh.area + mesh.volume
picture: npt.NDArray[np.uint8] = maquette.Image(np.zeros((2, 2, 3), np.uint8)).pixels
note: maquette.Note | None = maquette.GraphError([]).problems[0].note
build = maquette.GraphBuilder(doc="a")
build.output("a.ply", build.node("box", ron.Primitive(shape=ron.Box(size=(1, 2, 3)))))
text: str = build.text + maquette.__version__
same: bool = bool(mesh.compare(mesh, max=0.1))
asyncio.run(later(graph))
'''

WRONG = [
    "maquette.nope",
    "maquette.load('a', memry='2GB')",
    "maquette.load('a').run().trace[0].stat",
    "maquette.load(open('f'))",
    "maquette.load('a').run()['a'].save(b'x')",
    "maquette.load('a').run()['a'].vertices",
    "maquette.load('a').run().value('a', maquette.Mesh).positions",
    "maquette.read('a.ply', maquette.Mesh).pixels",
    "maquette.read('a.ply', maquette.Mesh).render(1, 2, 3)",
    "maquette.read('a.ply', maquette.Mesh).texture.pixels",
    "maquette.load('a').run(timeout='3')",
]


def check_types(checker: str, folder: pathlib.Path, text: str) -> List[str]:
    """The lines with errors of a type checker."""
    (folder / "it.py").write_text(text)
    words = {"mypy": ["-m", "mypy", "--strict", "--no-error-summary"], "pyright": ["-m", "pyright", "--pythonpath", sys.executable]}[checker]
    pytest.importorskip(checker)
    done = subprocess.run([sys.executable, *words, "it.py"], capture_output=True, text=True, cwd=folder)
    if checker == "pyright" and "No configuration file" not in done.stdout and "error" not in done.stdout and done.returncode:
        pytest.skip(f"pyright cannot run here: {done.stderr[-200:]}")
    errors = re.findall(r"it\.py:(\d+)(?::\d+)?(?: -)?:? error:? .*", done.stdout)
    assert (done.returncode == 0) == (not errors), done.stdout + done.stderr
    return [text.split("\n")[int(line) - 1] for line in errors]


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_readme_examples_and_users_are_typed(checker: str, tmp_path: pathlib.Path) -> None:
    readme = examples_of(HERE / "README.md")
    assert "maquette.load" in readme
    for text in (readme, USER):
        assert not check_types(checker, tmp_path, text)
    doc = re.search(r"    import maquette\n.*?(?=\n\n\S)", maquette.__doc__ or "", re.DOTALL)
    assert doc and not check_types(checker, tmp_path, re.sub("(?m)^    ", "", doc.group()))


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_mistakes_are_found_by_types(checker: str, tmp_path: pathlib.Path) -> None:
    lines = ["import maquette", *WRONG]
    found = check_types(checker, tmp_path, "\n".join(lines))
    assert set(found) == set(WRONG)


def test_examples_pass_pyright(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("pyright")
    for example in sorted((HERE / "examples").glob("*.py")):
        shutil.copy(example, tmp_path)
    words = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable]
    done = subprocess.run([*words, "."], capture_output=True, text=True, cwd=tmp_path)
    # Without trimesh or SciPy, the only errors are the missing imports.
    errors = [line for line in done.stdout.splitlines() if " error: " in line and "could not be resolved" not in line and "reportMissing" not in line]
    assert not errors, "\n".join(errors)


@pytest.mark.every_change
def test_the_examples_of_the_readme_run(graphs: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(graphs.parent)
    names: Dict[str, Any] = {}
    exec(examples_of(HERE / "README.md"), names)
    assert len(names["run"]["model.glb"].vertices) and pathlib.Path("pinocchio.glb").exists()
    assert names["skin"].compare(names["skin"]).verdict == "identical"


@pytest.mark.every_change
def test_the_wheel_has_no_more_than_the_module() -> None:
    assert not [name for name in ("trimesh", "open3d", "pyvista") if name in str(metadata.requires("maquette"))]
    assert metadata.requires("maquette") == ["numpy>=1.22"]

