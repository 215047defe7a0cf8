"""lib3mf, the reference implementation of the 3MF Consortium."""

import io
import pathlib

import lib3mf
import numpy as np
import record
from PIL import Image

WRAPPER = lib3mf.get_wrapper()


def read(path: pathlib.Path) -> record.Record:
    model = WRAPPER.CreateModel()
    reader = model.QueryReader("3mf" if path.suffix == ".3mf" else "stl")
    reader.SetStrictModeActive(path.suffix == ".3mf")
    reader.ReadFromFile(str(path))
    warnings = [reader.GetWarning(k) for k in range(reader.GetWarningCount())]
    if warnings:
        raise ValueError(f"warning: {warnings[0]}")
    found = {"points": [], "faces": []}
    items = model.GetBuildItems()
    while items.MoveNext():
        item = items.GetCurrent()
        mesh = model.GetMeshObjectByID(item.GetObjectResource().GetResourceID())
        fields = item.GetObjectTransform().Fields if item.HasObjectTransform() else [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]]
        first = len(found["points"])
        for vertex in mesh.GetVertices():
            at = [*vertex.Coordinates, 1.0]
            found["points"].append([sum(at[k] * fields[k][column] for k in range(4)) for column in range(3)])
        triangles = [list(triangle.Indices) for triangle in mesh.GetTriangleIndices()]
        found["faces"] += [[first + k for k in triangle] for triangle in triangles]
        looks(model, mesh, len(triangles), found)
    return found


def looks(model: "lib3mf.Model", mesh: "lib3mf.MeshObject", count: int, found: record.Record) -> None:
    """Adds colors, or texture coordinates and their picture."""
    colors, uv, picture = [], [], []
    for k in range(count):
        properties = mesh.GetTriangleProperties(k)
        if not properties.ResourceID:
            continue
        kind = model.GetPropertyTypeByID(properties.ResourceID)
        if kind == lib3mf.PropertyType.Colors:
            group = model.GetColorGroupByID(properties.ResourceID)
            corners = [group.GetColor(it) for it in properties.PropertyIDs]
            colors += [[it.Red, it.Green, it.Blue] for it in corners]
        elif kind == lib3mf.PropertyType.TexCoord:
            group = model.GetTexture2DGroupByID(properties.ResourceID)
            corners = [group.GetTex2Coord(it) for it in properties.PropertyIDs]
            uv += [[it.U, it.V] for it in corners]
            picture = picture or pixels(group.GetTexture2D().GetAttachment())
    for key, values in (("colors", colors), ("uv", uv), ("picture", picture)):
        found[key] = found.get(key, []) + values


def pixels(attachment: "lib3mf.Attachment") -> list:
    data = attachment.WriteToBuffer()
    return np.asarray(Image.open(io.BytesIO(bytes(data))).convert("RGB")).tolist()


record.main(read)
