"""Tests that edits, undo and redo of the user never lose external changes of a graph's file."""

from __future__ import annotations

import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import unittest
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parents[4]
sys.path.insert(0, str(ROOT / "hosts/blender/addon"))

import history  # noqa: E402

PROGRAM = os.environ.get("MAQUETTE", str(ROOT / "target/debug/maquette"))

NODES = 8
GRAPH = """Graph(
    format: 1,
    inputs: { "cage": Mesh(doc: "a cage") },
    nodes: {
%s
    },
    outputs: { "mesh": "n0" },
)
""" % "\n".join(f'        "n{it}": Subdivide(mesh: "cage", scheme: Loop, levels: 0),' for it in range(NODES))


class HistoryTest(unittest.TestCase):
    """A file with two editors, one of which uses a server and undo steps."""

    def setUp(self) -> None:
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.graph = self.folder / "graph.ron"
        self.graph.write_text(GRAPH)
        pipe = subprocess.PIPE
        self.server = subprocess.Popen([PROGRAM, "serve", "--stdio"], stdin=pipe, stdout=pipe, text=True)
        self.addCleanup(self.server.wait)
        for stream in self.server.stdin, self.server.stdout:
            assert stream
            self.addCleanup(stream.close)
        self.answer()

    def answer(self) -> dict[str, Any]:
        """The next message of the server."""
        assert self.server.stdout
        return json.loads(self.server.stdout.readline())

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Sends a request and returns its answer."""
        assert self.server.stdin
        print(json.dumps({"id": 1, "do": do, "graph": str(self.graph), **fields}), file=self.server.stdin, flush=True)
        return self.answer()

    def test_a_text_is_known_by_the_number_of_changes_that_it_has(self) -> None:
        known = history.History()
        known.begin("a", 7)
        known.update("a", "b")
        self.assertEqual((known.text, known.count, known.changes_since(7)), ("b", 7, []))
        known.update("c", "d")
        known.add_moves({"red": (1.0, 2.0)})
        changes = [history.Change("b", "c", {}), history.Change("d", "d", {"red": (1.0, 2.0)})]
        self.assertEqual((known.count, known.changes_since(7), known.changes_since(8), known.changes_since(9)), (9, changes, changes[1:], []))
        for unknown in (6, 10, -1):
            self.assertIsNone(known.changes_since(unknown))
        for number in range(history.MAX_CHANGES):
            known.update(str(number), str(number))
        self.assertIsNone(known.changes_since(7))
        self.assertEqual(len(known.changes_since(9) or ()), history.MAX_CHANGES)

    def test_undo_and_redo_lose_nothing_that_others_wrote(self) -> None:
        dice = random.Random(11)
        known = history.History()
        known.begin(GRAPH, 0)
        # The undo steps, each with its text and the number of external changes in it, and the index of the current step.
        steps, place = [(GRAPH, 0)], 0
        written: list[str] = []
        own = undone = 0
        for number in range(120):
            what = dice.choice(["own", "theirs", "undo", "redo", "undo"])
            if what == "own":
                node = f"n{dice.randrange(NODES // 2)}"
                done = self.ask("edit", edits=[{"set": {"target": f"{node}.levels", "value": str(number % 7)}}])
                self.assertEqual(done["event"], "answer", done)
                known.update(done["before"], done["text"])
                place += 1
                steps[place:] = [(done["text"], known.count)]
                own += 1
            elif what == "theirs":
                # Change nodes of the other half, or a comment; sometimes the host notices that only when it writes next.
                node, note = f'"n{NODES // 2 + dice.randrange(NODES // 2)}"', f"    // Theirs, {number}.\n"
                text = self.graph.read_text()
                at = text.index(f"        {node}")
                self.graph.write_text(text[:at] + "    " + note + text[at:])
                written.append(note.strip())
                if dice.random() < 0.7:
                    known.update(self.graph.read_text(), self.graph.read_text())
            elif 0 <= place + (step := 1 if what == "redo" else -1) < len(steps):
                place += step
                text, count = steps[place]
                later = known.changes_since(count)
                assert later is not None
                done = self.ask("put", was=known.text, text=text, theirs=[(it.before, it.after) for it in later])
                self.assertEqual(done["event"], "answer", done)
                known.update(done["before"], done["text"])
                undone += 1
                steps[place] = (done["text"], known.count)
                levels = [it.split("levels: ")[1] for it in done["text"].splitlines() if "levels: " in it]
                self.assertEqual(levels, [it.split("levels: ")[1] for it in text.splitlines() if "levels: " in it])
            lost = [it for it in written if it not in self.graph.read_text()]
            self.assertEqual(lost, [], (number, what))
        self.assertTrue(own > 10 and undone > 20 and len(written) > 10, (own, undone, len(written)))


if __name__ == "__main__":
    unittest.main()
