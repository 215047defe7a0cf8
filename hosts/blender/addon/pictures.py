"""Image textures of materials: writes those of Blender into files for the engine, and shows files of the engine as shader nodes."""

from __future__ import annotations

import pathlib
import struct
import zlib
from typing import Any

import bpy

from .records import levels

# Kinds of maps of the engine, and the inputs of the shader.
SOCKETS = {
    "base color": "Base Color",
    "metallic": "Metallic",
    "roughness": "Roughness",
    "normal": "Normal",
    "emissive": "Emission Color",
    "opacity": "Alpha",
}
COLORS = ("base color", "emissive", "opacity")

CHANNELS = ("Red", "Green", "Blue")
WRAPS = {"repeat": "REPEAT", "mirror": "MIRROR", "clamp": "EXTEND"}

# First bytes of the formats that the engine reads: PNG, JPEG, WebP, BMP, TIFF, OpenEXR, Radiance HDR.
READABLE = (b"\x89PNG", b"\xff\xd8\xff", b"RIFF", b"BM", b"II*\0", b"MM\0*", b"v/1\x01", b"#?RADIANCE")


class Files:
    """Writes images to the engine's folder, each once."""

    def __init__(self, folder: pathlib.Path, start: str) -> None:
        self.folder, self.start = folder, start
        self.names: dict[bpy.types.Image, str | None] = {}

    def name(self, image: bpy.types.Image) -> str | None:
        """The file name of an image; None if it has no pixels."""
        if image not in self.names:
            content = _content(image)
            name = f"{self.start}map{len(self.names)}" if content else None
            if name:
                (self.folder / name).write_bytes(content)
            self.names[image] = name
        return self.names[image]


def _content(image: bpy.types.Image) -> bytes:
    """The bytes of the image's file, or its pixels as PNG if it was painted or has another format; empty if it has no pixels."""
    if image.source == "FILE" and not image.is_dirty:
        try:
            own = image.packed_file.data if image.packed_file else pathlib.Path(bpy.path.abspath(image.filepath, library=image.library)).read_bytes()
        except OSError:
            return b""
        if own.startswith(READABLE):
            return bytes(own)
    return _png(image) if image.source in ("FILE", "GENERATED") else b""


def _png(image: bpy.types.Image) -> bytes:
    """The pixels of an image as PNG; empty if it has none."""
    import numpy as np

    width, height = image.size
    numbers = np.empty(4 * width * height, "f4")
    if not len(numbers) or len(image.pixels) != len(numbers):
        return b""
    image.pixels.foreach_get(numbers)
    pixels = numbers.reshape(-1, 4)
    colors = levels(pixels) if image.is_float else np.rint(pixels[:, :3].clip(0, 1) * 255).astype("u1")
    opacity = np.rint(pixels[:, 3:].clip(0, 1) * 255).astype("u1")
    rows = np.hstack([colors, opacity]).reshape(height, 4 * width)[::-1]
    # Each row begins with its filter type, 0: none.
    content = zlib.compress(np.insert(rows, 0, 0, axis=1).tobytes(), 1)

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", content) + chunk(b"IEND", b"")


def maps(shader: Any, uv: str, files: Files) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """The maps of a shader in the protocol of the engine, and the names of inputs linked to anything else.

    `uv` is the UV map that the engine calls `uv`.
    """
    found, others = {}, []
    for kind, name in SOCKETS.items():
        if kind == "opacity" or not shader.inputs[name].links:
            continue
        its = _map(shader.inputs[name], uv)
        file = files.name(its.pop("image")) if its else None
        if its and file:
            found[kind] = {**its, "file": file}
        else:
            others.append(name)
    if shader.inputs["Alpha"].links:
        node, output = _source(shader.inputs["Alpha"])
        color, _ = _source(shader.inputs["Base Color"])
        if "base color" not in found or node != color or output != "Alpha":
            others.append("Alpha")
    return found, others


def _source(socket: Any) -> tuple[Any, str]:
    """The node that an input is linked to, and the name of its output; None if there is none."""
    while socket.links:
        link = socket.links[0]
        if link.from_node.type != "REROUTE":
            return link.from_node, link.from_socket.name
        socket = link.from_node.inputs[0]
    return None, ""


def _map(socket: Any, uv: str) -> dict[str, Any] | None:
    """The image texture that an input is linked to, with its settings; None if it is linked to anything else."""
    its: dict[str, Any] = {"strength": 1.0, "channel": None}
    node, output = _source(socket)
    if node and node.type == "NORMAL_MAP" and node.space == "TANGENT":
        its["strength"] = float(node.inputs["Strength"].default_value)
        node, output = _source(node.inputs["Color"])
    if node and node.type == "SEPARATE_COLOR" and node.mode == "RGB" and output in CHANNELS:
        its["channel"] = CHANNELS.index(output)
        node, output = _source(node.inputs["Color"])
    if node is None or node.type != "TEX_IMAGE" or node.image is None or output != "Color":
        return None
    wrap = next((word for word, extension in WRAPS.items() if extension == node.extension), "clamp")
    place, output = _source(node.inputs["Vector"])
    known = uv
    if place and place.type == "UVMAP":
        known = place.uv_map or uv
    elif place and (place.type, output) != ("TEX_COORD", "UV"):
        return None
    # A name such as `wood.001` has no file extension.
    name = bpy.path.basename(node.image.filepath) or node.image.name.replace(".", "_")
    return {**its, "image": node.image, "name": name, "wrap": [wrap, wrap], "uv": "uv" if known == uv else known}


def show(material: bpy.types.Material, shader: Any, name: str, kind: str, image: bpy.types.Image | None, its: dict[str, Any]) -> None:
    """Links an input of a shader to an image texture, and removes the previous one. `its` is the map in the protocol of the engine."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    for old in [nodes.get(f"{name}{part}") for part in ("", " channel", " normal", " uv")]:
        if old:
            nodes.remove(old)
    if image is None:
        return
    shown = nodes.new("ShaderNodeTexImage")
    shown.name, shown.image = name, image
    shown.extension = WRAPS[its.get("wrap", ["repeat"])[0]]
    shown.location = (shader.location.x - 640, shader.location.y - 300 * [*SOCKETS].index(kind))
    if kind not in COLORS:
        image.colorspace_settings.name = "Non-Color"
    if its.get("uv", "uv") != "uv":
        place = nodes.new("ShaderNodeUVMap")
        place.name, place.uv_map = f"{name} uv", its["uv"]
        place.location = (shown.location.x - 200, shown.location.y)
        links.new(place.outputs["UV"], shown.inputs["Vector"])
    color = shown.outputs["Alpha" if kind == "opacity" else "Color"]
    if its.get("channel") is not None and kind not in (*COLORS, "normal"):
        split = nodes.new("ShaderNodeSeparateColor")
        split.name, split.location = f"{name} channel", (shown.location.x + 300, shown.location.y)
        links.new(color, split.inputs["Color"])
        color = split.outputs[CHANNELS[its["channel"]]]
    if kind == "normal":
        turned = nodes.new("ShaderNodeNormalMap")
        turned.name, turned.location = f"{name} normal", (shown.location.x + 300, shown.location.y)
        turned.inputs["Strength"].default_value = max(its["strength"], 0.0)
        links.new(color, turned.inputs["Color"])
        color = turned.outputs["Normal"]
    links.new(color, shader.inputs[SOCKETS[kind]])
