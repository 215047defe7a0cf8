"""Tests of the controls of each graph of the project, without Blender."""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[4]
sys.path.insert(0, str(ROOT / "hosts/blender/addon"))

import panel  # noqa: E402

PROGRAM = os.environ.get("MAQUETTE", str(ROOT / "target/debug/maquette"))
GRAPHS = [it for it in sorted((ROOT / "graphs").rglob("*.ron")) if not it.name.endswith((".test.ron", ".lock.ron"))]


class PanelTest(unittest.TestCase):
    """Controls from schemas."""

    @classmethod
    def setUpClass(cls) -> None:
        lines = [json.dumps({"id": place, "do": "load", "graph": str(it)}) for place, it in enumerate(GRAPHS)]
        done = subprocess.run([PROGRAM, "serve", "--stdio"], input="\n".join(lines), capture_output=True, text=True, check=True)
        told = [json.loads(line) for line in done.stdout.splitlines()]
        cls.loaded = {str(GRAPHS[it["id"]]): it for it in told if it["event"] == "answer" and it["ok"]}
        assert len(cls.loaded) > 20, len(cls.loaded)

    def test_each_parameter_has_a_control_with_its_range_default_unit_and_doc(self) -> None:
        kinds = set()
        for graph, told in self.loaded.items():
            fields = {name: it for name, it in told["schema"]["properties"].items() if "port" not in it}
            controls = panel.controls(told["schema"])
            self.assertEqual([it.name for it in controls], list(fields), graph)
            for it in controls:
                field = fields[it.name]
                self.assertEqual((it.default, it.low, it.high), (field.get("default"), field.get("minimum"), field.get("maximum")))
                self.assertEqual((it.doc, it.unit), (field.get("description", ""), field.get("unit", "")))
                kinds.add(it.kind)
        self.assertLessEqual({"number", "integer", "choice", "color"}, kinds)

    def test_a_parameter_that_drafts_have_another_value_of_says_so(self) -> None:
        told = self.loaded[str(ROOT / "graphs/language/drafts.ron")]
        levels = next(it for it in panel.controls(told["schema"]) if it.draft)
        self.assertEqual((levels.title, levels.default), ("Levels, in drafts 0", 2))

    def test_a_default_shown_and_given_back_is_the_default(self) -> None:
        for graph, told in self.loaded.items():
            controls = panel.controls(told["schema"])
            given = {it.name: panel.ron(it, panel.widget_value(it, None)) for it in controls if it.kind != "ron"}
            again = subprocess.run(
                [PROGRAM, "check", graph, *(word for name, text in given.items() for word in ("--set", f"{name}={text}"))],
                capture_output=True,
                text=True,
            )
            self.assertEqual(again.returncode, 0, (graph, given, again.stderr + again.stdout))
            for it in controls:
                if it.kind != "ron":
                    self.assertTrue(panel.is_same(it, panel.widget_value(it, given[it.name]), panel.widget_value(it, None)), (graph, it))

    def test_a_number_that_a_widget_made_single_has_the_text_that_was_seen(self) -> None:
        for text in ("0.1", "12.1", "31.8", "20.0", "0.0", "-7.25", "1e-07", "40.0", "1234567.0"):
            self.assertEqual(panel.number_text(panel.to_single(float(text))), text)
        # Numbers that are not in single precision keep all digits.
        for number in (0.1, 1 / 3, 123456789.125):
            self.assertEqual(float(panel.number_text(number)), number)

    def test_only_what_was_touched_differs(self) -> None:
        control = panel.Control("x", "number", 0.1)
        self.assertTrue(panel.is_same(control, panel.to_single(0.1), 0.1))
        for value in (float("nan"), float("inf"), "x", [1.0], None):
            self.assertIsNone(panel.try_ron(control, value))
        self.assertFalse(panel.is_same(control, 0.1001, 0.1))
        text = panel.Control("t", "text", "a")
        self.assertEqual(panel.widget_value(text, panel.ron(text, 'a "b" \\ \u00e4')), 'a "b" \\ \u00e4')


if __name__ == "__main__":
    unittest.main()
