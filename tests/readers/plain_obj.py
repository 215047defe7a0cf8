"""A reader of OBJ files for `test_check.py` that needs no installation. It crashes at a file with the word `crash`."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent / "check" / "programs"))

import record


def read(path: pathlib.Path) -> record.Record:
    rows = [line.split() for line in path.read_text().splitlines()]
    if ["crash"] in rows:
        sys.exit("it crashes")
    vertices = [[float(word) for word in row[1:]] for row in rows if row[:1] == ["v"]]
    corners = [[word.split("/") for word in row[1:]] for row in rows if row[:1] == ["f"]]
    uv = [[float(word) for word in row[1:]] for row in rows if row[:1] == ["vt"]]
    return {
        "points": [row[:3] for row in vertices],
        "faces": [[int(words[0]) - 1 for words in face] for face in corners],
        "colors": [[255 * x for x in row[3:]] for row in vertices if len(row) == 6],
        "uv": [uv[int(words[1]) - 1] for face in corners for words in face if len(words) > 1],
    }


record.main(read)
