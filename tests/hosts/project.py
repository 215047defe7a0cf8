"""The project for the comparison of hosts: small files with every kind of parameter, an input, a draft and a used graph."""

from __future__ import annotations

import pathlib
import struct
import zlib

IT = """Graph(
    format: 1,
    use: { "Part": "part.ron" },
    params: {
        "levels": Integer(default: 1, min: 0, max: 4, doc: "How often faces are divided."),
        "move": Number(default: 1, min: 0, max: 90, unit: "mm", doc: "How far it is moved."),
        "turn": Vector(default: (0, 0, 0), min: -180, max: 180, doc: "How it is turned."),
        "invert": Toggle(default: false, doc: "Which pixels are taken."),
        "paint": Color(default: "#ff0000", doc: "The color that is looked for."),
        "scheme": Choice(default: DooSabin, of: [DooSabin, CatmullClark], doc: "The rules."),
        "file": Text(default: "box.obj", doc: "What is read."),
        "eye-step": Integer(default: 0, min: 0, max: 9, doc: "Has a hyphen."),
    },
    nodes: {
        "box": ReadMesh(path: Param("file")),
        "part": Part(mesh: "box"),
        "skin": Subdivide(mesh: "part.out", scheme: Param("scheme"), levels: Draft(final: Param("levels"), draft: 0)),
        "turned": Transform(mesh: "skin", rotate: Param("turn"), translate: (Expr("move + eye-step"), 0, 0)),
        "dots": ReadImage(path: "dots.png"),
        "red": Threshold(image: "dots", select: Near(color: Param("paint")), invert: Param("invert")),
        "idle": Primitive(shape: Box(size: (1, 2, 3))),
    },
    outputs: { "skin.ply": "turned", "sub/skin.glb": "skin", "box.stl": "box", "red.png": "red" },
)
"""
PART = """Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "What is moved.") },
    nodes: { "moved": Transform(mesh: "mesh", translate: (1, 0, 0)) },
    outputs: { "out": "moved" },
)
"""
# A graph with a node that fails and an expectation that is not met.
WRONG = """Graph(
    format: 1,
    nodes: {
        "open": ReadMesh(path: "open.obj"),
        "box": Primitive(shape: Box(size: (1, 2, 3))),
        "solid": Boolean(mesh: "open", with: ["box"], operation: Union),
        "skin": Subdivide(mesh: "solid", scheme: CatmullClark, levels: 1),
    },
    outputs: { "open.ply": "open", "skin.ply": "skin", "box.ply": "box" },
    expect: [Closed("open.ply")],
)
"""
OUTSIDE = """Graph(format: 1, nodes: { "box": ReadMesh(path: "../outside/box.obj") }, outputs: { "box.ply": "box" })
"""
SLOW = """Graph(
    format: 1,
    nodes: {
        "box": Primitive(shape: Box(size: (1, 2, 3))),
        "skin": Subdivide(mesh: "box", scheme: CatmullClark, levels: 9),
    },
    outputs: { "skin.ply": "skin" },
)
"""
BOX = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nv 0 0 9\nv 9 0 9\nv 9 9 9\nv 0 9 9\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + "".join(
    "f " + " ".join(f"{vertex}/{corner}" for corner, vertex in enumerate(face.split(), 1)) + "\n"
    for face in ("4 3 2 1", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8")
)
OPEN = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nf 1 2 3\nf 1 3 4\n"


def picture() -> bytes:
    """A PNG of 4 x 3 pixels, red and white."""
    rows = b"".join(b"\0" + b"".join(b"\xff\0\0" if (row + column) % 2 else b"\xff\xff\xff" for column in range(4)) for row in range(3))

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", 4, 3, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def make(folder: pathlib.Path) -> pathlib.Path:
    """Writes the project into a new folder, next to a folder that it may not read, and returns the project's folder."""
    project, outside = folder / "project", folder / "outside"
    project.mkdir(parents=True)
    outside.mkdir()
    (project / "maquette.toml").write_text("")
    graphs = {"it": IT, "part": PART, "wrong": WRONG, "outside": OUTSIDE, "slow": SLOW}
    for name, text in graphs.items():
        (project / f"{name}.ron").write_text(text)
    (project / "box.obj").write_text(BOX)
    (project / "open.obj").write_text(OPEN)
    (project / "dots.png").write_bytes(picture())
    (outside / "box.obj").write_text(BOX)
    return project
