"""How a reader tells what a program finds in files: one line of JSON for each file.

A record has `error`, or some of these; what the program cannot tell is left out, and what it did not find is empty:

    points    [x, y, z] in mm and in the axes of the file, whatever the program makes of them
    faces     indices of points, as many as the program keeps
    lines     indices of points
    colors, uv, normals
              one entry for each point or for each corner of the faces, colors from 0 to 255
    wear      an attribute of points that no format knows, one number in a list for each
    face_colors
    picture   rows of pixels: that of a picture file, or on the mesh; of a large one as `thinned` leaves them
    named_picture
              the name of the picture on the mesh, of a program that does not open it
    materials by their names: `triangles`, how many have it; `maps`, what its pictures say, in the words of `truth.py`; `color`, three
              numbers that are linear in light
    weights, knots
              of the control points of a surface, and along u and v
"""

from __future__ import annotations

import json
import os
import pathlib
import sys
from typing import Any, Callable, Dict

Record = Dict[str, Any]


def main(read: Callable[[pathlib.Path], Record]) -> None:
    """Reads the files that the command line names. What libraries print goes to the standard error."""
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for name in sys.argv[1:]:
        try:
            record = read(pathlib.Path(name))
        except Exception as error:
            record = {"error": " ".join(str(error).split()) or type(error).__name__}
        if "picture" in record:
            record["picture"] = thinned(record["picture"])
        print(json.dumps({"file": name, **record}, default=plain), file=output, flush=True)


def plain(array: Any) -> Any:
    """An array of numpy as a list."""
    return array.tolist()


def scaled(points: Any, factor: float) -> Any:
    """Points in other units."""
    return [[factor * x for x in point] for point in points]


def thinned(picture: Any) -> Any:
    """At most 64 rows and columns, evenly spaced, and the number of all."""
    rows = len(picture)
    step = -(-max(rows, len(picture[0])) // 64) if rows else 1
    return {"size": [len(picture[0]) if rows else 0, rows], "rows": [list(map(entry, row[::step])) for row in picture[::step]]}


def entry(pixel: Any) -> Any:
    """Numbers that JSON has."""
    return plain(pixel) if hasattr(pixel, "tolist") else pixel
