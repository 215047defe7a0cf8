"""Tests that `save` and `to_bytes` write and warn as `maquette run` does, and raise the same errors as Python's own functions."""

from __future__ import annotations

import errno
import os
import pathlib
import re
import subprocess
import warnings
from typing import Any, Callable, Dict, List

import numpy as np
import pytest

import maquette

pytestmark = pytest.mark.every_change

V = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
F = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
PICTURE = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
ENDINGS = ["glb", "ply", "obj", "stl", "3mf"]
MESHES: Dict[str, maquette.Mesh] = {
    "closed": maquette.Mesh(V, F),
    "open": maquette.Mesh(V, F[:3]),
    "far": maquette.Mesh(V * 1e-3 + 5e6, F),
    "rich": maquette.Mesh(V, F, uv=V[:, :2] / 9, texture=PICTURE, heat=[1.0, 2, 3, 4], color=PICTURE[:, 0], face_attributes={"part": [1, 2, 3, 4]}),
    "one": maquette.Mesh(V[:3], [[0, 1, 2]], corner_attributes={"k": [1.0, 2, 3]}),
}
TEXT = 'Graph(format: 1, inputs: {"m": Mesh(doc: "")}, nodes: {"t": Transform(mesh: "m", translate: (0, 0, 0))}, outputs: {"t": "t"})'


def warnings_of(work: Callable[[], Any]) -> List[str]:
    """The warnings of a call, without the names of files."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        work()
    texts = [getattr(getattr(it.message, "problem", None), "message", str(it.message)) for it in found]
    return sorted(re.sub(r"^(`[^`]*`|/\S+): ", "", text) for text in texts)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("name", MESHES)
def test_what_is_saved_has_the_bytes_and_warnings_of_the_command_line(
    name: str, ending: str, tmp_path: pathlib.Path, program: Callable[..., "subprocess.CompletedProcess[str]"]
) -> None:
    # Through a file format that holds all data.
    MESHES[name].save(tmp_path / "in.ply")
    text = f'Graph(format: 1, nodes: {{"m": ReadMesh(path: "in.ply")}}, outputs: {{"o.{ending}": "m"}})'
    (tmp_path / "g.ron").write_text(text)
    graph = maquette.load(tmp_path / "g.ron", cache=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = graph.run()
    mesh = run[f"o.{ending}"]
    by_write = warnings_of(lambda: run.write(tmp_path / "write", provenance=False))
    assert warnings_of(lambda: mesh.save(tmp_path / f"save/o.{ending}")) == by_write
    files = sorted(os.listdir(tmp_path / "save"))
    if len(files) == 1:
        assert warnings_of(lambda: mesh.to_bytes(ending)) == by_write
    done = program("run", str(tmp_path / "g.ron"), "--no-provenance", "--out", str(tmp_path / "program"))
    assert done.returncode == 0
    for file in files:
        contents = {(tmp_path / folder / file).read_bytes() for folder in ("save", "write", "program")}
        assert len(contents) == 1, file


def test_what_is_lost_far_or_open_is_told() -> None:
    assert any("closed" in it for it in warnings_of(lambda: MESHES["open"].to_bytes("stl")))
    assert any("single" in it or "steps" in it for it in warnings_of(lambda: MESHES["far"].to_bytes("ply")))
    assert any("heat" in it for it in warnings_of(lambda: MESHES["rich"].to_bytes("3mf")))
    assert warnings_of(lambda: MESHES["closed"].to_bytes("stl")) == []


def test_errors_of_files_are_those_of_python(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = MESHES["closed"]
    for call in (maquette.read, lambda it: maquette.read(str(it)), lambda it: maquette.read(it, maquette.Mesh), maquette.load):
        with pytest.raises(FileNotFoundError) as missing:
            call(tmp_path / "nothing.ply")
        assert missing.value.errno == errno.ENOENT and "nothing.ply" in str(missing.value)
        with pytest.raises(IsADirectoryError):
            call(tmp_path)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OSError) as below:
        mesh.save(tmp_path / "file/it.ply")
    assert below.value.errno in (errno.ENOTDIR, errno.EEXIST), below.value
    (tmp_path / "closed.ply").write_text("mine")
    (tmp_path / "closed.ply").chmod(0o444)
    with pytest.raises(PermissionError):
        mesh.save(tmp_path / "closed.ply")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(OSError, match="folder"):
        mesh.save(tmp_path / "folder.ply")
    with pytest.raises(ValueError, match="ply"):
        (tmp_path / "bad.ply").write_text("ply\nrubbish")
        maquette.read(tmp_path / "bad.ply")
    with pytest.raises(OSError) as refused:
        mesh.save("/proc/it.ply")
    assert refused.value.errno in (errno.EACCES, errno.ENOENT, errno.EPERM, errno.EROFS) and refused.value.filename == "/proc/it.ply"


def test_names_that_are_not_utf_8_are_kept_or_refused(tmp_path: pathlib.Path) -> None:
    odd = os.fsdecode(b"caf\xe9")
    with pytest.raises(ValueError, match="UTF-8"):
        MESHES["closed"].save(tmp_path / f"{odd}.ply")
    (tmp_path / odd).mkdir()
    (path,) = MESHES["closed"].save(tmp_path / odd / "it.ply")
    assert os.path.exists(path)
    text = 'Graph(format: 1, nodes: {"b": Primitive(shape: Box(size: (1, 1, 1)))}, outputs: {"b.ply": "b"})'
    graph = maquette.load("a.ron", text=text, cache=None)
    (file,) = graph.run().write(tmp_path / odd)
    assert os.path.exists(file.path) and odd in file.path


def test_flags_that_a_file_does_not_hold_are_named() -> None:
    mesh = maquette.Mesh(V, F, seen=[True, False, True, True])
    for ending in ENDINGS:
        assert any("`seen`" in it for it in warnings_of(lambda: mesh.to_bytes(ending))) == (ending != "ply"), ending
