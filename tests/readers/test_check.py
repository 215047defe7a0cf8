"""Tests that the comparison notices damaged data: `python3 -m unittest discover tests/readers`. Needs no other programs."""

import copy
import pathlib
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE / "check"))

import compare
import table
from limits import LIMITS, Limit
from program import PROGRAMS, Program
from programs.record import thinned
from truth import in_file, outputs

READER = Program("reader", str(HERE / "plain_obj.py"), ("obj",), sys.executable)

# An L-shaped cap, whose first corner gives a wrong fan triangulation, and a wall.
CAP = [[20, 0, 3], [20, 10, 3], [10, 10, 3], [10, 20, 3], [0, 20, 3], [0, 0, 3]]
WALL = [[30, 0, 0], [30, 8, 0], [30, 8, 9]]
COLORS = [[255, 0, 0], [10, 200, 30], [128, 64, 32], [0, 0, 255], [9, 9, 9], [0, 0, 0], [1, 2, 3], [250, 128, 5], [77, 7, 70]]
TRUTH = {
    "type": "Mesh",
    "points": CAP + WALL,
    "faces": [[0, 1, 2, 3, 4, 5], [6, 7, 8]],
    "colors": COLORS,
    "normals": [],
    "uv": [[k / 10, k * k / 100] for k in range(9)],
    "uv_on": "corners",
    "normals_on": "points",
}
TRIANGLES = [[0, 1, 2], [5, 0, 2], [5, 2, 4], [2, 3, 4], [6, 7, 8]]


def obj(points=TRUTH["points"], faces=TRUTH["faces"], colors=COLORS, uv=TRUTH["uv"]) -> str:
    lines = ["v " + " ".join(map(str, [*point, *(x / 255 for x in color)])) for point, color in zip(points, colors or [[]] * len(points))]
    lines += [f"vt {u} {v}" for u, v in uv]
    places = {k: place for place, k in enumerate(k for face in TRUTH["faces"] for k in face)}
    corner = lambda k: f"{k + 1}/{places[k] + 1}" if uv else str(k + 1)
    return "\n".join(lines + ["f " + " ".join(map(corner, face)) for face in faces])


def replace_item(items, index, item):
    return [item if k == index else other for k, other in enumerate(items)]


class Damage(unittest.TestCase):
    """Damaged files, read by a separate program like all others."""

    def words(self, **files: str) -> dict:
        with tempfile.TemporaryDirectory() as folder:
            paths = [pathlib.Path(folder) / f"{name}.obj" for name in files]
            for path, text in zip(paths, files.values()):
                path.write_text(text)
            records = READER.read(paths)
        return {("reader", name): compare.difference(TRUTH, records[f"{name}.obj"]) for name in files}

    def cell(self, text: str) -> str:
        return table.Verdicts(self.words(it=text), []).cell("reader", ["it"])

    def test_what_is_right_is_ok(self):
        self.assertEqual(self.cell(obj()), "ok")
        self.assertEqual(self.cell(obj(faces=TRIANGLES)), "ok")
        # Starting at another corner.
        self.assertEqual(self.cell(obj(faces=[[2, 3, 4, 5, 0, 1], [8, 6, 7]])), "ok")

    def test_each_damage_is_a_failure(self):
        for word, text in {
            "positions": obj(points=replace_item(TRUTH["points"], 3, [10, 19.9, 3])),
            "scaled by 0.001": obj(points=[[x / 1000 for x in point] for point in TRUTH["points"]]),
            "turned": obj(points=[[x, z, -y] for x, y, z in TRUTH["points"]]),
            "moved": obj(points=[[x + 5, y, z] for x, y, z in TRUTH["points"]]),
            "no faces": obj(faces=[]),
            "6 of 9 vertices": obj(faces=[[0, 1, 2, 3, 4, 5]]),
            "4 of 5 triangles": obj(faces=TRIANGLES[:2] + TRIANGLES[3:]),
            "inside out": obj(faces=[face[::-1] for face in TRIANGLES]),
            # A fan.
            "area": obj(faces=[[0, k, k + 1] for k in range(1, 5)] + [[6, 7, 8]]),
            "no colors": obj(colors=[]),
            "colors": obj(colors=replace_item(COLORS, 2, [128, 64, 40])),
            "linear colors": obj(colors=[compare.linear_color(color) for color in COLORS]),
            "no uv": obj(uv=[]),
            "uv": obj(uv=replace_item(TRUTH["uv"], 1, [0.2, 0.5])),
            "no points": "f",
        }.items():
            self.assertEqual(self.cell(text), f"FAILED: {word}", word)

    def test_a_program_that_ends_at_a_file_reads_the_rest(self):
        words = self.words(a=obj(), b="crash", c=obj())
        self.assertEqual([*words.values()], ["", "the program ends with 1: it crashes", ""])

    def test_limits_are_marked_and_noticed_when_they_are_gone(self):
        limits = [Limit("other", "*", "*", "it is not here"), Limit("reader", "it", "no co*", "it knows none")]
        known = table.Verdicts(self.words(it=obj(colors=[]), other=obj()), limits)
        self.assertEqual((known.cell("reader", ["it", "other"]), known.failures()), ("ok *2", []))
        self.assertEqual(known.cell("reader", ["it"]), "no *2")
        self.assertEqual(known.cell("reader", ["another"]), "-")
        self.assertIn("1 passed, 0 failed", table.text(table.Verdicts(self.words(it=obj(colors=[])), limits), {"it.obj": "Mesh"}, []))
        gone = table.Verdicts(self.words(it=obj()), limits)
        self.assertEqual(gone.failures(), ["reader, it: `no co*` no longer occurs: remove it from limits.py"])
        # A different fault is not covered by the limit.
        self.assertEqual(table.Verdicts(self.words(it=obj(uv=[])), limits).cell("reader", ["it"]), "FAILED: no uv")


