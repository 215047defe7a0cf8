"""Tests that other programs find the provenance in files, and read the files as if they had none."""

from __future__ import annotations

import json
import pathlib
import zipfile
from typing import Any, Callable, Tuple

import numpy as np
import pytest

GRAPH = """Graph(
    format: 1,
    params: { "height": Number(default: 10.0, min: 0.0, max: 90.0, unit: "mm", doc: "How high.") },
    nodes: {
        "mesh": ReadMesh(path: "doll/coarse.obj"),
        "lifted": Transform(mesh: "mesh", translate: (0, Param("height"), 0)),
        "color": ReadImage(path: "doll/color.png"),
        "net": PointNet(points: [[(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 0), (1, 1, 1), (2, 1, 0)], [(0, 2, 0), (1, 2, 0), (2, 2, 0)]]),
        "surface": Nurbs(net: "net"),
    },
    outputs: {
        "a.glb": "lifted", "a.ply": "lifted", "a.obj": "lifted", "a.stl": "lifted", "a.3mf": "lifted",
        "a.png": "color", "a.tiff": "color", "a.step": "surface", "a.json": "net",
    },
)"""

Folders = Tuple[pathlib.Path, pathlib.Path]


@pytest.fixture
def folders(graphs: pathlib.Path, tmp_path: pathlib.Path, program: Callable[..., Any]) -> Folders:
    """All files, with and without provenance."""
    (graphs / "told.ron").write_text(GRAPH)
    made = tmp_path / "told", tmp_path / "plain"
    for folder, more in zip(made, ([], ["--no-provenance"])):
        done = program("run", str(graphs / "told.ron"), "--out", str(folder), "--set", "height=25", *more)
        assert done.returncode == 0, done.stderr
    return made


def check_provenance(words: Any, output: str) -> None:
    """Checks that the text is the provenance of the output."""
    found = json.loads(words) if isinstance(words, str) else words
    assert found["output"] == output and found["graph"] == "told.ron", found
    if output.startswith("a.glb"):
        assert found["parameters"] == {"height": 25}, found


def comment(text: str) -> str:
    """The text after `maquette` in a comment."""
    return text[text.index("maquette {") + len("maquette ") :]


def test_glb(folders: Folders) -> None:
    pygltflib = pytest.importorskip("pygltflib")
    trimesh = pytest.importorskip("trimesh")
    with_words, plain = (pygltflib.GLTF2().load(str(folder / "a.glb")) for folder in folders)
    check_provenance(with_words.asset.extras["maquette"], "a.glb")
    assert with_words.asset.version == "2.0" and not plain.asset.extras
    assert with_words.binary_blob() == plain.binary_blob()
    scenes = [trimesh.load_scene(folder / "a.glb") for folder in folders]
    same(*(scene.to_geometry() for scene in scenes))
    # A program that reads and writes the file may keep it.
    pygltflib.GLTF2().from_json(with_words.to_json())


def same(one: Any, other: Any) -> None:
    assert len(one.vertices) > 100
    assert (one.vertices == other.vertices).all() and (one.faces == other.faces).all()


def test_ply(folders: Folders) -> None:
    plyfile = pytest.importorskip("plyfile")
    trimesh = pytest.importorskip("trimesh")
    with_words, plain = (plyfile.PlyData.read(str(folder / "a.ply")) for folder in folders)
    mine = [line[len("maquette ") :] for line in with_words.comments if line.startswith("maquette ")]
    check_provenance(comment("maquette " + "".join(mine)), "a.ply")
    assert mine[0].startswith("{") and not any("maquette " in line for line in plain.comments)
    assert (with_words["vertex"].data == plain["vertex"].data).all()
    same(*(trimesh.load_mesh(folder / "a.ply") for folder in folders))


def test_obj(folders: Folders) -> None:
    trimesh = pytest.importorskip("trimesh")
    same(*(trimesh.load_mesh(folder / "a.obj") for folder in folders))
    lines = (folders[0] / "a.obj").read_text().splitlines()
    check_provenance(comment(next(line for line in lines if line.startswith("# maquette {"))), "a.obj")


def test_stl(folders: Folders) -> None:
    trimesh = pytest.importorskip("trimesh")
    with_words, plain = (trimesh.load_mesh(folder / "a.stl") for folder in folders)
    same(with_words, plain)
    header = (folders[0] / "a.stl").read_bytes()[:80].decode("ascii")
    assert header.split(", ")[0].startswith("binary STL of maquette") and len(header.split()[-1]) == 16, header


def test_3mf(folders: Folders) -> None:
    trimesh = pytest.importorskip("trimesh")
    for module in ("lxml", "networkx"):
        pytest.importorskip(module)
    scenes = [trimesh.load_scene(folder / "a.3mf") for folder in folders]
    same(*(scene.to_geometry() for scene in scenes))
    # 3MF has z up, and the model is on the plate: y becomes z, and no z is below 0.
    low, high = scenes[0].bounds
    source = trimesh.load_mesh(folders[0] / "a.stl")
    assert np.allclose(low, 0, atol=1e-4) and np.allclose(high, source.extents[[0, 2, 1]], atol=1e-4)
    assert scenes[0].units == "millimeter"
    archives = [zipfile.ZipFile(folder / "a.3mf") for folder in folders]
    assert all(archive.testzip() is None for archive in archives)
    check_provenance(json.loads(archives[0].read("Metadata/maquette.json")), "a.3mf")
    assert "Metadata/maquette.json" not in archives[1].namelist()


@pytest.mark.parametrize("file", ["a.png", "a.tiff"])
def test_pictures(folders: Folders, file: str) -> None:
    from PIL import Image

    with Image.open(folders[0] / file) as with_words, Image.open(folders[1] / file) as plain:
        assert (np.asarray(with_words) == np.asarray(plain)).all()
        if file == "a.png":
            check_provenance(with_words.text["maquette"], file)  # type: ignore[attr-defined]
            assert "maquette" not in plain.text  # type: ignore[attr-defined]
        else:
            check_provenance(comment(with_words.tag_v2[270]), file)  # type: ignore[attr-defined]
            assert 270 not in plain.tag_v2  # type: ignore[attr-defined]


def test_tiff_elsewhere(folders: Folders) -> None:
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffFile(folders[0] / "a.tiff") as file:
        check_provenance(comment(file.pages[0].description), "a.tiff")
        assert (file.asarray() == tifffile.imread(folders[1] / "a.tiff")).all()


def test_step(folders: Folders) -> None:
    control = pytest.importorskip("OCP.STEPControl", reason="OCP cannot be loaded here", exc_type=ImportError)
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer

    counts = []
    for folder in folders:
        reader = control.STEPControl_Reader()
        assert reader.ReadFile(str(folder / "a.step")) == IFSelect_ReturnStatus.IFSelect_RetDone
        assert reader.TransferRoots() == 1
        explorer, count = TopExp_Explorer(reader.OneShape(), TopAbs_ShapeEnum.TopAbs_FACE), 0
        while explorer.More():
            explorer.Next()
            count += 1
        counts.append(count)
    assert counts[0] == counts[1] >= 1
    lines = (folders[0] / "a.step").read_text().splitlines()
    check_provenance(comment(next(line for line in lines if line.startswith("/* maquette {"))).removesuffix(" */"), "a.step")


def test_json(folders: Folders) -> None:
    with_words, plain = (json.loads((folder / "a.json").read_text()) for folder in folders)
    check_provenance(with_words.pop("maquette"), "a.json")
    assert with_words == plain
