"""Records of the data that a program reads from a file: one line of JSON for each file.

A record has `error`, or some of these fields. Fields that the program cannot report are absent; fields of data that it did not find are
empty.

    points    [x, y, z] in mm and in the axes of the file, converted back if the program changes them
    faces     indices of points, as many corners as the program keeps
    lines     indices of points
    colors, uv, normals
              one entry for each point or for each corner of the faces, colors from 0 to 255
    wear      a custom attribute of points, one number in a list for each
    face_colors
    picture   rows of pixels, of a picture file or of the texture of a mesh; large ones are subsampled by `thinned`
    named_picture
              the name of the texture, for a program that does not open it
    materials by name: `triangles`, the number of triangles; `maps`, the kinds of its textures, as in `truth.py`; `color`, three numbers in
              linear light
    weights, knots
              the weights of the control points of a surface, and the knots along u and v
"""

from __future__ import annotations

import json
import os
import pathlib
import sys
from typing import Any, Callable, Dict

Record = Dict[str, Any]


def main(read: Callable[[pathlib.Path], Record]) -> None:
    """Reads the files of the command line. Output of libraries goes to standard error."""
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
    """Converts a NumPy array to a list."""
    return array.tolist()


def scaled(points: Any, factor: float) -> Any:
    """Scales points to other units."""
    return [[factor * x for x in point] for point in points]


def thinned(picture: Any) -> Any:
    """Subsamples a picture to at most 64 rows and columns; also returns its size."""
    rows = len(picture)
    step = -(-max(rows, len(picture[0])) // 64) if rows else 1
    return {"size": [len(picture[0]) if rows else 0, rows], "rows": [list(map(entry, row[::step])) for row in picture[::step]]}


def entry(pixel: Any) -> Any:
    """Converts a pixel to types of JSON."""
    return plain(pixel) if hasattr(pixel, "tolist") else pixel
