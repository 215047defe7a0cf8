"""Checks that files are solids for trimesh and PrusaSlicer, and slices each:  check.py NAME-SURFACES.stl|3mf ..

Both programs must find a closed, outward oriented surface, with the number of connected surfaces in the file's name. Both volumes must
agree, and the G-code must have layers up to the height of the solid.
"""

import re
import subprocess
import sys
from pathlib import Path

import trimesh

# The height of a raft of one layer and of the gap above it, in mm.
RAFT = 0.5


def slicer(*words):
    done = subprocess.run(["prusa-slicer", *map(str, words)], capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def slicer_info(path):
    """The facts that PrusaSlicer reports about a file, by name."""
    _, text = slicer("--info", path)
    return dict(re.findall(r"^(\w+) *= *(.+?)\s*$", text, re.MULTILINE))


def faults(path):
    surfaces = int(path.stem.rsplit("-", 1)[1])
    mesh = trimesh.load(path, force="mesh")
    # Formats without shared vertices, or with one for each color, repeat positions.
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    # Drop faces that are degenerate because two corners coincide in the file's precision.
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    if not mesh.is_watertight:
        yield "trimesh: not closed"
    if not mesh.is_winding_consistent or mesh.volume <= 0:
        yield f"trimesh: not oriented outward, the volume is {mesh.volume:.1f} mm3"
    if mesh.body_count != surfaces:
        yield f"trimesh: {mesh.body_count} surfaces, not {surfaces}"
    info = slicer_info(path)
    if info.get("manifold") != "yes":
        yield f"PrusaSlicer: not a manifold: {info}"
    elif abs(float(info["volume"]) / mesh.volume - 1) > 1e-3:
        yield f"PrusaSlicer: the volume is {info['volume']}, but {mesh.volume:.1f} mm3 in trimesh"
    code = path.with_suffix(path.suffix + ".gcode")
    # A shell stands on the lowest point of its border, so it is printed on a raft of one layer.
    raft = int(path.stem.startswith("Shell"))
    status, text = slicer("--export-gcode", "--skirts", "0", "--raft-layers", raft, "--output", code, path)
    if status or not code.is_file():
        yield f"PrusaSlicer: cannot slice it: {text[-300:]}"
        return
    heights = [float(z) for z in re.findall(r"^;Z:([\d.]+)", code.read_text(), re.MULTILINE)]
    tall = float(info.get("size_z", "nan")) + raft * RAFT
    if not heights or abs(max(heights) - tall) > 0.5:
        yield f"PrusaSlicer: layers up to {max(heights, default=0):.1f} mm of {tall:.1f}"
    print(f"{path.name}: {mesh.volume:.0f} mm3, {len(mesh.faces)} faces, {len(heights)} layers")


if __name__ == "__main__":
    wrong = [f"{path.name}: {fault}" for path in map(Path, sys.argv[1:]) for fault in faults(path)]
    print("\n".join(wrong) if wrong else "all are solids")
    sys.exit(bool(wrong))