class Comparison(unittest.TestCase):
    def difference(self, truth, **found):
        return compare.difference(truth, found)

    def test_clouds_have_all_points_and_no_faces(self):
        truth = {"type": "Points", "points": CAP, "normals": [[0, 0, 1]] * 6}
        self.assertEqual(self.difference(truth, points=CAP, normals=[[0, 0, 1]] * 6), "")
        self.assertEqual(self.difference(truth, points=CAP[1:]), "5 of 6 points")
        self.assertEqual(self.difference(truth, points=CAP + CAP[:1]), "7 of 6 points")
        self.assertEqual(self.difference(truth, points=CAP, faces=[[0, 1, 2]]), "1 faces")
        self.assertEqual(self.difference(truth, points=CAP, normals=[]), "no normals")
        self.assertEqual(self.difference(truth, points=CAP, normals=[[0, 0, -1]] * 6), "normals")
        self.assertEqual(self.difference(truth, points=replace_item(CAP, 0, [float("nan")] * 3)), "points that are not finite")
        self.assertEqual(self.difference(truth, error="cut off"), "cut off")

    def test_lines_join_the_same_points(self):
        truth = {"type": "Curve", "points": CAP, "lines": [[k, (k + 1) % 6] for k in range(6)]}
        self.assertEqual(self.difference(truth, points=CAP, lines=[[0, 1, 2, 3, 4, 5, 0]]), "")
        self.assertEqual(self.difference(truth, points=CAP, lines=[[0, 1, 2, 3, 4, 5]]), "lines")
        self.assertEqual(self.difference(truth, points=CAP, lines=[]), "no lines")

    def test_pictures_have_the_same_pixels(self):
        truth = {"type": "Image", "picture": [[[k, j, 200] for k in range(100)] for j in range(70)]}
        self.assertEqual(self.difference(truth, picture=thinned(truth["picture"])), "")
        for word, change in {
            "70 x 100 pixels": lambda rows: [list(row) for row in zip(*rows)],
            "levels": lambda rows: rows[::-1],
            "no colors": lambda rows: [[pixel[0] for pixel in row] for row in rows],
            "no picture": lambda rows: [],
        }.items():
            self.assertEqual(self.difference(truth, picture=thinned(change(copy.deepcopy(truth["picture"])))), word)
        deep = {"type": "Field", "picture": [[0, 12345, 65535]]}
        self.assertEqual(self.difference(deep, picture=thinned([[0, 48, 255]])), "8 of 16 bits")

    def test_surfaces_have_the_same_points_weights_and_knots(self):
        truth = {"type": "Surface", "points": CAP, "weights": [1, 1, 2, 1, 1, 1], "knots": [[6, [0], [1], [0.5]]] * 2}
        found = {"points": CAP, "weights": [0.5, 0.5, 1, 0.5, 0.5, 0.5], "knots": [[0, 0, 0, 1, 1, 1]] * 2}
        self.assertEqual(self.difference(truth, **found), "")
        self.assertEqual(self.difference(truth, **{**found, "points": CAP[::-1]}), "control points")
        self.assertEqual(self.difference(truth, **{**found, "weights": [1] * 6}), "weights")
        self.assertEqual(self.difference(truth, **{**found, "knots": [[0, 0, 0.5, 0.5, 1, 1]] * 2}), "")
        self.assertEqual(self.difference(truth, **{**found, "knots": [[0, 0, 0.2, 1, 1, 1]] * 2}), "knots")
        self.assertEqual(self.difference(truth, points=CAP), "control points alone")

    def test_each_format_holds_what_the_documentation_says(self):
        held = {ending: in_file(f"it.{ending}", copy.deepcopy(TRUTH)) for ending in ("glb", "obj", "stl", "3mf", "ply")}
        self.assertEqual([ending for ending in held if held[ending]["colors"]], ["glb", "obj", "3mf", "ply"])
        self.assertEqual([ending for ending in held if held[ending]["uv"]], ["glb", "obj"])
        # On the build plate.
        self.assertEqual([min(axis) for axis in zip(*held["3mf"]["points"])], [0, 0, 0])
        captured = in_file("it.obj", {**copy.deepcopy(TRUTH), "captured": True})
        self.assertEqual(captured["points"][0], [20, 0, -3])


class Lists(unittest.TestCase):
    def test_limits_are_of_programs_and_files_that_there_are(self):
        files = outputs(HERE / "files.ron")
        names = {program.name: program for program in PROGRAMS}
        for limit in LIMITS:
            for name in limit.programs.split():
                known = [file for file in files if limit.is_of(name, file) and file.rsplit(".", 1)[1] in names[name].endings]
                self.assertTrue(known, limit)

    def test_each_format_of_a_value_has_a_program(self):
        endings = {file.rsplit(".", 1)[1] for file in outputs(HERE / "files.ron")}
        self.assertEqual(endings, {ending for program in PROGRAMS for ending in program.endings})


if __name__ == "__main__":
    unittest.main()
