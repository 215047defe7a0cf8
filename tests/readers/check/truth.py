"""The expected data of files: values as printed by `maquette inspect`, converted to the records of `programs/record.py`."""

from __future__ import annotations

import concurrent.futures
import json
import math
import pathlib
import re
import subprocess
from typing import Any, Dict, List, Optional

Record = Dict[str, Any]
Table = Dict[str, List[Any]]
Columns = List[Dict[str, Any]]

# The materials of `inputs/materials.mtl`.
MATERIALS = {
    "skin": {"triangles": 2, "maps": ["color", "emission", "normals", "roughness"]},
    "bare": {"triangles": 2, "maps": [], "color": [1.0, 0.25, 0.0]},
}

# The meshes that are expected for surfaces in mesh files.
MESHES_OF_SURFACES = {"surface": "surface-mesh", "vase": "vase-mesh"}


def outputs(graph: pathlib.Path) -> Dict[str, str]:
    """The link of each output of a graph."""
    text = graph.read_text(encoding="utf8").split("outputs: {")[1]
    return dict(re.findall(r'^\s*"(.+)": "(.+)",$', text, re.MULTILINE))


def truths(graph: pathlib.Path, maquette: str) -> Dict[str, Record]:
    """The expected record of each output."""
    inspector = Inspector(graph, maquette)
    links = {name: link_of(name, link) for name, link in outputs(graph).items()}
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        values = dict(zip(set(links.values()), pool.map(inspector.value, set(links.values()))))
    return {name: in_file(name, values[link]) for name, link in links.items()}


def link_of(name: str, link: str) -> str:
    return MESHES_OF_SURFACES.get(link, link) if name.endswith((".glb", ".ply")) else link


class Inspector:
    """Reads the values of a graph's nodes by `maquette inspect`."""

    def __init__(self, graph: pathlib.Path, maquette: str) -> None:
        self.graph, self.maquette = graph, maquette

    def json(self, *words: str) -> Any:
        command = [self.maquette, "inspect", self.graph.name, *words, "--json"]
        done = subprocess.run(command, cwd=self.graph.parent, capture_output=True, text=True, encoding="utf8")
        if done.returncode != 0:
            raise ValueError(f"{' '.join(command)}: {done.stderr or done.stdout}")
        return json.loads(done.stdout)

    def table(self, link: str, kind: str) -> Table:
        """The columns of a kind of elements, by name."""
        table = self.json(link, "--table", kind)
        columns = zip(*table["rows"]) if table["rows"] else [[] for _ in table["columns"]]
        return {column["name"]: list(values) for column, values in zip(table["columns"], columns)}

    def value(self, link: str) -> Record:
        """The record of a value, with its `type`."""
        found = self.json(link, "--table")["outputs"]
        output = next((it for it in found if link.endswith("." + it["name"])), found[0])
        columns = output["parts"]["columns"]
        readers = {"Mesh": self.mesh, "RangeImage": self.range, "Handles": self.handles, "Surface": self.surface}
        readers |= dict.fromkeys(("Points", "Region", "Curve", "ControlNet"), self.points)
        value = {"type": output["type"], **readers.get(output["type"], self.picture)(link, columns)}
        if value["type"] == "ControlNet":
            rows, columns = map(int, output["parts"]["facts"]["control points"].split(" x "))
            corners = (row * columns + column for row in range(rows - 1) for column in range(columns - 1))
            value["faces"] = [[k, k + columns, k + columns + 1, k + 1] for k in corners]
        if value["type"] == "Curve":
            count = len(value["points"])
            closing = output["parts"]["facts"]["closed"] == "true"
            value["lines"] = [[k, (k + 1) % count] for k in range(count if closing else count - 1)]
        return value

    def mesh(self, link: str, columns: Columns) -> Record:
        vertices, corners = self.table(link, "vertices"), self.table(link, "corners")
        faces: List[List[int]] = []
        for face, vertex in zip(map(int, corners["face"]), map(int, corners["vertex"])):
            faces += [[]] if face == len(faces) else []
            faces[face].append(vertex)
        found = {"points": places(vertices), "faces": faces, "colors": levels(vertices, "color"), "wear": together(vertices, "wear")}
        for key, words in (("normals", ("normal_x", "normal_y", "normal_z")), ("uv", ("uv_u", "uv_v"))):
            found[key] = together(vertices, *words) or together(corners, *words)
            found[f"{key}_on"] = "points" if together(vertices, *words) else "corners"
        if is_there(columns, "face", "color"):
            found["face_colors"] = levels(self.table(link, "faces"), "color")
        if is_there(columns, "texel", "texture"):
            texels = levels(self.table(link, "texels"), "texture")
            width = int(self.table(link, "whole")["texture_size_u"][0])
            found["picture"] = [texels[k : k + width] for k in range(0, len(texels), width)]
        found["captured"] = is_there(columns, "whole", "frame")
        if link == "materials":
            found["materials"] = MATERIALS
        return found

    def points(self, link: str, columns: Columns) -> Record:
        table = self.table(link, "points")
        return {
            "points": places(table),
            "colors": levels(table, "color"),
            "normals": together(table, "normal_x", "normal_y", "normal_z"),
            "weights": table.get("weight", []),
            # A region is part of a capture.
            "captured": "cell" in table or is_there(columns, "whole", "frame"),
        }

    def handles(self, link: str, _: Columns) -> Record:
        return {"points": places(self.table(link, "points"))}

    def range(self, link: str, _: Columns) -> Record:
        table, whole = self.table(link, "cells"), self.table(link, "whole")
        width = 1 + int(max(table["column"]))
        depths = [z or 0.0 for z in table["z"]]
        valid = [k for k, z in enumerate(table["z"]) if z is not None]
        points, colors = places(table), levels(table, "color")
        pose = [whole[f"pose_{k + 1}"][0] for k in range(16)]
        return {
            "points": [points[k] for k in valid],
            "colors": [colors[k] for k in valid],
            "depths": [depths[k : k + width] for k in range(0, len(depths), width)],
            "pose": pose,
            "captured": True,
        }

    def surface(self, link: str, columns: Columns) -> Record:
        # A summary of the knots, since lists of different lengths cannot be a table.
        knots = [next(it for it in columns if it["name"] == name) for name in ("knots u", "knots v")]
        return {**self.points(link, columns), "knots": [[it["count"], it["least"], it["greatest"], it["mean"]] for it in knots]}

    def picture(self, link: str, _: Columns) -> Record:
        table = self.table(link, "pixels")
        width = 1 + int(max(table["column"]))
        pixels = levels(table, "color") or next(table[name] for name in table if name not in ("index", "column", "row"))
        return {"picture": [pixels[k : k + width] for k in range(0, len(pixels), width)]}


