"""Programs that open files, each by a script in `programs` with its own interpreter."""

from __future__ import annotations

import json
import pathlib
import subprocess
from dataclasses import dataclass
from typing import Any, Dict, List, Tuple

HERE = pathlib.Path(__file__).resolve().parent / "programs"
MADE = HERE.parents[3] / "target" / "readers"

# The timeout for all files of a program, in seconds.
TIMEOUT = 600


@dataclass(frozen=True)
class Program:
    """A program, and the file extensions that it supports."""

    name: str
    script: str
    endings: Tuple[str, ...]
    # The interpreter of the script: a path below `target/readers`, or a command in the PATH.
    interpreter: str = "bin/python"
    # True if CI runs the program for every change.
    is_quick: bool = True

    def read(self, files: List[pathlib.Path]) -> Dict[str, Dict[str, Any]]:
        """Returns a record for each file, by name. If the program crashes at a file, this file has an error; the others are read again."""
        found: Dict[str, Dict[str, Any]] = {}
        rest = list(files)
        while rest:
            done = subprocess.run([*self.command(), *map(str, rest)], capture_output=True, text=True, encoding="utf8", timeout=TIMEOUT)
            records = [json.loads(line) for line in done.stdout.splitlines()]
            found.update((pathlib.Path(record.pop("file")).name, record) for record in records)
            rest = rest[len(records) :]
            if rest:
                lines = done.stderr.strip().splitlines()
                found[rest.pop(0).name] = {"error": f"the program ends with {done.returncode}: {lines[-1] if lines else 'no message'}"}
        return found

    def command(self) -> List[str]:
        interpreter = MADE / self.interpreter
        command = [str(interpreter) if "/" in self.interpreter else self.interpreter, str(HERE / self.script)]
        return command + [str(MADE / "web")] if self.script.endswith(".mjs") else command


PROGRAMS = [
    Program("Open3D", "with_open3d.py", ("ply", "obj", "stl", "glb", "pcd", "xyz", "png")),
    Program("MeshLab", "with_meshlab.py", ("ply", "obj", "stl", "glb", "3mf", "xyz", "ptx")),
    Program("trimesh", "with_trimesh.py", ("ply", "obj", "stl", "glb", "3mf", "xyz")),
    Program("assimp", "with_assimp.py", ("ply", "obj", "stl", "glb", "3mf")),
    Program("PCL", "with_pcl.py", ("ply", "obj", "stl", "pcd")),
    Program("Pillow", "with_pillow.py", ("png", "tiff")),
    Program("CloudCompare", "with_cloudcompare.py", ("ply", "obj", "stl", "ptx", "xyz"), is_quick=False),
    Program("Blender", "with_blender.py", ("ply", "obj", "stl", "glb", "png", "tiff"), "blender/bin/python", is_quick=False),
    Program("three.js", "with_three.mjs", ("ply", "obj", "stl", "glb", "3mf", "pcd", "xyz", "png"), "node", is_quick=False),
    Program("PrusaSlicer", "with_prusaslicer.py", ("obj", "stl", "3mf", "step"), is_quick=False),
    Program("OpenCV", "with_opencv.py", ("png", "tiff"), "slow/bin/python", is_quick=False),
    Program("lib3mf", "with_lib3mf.py", ("3mf", "stl"), "slow/bin/python", is_quick=False),
    Program("OpenCascade", "with_opencascade.py", ("step",), "slow/bin/python", is_quick=False),
]
