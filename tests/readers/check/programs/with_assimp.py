"""assimp, by its command line, whose JSON export is the scene as its library returns it."""

import json
import pathlib
import subprocess
import tempfile

import record


def read(path: pathlib.Path) -> record.Record:
    with tempfile.TemporaryDirectory() as folder:
        output = pathlib.Path(folder) / "scene.json"
        done = subprocess.run(["assimp", "export", str(path), str(output), "-fassjson"], capture_output=True, text=True)
        if done.returncode != 0 or not output.is_file():
            raise ValueError(next(iter(reversed((done.stdout + done.stderr).strip().splitlines())), "no message"))
        scene = json.loads(output.read_text(encoding="utf8", errors="replace"))
    found = {"points": [], "faces": [], "lines": [], "colors": [], "normals": [], "uv": []}
    identity = [float(i % 5 == 0) for i in range(16)]
    add(scene, scene["rootnode"], identity, found)
    if path.suffix == ".glb":
        found["points"] = record.scaled(found["points"], 1000)
    for key in ("colors", "normals", "uv"):
        if len(found[key]) != len(found["points"]):
            found[key] = []
    found["materials"] = materials(scene, path.suffix)
    names = [it["value"] for material in scene.get("materials", ()) for it in material["properties"] if it["key"] == "$tex.file"]
    # The name of an embedded picture begins with `*`.
    found["named_picture"] = names[0] if names and (names[0][0] == "*" or (path.parent / names[0]).is_file()) else ""
    return found


def materials(scene: dict, ending: str) -> record.Record:
    """The materials of meshes; `semantic` is the kind of a texture."""
    kinds = {1: "color", 12: "color", 4: "emission", 6: "normals", 16: "roughness"}
    found = {}
    for mesh in scene["meshes"]:
        properties = scene["materials"][mesh["materialindex"]]["properties"]
        name = next((it["value"] for it in properties if it["key"] == "?mat.name"), "")
        entry = found.setdefault(name, {"triangles": 0, "maps": set()})
        entry["triangles"] += sum(len(face) - 2 for face in mesh.get("faces", ()))
        entry["maps"] |= {kinds[it["semantic"]] for it in properties if it["key"] == "$tex.file" and it["semantic"] in kinds}
        key = "$clr.base" if ending == ".glb" else "$clr.diffuse"
        entry["color"] = next((it["value"][:3] for it in properties if it["key"] == key), [1, 1, 1])
    return {name: {**entry, "maps": sorted(entry["maps"])} for name, entry in found.items()}


def add(scene: dict, node: dict, parent: list, found: record.Record) -> None:
    """Adds the meshes of a node and of its descendants. Matrices are stored by rows."""
    own = node["transformation"]
    matrix = [sum(parent[4 * row + k] * own[4 * k + column] for k in range(4)) for row in range(4) for column in range(4)]
    for index in node.get("meshes", ()):
        mesh = scene["meshes"][index]
        first = len(found["points"])
        for point in triples(mesh.get("vertices", ()), 3):
            found["points"].append([sum(matrix[4 * row + k] * point[k] for k in range(3)) + matrix[4 * row + 3] for row in range(3)])
        for x, y, z in triples(mesh.get("normals", ()), 3):
            turned = [matrix[4 * row] * x + matrix[4 * row + 1] * y + matrix[4 * row + 2] * z for row in range(3)]
            length = sum(x * x for x in turned) ** 0.5 or 1.0
            found["normals"].append([x / length for x in turned])
        colors = mesh.get("colors") or [[]]
        found["colors"] += [[255 * x for x in color[:3]] for color in triples(colors[0], 4)]
        uv = mesh.get("texturecoords") or [[]]
        width = (mesh.get("numuvcomponents") or [2])[0]
        found["uv"] += [pair[:2] for pair in triples(uv[0], width)]
        found["faces"] += [[first + k for k in face] for face in mesh.get("faces", ()) if len(face) > 2]
        found["lines"] += [[first + k for k in face] for face in mesh.get("faces", ()) if len(face) == 2]
    for child in node.get("children", ()):
        add(scene, child, matrix, found)


def triples(numbers: list, width: int) -> list:
    return [numbers[k : k + width] for k in range(0, len(numbers), width)]


record.main(read)
