"""Tests of the client, without Blender: `MAQUETTE=target/debug/maquette python3 -m unittest discover hosts/blender/tests/plain`."""

from __future__ import annotations

import os
import pathlib
import shutil
import signal
import sys
import tempfile
import time
import unittest
from typing import Any, Callable

ROOT = pathlib.Path(__file__).resolve().parents[4]
sys.path.insert(0, str(ROOT / "hosts/blender/addon"))

import client  # noqa: E402

PROGRAM = os.environ.get("MAQUETTE", str(ROOT / "target/debug/maquette"))


class ClientTest(unittest.TestCase):
    """A client, and a copy of graphs."""

    def setUp(self) -> None:
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        shutil.copy(ROOT / "graphs/doll.ron", self.folder)
        shutil.copytree(ROOT / "graphs/doll", self.folder / "doll")
        self.graph = str(self.folder / "doll.ron")
        self.client = self.start()

    def start(self, *command: str) -> client.Client:
        """Starts a client."""
        made = client.Client(list(command) or [PROGRAM, "serve", "--stdio", "--no-cache"])
        self.addCleanup(made.stop)
        return made

    def until(self, is_so: Callable[[], Any], seconds: float = 60) -> None:
        """Polls until a condition is true."""
        end = time.monotonic() + seconds
        while not is_so():
            self.assertLess(time.monotonic(), end, "it took too long")
            self.client.poll()
            time.sleep(0.001)

    def ask(self, do: str, **fields: Any) -> client.Answer:
        """Sends a request, and waits for its answer."""
        answers: list[client.Answer] = []
        self.client.ask(do, answers.append, **fields)
        self.until(lambda: answers)
        return answers[0]

    def test_a_run_tells_how_far_it_is_and_gives_files(self) -> None:
        events: list[dict[str, Any]] = []
        answers: list[client.Answer] = []
        self.client.ask("run", answers.append, events.append, graph=self.graph, want=[{"value": "model", "as": "mesh"}])
        self.until(lambda: answers)
        self.assertTrue(answers[0].ok and answers[0]["ok"], answers[0].event)
        self.assertLessEqual({"started", "finished"}, {it["event"] for it in events})
        columns = {it["name"]: it for it in answers[0]["values"]["model"]["columns"]}
        assert self.client.folder
        size = (self.client.folder / columns["position"]["file"]).stat().st_size
        self.assertEqual(size, columns["position"]["count"] * 12)

    def test_a_refusal_has_its_reason_and_its_problems(self) -> None:
        refused = self.ask("edit", graph=self.graph, edits=[{"link": {"port": "spots.mask", "to": "scan.color"}}])
        self.assertFalse(refused.ok)
        self.assertIn("wants a Mask", refused.problems[0]["message"])
        self.assertTrue(self.ask("load", graph=self.graph)["ok"])

    def test_nothing_waits_while_a_graph_is_computed(self) -> None:
        longest = []
        for growth in ("12.0", "13.0", "14.0"):
            answers: list[client.Answer] = []
            polls = []
            for levels in range(5):
                run = {"graph": self.graph, "set": {"levels": str(levels), "growth": growth}, "want": [{"value": "model", "as": "facts"}]}
                self.client.ask("run", answers.append, **run)
            while len(answers) < 5:
                before = time.thread_time()
                self.client.poll()
                polls.append(time.thread_time() - before)
            longest.append(max(polls))
        # The time of this thread, since the machine may be busy; the best of three, since some systems count in steps of 10 ms.
        self.assertLessEqual(min(longest), 0.005)
        self.assertEqual([it.event.get("replaced") for it in answers if it.event.get("ok")], [None] * sum("ok" in it.event for it in answers))
        self.assertTrue(answers[-1]["ok"])

    def test_a_killed_server_is_noticed_and_everyone_is_told(self) -> None:
        self.ask("load", graph=self.graph)
        answers: list[client.Answer] = []
        for _ in range(3):
            self.client.ask("run", answers.append, graph=self.graph)
        assert self.client.pid
        os.kill(self.client.pid, signal.SIGKILL)
        self.until(lambda: self.client.ended)
        self.until(lambda: len(answers) == 3)
        self.assertFalse(any(it.ok for it in answers[-1:]))
        self.assertIn("the engine has ended by signal 9", self.client.ended or "")
        # Requests to the killed server are answered, too, and a new server works.
        self.assertIn("has ended", self.ask("catalog").why)
        self.client = self.start()
        self.assertTrue(self.ask("catalog")["nodes"])

    def test_what_is_no_server_is_said_with_its_last_words(self) -> None:
        self.client = self.start(str(self.folder / "nothing"))
        self.assertIn("cannot start the engine", self.ask("catalog").why)
        self.client = self.start(sys.executable, "-c", "raise SystemExit('no engine here')")
        self.assertIn("with 1: no engine here", self.ask("catalog").why)
        self.client = self.start(sys.executable, "-c", "print('hello', flush=True); input()")
        self.assertIn("invalid message", self.ask("catalog").why)

    def test_a_server_that_does_not_read_stops_nobody(self) -> None:
        self.client = self.start(sys.executable, "-c", "import time; time.sleep(60)")
        before = time.thread_time()
        for _ in range(50):
            self.client.ask("edit", None, graph="x" * 100_000, edits=[])
            self.client.poll()
        self.assertLess(time.thread_time() - before, 1)
        self.client.stop()
        self.assertFalse(self.client.busy)


if __name__ == "__main__":
    unittest.main()
