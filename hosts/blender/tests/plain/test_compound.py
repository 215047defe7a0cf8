"""Tests of values with parts, with every type of the catalog."""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys
import types
import unittest
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parents[4]

# The package of the add-on, without its `__init__`, which needs Blender.
package = types.ModuleType("addon")
package.__path__ = [str(ROOT / "hosts/blender/addon")]
sys.modules["addon"] = package

from addon import compound  # noqa: E402

PROGRAM = os.environ.get("MAQUETTE") or str(ROOT / "target/debug/maquette")


def catalog() -> list[dict[str, Any]]:
    done = subprocess.run([PROGRAM, "nodes", "--json"], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    return found if isinstance(found, list) else found["nodes"]


class Compound(unittest.TestCase):
    """Tests that parsing and composing are inverse."""

    known: dict[tuple[str, str], compound.Variants]

    @classmethod
    def setUpClass(cls) -> None:
        cls.known = {(it["name"], name): its for it in catalog() for name, its in compound.variants(it["parameters"]).items()}

    def test_fields_with_parts_are_found(self) -> None:
        self.assertLessEqual({("Threshold", "select"), ("Primitive", "shape"), ("ExtractRegion", "pick")}, self.known.keys())
        # Fields with only plain words are not included.
        self.assertNotIn(("Subdivide", "scheme"), self.known)

    def test_what_begins_a_word_is_read_as_it_was_written(self) -> None:
        for its in self.known.values():
            for word, controls in its.items():
                text = compound.change_word(word, {}, its)
                found, parts = compound.parse(text, its)
                self.assertEqual(found, word)
                self.assertEqual(parts.keys(), {it.name for it in controls if it.is_required and it.kind != "ron"})
                self.assertEqual(compound.compose(found, parts, its), text)

    def test_parts_are_divided_at_their_commas_alone(self) -> None:
        its = self.known["Threshold", "select"]
        texts = {
            'Near(color: "#c33923", distance: 30.0)': {"color": '"#c33923"', "distance": "30.0"},
            'Near ( color : r#"a, "b)"# , distance: Expr("max(1, 2)"), )': {"color": 'r#"a, "b)"#', "distance": 'Expr("max(1, 2)")'},
            "Box(space: Hsv, low: (0.0, 0.5, 0.2), high: (20.0, 1.0, 1.0))": {
                "space": "Hsv",
                "low": "(0.0, 0.5, 0.2)",
                "high": "(20.0, 1.0, 1.0)",
            },
            'Near(color: "a\\",(", distance: 1.0 /* ), */)': {"color": '"a\\",("', "distance": "1.0 /* ), */"},
            "Otsu": {},
            "Otsu()": {},
        }
        for text, parts in texts.items():
            self.assertEqual(compound.parse(text, its)[1], parts, text)

    def test_what_is_another_value_is_left_alone(self) -> None:
        its = self.known["Threshold", "select"]
        for text in ("", 'Param("select")', "Near", "Near(hue: 3)", "Near(color: 1, color: 2)", "Near(color: (1)", "Near)", "3"):
            if text == "Near":
                self.assertEqual(compound.parse(text, its), ("Near", {}))
                continue
            with self.assertRaises(ValueError, msg=text):
                compound.parse(text, its)

    def test_another_word_keeps_the_parts_that_it_takes(self) -> None:
        its = self.known["Threshold", "select"]
        _, parts = compound.parse('Near(color: "#c33923", distance: 30.0)', its)
        self.assertEqual(compound.change_word("Sample", parts, its), "Sample(at: (1, 1), distance: 30.0)")


if __name__ == "__main__":
    unittest.main()