def is_there(columns: Columns, on: str, name: str) -> bool:
    return any((it["on"], it["name"]) == (on, name) for it in columns)


def together(table: Table, *names: str) -> List[List[float]]:
    """Combines columns to rows; empty if the table does not have them."""
    return [list(row) for row in zip(*(table[name] for name in names))] if names[0] in table else []


def places(table: Table) -> List[List[float]]:
    return together(table, "x", "y", "z")


def levels(table: Table, name: str) -> List[List[float]]:
    return together(table, f"{name}_red", f"{name}_green", f"{name}_blue")


def in_file(name: str, value: Record) -> Record:
    """The data of a value that a file of this format holds according to the documentation, in the axes of the file."""
    ending, kind = name.rsplit(".", 1)[1], value["type"]
    held = dict(value)
    if value.get("captured") and not (kind == "RangeImage" and ending != "ply"):
        # Captures have the axes of the camera, and y up in files.
        turn(held, lambda p: [p[0], -p[1], -p[2]])
    if kind == "Mesh":
        return mesh_in_file(ending, held)
    if kind == "RangeImage":
        return range_in_file(ending, held)
    if kind == "Points" and ending == "xyz" and held["colors"]:
        return {**held, "normals": []}
    if kind in ("Image", "Mask", "Labels", "Field"):
        return {**held, "picture": picture_in_file(ending, kind, held["picture"])}
    return held


def turn(held: Record, change: Any) -> None:
    """Applies a change of axes to points and normals."""
    for key in ("points", "normals"):
        if held.get(key):
            held[key] = [change(it) for it in held[key]]


def mesh_in_file(ending: str, held: Record) -> Record:
    has_picture = bool(held.get("picture") and held["uv"])
    if ending in ("glb", "obj", "3mf") and has_picture:
        held["colors"] = []
    if ending in ("ply", "stl"):
        held["picture"] = []
    if ending == "ply" and held["uv_on"] == "corners" and any(len(face) > 3 for face in held["faces"]):
        # They are stored under a name that other programs do not know.
        held["uv"] = []
    if ending == "ply" and held["normals_on"] == "corners":
        held["normals"] = []
    if ending in ("stl", "3mf"):
        held["normals"] = []
    if ending == "stl" or (ending == "3mf" and not has_picture):
        held["uv"] = []
    if ending == "stl":
        held["colors"] = []
    if ending != "ply":
        held.pop("face_colors", None)
        held.pop("wear", None)
    if ending == "3mf":
        # On the build plate: z up, all coordinates positive.
        turn(held, lambda p: [p[0], -p[2], p[1]])
        held["size"] = max(abs(x) for point in held["points"] for x in point)
        lowest = [min(point[k] for point in held["points"]) for k in range(3)]
        held["points"] = [[x - low for x, low in zip(point, lowest)] for point in held["points"]]
    held["triangles"] = ending in ("glb", "stl", "3mf")
    return held


def range_in_file(ending: str, held: Record) -> Record:
    if ending == "png":
        # The depth scale, an integer number of steps for each mm, which is stored next to the file.
        farthest = max(map(max, held["depths"]))
        steps = next(step for step in (1000, 500, 200, 100, 50, 20, 10, 5, 2, 1) if farthest * step <= 65535)
        return {"type": "Picture", "picture": [[round(steps * z) for z in row] for row in held["depths"]]}
    if ending == "ptx":
        pose = held["pose"]
        held["points"] = [[sum(pose[4 * k + row] * [*point, 1.0][k] for k in range(4)) for row in range(3)] for point in held["points"]]
    return held


def picture_in_file(ending: str, kind: str, picture: List[List[Any]]) -> List[List[Any]]:
    if kind == "Mask":
        return [[255 * inside for inside in row] for row in picture]
    if kind == "Field" and ending == "png":
        least, greatest = min(map(min, picture)), max(map(max, picture))
        return [[math.floor((x - least) * 65535 / (greatest - least) + 0.5) for x in row] for row in picture]
    return picture
