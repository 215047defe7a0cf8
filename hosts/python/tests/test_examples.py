"""Tests that the examples and the notebook run."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).resolve().parents[1]


def example(name: str, *words: str, cwd: pathlib.Path) -> str:
    done = subprocess.run([sys.executable, str(HERE / "examples" / name), *words], capture_output=True, text=True, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_mesh_of_trimesh_is_pulled_and_closed(tmp_path: pathlib.Path) -> None:
    assert example("trimesh_ffd.py", "egg.glb", cwd=tmp_path) == "closed: False -> True, height 81.6 mm\n"
    assert (tmp_path / "egg.glb").stat().st_size > 10_000


def test_a_sweep_is_plotted(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    example("sweep.py", str(graphs / "doll.ron"), "sweep.png", cwd=tmp_path)
    assert (tmp_path / "sweep.png").stat().st_size > 50_000


def test_a_loss_is_minimized(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    told = example("minimize.py", str(graphs / "doll.ron"), cwd=tmp_path)
    assert 19.9 < float(told.split()[1]) < 20.1 and float(told.split("off by ")[1].split()[0]) < 0.01


def test_the_notebook_runs_and_shows_graph_value_and_progress(graphs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(HERE / "examples/doll.ipynb", as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(graphs)}})
    client.execute()
    shown = [set(output.get("data", {})) for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("image/svg+xml" in kinds for kinds in shown), "no graph"
    pictures = ["<img" in "".join(o.get("data", {}).get("text/html", "")) for cell in notebook.cells for o in cell.get("outputs", ())]
    assert any(pictures), "no value"
    bars = [o for cell in notebook.cells for o in cell.get("outputs", ()) if "<progress" in "".join(o.get("data", {}).get("text/html", ""))]
    assert bars and 'value="1.000"' in "".join(bars[0]["data"]["text/html"])
    tables = ["".join(o.get("data", {}).get("text/html", "")) for cell in notebook.cells for o in cell.get("outputs", ())]
    assert any("growth" in table and "40.0" in table for table in tables), "no parameters"
    assert any("cached" in table and "computed" in table for table in tables), "no trace"
    if out := os.environ.get("MAQUETTE_NOTEBOOK"):
        exporter = pytest.importorskip("nbconvert").HTMLExporter()
        pathlib.Path(out).write_text(exporter.from_notebook_node(notebook)[0])
