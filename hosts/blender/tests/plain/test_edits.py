"""Tests of graphs as nodes, without Blender: views agree with the text, and changes are written into the text or refused."""

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

import edits  # noqa: E402

PROGRAM = os.environ.get("MAQUETTE", str(ROOT / "target/debug/maquette"))


class EditsTest(unittest.TestCase):
    """A server, and a copy of all graphs of the project."""

    def setUp(self) -> None:
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.graphs = []
        for path in sorted((ROOT / "graphs").rglob("*.ron")):
            to = self.folder / path.relative_to(ROOT)
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, to)
            if "\nGraph(" in "\n" + path.read_text() and not path.name.endswith(".lock.ron"):
                self.graphs.append(to)
        assert len(self.graphs) > 20, self.graphs
        pipe = subprocess.PIPE
        self.server = subprocess.Popen([PROGRAM, "serve", "--stdio"], stdin=pipe, stdout=pipe, text=True)
        self.addCleanup(self.server.wait)
        for stream in self.server.stdin, self.server.stdout:
            assert stream
            self.addCleanup(stream.close)
        self.said()

    def said(self) -> dict[str, Any]:
        """The next message of the server."""
        assert self.server.stdout
        return json.loads(self.server.stdout.readline())

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Sends a request, and returns its answer."""
        assert self.server.stdin
        print(json.dumps({"id": 1, "do": do, **fields}), file=self.server.stdin, flush=True)
        return self.said()

    def outline(self, graph: pathlib.Path) -> dict[str, Any]:
        """The outline of a graph."""
        return self.ask("outline", graph=str(graph))["outline"]

    def change(self, graph: pathlib.Path, now: edits.GraphView) -> dict[str, Any]:
        """Writes the differences of a view into the text."""
        changes, _ = edits.difference(self.outline(graph), now)
        self.assertTrue(changes)
        return self.ask("edit", graph=str(graph), edits=changes)

    def test_what_is_shown_of_each_graph_is_what_stands_in_it(self) -> None:
        for graph in self.graphs:
            outline = self.outline(graph)
            self.assertEqual(edits.difference(outline, edits.view_of(outline)), ([], []), graph)

    def test_each_change_comes_into_the_text_as_it_was_shown(self) -> None:
        dice = random.Random(7)
        done = {"link": 0, "unlink": 0, "remove": 0, "rename": 0, "field": 0}
        refused = 0
        for graph in self.graphs:
            for _ in range(12):
                text = graph.read_text()
                outline = self.outline(graph)
                now = edits.view_of(outline)
                kind = self.changed(now, outline, dice)
                if kind is None or now == edits.view_of(outline):
                    continue
                answer = self.change(graph, now)
                if answer["event"] == "refused":
                    self.assertTrue(answer["why"])
                    self.assertEqual(graph.read_text(), text)
                    refused += 1
                    continue
                after = edits.view_of(self.outline(graph))
                self.assertEqual(self.normal(after), self.normal(self.renamed(now)), (graph, kind, answer["text"]))
                self.assertEqual(edits.difference(self.outline(graph), after), ([], []))
                done[kind] += 1
                graph.write_text(text)
        self.assertTrue(all(count >= 5 for count in done.values()) and refused >= 5, (done, refused))

    def changed(self, now: edits.GraphView, outline: dict[str, Any], dice: random.Random) -> str | None:
        """Makes a random change, as a user does."""
        node = dice.choice(now.nodes)
        ports = [it for it, links in node.links.items() if links]
        kind = dice.choice(["link", "unlink", "remove", "rename", "field"])
        if kind == "remove":
            now.nodes.remove(node)
            # Blender removes the links of a removed node.
            for other in now.nodes:
                for links in other.links.values():
                    links[:] = [it for it in links if it[0] != node.name]
            now.outputs = {name: it for name, it in now.outputs.items() if not it or it[0] != node.name}
        elif kind == "rename":
            node.title = f"{node.name}-again"
        elif kind == "field" and node.fields:
            name = dice.choice(sorted(node.fields))
            try:
                node.fields[name] = repr(float(node.fields[name]) * 0.5 + 0.25)
            except ValueError:
                return None
        elif kind == "unlink" and ports:
            dice.choice([node.links[it] for it in ports]).pop()
        elif kind == "link" and ports:
            port = dice.choice(ports)
            others = [(it["name"], out["name"]) for it in outline["nodes"] for out in it["outputs"] if it["name"] != node.name]
            if not others:
                return None
            node.links[port][dice.randrange(len(node.links[port]))] = dice.choice(others)
        else:
            return None
        return kind

    def renamed(self, now: edits.GraphView) -> edits.GraphView:
        """The view after all renames."""
        titles = {it.name: it.title for it in now.nodes}
        for node in now.nodes:
            for links in node.links.values():
                links[:] = [(titles.get(name, name), output) for name, output in links]
            node.name = node.title
        now.outputs = {name: it and (titles.get(it[0], it[0]), it[1]) for name, it in now.outputs.items()}
        return now

    def normal(self, now: edits.GraphView) -> Any:
        """A comparable form: without ports that have no links, and without fields that contain links and other text."""
        nodes = [(it.name, it.kind, {port: links for port, links in it.links.items() if links}) for it in now.nodes]
        fields = [{name: text for name, text in it.fields.items() if '"' not in text} for it in now.nodes]
        return nodes, fields, now.outputs

    def test_a_new_node_waits_for_the_links_that_it_must_have(self) -> None:
        graph = next(it for it in self.graphs if it.name == "doll.ron")
        now = edits.view_of(self.outline(graph))
        new = edits.Node("", "Subdivide", "", {"mesh": []}, {"scheme": "Loop"})
        now.nodes.append(new)
        self.assertEqual(edits.difference(self.outline(graph), now), ([], [new]))
        new.links["mesh"].append(("grid", "mesh"))
        self.assertEqual(self.change(graph, now)["event"], "answer")
        self.assertIn('"subdivide": Subdivide(mesh: "grid", scheme: Loop)', graph.read_text())
        now = edits.view_of(self.outline(graph))
        now.outputs["fine.ply"] = ("subdivide", "mesh")
        self.assertEqual(self.change(graph, now)["event"], "answer")
        self.assertIn('"fine.ply": "subdivide"', graph.read_text())
        # An unsuitable link is refused with the message of the checker.
        now = edits.view_of(self.outline(graph))
        now.node("subdivide").links["mesh"] = [("scan", "color")]
        self.assertIn("wants a Mesh", self.change(graph, now)["problems"][0]["message"])


if __name__ == "__main__":
    unittest.main()
