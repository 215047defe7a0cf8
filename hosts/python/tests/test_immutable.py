"""Tests that values cannot be changed: writes into their arrays in every known way change no result of this or another process."""

from __future__ import annotations

import ctypes
import pathlib
import subprocess
from collections.abc import Mapping
from typing import Callable, Iterator, List, Tuple

import numpy as np
import pytest
from numpy.typing import NDArray

import maquette

Array = NDArray[np.generic]

pytestmark = pytest.mark.every_change

GRAPH = """Graph(
    format: 1,
    params: { "levels": Integer(default: 1, min: 0, max: 4, doc: "l") },
    nodes: {
        "box": Primitive(shape: Box(size: (10, 20, 30))),
        "skin": Subdivide(mesh: "box", scheme: DooSabin, levels: Param("levels")),
    },
    outputs: { "skin.ply": "skin", "box.ply": "box" },
)"""


def through_a_pointer(array: Array) -> None:
    """Writes through the address of the array, as PyTorch, VTK and Open3D do."""
    ctypes.memset(array.ctypes.data, 0xA5, array.nbytes)


def through_the_interface(array: Array) -> None:
    """Writes through `__array_interface__`, ignoring its read-only flag."""
    ctypes.memset(array.__array_interface__["data"][0], 0xA5, array.nbytes)


def through_pyvista(array: Array) -> None:
    pyvista = pytest.importorskip("pyvista")
    if array.dtype != np.float64 or array.ndim != 2 or array.shape[1] != 3:
        return
    cloud = pyvista.PolyData(array)
    cloud.points += 100.0


def through_open3d(array: Array) -> None:
    open3d = pytest.importorskip("open3d")
    tensor = open3d.core.Tensor.from_numpy(array.view(np.uint8) if array.dtype == np.bool_ else array)
    tensor += 100


def through_the_buffer(array: Array) -> None:
    """Writes through the address of the buffer."""
    view = memoryview(array)
    address = np.frombuffer(view, dtype=np.uint8).ctypes.data if array.size and array.flags.c_contiguous else array.ctypes.data
    ctypes.memset(address, 0xA5, view.nbytes)


def through_the_base(array: Array) -> None:
    """Writes through the base of the array."""
    base = array
    while isinstance(base.base, np.ndarray):
        base = base.base
    try:
        base.flags.writeable = True
    except ValueError:
        return
    ctypes.memset(base.ctypes.data, 0xA5, base.nbytes)


def through_dlpack(array: Array) -> None:
    if array.dtype != np.bool_ and hasattr(np, "from_dlpack"):
        try:
            through_a_pointer(np.from_dlpack(array))
        except BufferError:
            pass


def through_torch(array: Array) -> None:
    torch = pytest.importorskip("torch")
    if array.dtype in (np.float64, np.float32, np.uint8):
        torch.from_numpy(array).fill_(7)
        torch.as_tensor(array).fill_(7)


WAYS = [
    through_a_pointer,
    through_the_interface,
    through_the_buffer,
    through_the_base,
    through_dlpack,
    through_torch,
    through_pyvista,
    through_open3d,
]


def values() -> List[maquette.Value]:
    """A value of each type that Python can create, with all optional data."""
    grid = np.random.default_rng(1).random((4, 5, 3))
    faces = [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4]]
    picture = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    mesh = maquette.Mesh(
        grid[0], faces, uv=grid[0, :, :2], texture=picture, heat=grid[0, :, 0], face_attributes={"part": [1, 2, 3]}
    )
    return [
        mesh,
        maquette.Mesh(grid[0], [[0, 1, 2], [2, 3, 4]]),
        maquette.Points(grid[0], heat=grid[0, :, 0]),
        maquette.Image(picture),
        maquette.Mask(picture[..., 0] > 9),
        maquette.Field(grid[..., 0].astype(np.float32)),
        maquette.Labels(picture[..., 0]),
        maquette.RangeImage(grid, color=picture, camera=(5, 5, 2, 2)),
        maquette.Curve(grid[0]),
        maquette.ControlNet(grid),
        maquette.Handles(grid[0], grid[1]),
        maquette.Direction((0, 0, 1)),
    ]


def arrays(value: maquette.Value) -> Iterator[Tuple[str, Array]]:
    """All arrays of a value, with the names of their sources."""
    for name, part in value.parts.items():
        yield f"parts[{name!r}]", part.array
    for name in dir(type(value)):
        if name.startswith("_") or not isinstance(getattr(type(value), name), property) or name == "parts":
            continue
        try:
            given = getattr(value, name)
        except (AttributeError, ValueError):
            continue
        given = dict(given) if isinstance(given, Mapping) else dict(enumerate(given)) if isinstance(given, tuple) else {0: given}
        for key, array in given.items():
            array = array.pixels if isinstance(array, maquette.Image) else array
            array = array if isinstance(array, np.ndarray) or not hasattr(array, "__array__") else np.asarray(array)
            if isinstance(array, np.ndarray):
                yield f"{name}[{key!r}]", array


@pytest.mark.parametrize("way", WAYS)
def test_no_way_of_writing_into_an_array_changes_its_value(way: Callable[[Array], None]) -> None:
    for value in values():
        before = {name: array.tobytes() for name, array in arrays(value)}
        assert before, value
        for name, array in arrays(value):
            way(array)
            after = {name: array.tobytes() for name, array in arrays(value)}
            assert after == before, f"{value.kind}.{name}"
        again = maquette.Value.from_parts(value.kind, value.parts, value.facts)
        assert again.hash == value.hash


@pytest.mark.parametrize("way", WAYS)
def test_results_here_on_disk_and_of_the_command_line_stay_right(
    way: Callable[[Array], None],
    tmp_path: pathlib.Path,
    program: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    path = tmp_path / "it.ron"
    path.write_text(GRAPH)
    truth = maquette.load(path, cache=None).run(levels=2)["skin"]
    graph = maquette.load(path)
    for name, array in arrays(graph.run()["box"]):
        way(array)
    assert graph.run(levels=2)["skin"] == truth
    for name, array in arrays(graph.run(levels=2)["skin"]):
        way(array)
    maquette._graph._maquette.finish_all()
    done = program("run", str(path), "--set", "levels=2", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    written = maquette.read(tmp_path / "out/skin.ply")
    assert isinstance(written, maquette.Mesh) and isinstance(truth, maquette.Mesh)
    assert np.allclose(written.vertices, truth.vertices, atol=1e-4)
